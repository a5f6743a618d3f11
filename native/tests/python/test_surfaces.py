"""Meshes through the frames."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
import pytest
import trimesh
from pointmorph import sequences
from pointmorph.sequences import surfaces
from pointmorph.storage.files import read_ply
from scipy.spatial import cKDTree
from shapes import around, ball, grid

SIZE = np.array([1.5, 1.0, 0.7])  # half axes of the ellipsoid
COUNT = 2000  # points of the ellipsoid


def blob(count: int, size: np.ndarray, center: float = 0.0) -> pointmorph.Cloud:
    """Coloured by height."""
    points = ball(count)
    colors = np.concatenate([np.repeat(0.5 + 0.5 * points[:, 2:], 3, 1), np.ones((count, 1))], 1)
    normals = points / size
    return pointmorph.Cloud(points * size + center, normals, colors)


def tied(source: pointmorph.Cloud, target: pointmorph.Cloud) -> pointmorph.Morph:
    """The morph that takes every place of one ball to the same of the other."""
    rows = [around(ball(len(cloud))) for cloud in (source, target)]
    return pointmorph.morph(source, target, {n: (rows[0][n], rows[1][n]) for n in rows[0]})


@pytest.fixture(scope="module")
def round_morph() -> pointmorph.Morph:
    return tied(blob(3000, np.ones(3)), blob(COUNT, SIZE))


@pytest.fixture(scope="module")
def surface_at(round_morph: pointmorph.Morph) -> Callable[[float], surfaces.Surface]:
    """The surface through the resampled frame at t, made once."""
    made = surfaces.Surfaces(round_morph)
    return cache(lambda t: made.through(round_morph.resampled_frame(t), t))


def mesh_of(surface: surfaces.Surface) -> trimesh.Trimesh:
    return trimesh.Trimesh(surface.positions, surface.faces, process=False)


@pytest.mark.parametrize("t", [0.0, 0.05, 0.5, 1.0])
def test_closed_shapes_give_closed_surfaces_near_the_points(
    round_morph: pointmorph.Morph, surface_at: Callable[[float], surfaces.Surface], t: float
) -> None:
    frame = round_morph.resampled_frame(t)
    surface = surface_at(t)
    mesh = mesh_of(surface)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert mesh.body_count == 1
    spacing = np.sqrt(mesh.area / COUNT)
    assert cKDTree(frame.positions).query(surface.positions)[0].max() < spacing
    assert cKDTree(mesh.triangles_center).query(frame.positions)[0].max() < spacing
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-6)
    assert surface.velocities is not None
    for array in (surface.positions, surface.colors, surface.velocities):
        assert np.isfinite(array).all()


def test_the_surface_at_the_end_is_the_true_one(
    surface_at: Callable[[float], surfaces.Surface],
) -> None:
    surface = surface_at(1.0)
    on_ball = surface.positions / SIZE
    spacing = np.sqrt(4 * np.pi / COUNT)
    assert np.abs(np.linalg.norm(on_ball, axis=1) - 1.0).max() < 0.1 * spacing
    true = on_ball / SIZE
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((true * surface.normals).sum(1), -1, 1))).max() < 10
    height = 0.5 + 0.5 * on_ball[:, 2]
    np.testing.assert_allclose(surface.colors[:, 0], height, atol=spacing)
    np.testing.assert_allclose(surface.colors[:, 3], 1.0, rtol=1e-12)


def test_the_surface_goes_where_its_velocities_say(
    surface_at: Callable[[float], surfaces.Surface],
) -> None:
    now = surface_at(0.4)
    later = mesh_of(surface_at(0.6))
    assert now.velocities is not None
    moved = now.positions + 0.2 * now.velocities
    spacing = np.sqrt(later.area / COUNT)
    there = cKDTree(trimesh.sample.sample_surface(later, 200000, seed=1)[0])
    assert there.query(moved)[0].max() < 0.3 * spacing
    assert there.query(now.positions)[0].max() > spacing


def test_a_patch_stays_open_and_a_small_hole_is_closed() -> None:
    points = grid(31, 0.0, np.float64)
    points = points[np.linalg.norm(points - [0.4, 0.4, 0.0], axis=1) > 0.12]  # 3 spacings wide
    cloud = pointmorph.Cloud(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
    morph = pointmorph.morph(cloud, pointmorph.Cloud(2.0 * points, cloud.normals))
    surface = surfaces.Surfaces(morph).through(morph.resampled_frame(0.0), 0.0)
    mesh = mesh_of(surface)
    spacing = 2.0 / 30
    assert mesh.area == pytest.approx(4.0, rel=0.25)  # up to 1.5 spacings more at the border
    np.testing.assert_allclose(surface.positions[:, 2], 0.0, atol=0.5 * spacing)
    assert np.abs(surface.positions).max() < 1.0 + 2.0 * spacing
    assert mesh.body_count == 1
    assert mesh.euler_number == 1  # a disk: no hole


def test_heaps_near_an_end_make_no_beads() -> None:
    morph = tied(blob(100, np.ones(3)), blob(2000, np.ones(3)))
    frame = morph.frame(0.03)  # twenty pairs around every point of the source
    mesh = mesh_of(surfaces.Surfaces(morph).through(frame, 0.03))
    assert mesh.body_count == 1
    assert mesh.is_watertight


def test_the_same_at_any_scale_and_place_and_again() -> None:
    def made(scale: float, center: float) -> surfaces.Surface:
        source = blob(300, scale * np.ones(3), center)
        morph = tied(source, blob(250, scale * SIZE, center))
        return surfaces.Surfaces(morph).through(morph.frame(0.5), 0.5)

    expected = made(1.0, 0.0)
    assert made(1.0, 0.0).positions.tobytes() == expected.positions.tobytes()
    for scale, center in ((1e-6, 0.0), (1e6, 3e6)):
        surface = made(scale, center)
        assert mesh_of(surface).is_watertight
        extent = np.ptp(surface.positions, axis=0) / scale
        np.testing.assert_allclose(extent, np.ptp(expected.positions, axis=0), rtol=0.02)


def test_too_few_points_and_a_missing_library_say_so(
    round_morph: pointmorph.Morph, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    frame = round_morph.frame(0.5)
    few = pointmorph.Frame(*(values[:5] for values in vars(frame).values()))
    same = pointmorph.Frame(0 * frame.positions, frame.normals, frame.colors, frame.radii)
    through = surfaces.Surfaces(round_morph).through
    for bad in (few, same):
        with pytest.raises(pointmorph.CloudError, match="at least 12 points"):
            through(bad, 0.5)
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(pointmorph.OptionError, match="pip install pymeshlab"):
        surfaces.check_available()
    with pytest.raises(pointmorph.OptionError, match="pip install pymeshlab"):
        sequences.write_frames(round_morph, tmp_path, [0.5], mesh="obj")
    assert not list(tmp_path.iterdir())


def test_files_of_every_kind_hold_the_mesh(
    round_morph: pointmorph.Morph,
    surface_at: Callable[[float], surfaces.Surface],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = surface_at(0.6)
    for kind in ("ply", "obj", "stl", "glb"):
        if kind == "obj":  # the first was made anew; the others differ in how they are written
            monkeypatch.setattr(surfaces.Surfaces, "through", lambda *_: expected)
        times = [0.0, 0.6, 1.0] if kind == "ply" else [0.6]
        sequences.write_frames(round_morph, tmp_path, times, first=9 - len(times), mesh=kind)
        names = {path.name for path in tmp_path.iterdir()}
        numbers = range(9 - len(times), 9)
        assert names == {
            *(f"frame_{number:04d}.ply" for number in numbers),
            *(f"mesh_{number:04d}.{kind}" for number in numbers),
        }
        read = trimesh.load(
            tmp_path / f"mesh_{7 if kind == 'ply' else 8:04d}.{kind}", process=False, force="mesh"
        )
        assert len(read.faces) == len(expected.faces)
        np.testing.assert_allclose(read.bounds, mesh_of(expected).bounds, atol=1e-5)
        assert read.volume == pytest.approx(mesh_of(expected).volume, rel=1e-4)
        if kind != "stl":
            colors = np.asarray(read.visual.vertex_colors)[:, :3] / 255
            np.testing.assert_allclose(colors, expected.colors[:, :3], atol=0.5 / 255 + 1e-6)
        if kind == "ply":
            rows = read_ply(tmp_path / "mesh_0007.ply")["vertex"].data
            assert expected.velocities is not None
            by_frame = expected.velocities * np.gradient(times)[1]
            np.testing.assert_allclose(rows["vx"], by_frame[:, 0], atol=1e-6)
    sequences.write_frames(round_morph, tmp_path, [0.6])
    assert not list(tmp_path.glob("mesh_*"))


def test_a_mesh_that_is_missing_is_written_when_a_run_goes_on(tmp_path: Path) -> None:
    morph = pointmorph.morph(pointmorph.Cloud(grid(11)), pointmorph.Cloud(grid(11, 0.8)))
    for _ in range(2):
        sequences.write_frames(morph, tmp_path, [0.0, 1.0], mesh="obj", resume=True)
        times = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.*")}
        (tmp_path / "mesh_0001.obj").unlink()
    sequences.write_frames(morph, tmp_path, [0.0, 1.0], mesh="obj", resume=True)
    again = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.*")}
    assert [path.name for path in again if again[path] != times[path]] == ["mesh_0001.obj"]


@pytest.mark.parametrize("count", [300, 9000])
def test_points_that_lie_together_are_thinned_in_their_order(
    round_morph: pointmorph.Morph, count: int
) -> None:
    random = np.random.default_rng(count)
    points = random.random((count, 3)).round(1) + 0.01 * random.random((count, 3))
    normals = random.normal(size=(count, 3))
    spacing = random.uniform(0.02, 0.3, count)
    stays = np.ones(count, bool)
    for row in range(count):  # one by one
        near = np.linalg.norm(points - points[row], axis=1) <= 0.5 * spacing[row]
        if stays[row]:
            stays[(np.arange(count) > row) & near & (normals @ normals[row] > 0.0)] = False
    rows = surfaces.Surfaces(round_morph)._thinned(points, normals, spacing, lambda: False)
    assert 0 < len(rows) < count
    np.testing.assert_array_equal(rows, np.flatnonzero(stays))


def test_thousands_of_pairs_at_a_point_are_thinned_by_those_that_stay(
    round_morph: pointmorph.Morph, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = 0

    class Counting(cKDTree):
        def query_ball_point(self, *arguments: object) -> object:
            nonlocal found
            around = super().query_ball_point(*arguments)
            found += sum(map(len, around))
            return around

    made = surfaces.Surfaces(round_morph)
    monkeypatch.setattr(made, "_tree", Counting)
    corners = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(-1, 3)
    points = np.repeat(corners, 1000, axis=0)
    rows = made._thinned(points, points, np.full(len(points), 0.5), lambda: False)
    np.testing.assert_array_equal(rows, 1000 * np.arange(8))
    assert found < 100 * len(points)  # of each, all others at its corner would be 1,000 times


def test_a_mesh_that_is_being_made_can_be_stopped(
    round_morph: pointmorph.Morph, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, frame = surfaces.Surfaces(round_morph), round_morph.frame(0.5)
    with pytest.raises(pointmorph.Cancelled):  # while points are thinned
        made.through(frame, 0.5, lambda: True)
    begun: list[subprocess.Popen[bytes]] = []

    class Process(subprocess.Popen[bytes]):
        def __init__(self, *arguments: Any, **others: Any) -> None:
            super().__init__(*arguments, **others)
            begun.append(self)

    monkeypatch.setattr(surfaces.subprocess, "Popen", Process)
    with pytest.raises(pointmorph.Cancelled):  # and while MeshLab is at work
        made.through(frame, 0.5, lambda: bool(begun))
    assert begun[0].returncode not in (None, 0)
