"""What files of strangers claim, checked against what they can hold, before anything is allocated.

A header of a few bytes can claim 10¹² points, a scene can hold itself a thousand times over, and a
name in a file can lead out of its folder. Readers are called after these checks only.
"""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote
from xml.etree import ElementTree

from pointmorph.base.errors import FileError

_LONGEST_HEADER = 1 << 20
"""Of a PLY file, in bytes."""
_MOST_COPIES = 100_000_000
"""Vertices of a scene, with all copies of its meshes."""
_DENSEST = 100
"""How many times smaller than what it holds a compressed file may be; numbers as text are
about 10 times smaller."""
_SPARSEST = 64
"""How many times larger than its bytes a scene's arrays may be: several may share bytes, and those
that are compressed are 10 times larger."""

_PLY_SIZES = {
    name: size
    for names, size in (
        (("char", "uchar", "int8", "uint8"), 1),
        (("short", "ushort", "int16", "uint16"), 2),
        (("int", "uint", "float", "int32", "uint32", "float32"), 4),
        (("double", "float64"), 8),
    )
    for name in names
}
_GLTF_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_GLTF_JSON = 0x4E4F534A
_BUILD = ""
"""What a 3MF file shows, as a part that holds all others."""

_Key = TypeVar("_Key")


def check_claims(path: Path, suffix: str) -> None:
    """Raises FileError when a file can't hold what it claims, or names files outside of its folder.

    Parameters
    ----------
    path : path
    suffix : str
        The format, as one of `formats.SUFFIXES`.
    """
    check = _CHECKS.get(suffix)
    if check is not None:
        check(path)


def parsed_json(text: str | bytes) -> Any:
    """What JSON says. Raises ValueError where it isn't JSON, also where it is nested too deeply, or
    where an object has a name twice."""
    try:
        return json.loads(text, object_pairs_hook=_each_once)
    except RecursionError:
        raise ValueError("lists nested too deep to be read") from None


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{twice!r} twice in one object")
    return content


def json_object(path: Path, expected: str, syntax: str = "") -> dict[str, Any]:
    """What a JSON file holds. Raises FileError if that isn't an object like `expected`, or not even
    what `syntax` says (default: the same)."""
    try:
        content = parsed_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(
            str(path), "a readable file", error.strerror or str(error), "Check the path."
        ) from error
    except ValueError as error:
        raise FileError(str(path), syntax or expected, str(error), "Correct the file.") from error
    if not isinstance(content, dict):
        raise FileError(str(path), expected, "something else", "Correct the file.")
    return content


def _refuse(path: Path, expected: str, found: str) -> FileError:
    return FileError(str(path), expected, found, "Export the file again.")


# --- PLY ------------------------------------------------------------------------------------------


def _check_ply(path: Path) -> None:
    """That every element has room for its rows."""
    with path.open("rb") as file:
        header = file.read(_LONGEST_HEADER)
    end = header.find(b"end_header")
    if end < 0:
        raise _refuse(path, "a PLY file", "no header, or none that ends within 1 MB")
    room = path.stat().st_size - end
    lines = [line.split() for line in header[:end].decode("ascii", "replace").splitlines()]
    is_text = ["format", "ascii", "1.0"] in lines
    least: list[tuple[str, int, int]] = []  # of each element its name, its rows, and bytes a row
    for words in lines:
        if words[:1] == ["element"] and len(words) == 3:
            try:
                least.append((words[1], int(words[2]), 0))
            except ValueError:
                raise _refuse(path, "the number of rows", f"{words[2]!r}") from None
        elif words[:1] == ["property"] and least and len(words) > 2:
            # A list takes room for its length at least.
            kind = words[2] if words[1] == "list" else words[1]
            name, rows, size = least[-1]
            least[-1] = (name, rows, size + (2 if is_text else _PLY_SIZES.get(kind, 1)))
    for name, rows, size in least:
        if rows < 0 or (rows > 0 and size == 0):
            raise _refuse(path, f"properties of each {name}", f"{rows} rows, {size} bytes each")
        room -= rows * size
        if room < 0:
            raise _refuse(
                path, f"{rows} rows of {size} bytes as {name}", f"{room + rows * size} bytes"
            )


# --- glTF -----------------------------------------------------------------------------------------


def _check_gltf(path: Path) -> None:
    _check_scene(path, path.read_bytes(), 0)


def _check_glb(path: Path) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(20)
        if len(head) < 20 or head[:4] != b"glTF":
            raise _refuse(path, "a binary glTF file", "another")
        length, kind = struct.unpack("<II", head[12:])
        if kind != _GLTF_JSON or length > size - 20:
            raise _refuse(path, f"its scene, {length} bytes", f"{size - 20} bytes")
        text = file.read(length)
    _check_scene(path, text, size)


def _check_scene(path: Path, text: bytes, room: int) -> None:
    """Checks which files a scene's arrays are in, their size, and how many copies of meshes it has.

    Pictures from elsewhere aren't needed; the reader leaves them out.

    Parameters
    ----------
    text : bytes
        The scene, as JSON.
    room : int
        Bytes beside it in the same file.
    """
    try:
        scene = parsed_json(text)
    except ValueError as error:
        raise _refuse(path, "a scene in JSON", str(error)) from error
    if not isinstance(scene, dict):
        raise _refuse(path, "a scene in JSON", "something else")
    for item in _rows(scene, "buffers"):
        room += _bytes_at(path, item.get("uri"))
    claimed = 0
    for accessor in _rows(scene, "accessors"):
        columns = _GLTF_COLUMNS.get(str(accessor.get("type")), 16)
        claimed += columns * _count(path, accessor.get("count"))
        if claimed > _SPARSEST * room:
            raise _refuse(path, f"at most {_SPARSEST * room} numbers", f"{claimed}")
    sizes = [_mesh_size(path, scene, mesh) for mesh in _rows(scene, "meshes")]
    nodes = list(_rows(scene, "nodes"))
    children = {
        number: [c for c in _list(node.get("children")) if isinstance(c, int)]
        for number, node in enumerate(nodes)
    }
    own = {
        number: sizes[node["mesh"]]
        for number, node in enumerate(nodes)
        if isinstance(node.get("mesh"), int) and 0 <= node["mesh"] < len(sizes)
    }
    _check_copies(path, children, own)


def _mesh_size(path: Path, scene: dict[str, Any], mesh: dict[str, Any]) -> int:
    accessors = list(_rows(scene, "accessors"))
    size = 0
    for primitive in _rows(mesh, "primitives"):
        attributes = primitive.get("attributes")
        number = attributes.get("POSITION") if isinstance(attributes, dict) else None
        if isinstance(number, int) and 0 <= number < len(accessors):
            size += _count(path, accessors[number].get("count"))
    return size


def _bytes_at(path: Path, uri: Any) -> int:
    """How many bytes a scene has there."""
    if not isinstance(uri, str):
        return 0
    if uri.startswith("data:"):
        return len(uri)
    folder = path.parent.resolve()
    named = (folder / unquote(uri)).resolve()
    if not named.is_relative_to(folder):
        raise _refuse(path, "names of files beside it", f"{uri!r}")
    return named.stat().st_size if named.is_file() else 0


def _count(path: Path, value: Any) -> int:
    if not isinstance(value, int) or value < 0:
        raise _refuse(path, "a number of items", f"{value!r}")
    return value


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _rows(table: Mapping[str, Any], name: str) -> Iterable[dict[str, Any]]:
    return (row if isinstance(row, dict) else {} for row in _list(table.get(name)))


# --- 3MF ------------------------------------------------------------------------------------------


def _check_3mf(path: Path) -> None:
    """That what is compressed isn't much larger, and that parts don't hold parts a million-fold."""
    size = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as archive:
            held = sum(item.file_size for item in archive.infolist())
            if held > _DENSEST * size:
                raise _refuse(path, f"at most {_DENSEST * size} bytes in it", f"{held}")
            children: dict[str, list[str]] = {}
            own: dict[str, int] = {}
            for item in archive.infolist():
                if item.filename.lower().endswith(".model"):
                    with archive.open(item) as file:
                        _take_parts(file, children, own)
    except (zipfile.BadZipFile, NotImplementedError, ElementTree.ParseError) as error:
        raise _refuse(path, "a 3MF file", str(error)) from error
    _check_copies(path, children, own)


def _take_parts(file: Any, children: dict[str, list[str]], own: dict[str, int]) -> None:
    """Of each object in an XML model, the objects that it holds and the number of its vertices."""
    held: list[str] = []
    vertices = 0
    for _, item in ElementTree.iterparse(file):
        kind = item.tag.rpartition("}")[2]
        if kind == "vertex":
            vertices += 1
        elif kind == "component":
            held.append(item.get("objectid", ""))
        elif kind == "item":
            children.setdefault(_BUILD, []).append(item.get("objectid", ""))
        elif kind == "object":
            name = item.get("id", "")
            children.setdefault(name, []).extend(held)
            own[name] = own.get(name, 0) + vertices
            held, vertices = [], 0
        item.clear()


def _check_copies(
    path: Path, children: Mapping[_Key, Sequence[_Key]], own: Mapping[_Key, int]
) -> None:
    """Raises FileError where parts hold themselves, or make too many vertices all together.

    Parameters
    ----------
    children : mapping
        Of each part, the parts that it holds.
    own : mapping
        Of each part, how many vertices it has itself.
    """
    sizes: dict[_Key, int] = {}  # 0 while a part's own parts are counted
    for start in children:
        waiting = [start]
        while waiting:
            part = waiting[-1]
            if part not in sizes:
                sizes[part] = 0
                below = [c for c in children.get(part, ()) if c in children]
                if any(c in sizes and sizes[c] == 0 for c in below):
                    raise _refuse(path, "parts that hold other parts", "one that holds itself")
                waiting += [c for c in below if c not in sizes]
                continue
            waiting.pop()
            if sizes[part] == 0:
                below = [c for c in children.get(part, ()) if c in children]
                # At least 1: also what has no vertices is copied.
                sizes[part] = 1 + own.get(part, 0) + sum(sizes[c] for c in below)
                if sizes[part] > _MOST_COPIES:
                    raise _too_many(path)
    held = {c for below in children.values() for c in below}
    if sum(size for part, size in sizes.items() if part not in held) > _MOST_COPIES:
        raise _too_many(path)


def _too_many(path: Path) -> FileError:
    return _refuse(path, f"at most {_MOST_COPIES:,} vertices", "copies of parts with more")


_CHECKS: dict[str, Callable[[Path], None]] = {
    ".ply": _check_ply,
    ".gltf": _check_gltf,
    ".glb": _check_glb,
    ".3mf": _check_3mf,
}
