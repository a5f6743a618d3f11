"""A .glb file with other places for its vertices; nodes, materials and UVs stay as they are."""

from __future__ import annotations

import copy
import json
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.meshes.geometry import vertex_normals
from pointmorph.shapes.clouds import FloatArray

_Doubles = npt.NDArray[np.float64]

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_FLOATS, _TRIANGLES, _STRIP = 5126, 4, 5
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
# Faces that are packed, which takes a reader of its own.
_PACKED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}


def moved_glb(
    path: Path, given: FloatArray, faces: npt.NDArray[np.int64], positions: FloatArray
) -> bytes | None:
    """The file with its vertices at `positions`, or None if it has what only trimesh reads.

    Normals are made anew, hard edges stay hard. Skins, animations, morph targets and tangents,
    which would be wrong, are left out.

    Parameters
    ----------
    path : path
    given, positions : (N, 3) array
        Where the vertices are in the file, and where they go, in the order in which they are read.
    faces : (F, 3) array
    """
    file = _opened(path)
    parts = [] if file is None else list(_parts(file.header))
    if file is None or sum(file.count(part) for part in parts) != len(given):
        return None
    first = 0
    normals = np.zeros((len(given), 3))
    rows = []
    for part in parts:
        own = slice(first, first + file.count(part))
        first = own.stop
        places = file.values(part.attributes(file.header)["POSITION"])
        if places is None or not part.is_at(places, given[own]):
            return None
        before = file.values(part.attributes(file.header).get("NORMAL"))
        normals[own] = 0 if before is None else before
        rows.append(own)
    normals = _hard_normals(given, normals, faces, positions)
    file.separate(parts)
    for part, own in zip(parts, rows, strict=True):
        turn = part.to_world[:3, :3]
        local = np.linalg.solve(turn, (positions[own] - part.to_world[:3, 3]).T).T
        file.put(part, "POSITION", local)
        if "NORMAL" in part.attributes(file.header):
            lengths = np.linalg.norm(normals[own] @ turn, axis=1, keepdims=True)
            file.put(part, "NORMAL", normals[own] @ turn / np.maximum(lengths, 1e-300))
    return file.content()


def _hard_normals(
    given: FloatArray, normals: _Doubles, faces: npt.NDArray[np.int64], positions: FloatArray
) -> _Doubles:
    """Normals of moved faces, the same where vertices had the same place and normal."""
    keys = np.ascontiguousarray(np.hstack([given, normals]), np.float64) + 0.0  # no -0
    rows = keys.view(np.dtype((np.void, keys.itemsize * 6))).ravel()
    _, kept, one = np.unique(rows, return_index=True, return_inverse=True)
    one = one.reshape(-1)
    result: _Doubles = vertex_normals(positions[kept], one[faces])[one]
    return result


@dataclass
class _Part:
    """The faces of a node that have one material."""

    node: int
    primitive: int
    to_world: _Doubles

    def attributes(self, header: dict[str, Any]) -> dict[str, int]:
        mesh = header["meshes"][header["nodes"][self.node]["mesh"]]
        attributes: dict[str, int] = mesh["primitives"][self.primitive]["attributes"]
        return attributes

    def is_at(self, places: npt.NDArray[Any], given: FloatArray) -> bool:
        """Whether its vertices, moved by its node, are those that were read."""
        turn = self.to_world[:3, :3]
        if not np.linalg.cond(turn) < 1e6:
            return False
        ours = places @ turn.T + self.to_world[:3, 3]
        size = np.abs(given).max(initial=0)
        return bool(np.abs(ours - given).max(initial=0) <= 1e-5 * size)


def _parts(header: dict[str, Any]) -> Iterator[_Part]:
    """In the order in which trimesh reads them."""
    nodes = header["nodes"]
    roots = header["scenes"][header.get("scene", 0)].get("nodes", [])
    left = [(root, np.eye(4)) for root in roots]
    while left:
        number, to_parent = left.pop()
        to_world = to_parent @ _transform(nodes[number])
        left += [(child, to_world) for child in nodes[number].get("children", [])]
        if "mesh" not in nodes[number]:
            continue
        for row, primitive in enumerate(header["meshes"][nodes[number]["mesh"]]["primitives"]):
            if primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP):
                yield _Part(number, row, to_world)


def _transform(node: dict[str, Any]) -> _Doubles:
    """From the node to its parent."""
    if "matrix" in node:
        matrix: _Doubles = np.array(node["matrix"], np.float64).reshape(4, 4).T
        return matrix
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result = np.eye(4)
    result[:3, :3] = np.array(turn) * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    result[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return result


def _opened(path: Path) -> _File | None:
    content = path.read_bytes()
    chunks: dict[int, bytes] = {}
    first = 12
    while first + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, first)
        chunks.setdefault(kind, content[first + 8 : first + 8 + length])
        first += 8 + length
    if _JSON not in chunks or _BINARY not in chunks:
        return None
    header = json.loads(chunks[_JSON])
    if "uri" in header["buffers"][0] or _PACKED & set(header.get("extensionsUsed", [])):
        return None
    return _File(header, bytearray(chunks[_BINARY]))


class _File:
    def __init__(self, header: dict[str, Any], binary: bytearray) -> None:
        self.header = header
        self._binary = binary
        self._uses = Counter(
            accessor
            for mesh in header["meshes"]
            for primitive in mesh["primitives"]
            for accessor in primitive["attributes"].values()
        )

    def count(self, part: _Part) -> int:
        return int(self.header["accessors"][part.attributes(self.header)["POSITION"]]["count"])

    def values(self, accessor: int | None) -> npt.NDArray[Any] | None:
        """Three numbers for each vertex, where they are in the file; None if they aren't there."""
        if accessor is None:
            return None
        what = self.header["accessors"][accessor]
        if "bufferView" not in what or "sparse" in what or what["type"] != "VEC3":
            return None
        view = self.header["bufferViews"][what["bufferView"]]
        kind = np.dtype(_TYPES[what["componentType"]])
        start = view.get("byteOffset", 0) + what.get("byteOffset", 0)
        strides = (view.get("byteStride", 3 * kind.itemsize), kind.itemsize)
        return np.ndarray((what["count"], 3), kind, self._binary, start, strides)

    def separate(self, parts: list[_Part]) -> None:
        """Gives nodes that share a mesh one each, and leaves out what would move vertices again."""
        header, taken = self.header, set()
        for number in dict.fromkeys(part.node for part in parts):
            node = header["nodes"][number]
            if node["mesh"] in taken:
                header["meshes"].append(copy.deepcopy(header["meshes"][node["mesh"]]))
                node["mesh"] = len(header["meshes"]) - 1
                for primitive in header["meshes"][-1]["primitives"]:
                    self._uses.update(primitive["attributes"].values())
            taken.add(node["mesh"])
        for node in header["nodes"]:
            for name in ("skin", "weights"):
                node.pop(name, None)
        for mesh in header["meshes"]:
            mesh.pop("weights", None)
            for primitive in mesh["primitives"]:
                primitive.pop("targets", None)
                primitive["attributes"].pop("TANGENT", None)
        for name in ("skins", "animations"):
            header.pop(name, None)

    def put(self, part: _Part, name: str, values: _Doubles) -> None:
        """Where the file has these numbers, or behind all others if that place isn't theirs alone
        or has no floats."""
        attributes = part.attributes(self.header)
        accessor = self.header["accessors"][attributes[name]]
        old = self.values(attributes[name])
        if old is None or accessor["componentType"] != _FLOATS or self._uses[attributes[name]] > 1:
            self._uses[attributes[name]] -= 1
            attributes[name] = self._added(len(values))
            accessor = self.header["accessors"][-1]
            old = self.values(attributes[name])
        assert old is not None
        old[:] = values
        if name == "POSITION":
            accessor["min"], accessor["max"] = old.min(axis=0).tolist(), old.max(axis=0).tolist()

    def _added(self, count: int) -> int:
        """A place for three floats for each of so many vertices."""
        start = -(-len(self._binary) // 4) * 4
        self._binary = self._binary.ljust(start + 12 * count, b"\0")
        view = {"buffer": 0, "byteOffset": start, "byteLength": 12 * count}
        self.header["bufferViews"].append(view)
        what = {"componentType": _FLOATS, "type": "VEC3", "count": count}
        what["bufferView"] = len(self.header["bufferViews"]) - 1
        self.header["accessors"].append(what)
        self._uses[len(self.header["accessors"]) - 1] = 1
        return len(self.header["accessors"]) - 1

    def content(self) -> bytes:
        binary = bytes(self._binary.ljust(-(-len(self._binary) // 4) * 4, b"\0"))
        self.header["buffers"][0]["byteLength"] = len(binary)
        text = json.dumps(self.header, separators=(",", ":")).encode()
        text = text.ljust(-(-len(text) // 4) * 4)
        chunks = b"".join(
            struct.pack("<II", len(chunk), kind) + chunk
            for kind, chunk in ((_JSON, text), (_BINARY, binary))
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
