"""Meshes that the command line writes for each frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_runs import PAIR, A, B, run, write_off, write_pair
from pointmorph import formats
from shapes import grid


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    return write_pair(tmp_path)


def quad_obj(path: Path, height: float) -> None:
    """An open sheet of squares with UVs and a material, in the order of `grid`."""
    side = 12
    lines = ["mtllib sheet.mtl", "o sheet"]
    for x, y, z in grid(side, height):
        lines.append(f"v {x} {y} {z}")
    for x, y, _ in grid(side):
        lines.append(f"vt {x} {y}")
    lines += ["vn 0 0 1", "usemtl cloth"]
    for a in range(side - 1):
        for b in range(side - 1):
            k = a * side + b + 1
            corners = (k, k + side, k + side + 1, k + 1)
            lines.append("f " + " ".join(f"{c}/{c}/1" for c in corners))
    path.write_text("\n".join(lines) + "\n")


def test_the_source_s_own_mesh_is_moved(tmp_path: Path) -> None:
    quad_obj(tmp_path / "sheet.obj", 0.0)
    write_off(tmp_path / "bump.off", A, 0.8)
    out = tmp_path / "out"
    call = ["morph", tmp_path / "sheet.obj", tmp_path / "bump.off", "--out", out, "--frames", 3]
    done = run(*call, "--mesh", "source")
    assert done.returncode == 0, done.stderr
    given = (tmp_path / "sheet.obj").read_text().splitlines()
    for number in range(3):
        lines = (out / f"mesh_{number:04d}.obj").read_text().splitlines()
        assert [x for x in lines if x.startswith(("vt", "usemtl", "mtllib", "o "))] == [
            x for x in given if x.startswith(("vt", "usemtl", "mtllib", "o "))
        ]
        assert next(x for x in lines if x.startswith("f ")) == "f 1/1 13/13 14/14 2/2"
        assert sum(x.startswith("v ") for x in lines) == 144
    first, last = (formats.read(out / f"mesh_000{number}.obj").positions for number in (0, 2))
    assert np.abs(first - grid(12)).max() < 1e-6
    height = 0.8 * np.exp(-3 * (last[:, 0] ** 2 + last[:, 1] ** 2))
    assert np.abs(last[:, 2] - height).max() < 0.02


@pytest.mark.parametrize(
    ("arguments", "found"),
    [(["--samples", "500"], "--samples"), (["--method", "paper"], "--method paper")],
)
def test_the_source_s_mesh_needs_its_faces(pair: Path, arguments: list[str], found: str) -> None:
    names = [pair / name for name in PAIR[1:]]
    done = run("morph", *names, "--out", pair / "out", "--mesh", "source", *arguments)
    assert done.returncode == 2
    assert found in done.stderr
    assert not (pair / "out").exists()


def test_the_target_s_mesh_is_written_denser(pair: Path) -> None:
    done = run(
        "morph", pair / "plane.off", pair / "bump.off", "--out", pair / "out", "--features",
        pair / "features.json", "--frames", 3, "--mesh", "source", "--denser",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    meshes = [formats.read(pair / "out" / f"mesh_000{number}.ply") for number in range(3)]
    assert len(meshes[0].positions) > A * A
    assert np.abs(meshes[0].positions[:, 2]).max() == 0
    assert meshes[2].positions[:, 2].max() > 0.7
    assert all(len(mesh.positions) == len(meshes[0].positions) for mesh in meshes)
    report = json.loads((pair / "out" / "report.json").read_text())
    assert report["denser"]["vertices"] == len(meshes[0].positions)
    done = run(
        "morph", pair / "plane.off", pair / "bump.off", "--out", pair / "back", "--frames", 2,
        "--features", pair / "features.json", "--mesh", "target",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    first, last = (formats.read(pair / "back" / f"mesh_000{number}.ply") for number in range(2))
    assert np.allclose(last.positions, grid(B, 0.8))
    assert np.abs(first.positions[:, 2]).max() < 0.05
    wrong = run("morph", pair / "plane.off", pair / "bump.off", "--out", pair / "no", "--denser")
    assert wrong.returncode == 2
    assert "--mesh" in wrong.stderr


def test_vertices_are_held_by_the_features_file(pair: Path) -> None:
    marks = json.loads((pair / "features.json").read_text())
    fixed = list(range(4 * A))
    marks["fixed"] = {"source": {"rows": fixed, "weights": [1.0] * len(fixed)}}
    marks["rigid"] = {"target": [0, 1, 2]}
    (pair / "held.json").write_text(json.dumps(marks))
    call = ["morph", pair / "plane.off", pair / "bump.off", "--frames", 2, "--mesh", "source"]
    done = run(*call, "--features", pair / "held.json", "--out", pair / "out")
    assert done.returncode == 0, done.stderr
    last = formats.read(pair / "out" / "mesh_0001.ply").positions
    assert np.allclose(last[1:24], grid(A, 0.0)[1:24])
    for wrong in (
        {"source": [A * A]},
        {"source": [-1]},
        {"source": {"rows": [1, 2], "weights": [1]}},
    ):
        marks["fixed"] = wrong
        (pair / "held.json").write_text(json.dumps(marks))
        refused = run(*call, "--features", pair / "held.json", "--out", pair / "no")
        assert refused.returncode == 1
        assert "fixed" in refused.stderr
