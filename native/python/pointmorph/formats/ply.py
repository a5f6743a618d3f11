"""PLY files, read and written as whole blocks.

plyfile takes a microsecond and more for each number of text, for each face, and on Windows for each
point; a model of a million points keeps one waiting for that. Here one array operation reads all.
"""

from __future__ import annotations

import itertools
import os
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Numbers = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

_TYPES = {
    name: kind
    for kind, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}
_NAMES = {kind: name for name, kind in reversed(_TYPES.items())}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 20
_ROWS_AT_ONCE = 1 << 18
_ROWS_WRITTEN = 1 << 16
_FILTERING = threading.Lock()
"""Filters of warnings are the same for all threads, which may read files side by side."""
_LENGTH = "\nlength"
"""Follows the name of a list where its length stands; no property has such a name."""


@dataclass(frozen=True)
class Lists:
    """A list in each row: those of row i are values[offsets[i]:offsets[i + 1]]."""

    offsets: npt.NDArray[np.int64]
    values: npt.NDArray[Any]


@dataclass(frozen=True)
class Property:
    """A column as the header describes it. Types are numpy's."""

    name: str
    kind: str
    length_kind: str | None = None
    """of a list's length; None if it is no list"""


@dataclass
class Element:
    """A table of a PLY file."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)
    columns: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    """(count,) each, in the byte order of this machine"""
    lists: dict[str, Lists] = field(default_factory=dict)


@dataclass(frozen=True)
class Header:
    """What stands before the data."""

    order: str
    """"<", ">", or "=" for text"""
    elements: list[Element]
    size: int
    """in bytes"""

    @property
    def is_text(self) -> bool:
        return self.order == "="


def read(path: str | os.PathLike[str]) -> dict[str, Element]:
    """The tables of a PLY file, by name.

    Parameters
    ----------
    path : path

    Raises
    ------
    ValueError
        If the file is damaged.
    OSError
        If it can't be read.
    """
    header = read_header(path)
    if header.is_text:
        numbers = numbers_of(Path(path).read_bytes()[header.size :])
        for element in header.elements:
            taken = _take_rows(element, numbers)
            numbers = numbers[_read_uneven(element, _Text(numbers)) if taken is None else taken :]
        if len(numbers):
            raise ValueError(f"{len(numbers)} numbers after the last table")
    else:
        data = np.fromfile(path, np.uint8, offset=header.size)
        for element in header.elements:
            size = _read_rows(element, data, header.order)
            if size is None:
                size = _read_uneven(element, _Binary(data, header.order))
            data = data[size:]
    return {element.name: element for element in header.elements}


def read_header(path: str | os.PathLike[str]) -> Header:
    """The header of a PLY file; its elements are still empty. Raises ValueError and OSError."""
    with open(path, "rb") as file:
        text = file.read(_LONGEST_HEADER)
    lines: list[list[str]] = []
    size = 0
    while not lines or lines[-1] != ["end_header"]:
        end = text.find(b"\n", size)
        if end < 0:
            raise ValueError("no PLY header, or none that ends")
        lines.append(text[size:end].decode("ascii", "replace").split())
        size = end + 1
    lines = [words for words in lines[:-1] if words and words[0] not in ("comment", "obj_info")]
    is_known = len(lines) > 1 and lines[0] == ["ply"] and lines[1][::2] == ["format", "1.0"]
    if not is_known or lines[1][1] not in _ORDERS:
        raise ValueError("no PLY header of a known format")
    elements: list[Element] = []
    for words in lines[2:]:
        is_list = words[:2] == ["property", "list"]
        if words[0] == "element" and len(words) == 3:
            elements.append(Element(words[1], int(words[2])))
        elif words[0] != "property" or len(words) != (5 if is_list else 3) or not elements:
            raise ValueError(f"header line {' '.join(words)!r}")
        else:
            kinds = [_TYPES.get(word, "") for word in words[2 if is_list else 1 : -1]]
            if "" in kinds:
                raise ValueError(f"header line {' '.join(words)!r}")
            length_kind = kinds[0] if is_list else None
            elements[-1].properties.append(Property(words[-1], kinds[-1], length_kind))
    if any(element.count < 0 for element in elements):
        raise ValueError("a table with a negative number of rows")
    return Header(_ORDERS[lines[1][1]], elements, size)


def with_columns(
    path: str | os.PathLike[str], table: str, columns: Mapping[str, npt.NDArray[Any]]
) -> bytes | None:
    """The contents of a binary file, with other numbers in some columns of a table.

    Parameters
    ----------
    path : path
    table : str
    columns : mapping of name to (N,) array
        Names that the table doesn't have are passed over.

    Returns
    -------
    bytes or None
        None for text, and where the table has lists or follows one that has.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    header = read_header(path)
    start = header.size
    for element in header.elements:
        if header.is_text or any(p.length_kind for p in element.properties):
            return None
        row = np.dtype([(p.name, header.order + p.kind) for p in element.properties])
        if element.name == table:
            content = np.fromfile(path, np.uint8)
            room = content[start : start + element.count * row.itemsize]
            if len(room) < element.count * row.itemsize:
                return None
            for name in (row.names or ()) if element.count else ():
                if name in columns:
                    room.view(row)[name] = columns[name]
            return content.tobytes()
        start += element.count * row.itemsize
    return None


class Table(Protocol):
    """A structured array, or what makes one of some rows at a time."""

    @property
    def dtype(self) -> np.dtype[Any]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, rows: slice, /) -> npt.NDArray[Any]: ...


def write(
    file: IO[bytes],
    vertices: Table,
    faces: npt.NDArray[np.integer[Any]] | None = None,
) -> None:
    """Writes a table of vertices, and one of triangles, as binary PLY.

    Parameters
    ----------
    file : writable binary file
    vertices : (N,) structured array, or another Table
        Taken some rows at a time.
    faces : (F, 3) array of int, optional
    """
    fields = [(name, vertices.dtype[name].str[1:]) for name in vertices.dtype.names or ()]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property {_NAMES[kind]} {name}" for name, kind in fields]
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    file.write("\n".join([*lines, "end_header\n"]).encode("ascii"))
    packed = np.dtype([(name, "<" + kind) for name, kind in fields])
    for first in range(0, len(vertices), _ROWS_WRITTEN):
        rows = vertices[first : first + _ROWS_WRITTEN].astype(packed, copy=False)
        file.write(np.ascontiguousarray(rows).data)
    if faces is not None:
        rows = np.empty(len(faces), [("length", "u1"), ("corners", "<i4", (3,))])
        rows["length"], rows["corners"] = 3, faces
        file.write(rows.data)


# --- Tables whose lists are equally long in all rows, as nearly all are


def _read_rows(element: Element, data: Bytes, order: str) -> int | None:
    """Reads a table from the start of `data`, and returns its size in bytes; None where lists
    aren't as long in all rows as in the first."""
    fields: list[tuple[Any, ...]] = []
    for p in element.properties if element.count else []:
        if p.length_kind is not None:
            length_type = np.dtype(order + p.length_kind)
            at = np.dtype(fields).itemsize
            head = data[at : at + length_type.itemsize]
            length = int(head.view(length_type)[0]) if len(head) == length_type.itemsize else -1
            if not 0 <= length <= len(data):
                return None
            fields.append((p.name + _LENGTH, length_type))
            fields.append((p.name, order + p.kind, (length,)))
        else:
            fields.append((p.name, order + p.kind))
    row = np.dtype(fields)
    if len(data) < element.count * row.itemsize:
        return None
    rows = np.frombuffer(data, row, element.count)
    widths = {p.name: row[p.name].shape[0] for p in element.properties if p.length_kind and fields}
    if not all(np.all(rows[name + _LENGTH] == width) for name, width in widths.items()):
        return None
    for p in element.properties if element.count else []:
        values = _native(rows[p.name])
        if p.length_kind is None:
            element.columns[p.name] = values
        else:
            offsets = np.arange(element.count + 1) * widths[p.name]
            element.lists[p.name] = Lists(offsets, values.reshape(-1))
    return element.count * row.itemsize if element.count else None


def _take_rows(element: Element, numbers: Numbers) -> int | None:
    """The same in numbers of a text."""
    firsts = [0]
    for p in element.properties if element.count else []:
        length = numbers[firsts[-1]] if p.length_kind and firsts[-1] < len(numbers) else 0.0
        if not 0 <= length <= len(numbers):
            return None
        firsts.append(firsts[-1] + 1 + int(length))
    width = firsts[-1]
    if width == 0 or element.count * width > len(numbers):
        return None
    rows = numbers[: element.count * width].reshape(element.count, width)
    columns = list(zip(element.properties, itertools.pairwise(firsts), strict=False))
    if not all(np.all(rows[:, a] == b - a - 1) for p, (a, b) in columns if p.length_kind):
        return None
    for p, (first, last) in columns:
        if p.length_kind is None:
            element.columns[p.name] = _cast(rows[:, first], p)
        else:
            offsets = np.arange(element.count + 1) * (last - first - 1)
            values = _cast(rows[:, first + 1 : last].reshape(-1), p)
            element.lists[p.name] = Lists(offsets, values)
    return element.count * width


# --- Other tables


@dataclass(frozen=True)
class _Binary:
    """Data in bytes."""

    data: Bytes
    order: str

    def size(self, kind: str) -> int:
        return np.dtype(kind).itemsize

    def lengths(self) -> Callable[[int, str], int]:
        content, sign = self.data.tobytes(), {">": "big"}.get(self.order, "little")

        def length(at: int, kind: str) -> int:
            return int.from_bytes(
                content[at : at + int(kind[1])],
                sign,  # type: ignore[arg-type]
                signed=kind[0] == "i",
            )

        return length

    def block(self, starts: Rows, length: int, p: Property) -> npt.NDArray[Any]:
        kind = np.dtype(self.order + p.kind)
        return self.data[starts[:, None] + np.arange(length * kind.itemsize)].view(kind)


@dataclass(frozen=True)
class _Text:
    """Data in numbers."""

    data: Numbers

    def size(self, _kind: str) -> int:
        return 1

    def lengths(self) -> Callable[[int, str], int]:
        content = self.data.tolist()
        return lambda at, _kind: int(content[at]) if at < len(content) else 0

    def block(self, starts: Rows, length: int, p: Property) -> npt.NDArray[Any]:
        return _cast(self.data[starts[:, None] + np.arange(length)], p)


def _read_uneven(element: Element, source: _Binary | _Text) -> int:
    """Reads a table whose lists differ in length; returns its size."""
    shape = (len(element.properties), element.count)
    lengths, starts = np.ones(shape, np.int64), np.zeros(shape, np.int64)
    at, length_at = 0, source.lengths()
    for row in range(element.count):  # only here is a step taken for each row
        for column, p in enumerate(element.properties):
            if p.length_kind:
                length = lengths[column, row] = length_at(at, p.length_kind)
                at += source.size(p.length_kind)
            else:
                length = 1
            starts[column, row] = at
            at += source.size(p.kind) * length
        if at > len(source.data):
            break
    if at > len(source.data) or np.any(lengths < 0):
        raise ValueError(f"early end of the file, in the table {element.name!r}")
    for p, row_lengths, row_starts in zip(element.properties, lengths, starts, strict=True):
        offsets = np.concatenate([[0], np.cumsum(row_lengths)])
        values = np.empty(offsets[-1], p.kind)
        for rows, length in _of_one_length(row_lengths):
            places = offsets[rows, None] + np.arange(length)
            values[places] = source.block(row_starts[rows], length, p)
        if p.length_kind is None:
            element.columns[p.name] = values
        else:
            element.lists[p.name] = Lists(offsets, values)
    return at


def _of_one_length(lengths: Rows) -> Iterator[tuple[Rows, int]]:
    """Rows whose lists are equally long, some at a time."""
    for length in np.unique(lengths[lengths > 0]).tolist():
        rows = np.flatnonzero(lengths == length)
        for first in range(0, len(rows), _ROWS_AT_ONCE):
            yield rows[first : first + _ROWS_AT_ONCE], length


def numbers_of(text: bytes) -> Numbers:
    """The numbers of a text, with white space between them.

    Raises
    ------
    ValueError
        If there is something else.
    """
    if not text.strip():
        return np.empty(0)
    with _FILTERING, warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, np.float64, sep=" ")
        except DeprecationWarning:
            raise ValueError("something other than numbers") from None


def _native(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A copy without gaps, in the byte order of this machine."""
    return np.array(values, values.dtype.newbyteorder("="), order="C")


def _cast(values: Numbers, p: Property) -> npt.NDArray[Any]:
    kind = np.dtype(p.kind)
    if kind.kind in "iu":
        limits = np.iinfo(kind)
        if not np.all((values >= limits.min) & (values <= limits.max) & (values % 1 == 0)):
            raise ValueError(f"numbers that aren't of type {_NAMES[p.kind]} as {p.name}")
    return np.ascontiguousarray(values.astype(kind))
