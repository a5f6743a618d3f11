"""Shapes from files and frames to files. Each format is one row of `FORMATS`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import FileError
from pointmorph.formats import obj, ply
from pointmorph.meshes.geometry import triangulate
from pointmorph.meshes.shape import Shape
from pointmorph.shapes.clouds import FloatArray
from pointmorph.storage.file_checks import check_claims
from pointmorph.storage.files import reachable, whole_file, write_bytes


@dataclass(frozen=True)
class Format:
    """A file format, named by its suffix."""

    suffix: str
    read: Callable[[Path], Shape]
    write_mesh: Callable[..., None] | None = None
    """Takes what the function `write_mesh` takes; None if meshes aren't written in this format."""
    loses: str = ""
    """What a mesh loses when it is written."""


def read(path: str | os.PathLike[str]) -> Shape:
    """Reads a mesh or a point cloud.

    Parameters
    ----------
    path : path
        Its suffix is one of `SUFFIXES`. Text files have x y z, and optionally nx ny nz, on each
        line.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged, or of an unknown format.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(
            str(path),
            f"one of {' '.join(SUFFIXES)}",
            repr(suffix),
            "Convert the file to one of these formats, in Blender for instance.",
        )
    opened = reachable(path)
    if not opened.is_file():
        found = "a folder" if opened.is_dir() else "no such file"
        raise FileError(str(path), "a file", found, "Check the path.")
    try:
        check_claims(opened, suffix)
        shape = _format(suffix).read(opened)
        _check_tables(shape)
    except FileError:
        raise
    except MemoryError as error:
        raise FileError(
            str(path),
            "a file that fits in memory",
            "too little memory to read it",
            "Close other programs. If the file is small, export it again.",
        ) from error
    except OSError as error:
        raise FileError(
            str(path), "a readable file", error.strerror or str(error), "Check the path."
        ) from error
    except Exception as error:  # the readers raise whatever their parsing meets
        detail = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
        raise FileError(
            str(path), f"a readable {suffix} file", detail, "Export the file again."
        ) from error
    return shape


def _check_tables(shape: Shape) -> None:
    """Raises ValueError unless there is a row of the right width for each vertex, and corners of
    faces are rows that there are."""
    count = len(shape.positions)
    tables = (
        ("x y z", shape.positions, 3),
        ("normals", shape.normals, 3),
        ("colors", shape.colors, 4),
    )
    for name, values, width in tables:
        if values is not None and values.shape != (count, width):
            raise ValueError(f"{name} in a table of {values.shape} for {count} vertices")
    faces = shape.faces
    if faces is not None and len(faces) and not 0 <= faces.min() <= faces.max() < count:
        raise ValueError(
            f"faces with rows {faces.min()} to {faces.max()} of a table with {count} vertices"
        )


def write_ply(
    path: str | os.PathLike[str],
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    radii: FloatArray,
    ids: npt.NDArray[np.int32] | None = None,
    velocities: FloatArray | None = None,
    confidence: npt.NDArray[np.float32] | None = None,
) -> None:
    """Writes a cloud as binary .ply: x y z nx ny nz red green blue alpha radius and, where given,
    id, vx vy vz, confidence.

    Parameters
    ----------
    path : path
        Written whole or not at all: if the call fails, an earlier file stays as it was.
    positions, normals : (N, 3) array
        Written in the type of `positions`, float32 or float64.
    colors : (N, 4) array
        0 to 1, written as 8 bits per channel.
    radii : (N,) array
    ids : (N,) array of int32, optional
    velocities : (N, 3) array, optional
    confidence : (N,) array of float32, optional

    Raises
    ------
    FileError
        If the file can't be written.
    """
    more = {"radius": radii, "id": ids, "vx vy vz": velocities, "confidence": confidence}
    _write_ply(path, _PlyVertices(positions, normals, colors, more))


def write_mesh(
    path: str | os.PathLike[str],
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    faces: npt.NDArray[np.int32],
    velocities: FloatArray | None = None,
) -> None:
    """Writes triangles in the format of the suffix, whole or not at all.

    Parameters
    ----------
    path : path
        Its suffix is one of `WRITTEN_MESH_SUFFIXES`. What a format can't hold is left out: see
        `Format.loses`.
    positions, normals : (V, 3) array
    colors : (V, 4) array
        0 to 1, written as 8 bits per channel.
    faces : (F, 3) array of int32
        Rows of `positions`.
    velocities : (V, 3) array, optional

    Raises
    ------
    FileError
        If the file can't be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITTEN_MESH_SUFFIXES:
        raise FileError(
            str(path),
            f"one of {' '.join(WRITTEN_MESH_SUFFIXES)}",
            repr(suffix),
            "Choose one of these formats.",
        )
    write = _format(suffix).write_mesh
    assert write is not None
    write(path, positions, normals, colors, faces, velocities)


def _format(suffix: str) -> Format:
    return next(format for format in FORMATS if format.suffix == suffix)


def _write_ply_mesh(
    path: str | os.PathLike[str],
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    faces: npt.NDArray[np.int32],
    velocities: FloatArray | None,
) -> None:
    _write_ply(path, _PlyVertices(positions, normals, colors, {"vx vy vz": velocities}), faces)


def _write_with_trimesh(
    path: str | os.PathLike[str],
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    faces: npt.NDArray[np.int32],
    _velocities: FloatArray | None,
) -> None:
    import trimesh

    mesh = trimesh.Trimesh(
        positions,
        faces,
        vertex_normals=normals,
        vertex_colors=_bytes(colors),
        process=False,
    )
    content: Any = mesh.export(file_type=Path(path).suffix[1:].lower())
    write_bytes(path, content.encode() if isinstance(content, str) else content)


class _PlyVertices:
    """The rows of a PLY file, made when they are written: all at once would take as much memory
    again as they have."""

    def __init__(
        self,
        positions: FloatArray,
        normals: FloatArray,
        colors: FloatArray,
        more: Mapping[str, npt.NDArray[Any] | None],
    ) -> None:
        """`more` has what is given besides, by the names of its columns."""
        number = "f8" if positions.dtype == np.float64 else "f4"
        kinds = {"red green blue alpha": "u1", "id": "i4", "confidence": "f4"}
        tables = {"x y z": positions, "nx ny nz": normals, "red green blue alpha": colors, **more}
        self._tables = {names: table for names, table in tables.items() if table is not None}
        self.dtype = np.dtype(
            [(name, kinds.get(names, number)) for names in self._tables for name in names.split()]
        )

    def __len__(self) -> int:
        return len(self._tables["x y z"])

    def __getitem__(self, rows: slice) -> npt.NDArray[Any]:
        vertices = np.empty(len(range(*rows.indices(len(self)))), self.dtype)
        for names, table in self._tables.items():
            some = _bytes(table[rows]) if names.startswith("red") else table[rows]
            for name, column in zip(names.split(), np.atleast_2d(np.transpose(some)), strict=True):
                vertices[name] = column
        return vertices


def _bytes(colors: FloatArray) -> npt.NDArray[np.uint8]:
    whole = np.clip(colors, 0.0, 1.0)
    whole *= 255.0
    return np.rint(whole, out=whole).astype(np.uint8)


def _write_ply(
    path: str | os.PathLike[str],
    vertices: ply.Table,
    faces: npt.NDArray[np.int32] | None = None,
) -> None:
    with whole_file(path) as file:
        ply.write(file, vertices, faces)


def _read_ply(path: Path) -> Shape:
    tables = ply.read(path)
    if "vertex" not in tables:
        raise FileError(str(path), "vertices", "none", "Export the file again, with its points.")
    columns = tables["vertex"].columns

    def stacked(*wanted: str) -> npt.NDArray[Any] | None:
        if not all(name in columns for name in wanted):
            return None
        result: npt.NDArray[Any] = np.stack([columns[name] for name in wanted], axis=-1)
        return result

    positions = stacked("x", "y", "z")
    if positions is None:
        raise FileError(str(path), "x, y and z", ", ".join(columns), "Export the file again.")

    def column(name: str) -> FloatArray | None:
        return _floats(columns[name]) if name in columns else None

    return Shape(
        path.stem,
        _floats(positions),
        _optional_floats(stacked("nx", "ny", "nz")),
        _colors(stacked("red", "green", "blue", "alpha"), stacked("red", "green", "blue")),
        column("radius"),
        _ply_faces(positions, tables),
        column("rigid"),
        column("fixed"),
        column("delay"),
    )


def _ply_faces(
    positions: npt.NDArray[Any], tables: Mapping[str, ply.Element]
) -> npt.NDArray[np.int64] | None:
    if "face" not in tables or tables["face"].count == 0:
        return None
    lists = tables["face"].lists
    wanted = next((n for n in ("vertex_indices", "vertex_index") if n in lists), None)
    if wanted is None:
        return None
    return triangulate(positions, lists[wanted].offsets, lists[wanted].values)[0]


def _read_text(path: Path) -> Shape:
    rows = np.loadtxt(path, ndmin=2, comments=("#", "//"))
    if rows.shape[1] < 3:
        raise FileError(
            str(path),
            "x y z on each line",
            f"{rows.shape[1]} columns",
            "Write at least three numbers on each line.",
        )
    normals = rows[:, 3:6] if rows.shape[1] >= 6 else None
    return Shape(path.stem, rows[:, :3], normals)


def _read_obj(path: Path) -> Shape:
    plain = obj.read(path)
    if plain is not None:
        positions, faces = plain
        return Shape(path.stem, positions, None, None, None, faces)
    positions, triangles, colors = obj.read_lines(path)
    if len(positions) == 0:
        raise FileError(str(path), "vertices", "none", "Export the file again, with its points.")
    return Shape(path.stem, positions, None, colors, None, triangles)


def _read_with_trimesh(path: Path) -> Shape:
    import trimesh

    # Rows must stay those of the file: nothing merged, nothing dropped.
    loaded: Any = trimesh.load(path, process=False, maintain_order=True)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_geometry()
    positions = np.asarray(loaded.vertices, np.float64)
    if len(positions) == 0:
        raise FileError(str(path), "vertices", "none", "Export the file again, with its points.")
    faces = np.asarray(loaded.faces, np.int64) if hasattr(loaded, "faces") else None
    colors = None
    visual = getattr(loaded, "visual", None)
    if visual is not None and visual.kind == "vertex":
        colors = _colors(np.asarray(visual.vertex_colors), None)
    return Shape(
        path.stem,
        positions,
        None,
        colors,
        None,
        faces if faces is not None and len(faces) else None,
    )


def _floats(values: npt.NDArray[Any]) -> FloatArray:
    if values.dtype == np.float32:
        return np.ascontiguousarray(values)
    return np.ascontiguousarray(values, np.float64)


def _optional_floats(values: npt.NDArray[Any] | None) -> FloatArray | None:
    return None if values is None else _floats(values)


def _colors(
    rgba: npt.NDArray[Any] | None, rgb: npt.NDArray[Any] | None
) -> npt.NDArray[np.float32] | None:
    """(N, 4), 0 to 1, from bytes, 16-bit integers or floats; opaque if there is no alpha."""
    given = rgba if rgba is not None else rgb
    if given is None:
        return None
    whole = np.issubdtype(given.dtype, np.integer)
    top = np.iinfo(given.dtype).max if whole else 1.0
    result = np.ones((len(given), 4), np.float32)
    result[:, : given.shape[1]] = given.astype(np.float64) / top
    return result


FORMATS = (
    Format(".ply", _read_ply, _write_ply_mesh),
    Format(".obj", _read_obj, _write_with_trimesh, loses="alpha and velocities"),
    Format(".off", _read_with_trimesh),
    Format(".stl", _read_with_trimesh, _write_with_trimesh, loses="all but the faces"),
    Format(".glb", _read_with_trimesh, _write_with_trimesh, loses="velocities"),
    Format(".gltf", _read_with_trimesh),
    Format(".3mf", _read_with_trimesh),
    *(Format(suffix, _read_text) for suffix in (".xyz", ".txt", ".pts", ".asc")),
)
SUFFIXES = tuple(format.suffix for format in FORMATS)
WRITTEN_MESH_SUFFIXES = tuple(format.suffix for format in FORMATS if format.write_mesh)
