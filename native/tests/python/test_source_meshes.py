"""Files of meshes, written again with their vertices moved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

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


def scene_of_three(path: Path) -> None:
    """A mesh in two nodes and another one below, all turned, scaled and moved, with a material, UVs
    and normals."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    square = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    material = trimesh.visual.material.PBRMaterial(name="paint", baseColorFactor=[255, 0, 0, 255])
    square.visual = trimesh.visual.TextureVisuals(uv=corners[:, :2], material=material)
    square.vertex_normals  # noqa: B018, which are written once they were asked for
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3]) @ np.diag([2.0, 3.0, 4.0, 1])
    turn[:3, 3] = [5, 6, 7]
    scene.add_geometry(square, node_name="left", geom_name="square", transform=turn)
    scene.graph.update("right", geometry="square", matrix=turn @ turn)
    box = trimesh.creation.box()
    scene.add_geometry(box, node_name="below", geom_name="box", parent_node_name="left")
    scene.export(path)


def header_of(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    header: dict[str, Any] = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    return header


def test_a_glb_keeps_rows_nodes_and_materials(tmp_path: Path) -> None:
    scene_of_three(tmp_path / "scene.glb")
    before = formats.read(tmp_path / "scene.glb")
    after = formats.read(moved(tmp_path / "scene.glb"))
    np.testing.assert_allclose(after.positions, before.positions + SHIFT, atol=1e-4)
    np.testing.assert_array_equal(after.faces, before.faces)
    old, new = header_of(tmp_path / "scene.glb"), header_of(tmp_path / "moved.glb")
    assert len(before.positions) == 4 + 4 + 8
    for node in (*old["nodes"], *new["nodes"]):
        node.pop("mesh", None)
    assert new["nodes"] == old["nodes"]
    assert new["materials"] == old["materials"]
    first = (tmp_path / "moved.glb").read_bytes()
    assert moved(tmp_path / "scene.glb").read_bytes() == first


def test_a_glb_of_several_materials_has_the_same_bytes_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where trimesh writes it, which gives its parts random names."""
    scene_of_three(tmp_path / "scene.glb")
    content = (tmp_path / "scene.glb").read_bytes()
    size = int.from_bytes(content[12:16], "little")
    header = header_of(tmp_path / "scene.glb")
    header["meshes"][0]["primitives"] += header["meshes"][1]["primitives"]
    text = json.dumps(header, separators=(",", ":")).encode()
    text = text.ljust(-(-len(text) // 4) * 4)
    sizes = [(20 + len(text) + len(content) - 20 - size).to_bytes(4, "little")]
    sizes.append(len(text).to_bytes(4, "little"))
    whole = content[:8] + sizes[0] + sizes[1] + content[16:20] + text + content[20 + size :]
    (tmp_path / "scene.glb").write_bytes(whole)
    for _ in range(2):
        first = moved(tmp_path / "scene.glb").read_bytes()
        assert moved(tmp_path / "scene.glb").read_bytes() == first
        monkeypatch.setattr("pointmorph.sequences.source_meshes.moved_glb", lambda *_: None)


def test_a_moved_glb_keeps_hard_edges(tmp_path: Path) -> None:
    """A roof of two sides that share their ridge's places, each with its own normals."""
    places = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1], [2, 0, 0], [2, 1, 0]])
    rows = [0, 2, 1, 3, 2, 4, 3, 5]
    roof = trimesh.Trimesh(
        places[rows], [[0, 1, 2], [1, 3, 2], [4, 5, 6], [5, 7, 6]], process=False
    )
    roof.vertex_normals  # noqa: B018
    roof.export(tmp_path / "roof.glb")
    shape = formats.read(tmp_path / "roof.glb")
    SourceMesh(tmp_path / "roof.glb", shape).write(
        tmp_path / "flat.glb", shape.positions * np.array([1, 1, 0.5])
    )
    again = trimesh.load(tmp_path / "flat.glb", process=False).to_geometry()
    slope = np.array([0.5, 0, 1]) / np.hypot(0.5, 1)
    normals = np.abs(again.vertex_normals)
    assert np.allclose(normals, slope, atol=1e-6)
    assert not np.allclose(again.vertex_normals[1], again.vertex_normals[4])


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


def test_a_denser_obj_of_polygons_of_any_size(tmp_path: Path) -> None:
    angles = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(2000)], axis=1)
    lines = [f"v {x} {y} {z}\n" for x, y, z in [*ring, (0, 0, 1)]]
    for number in range(0, 2000, 2):  # one face of many corners among others
        lines.append(f"f {number + 1} {number + 2} 2001\n")
        if number == 1000:
            lines.append("g disk\nf " + " ".join(str(row + 1) for row in range(2000)) + "\ng\n")
    (tmp_path / "cone.obj").write_text("".join(lines))
    shape = formats.read(tmp_path / "cone.obj")
    assert shape.faces is not None
    mesh = SourceMesh(tmp_path / "cone.obj", shape)
    a, b, c = shape.faces.T
    middle = len(shape.positions) + np.arange(len(a))
    faces = np.stack([[a, middle, c], [middle, b, c]], axis=1).reshape(3, -1).T
    parents = np.tile(np.arange(len(a)), 2)
    places = np.vstack([shape.positions, 0.5 * (shape.positions[a] + shape.positions[b])])
    mesh.denser = DenserMesh(faces, parents, np.stack([a, b], axis=1), places, places)
    mesh.write(tmp_path / "denser.obj", places)
    written = (tmp_path / "denser.obj").read_text()
    disk = written.partition("g disk\n")[2].partition("g\n")[0].splitlines()
    assert len(disk) == 2 * 1998
    corners = {int(word) for line in disk for word in line.split()[1:]}
    assert (places[np.array(sorted(corners)) - 1, 2] == 0).all()
    assert written.count("\nf ") == 2 * len(a)


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
