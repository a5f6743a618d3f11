"""Cuts through closed shapes from Python."""

from __future__ import annotations

import numpy as np
import pointmorph
import pytest
from shapes import CUBE, SQUARES, around, ball, grid


def test_a_cut_is_shown_in_the_units_and_rows_given() -> None:
    shift = np.array([7.0, -3.0, 1.0])
    points = ball(2500)
    cut = pointmorph.decompose(pointmorph.Cloud(5.0 * points + shift), around(points))
    unit = (cut.curve - shift) / 5.0
    assert np.allclose(np.linalg.norm(unit, axis=1), 1.0, atol=0.02)
    assert np.abs(unit[:, 2]).max() < 0.1
    for name, row in around(points).items():
        assert np.allclose(unit[cut.corners[name]], points[row], atol=1e-9)
        assert cut.sides[row] == 0
    assert np.all(cut.sides[points[:, 2] > 0.15] == 1)
    assert np.all(cut.sides[points[:, 2] < -0.15] == -1)
    assert np.all(np.sum(cut.normals * unit, axis=1) > 0.95)


def test_the_curve_comes_in_the_type_of_the_cloud() -> None:
    points = ball(800).astype(np.float32)
    assert pointmorph.decompose(pointmorph.Cloud(points), around(points)).curve.dtype == np.float32


def test_what_cannot_be_cut_is_refused() -> None:
    points = ball(800)
    loop = around(points)
    cloud = pointmorph.Cloud(points)
    with pytest.raises(pointmorph.FeatureError, match="at least 3"):
        pointmorph.decompose(cloud, {"front": loop["front"], "back": loop["back"]})
    with pytest.raises(pointmorph.FeatureError, match="point 800"):
        pointmorph.decompose(cloud, {**loop, "front": 800})
    with pytest.raises(pointmorph.FeatureError, match="already"):
        pointmorph.decompose(cloud, {**loop, "front": loop["back"]})
    patch = grid(21)
    with pytest.raises(pointmorph.FeatureError, match="is open and needs no loop"):
        pointmorph.decompose(pointmorph.Cloud(patch), {"a": 30, "b": 50, "c": 300})
    with pytest.raises(pointmorph.OptionError):
        pointmorph.decompose(cloud, loop, domain="flat")


def test_cancelling_a_cut() -> None:
    points = ball(2000)
    with pytest.raises(pointmorph.Cancelled):
        pointmorph.decompose(
            pointmorph.Cloud(points),
            around(points),
            progress=lambda stage, _: stage != "covariance",
        )


def test_the_proposed_loop_is_the_one_that_is_taken_and_can_be_cut() -> None:
    points = ball(2500)
    loop = around(points)
    marks = {name: (row, row) for name, row in loop.items()}
    cloud = pointmorph.Cloud(points)
    other = pointmorph.Cloud(3.0 * points + 1.0)
    proposed = pointmorph.propose_loop(cloud, other, marks)
    assert sorted(proposed) == sorted(loop)
    taken = pointmorph.morph(cloud, other, marks, domain="cut").report["loop"]
    assert proposed == taken
    cut = pointmorph.decompose(cloud, {name: loop[name] for name in proposed})
    assert abs(int(cut.sides.sum())) < 0.1 * len(points)


def test_a_mesh_of_few_vertices_is_cut_as_its_morph_cuts_it() -> None:
    cube = pointmorph.Cloud(CUBE, faces=SQUARES)
    cut = pointmorph.decompose(cube, {"a": 0, "b": 1, "c": 3, "d": 2})
    assert np.abs(cut.curve[:, 2] + 1.0).max() < 0.18  # twice the distance between samples
    assert len(cut.curve) > 40  # as many as samples of the faces ask for
    assert list(cut.sides[:4]) == [0, 0, 0, 0]
    assert len(set(cut.sides[4:])) == 1
    assert cut.sides[4] != 0

    marks = {str(k): (k, k) for k in (0, 3, 1, 2)}
    other = pointmorph.Cloud(2.0 * CUBE, faces=SQUARES)
    taken = pointmorph.morph(cube, other, marks, domain="cut").report["loop"]
    assert pointmorph.propose_loop(cube, other, marks) == taken == ["0", "2", "3", "1"]


def test_a_loop_through_all_corners_of_a_cube_cuts_it() -> None:
    cube, other = (pointmorph.Cloud(size * CUBE, faces=SQUARES) for size in (1.0, 2.0))
    proposed = pointmorph.propose_loop(cube, other, {str(k): (k, k) for k in range(8)})
    assert sorted(proposed) == [str(k) for k in range(8)]
    places = CUBE[[int(name) for name in proposed]]
    assert np.linalg.norm(np.roll(places, -1, axis=0) - places, axis=1).max() < 2.1  # its edges
    cut = pointmorph.decompose(cube, {name: int(name) for name in proposed})
    assert set(cut.sides) == {0}
    assert len(cut.curve) > 80


def test_no_loop_is_proposed_for_too_few_marks_or_an_open_patch() -> None:
    cloud = pointmorph.Cloud(ball(800))
    with pytest.raises(pointmorph.FeatureError, match="at least 3"):
        pointmorph.propose_loop(cloud, cloud, {"a": (0, 0), "b": (700, 700)})
    patch = pointmorph.Cloud(grid(21))
    with pytest.raises(pointmorph.FeatureError, match="is open and needs no loop"):
        pointmorph.propose_loop(patch, patch, {"a": (30, 30), "b": (50, 50), "c": (300, 300)})
    with pytest.raises(pointmorph.Cancelled):
        pointmorph.propose_loop(
            cloud, cloud, {"a": (0, 0)}, progress=lambda stage, _: stage != "covariance"
        )
