"""The script that measures wrapped meshes prints what the library says, as the page lists it."""

from __future__ import annotations

import json
from pathlib import Path

import bench_wrapping
import numpy as np
import pointmorph
import pytest
from pointmorph import formats
from pointmorph.shapes.clouds import SIDES
from shapes import grid, grid_faces

PAGE = Path(__file__).resolve().parents[3] / "docs" / "comparison.md"
PAIR = {"source": "source.ply", "target": "target.ply"}
MARKS = {"a": (0, 0), "b": (11, 13), "c": (132, 182), "d": (143, 195), "middle": (65, 104)}


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """A sheet of 12 by 12 vertices and a bump of 14 by 14."""
    for side, count, height in (("source", 12, 0.0), ("target", 14, 1.2)):
        points = grid(count, height)
        up = np.tile(np.float32([0, 0, 1]), (len(points), 1))
        colors = np.ones((len(points), 4), np.float32)
        faces = grid_faces(count).astype(np.int32)
        formats.write_mesh(tmp_path / f"{side}.ply", points, up, colors, faces)
    (tmp_path / "pair.json").write_text(json.dumps(PAIR | {"features": MARKS}))
    return tmp_path


def test_prints_the_figures_of_the_library(pair: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_wrapping.main([str(pair)]) == 0
    header, rule, row, mean = capsys.readouterr().out.splitlines()
    page = PAGE.read_text(encoding="utf-8")
    assert f"\n{header}\n{rule}\n" in page
    assert f"native/benchmarks/{Path(bench_wrapping.__file__).name}" in page
    ends = [formats.read(pair / f"{side}.ply").cloud() for side in ("source", "target")]
    found = [pointmorph.morph(*ends, marks).mesh_quality for marks in (None, MARKS)]
    assert found[0].uncovered != found[1].uncovered
    cells = row.strip("| ").split(" | ")
    assert cells[0] == pair.name
    for cell, (name, decimals) in zip(cells[1:], bench_wrapping.DECIMALS.items(), strict=True):
        figures = [100 * getattr(quality, name) for quality in found]
        assert cell == " · ".join(f"{figure:.{decimals}f}" for figure in figures)
    assert mean == row.replace(pair.name, "mean", 1)


def test_marks_of_clouds_are_those_of_the_nearest_vertices(pair: Path) -> None:
    meshes = {side: formats.read(pair / f"{side}.ply").positions for side in SIDES}
    rows = {"source": [50, 7], "target": [3, 90]}
    for side in SIDES:
        points = meshes[side][rows[side]] + np.float32(0.01)
        colors, radii = np.ones((2, 4), np.float32), np.full(2, 0.1, np.float32)
        formats.write_ply(pair / f"{side}_cloud.ply", points, points, colors, radii)
    listed = {side: f"{side}_cloud.ply" for side in SIDES}
    listed |= {f"{side}_mesh": f"{side}.ply" for side in SIDES}
    marks = {"features": {"first": [0, 0], "second": [1, 1]}}
    (pair / "pair.json").write_text(json.dumps(listed | marks))
    clouds, found = bench_wrapping.read(pair)
    assert found == {"first": (50, 3), "second": (7, 90)}
    assert [len(cloud) for cloud in clouds] == [144, 196]
    assert all(cloud.faces is not None for cloud in clouds)


def test_the_mean_is_that_of_all_pairs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    known = {"x": ([1.0, 2, 3, 4], [0.0, 0, 0, 0]), "y": ([2.0, 4, 6, 8], [1.0, 1, 1, 1])}
    monkeypatch.setattr(bench_wrapping, "figures", lambda folder: known[folder.name])
    bench_wrapping.main(["x", "y"])
    mean = capsys.readouterr().out.splitlines()[-1]
    assert mean == "| mean | 1.500 · 0.500 | 3.00 · 0.50 | 4.50 · 0.50 | 6.000 · 0.500 |"
