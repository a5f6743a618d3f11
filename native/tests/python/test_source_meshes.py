"""Files of meshes, written again with their vertices moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from plyfile import PlyData, PlyElement
from pointmorph import formats
from pointmorph.morphs.denser_meshes import DenserMesh
from pointmorph.sequences import SourceMesh
from shapes import grid, grid_faces

SHIFT = np.array([1.0, 2.0, 3.0])


def moved(path: Path) -> Path:
    """The file written again, with its vertices moved by SHIFT."""
    shape = formats.read(path)
    mesh = SourceMesh(path, shape)
    written = path.with_name(f"moved{mesh.suffix}")
    mesh.write(written, shape.positions + SHIFT)
    return written


def test_a_ply_keeps_polygons_and_other_properties(tmp_path: Path) -> None:
    vertices = np.zeros(4, [(name, "f4") for name in ("x", "y", "z", "s", "t", "nx", "ny", "nz")])
    vertices["x"], vertices["y"] = [0, 1, 1, 0], [0, 0, 1, 1]
    vertices["s"], vertices["nx"] = [5, 6, 7, 8], 1
    faces = np.empty(1, [("vertex_indices", "O")])
    faces["vertex_indices"][0] = np.array([0, 1, 2, 3], "i4")
    elements = [PlyElement.describe(vertices, "vertex"), PlyElement.describe(faces, "face")]
    PlyData(elements).write(str(tmp_path / "square.ply"))
    data = PlyData.read(str(moved(tmp_path / "square.ply")))
    assert data["vertex"]["s"].tolist() == [5, 6, 7, 8]
    assert data["face"]["vertex_indices"][0].tolist() == [0, 1, 2, 3]
    assert data["vertex"]["z"].tolist() == [3, 3, 3, 3]
    assert data["vertex"]["nz"].tolist() == [1, 1, 1, 1]


def test_an_obj_keeps_all_but_normals(tmp_path: Path) -> None:
    (tmp_path / "square.obj").write_text(
        "# made by hand\nmtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
        "vt 0 0\nvn 0 0 1\ng side\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf 1//1 3//1 4//1\n"
    )
    assert moved(tmp_path / "square.obj").read_text() == (
        "# made by hand\nmtllib a.mtl\nv 1 2 3 1 0 0\nv 2 2 3\nv 2 3 3\nv 1 3 3\n"
        "vt 0 0\ng side\nf 1/1 2/1 3/1 4/1\nf 1 3 4\n"
    )


def test_a_glb_keeps_its_texture_coordinates(tmp_path: Path) -> None:
    positions, faces = grid(4, dtype=np.float64), grid_faces(4)
    uv = positions[:, :2] / 2 + 0.5
    mesh = trimesh.Trimesh(positions, faces, process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv)
    mesh.export(tmp_path / "sheet.glb")
    again = trimesh.load(moved(tmp_path / "sheet.glb"), process=False).to_geometry()
    assert np.allclose(again.vertices, positions + SHIFT, atol=1e-6)
    assert np.array_equal(again.faces, faces)
    assert np.allclose(again.visual.uv, uv, atol=1e-6)


@pytest.mark.parametrize("suffix", [".off", ".stl"])
def test_other_formats_become_ply(tmp_path: Path, suffix: str) -> None:
    mesh = trimesh.Trimesh(grid(4, dtype=np.float64), grid_faces(4), process=False)
    mesh.export(tmp_path / f"sheet{suffix}")
    shape = formats.read(tmp_path / f"sheet{suffix}")
    written = moved(tmp_path / f"sheet{suffix}")
    assert written.suffix == ".ply"
    again = formats.read(written)
    assert np.allclose(again.positions, shape.positions + SHIFT)
    assert np.array_equal(again.faces, shape.faces)


def halved(path: Path) -> Path:
    """A square of two triangles, written again with a vertex in the middle of its diagonal."""
    shape = formats.read(path)
    assert shape.faces is not None
    faces = np.array([[0, 1, 4], [1, 2, 4], [0, 4, 3], [4, 2, 3]], np.int32)
    parents = np.array([0, 0, 1, 1])
    mesh = SourceMesh(path, shape)
    places = np.vstack([shape.positions, shape.positions[[0, 2]].mean(axis=0)])
    mesh.denser = DenserMesh(faces, parents, np.array([[0, 2]]), places, places)
    written = path.with_name(f"denser{mesh.suffix}")
    mesh.write(written, places + SHIFT)
    return written


def test_a_denser_ply_carries_properties(tmp_path: Path) -> None:
    vertices = np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("s", "f4"), ("red", "u1")])
    vertices["x"], vertices["y"] = [0, 1, 1, 0], [0, 0, 1, 1]
    vertices["s"], vertices["red"] = [5, 6, 8, 8], [10, 0, 21, 0]
    faces = np.empty(1, [("vertex_indices", "O"), ("material", "i4")])
    faces["vertex_indices"][0] = np.array([0, 1, 2, 3], "i4")
    faces["material"] = 7
    elements = [PlyElement.describe(vertices, "vertex"), PlyElement.describe(faces, "face")]
    PlyData(elements).write(str(tmp_path / "square.ply"))
    data = PlyData.read(str(halved(tmp_path / "square.ply")))
    assert data["vertex"]["s"].tolist() == [5, 6, 8, 8, 6.5]
    assert data["vertex"]["red"].tolist() == [10, 0, 21, 0, 16]
    assert data["vertex"]["x"].tolist() == [1, 2, 2, 1, 1.5]
    assert [list(face) for face in data["face"]["vertex_indices"]] == [
        [0, 1, 4],
        [1, 2, 4],
        [0, 4, 3],
        [4, 2, 3],
    ]
    assert data["face"]["material"].tolist() == [7, 7, 7, 7]


def test_a_denser_obj_carries_uvs_and_groups(tmp_path: Path) -> None:
    (tmp_path / "square.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
        "g side\nf 1/1/1 2/2/1 3/3/1 4/4/1\n"
    )
    assert halved(tmp_path / "square.obj").read_text() == (
        "v 1 2 3\nv 2 2 3\nv 2 3 3\nv 1 3 3\nv 1.5 2.5 3\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5\ng side\n"
        "f 1/1 2/2 5/5\nf 2/2 3/3 5/5\nf 1/1 5/5 4/4\nf 5/5 3/3 4/4\n"
    )


def test_a_denser_glb_carries_uvs(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=corners[:, :2])
    mesh.export(tmp_path / "square.glb")
    again = trimesh.load(halved(tmp_path / "square.glb"), process=False).to_geometry()
    assert np.allclose(again.vertices[4], SHIFT + np.array([0.5, 0.5, 0]))
    assert np.allclose(again.visual.uv[4], (0.5, 0.5))
    assert len(again.faces) == 4


def test_denser_files_of_other_formats_become_ply(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    mesh.export(tmp_path / "square.off")
    again = formats.read(halved(tmp_path / "square.off"))
    assert again.faces is not None
    assert (len(again.positions), len(again.faces)) == (5, 4)
