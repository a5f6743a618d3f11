"""Morphs of meshes: the map is found on samples of their faces, the vertices follow."""

from __future__ import annotations

import itertools
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
import trimesh
from pointmorph import formats
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


@cache
def cube_to_ball() -> pointmorph.Morph:
    points, faces = ball()
    return pointmorph.morph(
        pointmorph.Cloud(CUBE, faces=SQUARES), pointmorph.Cloud(points, faces=faces)
    )


def covers(pairs: Array, sources: int, targets: int) -> bool:
    return set(pairs[:, 0]) == set(range(sources)) and set(pairs[:, 1]) == set(range(targets))


def test_a_cube_of_eight_vertices_becomes_a_ball() -> None:
    morph = cube_to_ball()
    for one in (morph, pointmorph.morph(morph.target, morph.source)):
        assert covers(one.pairs, len(one.source), len(one.target))
        assert one.frame(0.5).positions.shape == (len(one.pairs), 3)
        assert np.isfinite(one.wrapped(1.0)).all()
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
    assert any("ball" in w and "inward" in w for w in morph.report["warnings"])
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
    straight = pointmorph.morph(source, target, marks, path="linear")
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
    assert "Folded" not in names  # which is of points


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


def test_the_target_s_mesh_wraps_onto_the_source() -> None:
    points, faces = ball()
    longer = points * (1.0, 1.3, 1.6)
    # So many that the pose needn't be searched for, which takes longer than all the rest.
    marks = {str(row): (row, row) for row in range(0, len(points), 60)}
    ends = pointmorph.Cloud(points, faces=faces), pointmorph.Cloud(longer, faces=faces)
    for path in ("linear", "rigid"):
        morph = pointmorph.morph(*ends, marks, path=path)
        assert morph.has_target_mesh
        assert np.array_equal(morph.wrapped_target(1.0), longer)
        there = morph.wrapped_target(0.0)
        assert np.array_equal(there[300], points[300])
        assert np.abs(np.linalg.norm(there, axis=1) - 1).max() < 0.02
        half = morph.wrapped_target(0.5)
        assert np.linalg.norm(half - 0.5 * (there + longer), axis=1).max() < 0.1
    back = pointmorph.morph(ends[1], ends[0], {name: (t, s) for name, (s, t) in marks.items()})
    assert back.wrapped(1.0).shape == there.shape
    with pytest.raises(pointmorph.CloudError, match="faces"):
        pointmorph.morph(ends[0], pointmorph.Cloud(longer)).wrapped_target(0.5)


def test_symmetric_models_stay_symmetric() -> None:
    points, faces = ball(24, 32)
    source = points * (1.0, 1.0, 1.5)
    target = source.copy()
    target[:, 1] *= 0.7 + 0.3 * np.cos(3 * points[:, 2])
    mirrored = points * (-1.0, 1.0, 1.0)
    mirror = np.array([np.linalg.norm(points - place, axis=1).argmin() for place in mirrored])
    assert np.allclose(points[mirror], mirrored)
    rows = [0, len(points) - 1, int(points[:, 0].argmax()), int(points[:, 1].argmax())]
    morph = pointmorph.morph(
        pointmorph.Cloud(source, faces=faces),
        pointmorph.Cloud(target, faces=faces),
        {str(row): (row, row) for row in rows},
    )
    spacing = np.sqrt(4 * np.pi / len(points))

    def lopsided(images: Array) -> Any:
        off = images[mirror] - images * (-1.0, 1.0, 1.0)
        return np.linalg.norm(off, axis=1).mean() / spacing

    assert lopsided(morph.wrapped(1.0)) < lopsided(morph.source_to_target) + 0.02
    assert lopsided(morph.wrapped(1.0)) < 0.3


def test_rigid_vertices_keep_their_shape_and_fixed_ones_stay() -> None:
    points, faces = ball()
    target = points * (1.0, 1.0, 2.0)
    top = (points[:, 2] > 0.8).astype(float)
    bottom = (points[:, 2] < -0.8).astype(float)
    morph = pointmorph.morph(
        pointmorph.Cloud(points, faces=faces, rigid=top, fixed=bottom),
        pointmorph.Cloud(target, faces=faces),
    )
    ends = morph.wrapped(1.0)
    assert np.array_equal(ends[bottom == 1], points[bottom == 1])
    cap, there = points[top == 1], ends[top == 1]
    sizes = np.linalg.norm(there - there.mean(0), axis=1) / np.linalg.norm(
        cap - cap.mean(0), axis=1
    )
    assert np.allclose(sizes, sizes[0])


@pytest.mark.parametrize("weights", [np.full(8, 1.5), np.full(8, -0.1), np.ones(7)])
def test_weights_are_checked(weights: Array) -> None:
    with pytest.raises(pointmorph.CloudError, match="rigid"):
        pointmorph.morph(
            pointmorph.Cloud(CUBE, faces=SQUARES, rigid=weights),
            pointmorph.Cloud(CUBE, faces=SQUARES),
        )


def test_wrapping_has_settings() -> None:
    ends = cube_to_ball().source, cube_to_ball().target
    firm = cube_to_ball().wrapped(1.0)
    loose = pointmorph.morph(*ends, wrap_conform=0.0).wrapped(1.0)
    assert not np.array_equal(firm, loose)
    relaxed = pointmorph.morph(*ends, wrap_relax=10).wrapped(1.0)
    assert np.isfinite(relaxed).all()
    assert np.array_equal(pointmorph.morph(*ends, wrap_relax=0).wrapped(1.0), firm)


def test_a_denser_mesh_carries_what_vertices_have() -> None:
    morph = cube_to_ball()
    mesh = morph.denser(tolerance=0.01)
    assert len(mesh.positions) == 8 + len(mesh.ends)
    assert np.array_equal(mesh.positions[:8], CUBE)
    assert np.array_equal(mesh.extended(CUBE), mesh.positions)
    assert mesh.extended(np.arange(8)).shape == (len(mesh.positions),)
    assert np.abs(np.linalg.norm(mesh.wrapped, axis=1) - 1).max() < 0.05
    assert set(mesh.parents) <= set(range(6))
    for face, parent in zip(mesh.faces, mesh.parents, strict=True):
        across = np.ptp(CUBE[SQUARES[parent]], axis=0) == 0
        assert np.array_equal(
            mesh.positions[face][:, across], np.tile(CUBE[SQUARES[parent][0]][across], (3, 1))
        )
    for path in ("linear", "rigid"):
        moving = mesh.motion(path)
        assert np.array_equal(moving.at(1), mesh.wrapped)
        assert np.isfinite(moving.at(0.5)).all()
    with pytest.raises(pointmorph.OptionError):
        morph.denser("both")


def test_a_mesh_in_motion_keeps_its_faces() -> None:
    points, faces = ball()
    ends = points @ turn(2.0, (0.0, 0.0, 1.0)).T
    for given in (faces, None):
        motion = pointmorph.Motion(points, points, ends, "rigid", faces=given)
        assert np.abs(np.linalg.norm(motion.at(0.5), axis=1) - 1).max() < 1e-6


def bends(positions: Array, faces: Array) -> tuple[Array, Array]:
    """The two triangles at each edge, and the cosine of the angle by which it bends."""
    mesh = trimesh.Trimesh(positions, faces, process=False)
    sides = np.cross(
        positions[faces[:, 1]] - positions[faces[:, 0]],
        positions[faces[:, 2]] - positions[faces[:, 0]],
    )
    normals = sides / np.maximum(np.linalg.norm(sides, axis=1), 1e-30)[:, None]
    pairs = mesh.face_adjacency
    return pairs, (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1)


def test_no_face_of_real_models_turns_over_on_a_rigid_path(real_pair: Path) -> None:
    shapes = [formats.read(real_pair / f"{side}.ply") for side in ("source", "target")]
    faces = shapes[0].faces
    assert faces is not None
    morph = pointmorph.morph(shapes[0].cloud(), shapes[1].cloud(), path="rigid")
    ends = [bends(morph.wrapped(t), faces) for t in (0.0, 1.0)]
    pairs = ends[0][0]
    # Away from where faces are creased at an end.
    near = np.zeros(len(shapes[0].positions), bool)
    near[faces[pairs[np.minimum(ends[0][1], ends[1][1]) < 0].ravel()].ravel()] = True
    for _ in range(2):
        near[faces[near[faces].any(axis=1)].ravel()] = True
    away = ~near[faces[pairs].reshape(len(pairs), 6)].any(axis=1)
    assert away.mean() > 0.8
    for k in range(24):
        _, cosines = bends(morph.wrapped(k / 23), faces)
        assert (cosines[away] < -0.5).sum() == 0, k
