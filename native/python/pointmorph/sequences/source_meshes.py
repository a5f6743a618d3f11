"""The source's own mesh, moved: its file again, with other places for its vertices.

Vertex order, faces, UVs and whatever else the file holds stay as they are.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import formats
from pointmorph.base.errors import FileError
from pointmorph.formats import ply
from pointmorph.meshes.geometry import vertex_normals
from pointmorph.morphs.denser_meshes import DenserMesh
from pointmorph.sequences.moved_glb import moved_glb
from pointmorph.shapes.clouds import FloatArray
from pointmorph.storage.files import read_ply, write_bytes


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
    denser : DenserMesh or None
        If set, the same mesh with more faces is written: triangles, with what the file holds of
        vertices and UVs in between.
    """

    def __init__(self, path: str | os.PathLike[str], shape: formats.Shape) -> None:
        assert shape.faces is not None
        self.denser: DenserMesh | None = None
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
            A row for each vertex of the shape, or of the denser mesh.

        Raises
        ------
        FileError
            If the file can't be written.
        """
        faces, denser = self._shape.faces, self.denser
        assert faces is not None
        if denser is not None:
            faces = denser.faces.astype(np.int64)
        normals = vertex_normals(positions, faces)
        own = self._path.suffix.lower()
        if own == ".glb" and denser is None:
            try:
                glb = moved_glb(self._path, self._shape.positions, faces, positions)
            except (LookupError, TypeError, ValueError):  # not quite a glTF, but for trimesh
                glb = None
            if glb is not None:
                write_bytes(path, glb)
                return
        move = _MOVED.get(own)
        if move is not None:
            write_bytes(path, move(self._path, positions, normals, denser))
            return
        colors = self._shape.colors
        if colors is None:
            colors = np.ones((len(self._shape.positions), 4), np.float32)
        if denser is not None:
            colors = denser.extended(colors)
        formats.write_mesh(
            path, positions, normals.astype(positions.dtype), colors, faces.astype(np.int32)
        )


Normals = npt.NDArray[np.float64]


def _moved_ply(
    path: Path, positions: FloatArray, normals: Normals, denser: DenserMesh | None
) -> bytes:
    columns = dict(zip(("x", "y", "z"), positions.T, strict=True))
    columns.update(zip(("nx", "ny", "nz"), normals.T, strict=True))
    quick = ply.with_columns(path, "vertex", columns) if denser is None else None
    if quick is not None:
        return quick
    data = read_ply(path)
    if denser is not None:
        data = _denser_ply(data, denser)
    rows = data["vertex"].data
    for name in rows.dtype.names or ():
        if name in columns:
            rows[name] = columns[name]
    content = io.BytesIO()
    data.write(content)
    return content.getvalue()


def _denser_ply(data: Any, denser: DenserMesh) -> Any:
    """The file with more vertices and faces. Lists of faces but their corners are left out."""
    from plyfile import PlyData, PlyElement

    given = data["vertex"].data
    vertices = np.empty(len(given) + len(denser.ends), given.dtype)
    for name in given.dtype.names:
        values = denser.extended(given[name])
        if np.issubdtype(given.dtype[name], np.integer):
            values = np.rint(values)
        vertices[name] = values
    polygons = data["face"]
    lists = {p.name for p in polygons.properties if hasattr(p, "len_dtype")}
    corners = "vertex_indices" if "vertex_indices" in lists else "vertex_index"
    rows = _polygon_of_faces([len(polygon) for polygon in polygons.data[corners]], denser)
    kept = [name for name in polygons.data.dtype.names if name not in lists]
    fields = [(name, polygons.data.dtype[name]) for name in kept]
    faces = np.empty(len(rows), [(corners, "i4", (3,)), *fields])
    faces[corners] = denser.faces
    for name in kept:
        faces[name] = polygons.data[name][rows]
    replaced = {"vertex": vertices, "face": faces}
    elements = [
        PlyElement.describe(replaced[element.name], element.name)
        if element.name in replaced
        else element
        for element in data.elements
    ]
    return PlyData(elements, data.text, data.byte_order, data.comments)


def _moved_obj(
    path: Path, positions: FloatArray, _normals: Normals, denser: DenserMesh | None
) -> bytes:
    """Normals are left out: whoever reads the file makes them from the faces."""
    own = len(positions) - (0 if denser is None else len(denser.ends))
    found = sum(words[:1] == ["v"] for _, words in _lines_of(path))
    if found != own:
        raise FileError(
            str(path), f"a line for each of {own} vertices", f"{found}", "Export the file again."
        )
    lines = (
        _moved_lines(path, positions) if denser is None else _denser_obj(path, positions, denser)
    )
    return "".join(lines).encode("utf-8", "surrogateescape")  # whatever bytes names have


def _lines_of(path: Path) -> Iterator[tuple[str, list[str]]]:
    with path.open(encoding="utf-8", errors="surrogateescape", newline="") as lines:
        for line in lines:
            yield line, line.split()


def _vertex_line(place: npt.NDArray[Any], rest: Sequence[str] = ()) -> str:
    return " ".join(["v", *(f"{value:.9g}" for value in place.tolist()), *rest]) + "\n"


def _moved_lines(path: Path, positions: FloatArray) -> Iterator[str]:
    row = 0
    for line, words in _lines_of(path):
        if not words or words[0] not in ("v", "vn", "f"):
            yield line
        elif words[0] == "v":
            yield _vertex_line(positions[row], words[4:])
            row += 1
        elif words[0] == "f":
            yield " ".join(["f", *map(_without_normal, words[1:])]) + "\n"


def _without_normal(corner: str) -> str:
    """v/vt/vn, v//vn, v/vt or v, without the normal."""
    return "/".join(corner.split("/")[:2]).rstrip("/")


def _denser_obj(path: Path, positions: FloatArray, denser: DenserMesh) -> Iterator[str]:
    """Vertices and UVs first, then the rest with each face in pieces."""
    lines = list(_lines_of(path))
    texts: list[list[float]] = []
    counts = {"v": 0, "vt": 0}
    polygons: list[list[tuple[int, int | None]]] = []  # vertex and UV of each corner
    for _, words in lines:
        if words and words[0] == "vt":
            texts.append([float(word) for word in words[1:]])
        if words and words[0] in counts:
            counts[words[0]] += 1
        if words and words[0] == "f":
            polygons.append([_corner(word, counts) for word in words[1:]])
    uvs = _DenserUvs(texts, denser, counts["v"])
    by_polygon = _faces_by_polygon([len(polygon) for polygon in polygons], denser)
    pieces = [
        uvs.of_faces(denser.faces[faces].tolist(), polygon)
        for polygon, faces in zip(polygons, by_polygon, strict=True)
    ]
    for place in positions:
        yield _vertex_line(place)
    for text in uvs.texts:
        yield " ".join(["vt", *(f"{value:.9g}" for value in text)]) + "\n"
    polygon = 0
    for line, words in lines:
        if not words or words[0] not in ("v", "vt", "vn", "f"):
            yield line
        elif words[0] == "f":
            for piece in pieces[polygon]:
                yield " ".join(["f", *piece]) + "\n"
            polygon += 1


def _corner(word: str, counts: dict[str, int]) -> tuple[int, int | None]:
    """Rows of the vertex and of the UV; numbers below 0 count from the last one so far."""
    numbers = [int(number) if number else 0 for number in word.split("/")[:2]]
    rows = [
        number - 1 if number > 0 else count + number
        for number, count in zip(numbers, counts.values(), strict=False)
    ]
    return rows[0], rows[1] if len(numbers) > 1 and numbers[1] != 0 else None


def _faces_by_polygon(sizes: Sequence[int], denser: DenserMesh) -> list[npt.NDArray[np.intp]]:
    """For each polygon of a file with so many corners, its faces of the denser mesh."""
    polygons = _polygon_of_faces(sizes, denser)
    order = np.argsort(polygons, kind="stable")
    ends = np.cumsum(np.bincount(polygons, minlength=len(sizes)))
    return np.split(order, ends[:-1])


def _polygon_of_faces(sizes: Sequence[int], denser: DenserMesh) -> npt.NDArray[np.int64]:
    """For each face of the denser mesh, the polygon that it is a piece of."""
    triangles = np.maximum(np.asarray(sizes, np.int64) - 2, 0)
    rows: npt.NDArray[np.int64] = np.repeat(np.arange(len(triangles)), triangles)[denser.parents]
    return rows


class _DenserUvs:
    """UVs with those in the middle of edges, which seams have twice."""

    def __init__(self, texts: list[list[float]], denser: DenserMesh, count: int) -> None:
        self.texts = texts
        self._denser = denser
        self._count = count
        self._between: dict[tuple[int, int], int] = {}

    def of_faces(
        self, faces: list[list[int]], polygon: list[tuple[int, int | None]]
    ) -> list[list[str]]:
        """Corners of faces that are pieces of a polygon with these vertices and UVs."""
        rows = dict(polygon)
        return [[self._corner(vertex, rows) for vertex in face] for face in faces]

    def _corner(self, vertex: int, rows: dict[int, int | None]) -> str:
        uv = self._row(vertex, rows)
        return f"{vertex + 1}" if uv is None else f"{vertex + 1}/{uv + 1}"

    def _row(self, vertex: int, rows: dict[int, int | None]) -> int | None:
        """The UV of a vertex in a polygon, which `rows`, those found so far, gets."""
        if vertex not in rows:
            a, b = (self._row(int(end), rows) for end in self._denser.ends[vertex - self._count])
            rows[vertex] = None if a is None or b is None else self._halfway(a, b)
        return rows[vertex]

    def _halfway(self, a: int, b: int) -> int:
        ends = (min(a, b), max(a, b))
        if ends not in self._between:
            self._between[ends] = len(self.texts)
            pair = zip(self.texts[a], self.texts[b], strict=False)
            self.texts.append([0.5 * (here + there) for here, there in pair])
        return self._between[ends]


def _moved_glb(
    path: Path, positions: FloatArray, _normals: Normals, denser: DenserMesh | None
) -> bytes:
    import trimesh

    loaded: Any = trimesh.load(path, process=False, maintain_order=True)
    if not isinstance(loaded, trimesh.Scene):
        mesh = _with_places(loaded, positions, denser, (0, 0))
        return bytes(mesh.export(file_type="glb"))
    # In the order in which Scene.to_geometry() puts them together.
    first = first_face = 0
    moved: Any = trimesh.Scene()
    for node in loaded.graph.nodes_geometry:
        _, name = loaded.graph[node]
        mesh = loaded.geometry[name].copy()
        if not hasattr(mesh, "faces"):
            continue
        count, faces = len(mesh.vertices), len(mesh.faces)
        mesh = _with_places(mesh, positions, denser, (first, first_face))
        # Names of nodes are random where a mesh has several materials.
        name = name if name not in moved.geometry else f"{name}_{len(moved.geometry)}"
        moved.add_geometry(mesh, node_name=name, geom_name=name)
        first, first_face = first + count, first_face + faces
    return bytes(moved.export(file_type="glb"))


def _with_places(
    mesh: Any, positions: FloatArray, denser: DenserMesh | None, first: tuple[int, int]
) -> Any:
    """A mesh whose vertices and faces begin at these rows of the whole, moved."""
    import trimesh

    own = np.arange(first[0], first[0] + len(mesh.vertices))
    if denser is None:
        mesh.vertices = positions[own]
        return mesh
    is_own = (denser.parents >= first[1]) & (denser.parents < first[1] + len(mesh.faces))
    faces = denser.faces[is_own]
    count = len(positions) - len(denser.ends)
    rows = np.concatenate([own, np.unique(faces[faces >= count])])
    number = np.zeros(len(positions), np.int64)
    number[rows] = np.arange(len(rows))

    def extended(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        whole = np.zeros((count, *values.shape[1:]))
        whole[own] = values
        chosen: npt.NDArray[Any] = denser.extended(whole)[rows]
        return chosen

    visuals: Any = trimesh.visual
    visual = mesh.visual
    if visual.kind == "texture" and visual.uv is not None:
        visual = visuals.TextureVisuals(extended(visual.uv), visual.material)
    elif visual.kind == "vertex":
        colors = np.rint(extended(visual.vertex_colors)).astype(np.uint8)
        visual = visuals.ColorVisuals(vertex_colors=colors)
    else:
        visual = None
    return trimesh.Trimesh(positions[rows], number[faces], visual=visual, process=False)


_MOVED: dict[str, Callable[[Path, FloatArray, Normals, DenserMesh | None], bytes]] = {
    ".ply": _moved_ply,
    ".obj": _moved_obj,
    ".glb": _moved_glb,
}
