"""The source's own mesh, moved: its file again, with other places for its vertices.

Vertex order, faces, UVs and whatever else the file holds stay as they are.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import formats
from pointmorph.clouds import FloatArray
from pointmorph.files import read_ply, write_bytes
from pointmorph.meshes import vertex_normals


class SourceMesh:
    """A mesh file whose vertices can be moved.

    Parameters
    ----------
    path : path
        The file that `shape` was read from.
    shape : Shape
        With faces.

    Attributes
    ----------
    suffix : str
        Of the files that `write` makes: that of `path` for .ply, .obj and .glb, which keep all that
        the file holds; otherwise .ply with the triangles alone.
    """

    def __init__(self, path: str | os.PathLike[str], shape: formats.Shape) -> None:
        assert shape.faces is not None
        self._path = Path(path)
        self._shape = shape
        own = self._path.suffix.lower()
        self.suffix = own if own in _MOVED else ".ply"

    def write(self, path: str | os.PathLike[str], positions: FloatArray) -> None:
        """Writes the mesh with its vertices at `positions`, whole or not at all.

        Parameters
        ----------
        path : path
        positions : (N, 3) array
            A row for each vertex of the shape.

        Raises
        ------
        FileError
            If the file can't be written.
        """
        faces = self._shape.faces
        assert faces is not None
        normals = vertex_normals(positions, faces)
        move = _MOVED.get(self._path.suffix.lower())
        if move is not None:
            write_bytes(path, move(self._path, positions, normals))
            return
        colors = self._shape.colors
        if colors is None:
            colors = np.ones((len(positions), 4), np.float32)
        formats.write_mesh(
            path, positions, normals.astype(positions.dtype), colors, faces.astype(np.int32)
        )


def _moved_ply(path: Path, positions: FloatArray, normals: npt.NDArray[np.float64]) -> bytes:
    data = read_ply(path)
    rows = data["vertex"].data
    for axis, name in enumerate(("x", "y", "z")):
        rows[name] = positions[:, axis]
        if "n" + name in (rows.dtype.names or ()):
            rows["n" + name] = normals[:, axis]
    content = io.BytesIO()
    data.write(content)
    return content.getvalue()


def _moved_obj(path: Path, positions: FloatArray, _normals: npt.NDArray[np.float64]) -> bytes:
    """Normals are left out: whoever reads the file makes them from the faces."""
    return "".join(_moved_lines(path, positions)).encode()


def _moved_lines(path: Path, positions: FloatArray) -> Iterator[str]:
    row = 0
    with path.open(encoding="utf-8", errors="surrogateescape", newline="") as lines:
        for line in lines:
            words = line.split()
            if not words or words[0] not in ("v", "vn", "f"):
                yield line.encode("utf-8", "replace").decode()
            elif words[0] == "v":
                place = " ".join(f"{value:.9g}" for value in positions[row].tolist())
                yield " ".join(["v", place, *words[4:]]) + "\n"
                row += 1
            elif words[0] == "f":
                yield " ".join(["f", *map(_without_normal, words[1:])]) + "\n"


def _without_normal(corner: str) -> str:
    """v/vt/vn, v//vn, v/vt or v, without the normal."""
    return "/".join(corner.split("/")[:2]).rstrip("/")


def _moved_glb(path: Path, positions: FloatArray, _normals: npt.NDArray[np.float64]) -> bytes:
    import trimesh

    loaded: Any = trimesh.load(path, process=False, maintain_order=True)
    if not isinstance(loaded, trimesh.Scene):
        loaded.vertices = positions
        return bytes(loaded.export(file_type="glb"))
    # In the order in which Scene.to_geometry() puts them together.
    first = 0
    moved: Any = trimesh.Scene()
    for node in loaded.graph.nodes_geometry:
        _, name = loaded.graph[node]
        mesh = loaded.geometry[name].copy()
        if not hasattr(mesh, "faces"):
            continue
        last = first + len(mesh.vertices)
        mesh.vertices = positions[first:last]
        moved.add_geometry(mesh, node_name=node, geom_name=node)
        first = last
    return bytes(moved.export(file_type="glb"))


_MOVED: dict[str, Callable[[Path, FloatArray, npt.NDArray[np.float64]], bytes]] = {
    ".ply": _moved_ply,
    ".obj": _moved_obj,
    ".glb": _moved_glb,
}
