"""Wavefront OBJ: vertices in the order of the file, whatever objects, groups, materials, UVs and
normals it has, and its faces as triangles.

A file as most programs write it is read as a whole, any other one line by line. Both give the same
rows.
"""

from __future__ import annotations

import warnings
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.meshes.geometry import triangulate

_Rows = npt.NDArray[np.int64]
_Colors = npt.NDArray[np.float32]

_WITHOUT_DIGITS = str.maketrans("", "", "0123456789")
_READ = ("v ", "f ")
# What says nothing about vertices and faces.
_SKIPPED = ("#", "vt ", "vn ", "o ", "g ", "s ", "mtllib ", "usemtl ")


def read(path: Path) -> tuple[npt.NDArray[np.float64], _Rows] | None:
    """Positions and triangles of a file, or None if it isn't a plain one.

    Raises
    ------
    OSError
        If it can't be read.
    """
    try:
        text = path.read_bytes().decode().replace("\r\n", "\n").strip()
    except UnicodeDecodeError:
        return None
    lines = text.split("\n")
    if "\r" in text or "\\\n" in text or not all(map(_is_known, lines)):
        return None
    faces = [line for line in lines if line.startswith("f ")]
    if not faces:
        return None
    positions = _positions([line[2:] for line in lines if line.startswith("v ")])
    corners = _corners([" ".join(line.split()[1:]) for line in faces])
    if positions is None or corners is None or corners[1].max() >= len(positions):
        return None
    return positions, triangulate(positions, *corners)[0]


def read_lines(path: Path) -> tuple[npt.NDArray[np.float64], _Rows | None, _Colors | None]:
    """Positions, triangles and colors of any file, line by line; None where it has none.

    Raises
    ------
    OSError
        If it can't be read.
    ValueError
        If a line isn't what it should be.
    """
    places, colors = array("d"), array("d")
    corners, sizes = array("q"), array("q")
    for number, words in _lines(path):
        try:
            if words[0] == "v":
                if len(words) < 4:
                    raise ValueError("fewer than three coordinates")
                places.extend(map(float, words[1:4]))
                if len(words) > 6:
                    colors.extend(map(float, (*words[4:8], "1")[:4]))
            elif words[0] == "f" and len(words) > 3:
                count = len(places) // 3
                corners.extend([_row(word, count) for word in words[1:]])
                sizes.append(len(words) - 1)
        except ValueError as error:
            raise ValueError(f"in line {number}: {error}") from error
    positions = np.array(places).reshape(-1, 3)
    # A line has all of them or none.
    whole = len(positions) > 0 and len(colors) == 4 * len(positions)
    triangles = None
    if sizes:
        faces = _offsets(np.array(sizes, np.int64)), np.array(corners, np.int64)
        triangles = triangulate(positions, *faces)[0]
    return positions, triangles, _colors(colors) if whole else None


def _offsets(sizes: _Rows) -> _Rows:
    offsets = np.zeros(len(sizes) + 1, np.int64)
    np.cumsum(sizes, out=offsets[1:])
    return offsets


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Words of each line that has some, with its number; one that ends with \\ goes on."""
    before: list[str] = []
    with path.open(encoding="utf-8", errors="surrogateescape") as lines:
        for number, line in enumerate(lines, 1):
            words = before + line.partition("#")[0].split()
            before = []
            if words and words[-1].endswith("\\"):
                before = [*words[:-1], *words[-1].removesuffix("\\").split()]
            elif words:
                yield number, words
    if before:
        yield number, before


def _row(corner: str, count: int) -> int:
    """The vertex of a corner such as 3, 3/1 or -1//2; below 0, counted from the last one so far."""
    number = int(corner.partition("/")[0])
    if number == 0:
        raise ValueError("a face with vertex 0, but they are counted from 1")
    return number - 1 if number > 0 else count + number


def _colors(numbers: array[float]) -> _Colors:
    """Red, green, blue and alpha, 0 to 1, of numbers up to 1 or up to 255."""
    colors = np.nan_to_num(np.array(numbers, np.float32).reshape(-1, 4))
    for channels in (colors[:, :3], colors[:, 3:]):
        if channels.max() > 1:
            channels /= 255
    return np.clip(colors, 0, 1)


def _is_known(line: str) -> bool:
    return not line or line.startswith(_READ) or line.startswith(_SKIPPED)


def _positions(rows: Sequence[str]) -> npt.NDArray[np.float64] | None:
    if not rows or len(rows[0].split()) != 3:
        return None
    text = " ".join(rows)
    numbers = _numbers(text, np.float64)
    if numbers is None or len(numbers) != 3 * len(rows):
        return None
    return numbers.reshape(-1, 3)


def _numbers(text: str, kind: type) -> npt.NDArray[Any] | None:
    """All numbers of a text, or None where it has something else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, kind, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _corners(faces: Sequence[str]) -> tuple[_Rows, _Rows] | None:
    """Of faces such as "1 2 3" or "1/1/1 2/2/1 3/3/1 4/4/1": where those of each begin, and all."""
    patterns = [face.translate(_WITHOUT_DIGITS) for face in faces]
    known = {pattern: pattern.split(" ") for pattern in set(patterns)}
    corners = {corner for split in known.values() for corner in split}
    if len(corners) != 1 or corners - {"", "/", "//"}:
        return None
    [corner] = corners
    sizes = np.array([len(known[pattern]) for pattern in patterns])
    text = " ".join(faces)
    empty = text.count("//")
    if sizes.min() < 3 or empty not in (0, sizes.sum()) or (empty and corner == "/"):
        return None
    each = 1 + len(corner) - (1 if empty else 0)
    rows = _numbers(text.replace("/", " "), np.int64)
    if rows is None or len(rows) != each * sizes.sum() or rows.min() < 1:
        return None
    return _offsets(sizes), rows[::each] - 1
