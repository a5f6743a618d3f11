"""Morphs of meshes: the map is found on samples of their faces, the vertices follow."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from shapes import CUBE, SQUARES

Array = npt.NDArray[Any]


def ball(rings: int = 24, sides: int = 32) -> tuple[Array, list[list[int]]]:
    """A sphere of squares with a fan of triangles at each pole."""
    points = [[0.0, 0.0, 1.0]]
    for ring in range(1, rings):
        height, radius = np.cos(np.pi * ring / rings), np.sin(np.pi * ring / rings)
        for side in range(sides):
            angle = 2 * np.pi * side / sides
            points.append([radius * np.cos(angle), radius * np.sin(angle), height])
    points.append([0.0, 0.0, -1.0])
    last = len(points) - 1
    faces = []
    for side in range(sides):
        after = (side + 1) % sides
        faces.append([0, 1 + side, 1 + after])
        faces.append([last, last - sides + after, last - sides + side])
        for ring in range(rings - 2):
            first = 1 + ring * sides
            faces.append([first + side, first + sides + side, first + sides + after, first + after])
    return np.array(points), faces


def turn(angle: float, axis: tuple[float, float, float]) -> Array:
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def covers(pairs: Array, sources: int, targets: int) -> bool:
    return set(pairs[:, 0]) == set(range(sources)) and set(pairs[:, 1]) == set(range(targets))


def test_a_cube_of_eight_vertices_becomes_a_ball() -> None:
    points, faces = ball()
    cube, sphere = pointmorph.Cloud(CUBE, faces=SQUARES), pointmorph.Cloud(points, faces=faces)
    for source, target in ((cube, sphere), (sphere, cube)):
        morph = pointmorph.morph(source, target)
        assert covers(morph.pairs, len(source), len(target))
        assert morph.frame(0.5).positions.shape == (len(morph.pairs), 3)
        assert np.isfinite(morph.wrapped(1.0)).all()
    morph = pointmorph.morph(cube, sphere)
    assert np.abs(np.linalg.norm(morph.wrapped(1.0), axis=1) - 1).max() < 0.05
    # Points of large faces aren't balls that hide each other.
    assert morph.frame(0).radii.max() < 0.26 * np.ptp(CUBE)


def test_the_corners_of_a_turned_cube_are_found() -> None:
    rotation = turn(0.7, (1.0, 2.0, 0.5))
    source = pointmorph.Cloud(CUBE, faces=SQUARES)
    target = pointmorph.Cloud(CUBE @ rotation.T, faces=SQUARES)
    marks = {str(k): (k, k) for k in (0, 1, 2, 7)}
    morph = pointmorph.morph(source, target, marks)
    off = np.linalg.norm(morph.wrapped(1.0) - target.positions, axis=1)
    assert off.max() < 0.1
    assert off[[0, 1, 2, 7]].max() == 0.0


def test_a_mesh_stays_itself() -> None:
    points, faces = ball(12, 16)
    cloud = pointmorph.Cloud(points, faces=faces)
    morph = pointmorph.morph(cloud, cloud)
    assert np.array_equal(morph.wrapped(0.0), points)
    assert np.array_equal(morph.wrapped(1.0), points)
    assert np.array_equal(morph.source_to_target, points)


def test_marks_meet_and_their_vertices_are_paired() -> None:
    points, faces = ball()
    longer = points * (1.0, 1.0, 1.6)
    marks = {"top": (0, 0), "bottom": (len(points) - 1, len(points) - 1), "side": (300, 300)}
    morph = pointmorph.morph(
        pointmorph.Cloud(points, faces=faces), pointmorph.Cloud(longer, faces=faces), marks
    )
    pairs = {tuple(pair) for pair in morph.pairs.tolist()}
    for s, t in marks.values():
        assert (s, t) in pairs
        assert np.array_equal(morph.source_to_target[s], longer[t])
        assert np.array_equal(morph.target_to_source[t], points[s])
        assert np.array_equal(morph.wrapped(1.0)[s], longer[t])


def test_a_bare_cloud_and_a_mesh() -> None:
    points, _ = ball()
    mesh, bare = pointmorph.Cloud(CUBE, faces=SQUARES), pointmorph.Cloud(points)
    morph = pointmorph.morph(mesh, bare)
    assert covers(morph.pairs, 8, len(points))
    assert np.abs(np.linalg.norm(morph.wrapped(1.0), axis=1) - 1).max() < 0.05
    with pytest.raises(pointmorph.CloudError, match="faces"):
        pointmorph.morph(bare, mesh).wrapped(1.0)


def test_a_bare_cloud_stays_what_it_was() -> None:
    points, _ = ball()
    plain = pointmorph.morph(pointmorph.Cloud(points), pointmorph.Cloud(2 * points))
    empty = pointmorph.morph(pointmorph.Cloud(points, faces=[]), pointmorph.Cloud(2 * points))
    assert np.array_equal(plain.source_to_target, empty.source_to_target)


def test_faces_inside_out_are_turned_and_said() -> None:
    points, faces = ball()
    inside_out = [face[::-1] for face in faces]
    morph = pointmorph.morph(
        pointmorph.Cloud(CUBE, faces=SQUARES, name="box"),
        pointmorph.Cloud(points, faces=inside_out, name="ball"),
    )
    assert any("ball" in w and "inside" in w for w in morph.report["warnings"])
    assert (morph.frame(1).normals * morph.frame(1).positions).sum(axis=1).min() > 0.9


def test_duplicate_vertices_stay_together() -> None:
    points, faces = ball(12, 16)
    corners = [k for face in faces for k in face]
    ends = np.cumsum([0, *map(len, faces)])
    split = [list(range(a, b)) for a, b in itertools.pairwise(ends)]
    morph = pointmorph.morph(
        pointmorph.Cloud(points[corners], faces=split), pointmorph.Cloud(CUBE, faces=SQUARES)
    )
    for images in (morph.source_to_target, morph.wrapped(1.0)):
        by_place: dict[int, Array] = {}
        for row, place in enumerate(corners):
            assert np.array_equal(images[row], by_place.setdefault(place, images[row]))


def test_a_mesh_on_its_way_bends_with_the_path() -> None:
    points, faces = ball()
    target = pointmorph.Cloud(points @ turn(2.0, (0.0, 0.0, 1.0)).T * 2.0, faces=faces)
    marks = {str(k): (k, k) for k in range(0, len(points), 40)}
    source = pointmorph.Cloud(points, faces=faces)
    straight = pointmorph.morph(source, target, marks)
    ends = straight.wrapped(1.0)
    assert np.allclose(straight.wrapped(0.25), 0.75 * points + 0.25 * ends)
    for path in ("similarity", "rigid"):
        bent = pointmorph.morph(source, target, marks, path=path)
        assert np.array_equal(bent.wrapped(0.0), points)
        assert np.linalg.norm(bent.wrapped(0.5), axis=1).min() > 1.3


def test_few_vertices_travel_on_every_path() -> None:
    target = pointmorph.Cloud(2.0 * CUBE @ turn(1.0, (1.0, 0.0, 0.0)).T, faces=SQUARES)
    for path in ("linear", "similarity", "rigid"):
        morph = pointmorph.morph(pointmorph.Cloud(CUBE, faces=SQUARES), target, path=path)
        assert np.isfinite(morph.wrapped(0.5)).all()
        assert np.isfinite(morph.frame(0.5).positions).all()
        assert np.isfinite(morph.resampled_frame(0.5).positions).all()
        assert morph.report["quality"]["source_to_target"]["coverage"] >= 0.0


@pytest.mark.parametrize("faces", [[[0, 1, 8]], [[0, -1, 2]], [[0.5, 1.5, 2.5]]])
def test_faces_of_other_rows_are_refused(faces: Any) -> None:
    with pytest.raises(pointmorph.CloudError):
        pointmorph.Cloud(CUBE, faces=faces)


def test_wrapped_refuses_times_outside() -> None:
    cloud = pointmorph.Cloud(CUBE, faces=SQUARES)
    with pytest.raises(pointmorph.OptionError):
        pointmorph.morph(cloud, cloud).wrapped(1.5)


def test_the_report_says_how_good_the_mesh_looks() -> None:
    points, faces = ball()
    sphere = pointmorph.Cloud(points, faces=faces, name="ball")
    morph = pointmorph.morph(sphere, pointmorph.Cloud(2.0 * points, faces=faces, name="big"))
    mesh = morph.report["mesh"]
    assert json.loads(json.dumps(mesh))["grade"] == "good"
    assert mesh["verdict"] == "Good: the faces of ball lie smoothly on big."
    assert mesh["worst"] == ()
    names = [name for name, _ in pointmorph.quality_summary(morph.report)]
    assert names[-4:] == [
        "Faces folded",
        "Edges creased",
        "Target missed",
        "Off the target",
    ]


def test_a_mesh_that_is_too_coarse_says_where() -> None:
    points, faces = ball()
    points[0] *= 2.5  # a spike
    morph = pointmorph.morph(
        pointmorph.Cloud(CUBE, faces=SQUARES, name="cube"),
        pointmorph.Cloud(points, faces=faces, name="spiky"),
    )
    quality = morph.mesh_quality
    assert quality.grade == "poor"
    assert quality.verdict.startswith("Poor: ")
    place = quality.worst[0]
    assert place.flaw in ("uncovered", "off")
    assert 0 <= place.source < len(CUBE)
    assert 0 <= place.target < len(points)
    assert place.advice.endswith(".")
    assert np.linalg.norm(place.position) < 3.0


def test_bare_clouds_have_no_mesh_to_measure() -> None:
    points, _ = ball()
    morph = pointmorph.morph(pointmorph.Cloud(points), pointmorph.Cloud(2.0 * points))
    assert "mesh" not in morph.report
    with pytest.raises(pointmorph.CloudError):
        _ = morph.mesh_quality
