"""Shapes from files and frames to files, by well-kept readers."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from pointmorph.clouds import Cloud, FloatArray
from pointmorph.errors import FileError
from pointmorph.meshes import boundary_loops, parts

TEXT_SUFFIXES = (".xyz", ".txt", ".pts", ".asc")
MESH_SUFFIXES = (".obj", ".off", ".stl", ".glb", ".gltf", ".3mf")
SUFFIXES = (".ply", *MESH_SUFFIXES, *TEXT_SUFFIXES)
WRITTEN_MESH_SUFFIXES = (".ply", ".obj", ".stl", ".glb")


@dataclass
class Shape:
    """What a file holds. Rows are those of the file."""

    name: str
    positions: FloatArray
    """(N, 3)"""
    normals: FloatArray | None = None
    """(N, 3)"""
    colors: npt.NDArray[np.float32] | None = None
    """(N, 4), 0 to 1"""
    radii: FloatArray | None = None
    """(N,)"""
    faces: npt.NDArray[np.int64] | None = None
    """(F, 3); None for a bare cloud"""

    def cloud(self) -> Cloud:
        """The vertices, in order. An open mesh hands over its longest boundary loop."""
        boundary = labels = None
        if self.faces is not None:
            labels = parts(self.faces, self.positions)
            loops = boundary_loops(self.faces, len(self.positions))
            boundary = loops[0] if loops else None
        return Cloud(
            self.positions,
            self.normals,
            self.colors,
            self.radii,
            name=self.name,
            boundary=boundary,
            parts=labels,
        )


def read(path: str | os.PathLike[str]) -> Shape:
    """Reads a mesh or a point cloud.

    Parameters
    ----------
    path : path
        .ply (plyfile), .obj .off .stl .glb .gltf .3mf (trimesh), or text with x y z and
        optionally nx ny nz on each line (.xyz .txt .pts .asc).

    Raises
    ------
    FileError
        For a file that is missing, empty, of another kind, or damaged.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(str(path), f"one of {' '.join(SUFFIXES)}", repr(suffix), "Convert it.")
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise FileError(str(path), "a file", found, "Check the path.")
    try:
        if suffix == ".ply":
            shape = _read_ply(path)
        elif suffix in TEXT_SUFFIXES:
            shape = _read_text(path)
        else:
            shape = _read_mesh(path)
    except FileError:
        raise
    except Exception as error:  # the readers raise whatever their parsing meets
        detail = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileError(
            str(path), f"a readable {suffix} file", detail, "Export it once more."
        ) from error
    return shape


def write_ply(
    path: str | os.PathLike[str],
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    radii: FloatArray,
    ids: npt.NDArray[np.int32] | None = None,
    velocities: FloatArray | None = None,
) -> None:
    """Writes a cloud as binary .ply: x y z nx ny nz red green blue alpha radius [id] [vx vy vz].

    Parameters
    ----------
    path : path
        Written whole or not at all: an interrupted or failed call leaves what was there before.
    positions, normals : (N, 3) array
        Written in the type of `positions`, float32 or float64.
    colors : (N, 4) array
        0 to 1, written as 8 bits a channel.
    radii : (N,) array
    ids : (N,) array of int32, optional
    velocities : (N, 3) array, optional

    Raises
    ------
    FileError
        When the place can't be written.
    """
    vertices = _ply_vertices(positions, normals, colors, radii, ids, velocities)
    _write_ply(path, vertices)


def write_mesh(
    path: str | os.PathLike[str],
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    faces: npt.NDArray[np.int32],
    velocities: FloatArray | None = None,
) -> None:
    """Writes triangles as .ply, .obj, .stl or .glb, by the suffix; whole or not at all.

    .ply holds all that there is; .glb loses velocities, .obj these and alpha; .stl has faces only.

    Parameters
    ----------
    path : path
    positions, normals : (V, 3) array
    colors : (V, 4) array
        0 to 1, written as 8 bits a channel.
    faces : (F, 3) array of int32
        Rows of positions.
    velocities : (V, 3) array, optional

    Raises
    ------
    FileError
        When the place can't be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITTEN_MESH_SUFFIXES:
        raise FileError(
            str(path), f"one of {' '.join(WRITTEN_MESH_SUFFIXES)}", repr(suffix), "Rename it."
        )
    if suffix == ".ply":
        vertices = _ply_vertices(positions, normals, colors, velocities=velocities)
        _write_ply(path, vertices, faces)
        return
    import trimesh

    mesh = trimesh.Trimesh(
        positions,
        faces,
        vertex_normals=normals,
        vertex_colors=_bytes(colors),
        process=False,
    )
    content: Any = mesh.export(file_type=suffix[1:])
    write_bytes(path, content.encode() if isinstance(content, str) else content)


def _ply_vertices(
    positions: FloatArray,
    normals: FloatArray,
    colors: FloatArray,
    radii: FloatArray | None = None,
    ids: npt.NDArray[np.int32] | None = None,
    velocities: FloatArray | None = None,
) -> npt.NDArray[Any]:
    number = "f8" if positions.dtype == np.float64 else "f4"
    fields = [(name, number) for name in ("x", "y", "z", "nx", "ny", "nz")]
    fields += [(name, "u1") for name in ("red", "green", "blue", "alpha")]
    if radii is not None:
        fields.append(("radius", number))
    if ids is not None:
        fields.append(("id", "i4"))
    if velocities is not None:
        fields += [(name, number) for name in ("vx", "vy", "vz")]
    vertices = np.empty(len(positions), fields)
    for axis, name in enumerate(("x", "y", "z")):
        vertices[name] = positions[:, axis]
        vertices["n" + name] = normals[:, axis]
    for channel, name in enumerate(("red", "green", "blue", "alpha")):
        vertices[name] = _bytes(colors)[:, channel]
    if radii is not None:
        vertices["radius"] = radii
    if ids is not None:
        vertices["id"] = ids
    if velocities is not None:
        for axis, name in enumerate(("vx", "vy", "vz")):
            vertices[name] = velocities[:, axis]
    return vertices


def _bytes(colors: FloatArray) -> npt.NDArray[np.uint8]:
    whole: npt.NDArray[np.uint8] = np.rint(np.clip(colors, 0.0, 1.0) * 255.0).astype(np.uint8)
    return whole


def _write_ply(
    path: str | os.PathLike[str],
    vertices: npt.NDArray[Any],
    faces: npt.NDArray[np.int32] | None = None,
) -> None:
    from plyfile import PlyData, PlyElement

    elements = [PlyElement.describe(vertices, "vertex")]
    if faces is not None:
        rows = np.empty(len(faces), [("vertex_indices", "i4", (3,))])
        rows["vertex_indices"] = faces
        elements.append(PlyElement.describe(rows, "face"))
    with whole_file(path) as file:
        PlyData(elements, byte_order="<").write(file)


def make_folder(folder: Path) -> None:
    """Makes a folder, and those that it's in, where there is none. Raises FileError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            str(folder),
            "a folder that can be made",
            error.strerror or str(error),
            "Choose another.",
        ) from error


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Writes a file whole or not at all. Raises FileError."""
    with whole_file(path) as file:
        file.write(content)


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A file that takes its name only once it's complete and on the disk.

    Raises
    ------
    FileError
        When it can't be made, written or renamed.
    """
    path = Path(path)
    try:
        file = tempfile.NamedTemporaryFile(  # noqa: SIM115  (renamed before it is closed)
            dir=path.parent, prefix=f".{path.name}.", suffix=".part", delete=False
        )
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        try:
            with file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.chmod(file.name, 0o666 & ~_umask())
            os.replace(file.name, path)
        except OSError as error:
            raise _unwritable(path, error) from error
    finally:
        if os.path.exists(file.name):
            os.unlink(file.name)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _unwritable(path: Path, error: OSError) -> FileError:
    reason = error.strerror or str(error)
    return FileError(
        str(path), "a place that can be written", reason, "Choose another folder or free some room."
    )


def _read_ply(path: Path) -> Shape:
    from plyfile import PlyData

    data = PlyData.read(str(path))
    if "vertex" not in data:
        raise FileError(str(path), "vertices", "none", "Export it once more, with its points.")
    rows = data["vertex"].data
    names = rows.dtype.names or ()

    def columns(*wanted: str) -> npt.NDArray[Any] | None:
        if not all(name in names for name in wanted):
            return None
        stacked: npt.NDArray[Any] = np.stack([rows[name] for name in wanted], axis=-1)
        return stacked

    positions = columns("x", "y", "z")
    if positions is None:
        raise FileError(str(path), "x, y and z", ", ".join(names), "Export it once more.")
    radii = rows["radius"] if "radius" in names else None
    return Shape(
        path.stem,
        _floats(positions),
        _optional_floats(columns("nx", "ny", "nz")),
        _colors(columns("red", "green", "blue", "alpha"), columns("red", "green", "blue")),
        None if radii is None else _floats(np.ascontiguousarray(radii)),
        _ply_faces(data),
    )


def _ply_faces(data: Any) -> npt.NDArray[np.int64] | None:
    if "face" not in data or len(data["face"].data) == 0:
        return None
    element = data["face"]
    lists = [p.name for p in element.properties if hasattr(p, "len_dtype")]
    wanted = next((n for n in ("vertex_indices", "vertex_index") if n in lists), None)
    return None if wanted is None else _triangles(list(element.data[wanted]))


def _triangles(polygons: list[Any]) -> npt.NDArray[np.int64]:
    """Fans of triangles."""
    sizes = np.fromiter((len(p) for p in polygons), np.int64, len(polygons))
    if np.all(sizes == 3):
        triangles: npt.NDArray[np.int64] = np.stack(polygons).astype(np.int64)
        return triangles
    fans = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    return np.asarray(fans, np.int64).reshape(-1, 3)


def _read_text(path: Path) -> Shape:
    rows = np.loadtxt(path, ndmin=2, comments=("#", "//"))
    if rows.shape[1] < 3:
        raise FileError(
            str(path), "x y z on each line", f"{rows.shape[1]} columns", "Write three numbers."
        )
    normals = rows[:, 3:6] if rows.shape[1] >= 6 else None
    return Shape(path.stem, rows[:, :3], normals)


def _read_mesh(path: Path) -> Shape:
    import trimesh

    # Rows must stay those of the file: nothing merged, nothing dropped.
    options: dict[str, Any] = {"process": False, "maintain_order": True}
    if path.suffix.lower() == ".obj":
        options |= {"split_object": False, "group_material": False, "skip_materials": True}
    loaded: Any = trimesh.load(path, **options)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_geometry()
    positions = np.asarray(loaded.vertices, np.float64)
    if len(positions) == 0:
        raise FileError(str(path), "vertices", "none", "Export it once more, with its points.")
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
    """(N, 4) in 0 to 1 of bytes, 16-bit numbers or floats; opaque without alpha."""
    given = rgba if rgba is not None else rgb
    if given is None:
        return None
    whole = np.issubdtype(given.dtype, np.integer)
    top = np.iinfo(given.dtype).max if whole else 1.0
    result = np.ones((len(given), 4), np.float32)
    result[:, : given.shape[1]] = given.astype(np.float64) / top
    return result
