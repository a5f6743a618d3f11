"""Files that claim more than they hold, or that lead elsewhere: refused before anything is made."""

from __future__ import annotations

import json
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pointmorph
import pytest
import trimesh.exchange.load  # here, not where memory is watched  # noqa: F401
from pointmorph import formats
from pointmorph.commands import cli
from shapes import CUBE, SQUARES


def refused(path: Path, words: str) -> None:
    """The file is refused in these words, and less than 8 MB are allocated for it."""
    tracemalloc.start()
    try:
        with pytest.raises(pointmorph.FileError, match=words):
            formats.read(path)
        assert tracemalloc.get_traced_memory()[1] < 8e6
    finally:
        tracemalloc.stop()


HEADER = "ply\nformat {} 1.0\nelement vertex {}\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("count", [10**12, 10**30, 3, -1])
def test_a_ply_file_has_room_for_its_points(tmp_path: Path, kind: str, count: int) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes((HEADER.format(kind, count) + "end_header\n").encode() + b"0 0 0\n" * 2)
    refused(path, "vertex" if kind != "ascii" or count != 3 else "early end")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("element face 1000000000000\nproperty list uchar int vertex_indices\n", "face"),
        ("element face 1000000000000\n", "properties of each face"),
        ("element face many\nproperty list uchar int vertex_indices\n", "number of rows"),
        ("comment " + "x" * 2_000_000 + "\n", "no header"),
    ],
)
def test_a_ply_file_has_room_for_all_else(tmp_path: Path, more: str, words: str) -> None:
    path = tmp_path / "a.ply"
    header = HEADER.format("binary_little_endian", 3) + more + "end_header\n"
    path.write_bytes(header.encode() + bytes(36))
    refused(path, words)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("corner", [3, -1, 2_000_000_000])
def test_faces_have_rows_that_exist(tmp_path: Path, kind: str, corner: int) -> None:
    header = HEADER.format(kind, 3) + "element face 1\nproperty list uchar int vertex_indices\n"
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    if kind == "ascii":
        rows = "".join(f"{x} {y} {z}\n" for x, y, z in points) + f"3 0 1 {corner}\n"
        content = rows.encode()
    else:
        content = points.tobytes() + struct.pack("<Biii", 3, 0, 1, corner)
    path = tmp_path / "a.ply"
    path.write_bytes(header.encode() + b"end_header\n" + content)
    refused(path, "rows")
    (tmp_path / "a.off").write_text(f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {corner}\n")
    refused(tmp_path / "a.off", "a readable")
    if corner > 0:  # numbers below 0 count from the last vertex there
        (tmp_path / "a.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {corner + 1}\n")
        refused(tmp_path / "a.obj", "a readable")


def test_rows_of_faces_are_checked_without_a_file() -> None:
    places = np.zeros((3, 3))
    with pytest.raises(pointmorph.CloudError, match="rows 0 to 2"):
        pointmorph.meshes.parts([[0, 1, 3]], places)
    with pytest.raises(pointmorph.CloudError, match="rows 0 to 2"):
        pointmorph.meshes.boundary_loops([[0, 1, -1]], 3)


def gltf(**changes: object) -> dict[str, object]:
    """A triangle whose points are in the file beside it."""
    scene: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": "points.bin", "byteLength": 36}],
    }
    return {**scene, **changes}


def write_gltf(folder: Path, **changes: object) -> Path:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    (folder / "points.bin").write_bytes(points.tobytes())
    path = folder / "a.gltf"
    path.write_text(json.dumps(gltf(**changes)))
    return path


def test_a_scene_is_read(tmp_path: Path) -> None:
    assert len(formats.read(write_gltf(tmp_path)).positions) == 3


def doubled(levels: int) -> list[dict[str, object]]:
    """Parts each of which holds the next one twice."""
    return [{"children": [k + 1, k + 1]} for k in range(levels)] + [{"mesh": 0}]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "at most"),
        ({"accessors": [{"componentType": 5126, "count": -1, "type": "VEC3"}]}, "number of items"),
        ({"accessors": [{"componentType": 5126, "count": "3", "type": "VEC3"}]}, "number of items"),
        ({"buffers": [{"uri": "../elsewhere/points.bin", "byteLength": 36}]}, "beside it"),
        ({"buffers": [{"uri": "%2e%2e/points.bin", "byteLength": 36}]}, "beside it"),
        ({"buffers": [{"uri": "/etc/hostname", "byteLength": 36}]}, "beside it"),
        ({"nodes": doubled(40)}, "copies of parts"),
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, "holds itself"),
    ],
)
def test_a_scene_stays_in_its_folder_and_in_bounds(
    tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "scenes").mkdir()
    write_gltf(tmp_path / "elsewhere")  # what the names lead to is there
    refused(write_gltf(tmp_path / "scenes", **changes), words)


def deep(levels: int) -> str:
    return "[" * levels + "]" * levels


def test_lists_within_lists_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text(deep(10_000))
    refused(tmp_path / "a.gltf", "too deep")
    text = deep(10_000).encode()
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(head + text)
    refused(tmp_path / "a.glb", "too deep")
    features = tmp_path / "features.json"
    features.write_text(f'{{"features": {deep(10_000)}}}')
    with pytest.raises(pointmorph.FileError, match="too deep"):
        cli.read_features(features)


def test_a_binary_scene_has_room_for_its_text(tmp_path: Path) -> None:
    head = struct.pack("<4sIIII", b"glTF", 2, 20, 4_000_000_000, 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(head)
    refused(tmp_path / "a.glb", "its scene")


def write_3mf(path: Path, objects: str, *, build: str = "1", padding: int = 0) -> None:
    model = (
        '<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'{objects}</resources><build><item objectid="{build}"/></build>{" " * padding}</model>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)


def test_3mf_files_that_grow_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.3mf"
    write_3mf(path, "", padding=20_000_000)
    refused(path, "bytes in it")
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CUBE)
    faces = "".join(
        f'<triangle v1="{q[0]}" v2="{q[k]}" v3="{q[k + 1]}"/>' for q in SQUARES for k in (1, 2)
    )
    cube = (
        f'<object id="1"><mesh><vertices>{vertices}</vertices>'
        f"<triangles>{faces}</triangles></mesh></object>"
    )
    holding = "".join(
        f'<object id="{k + 1}"><components><component objectid="{k}"/><component objectid="{k}"/>'
        "</components></object>"
        for k in range(1, 40)
    )
    write_3mf(path, cube + holding, build="40")
    refused(path, "copies of parts")
    itself = '<object id="2"><components><component objectid="2"/></components></object>'
    write_3mf(path, cube + itself, build="2")
    refused(path, "holds itself")
