"""What shapes have besides their form, carried along maps that are known exactly."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from conftest import SHARED
from pointmorph import formats
from pointmorph.meshes import triangulate
from pointmorph.meshes.local_frames import local_frames
from pointmorph.morphs.carrying import Carrier
from shapes import CUBE, SQUARES, ball, grid, grid_faces

Array = npt.NDArray[Any]


def turned(angle: float, axis: tuple[float, float, float]) -> Array:
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def bumpy(side: int = 15) -> tuple[Array, Array]:
    return grid(side, height=0.5, dtype=np.float64), grid_faces(side)


def tube(sides: int, rings: int, start: float = 0.0) -> tuple[Array, Array]:
    """A tube about the z axis, its first column of points at an angle; the faces of its last column
    are across the seam at that angle."""
    angles = start + 2 * np.pi * np.arange(sides) / sides
    heights = np.linspace(0, 2, rings)
    points = [[np.cos(a), np.sin(a), z] for z in heights for a in angles]
    faces = []
    for ring in range(rings - 1):
        for side in range(sides):
            a, b = ring * sides + side, ring * sides + (side + 1) % sides
            faces += [[a, b, b + sides], [a, b + sides, a + sides]]
    return np.array(points), np.array(faces)


def unrolled(sides: int, faces: Array, points: Array) -> Array:
    """UVs of a tube's corners: once around the image, with a seam."""
    share = (faces % sides) / sides
    share[(share.max(axis=1, keepdims=True) > 0.9) & (share < 0.1)] += 1.0
    return np.stack([share, points[faces][:, :, 2] / 2], axis=2).reshape(-1, 2)


def by_corner(faces: Array) -> tuple[Array, Array, Array]:
    """What corner_values needs: the giver's corners, and the taker's vertices and faces."""
    rows = np.arange(3 * len(faces))
    return rows.reshape(-1, 3), faces.reshape(-1), rows // 3


# --- Known maps -----------------------------------------------------------------------------------


def test_the_identity_changes_nothing() -> None:
    points, faces = bumpy()
    carrier = Carrier(points, points, points, faces, faces)
    rng = np.random.default_rng(1)
    values, offsets = rng.uniform(size=(len(points), 5)), rng.normal(size=(len(points), 3))
    np.testing.assert_allclose(carrier.frames, np.tile(np.eye(3), (len(points), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(carrier.values(values), values, atol=1e-12)
    np.testing.assert_allclose(carrier.returned(values), values, atol=1e-12)
    np.testing.assert_allclose(carrier.displacements(offsets), offsets, atol=1e-12)
    ends = points + np.array([0, 0, 0.1])
    strands = carrier.strands(ends, np.arange(len(points)))
    np.testing.assert_allclose(strands.points, ends, atol=1e-12)


@pytest.mark.parametrize("with_faces", [True, False])
@pytest.mark.parametrize("far", [0.0, 1e4])
def test_a_copy_that_is_turned_and_larger(with_faces: bool, far: float) -> None:
    """Offsets, and hair, are turned and scaled back exactly."""
    points, triangles = bumpy()
    faces = triangles if with_faces else None
    matrix = 2.5 * turned(2.0, (1, 2, 3))
    images = points @ matrix.T + far
    carrier = Carrier(points + far, images, images, faces, faces)
    np.testing.assert_allclose(
        carrier.frames, np.tile(matrix, (len(points), 1, 1)), atol=1e-9 + 1e-11 * far
    )
    offsets = np.random.default_rng(2).normal(size=points.shape)
    np.testing.assert_allclose(
        carrier.displacements(offsets @ matrix.T), offsets, atol=1e-9 + 1e-11 * far
    )
    hair = np.concatenate([points, points + np.array([0.1, 0, 0.2])])
    roots = np.tile(np.arange(len(points)), 2)
    strands = carrier.strands(hair @ matrix.T + far, roots)
    np.testing.assert_allclose(strands.points, hair + far, atol=1e-9 + 1e-11 * far)


def test_stretched_along_one_axis() -> None:
    """Along the surface as the map stretches it, across by the mean."""
    points, faces = grid(9, dtype=np.float64), grid_faces(9)
    images = points * [4, 1, 1]
    carrier = Carrier(points, images, images, faces, faces)
    np.testing.assert_allclose(
        carrier.frames, np.tile(np.diag([4.0, 1.0, 2.0]), (81, 1, 1)), atol=1e-12
    )
    offsets = np.tile([4.0, 1.0, 2.0], (81, 1))
    np.testing.assert_allclose(carrier.displacements(offsets), np.ones((81, 3)), atol=1e-12)


@pytest.mark.parametrize("with_faces", [True, False])
@pytest.mark.parametrize("side", [21, 41])
def test_a_sheet_that_is_bent(with_faces: bool, side: int) -> None:
    """Onto a tube: the frames are known, but for what a mean over a bend differs."""
    points = grid(side, dtype=np.float64)
    faces = grid_faces(side) if with_faces else None
    angle = 1.5 * points[:, 0]
    images = np.stack([np.sin(angle) / 1.5, points[:, 1], (1 - np.cos(angle)) / 1.5], axis=1)
    known = np.zeros((len(points), 3, 3))
    known[:, 0] = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    known[:, 1, 1] = 1.0
    known[:, 2] = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    carrier = Carrier(points, images, images, faces, faces)
    spacing = 2.0 / (side - 1)
    inside = np.abs(points[:, :2]).max(axis=1) < 1.0 - max(4.0 * spacing, 0.2)
    error = np.abs(carrier.frames - known).max(axis=(1, 2))
    assert error[inside].max() < (0.01 if with_faces else 2.0 * spacing**2 + 0.01)
    assert error.max() < 3.0 * spacing + 0.05  # a border sees one side only
    up = np.einsum("nij,j->ni", known, [0.0, 0.0, 1.0])
    moved = carrier.displacements(up)
    np.testing.assert_allclose(moved[inside], np.tile([0, 0, 1.0], (inside.sum(), 1)), atol=0.05)
    strands = carrier.strands(np.concatenate([images, images + up]), np.tile(range(side**2), 2))
    grown = (strands.points[side**2 :] - strands.points[: side**2])[inside]
    np.testing.assert_allclose(grown, np.tile([0, 0, 1.0], (inside.sum(), 1)), atol=0.05)


def test_vertices_that_share_a_place_have_one_frame() -> None:
    points, faces = bumpy(8)
    split = points[faces].reshape(-1, 3)  # no two faces share a vertex
    images = np.stack([split[:, 0], split[:, 1], split[:, 2] * 3], axis=1)
    loose = np.arange(len(split)).reshape(-1, 3)
    together = local_frames(points, points * [1, 1, 3], faces)
    np.testing.assert_allclose(local_frames(split, images, loose), together[faces.reshape(-1)])


def test_strands_say_where_they_are_attached() -> None:
    points, faces = bumpy()
    carrier = Carrier(points, 2 * points, 2 * points, faces, faces)
    roots = 2 * points[faces].mean(axis=1)
    strands = carrier.strands(roots, np.arange(len(roots)))
    assert strands.triangles is not None
    assert np.array_equal(strands.triangles, np.arange(len(faces)))
    np.testing.assert_allclose(strands.shares, 1 / 3)
    np.testing.assert_allclose(strands.scales, 0.5)


# --- Seams ----------------------------------------------------------------------------------------


def test_uvs_of_the_same_mesh_stay_at_both_sides_of_a_seam() -> None:
    points, faces = tube(24, 6)
    uvs = unrolled(24, faces, points)
    carrier = Carrier(points, points, points, faces, faces)
    found, across = carrier.corner_values(uvs, *by_corner(faces))
    np.testing.assert_allclose(found, uvs, atol=1e-12)
    assert not len(across)


def test_a_face_across_a_seam_goes_with_the_side_of_its_middle() -> None:
    points, faces = tube(48, 9)
    uvs = unrolled(48, faces, points)
    own, own_faces = tube(20, 5, start=0.13)
    corners = by_corner(faces)[0], *by_corner(own_faces)[1:]
    carrier = Carrier(own, own, points, own_faces, faces)
    found, across = carrier.corner_values(uvs, *corners)
    span = np.ptp(found.reshape(-1, 3, 2), axis=1)
    assert span[:, 0].max() < 1.2 / 20  # no face goes all around the image
    angles = np.unwrap(np.arctan2(own[own_faces][:, :, 1], own[own_faces][:, :, 0]), axis=1)
    torn = (np.floor(angles / (2 * np.pi)).max(axis=1)) > np.floor(angles / (2 * np.pi)).min(axis=1)
    assert np.array_equal(across, np.flatnonzero(torn))
    # What isn't torn has the UVs of its place: facets of the giver are off by little.
    shares = (angles / (2 * np.pi)) % 1.0
    np.testing.assert_allclose(found.reshape(-1, 3, 2)[~torn][:, :, 0], shares[~torn], atol=0.002)
    assert found[:, 0].min() >= 0.0
    assert found[:, 0].max() <= 1.0 + 1e-12


def test_a_seam_between_islands() -> None:
    """Two halves of a sheet whose images lie far apart."""
    points, faces = grid(9, dtype=np.float64), grid_faces(9)
    left = points[faces][:, :, 0].mean(axis=1) < 0.0
    uvs = 0.1 * points[faces][:, :, :2]
    uvs[left] += [5.0, 5.0]
    own, own_faces = grid(8, dtype=np.float64), grid_faces(8)
    carrier = Carrier(own, own, points, own_faces, faces)
    corners = by_corner(faces)[0], *by_corner(own_faces)[1:]
    found, across = carrier.corner_values(uvs.reshape(-1, 2), *corners)
    found = found.reshape(-1, 3, 2)
    assert len(across) == 14  # of 7 rows of squares
    place = own[own_faces][:, :, :2]
    is_left = place[:, :, 0].mean(axis=1) < 0.0
    inside = np.where(is_left[:, None], np.minimum(place[..., 0], 0), np.maximum(place[..., 0], 0))
    wanted = 0.1 * np.stack([inside, place[..., 1]], axis=2)
    wanted[is_left] += [5.0, 5.0]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


# --- What isn't as it should be -------------------------------------------------------------------


def test_a_pocket_that_the_other_shape_has_not_got_goes_with_what_is_around() -> None:
    """As that of a mouth: its walls are squeezed flat, where a differential means nothing."""
    flat, faces = grid(61, dtype=np.float64), grid_faces(61)
    away = np.linalg.norm(flat[:, :2], axis=1)
    inside = np.clip((0.15 - away) / 0.07, 0.0, 1.0)
    pocket = flat - inside[:, None] * [0.0, 0.0, 0.5]
    carrier = Carrier(pocket, flat, flat, faces, faces)
    moved = carrier.displacements(np.tile([0.0, 0.0, 1.0], (len(flat), 1)))
    assert np.linalg.norm(moved, axis=1).max() < 1.6
    assert moved[:, 2].min() > 0.7
    np.testing.assert_allclose(moved[away > 0.5], [[0.0, 0.0, 1.0]] * (away > 0.5).sum(), atol=0.05)


def test_a_collapsed_map_gives_no_long_offsets() -> None:
    points, faces = bumpy(8)
    images = points.copy()
    images[20:30] = images[20]
    images[40] = images[41]
    carrier = Carrier(points, images, points, faces, faces)
    moved = carrier.displacements(np.ones_like(points))
    assert np.isfinite(moved).all()
    assert np.linalg.norm(moved, axis=1).max() < 20
    nowhere = Carrier(points, 0 * points, points, faces, faces)
    assert np.isfinite(nowhere.displacements(np.ones_like(points))).all()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_points(count: int) -> None:
    points = np.arange(3.0 * count).reshape(count, 3)
    carrier = Carrier(points, 2 * points, 2 * points)
    np.testing.assert_allclose(carrier.values(2 * points), 2 * points, atol=1e-9)
    assert np.isfinite(carrier.displacements(points)).all()


def test_points_without_a_face_and_flat_faces() -> None:
    points, faces = bumpy(6)
    points = np.concatenate([points, [[3.0, 3, 3]]])
    faces = np.concatenate([faces, [[0, 0, 1]]])
    matrix = turned(1.0, (0, 0, 1))
    carrier = Carrier(points, points @ matrix.T, points @ matrix.T, faces, faces)
    np.testing.assert_allclose(carrier.frames, np.tile(matrix, (37, 1, 1)), atol=1e-9)


def test_errors_name_what_does_not_fit() -> None:
    points, faces = bumpy(6)
    with pytest.raises(pointmorph.CloudError, match="images: expected a table with 36 rows"):
        Carrier(points, points[:5], points)
    with pytest.raises(pointmorph.CloudError, match="values: expected a table with 36 rows"):
        Carrier(points, points, points).values(np.ones((5, 1)))
    with pytest.raises(pointmorph.CloudError, match="faces: expected triangles"):
        Carrier(points, points, points, faces[:, :2])
    with pytest.raises(pointmorph.CloudError, match="corner values: expected a shape with faces"):
        Carrier(points, points, points, faces).corner_values(points, *by_corner(faces))


WRONG_CALLS = {
    "positions: expected finite numbers": lambda p, f: Carrier(p * np.nan, p, p, f, f),
    "images: expected finite numbers": lambda p, f: Carrier(p, p * np.inf, p, f, f),
    "onto: expected a table with 3 columns": lambda p, f: Carrier(p, p, p[:, :2], f, f),
    "onto: expected at least one point": lambda p, f: Carrier(p, p, p[:0], f),
    "^faces: expected rows 0 to 35, found 0 to 36": lambda p, f: Carrier(p, p, p, _one_off(f), f),
    "onto_faces: expected rows 0 to 35": lambda p, f: Carrier(p, p, p, f, _one_off(f)),
    "^faces: expected whole numbers": lambda p, f: Carrier(p, p, p, f + 0.5, f),
    "offsets: expected a table with 3 columns": lambda p, f: _whole(p, f).displacements(p[:, :2]),
    "offsets: expected a table with 36 rows": lambda p, f: _whole(p, f).displacements(p[:5]),
    "values: expected a table of numbers": lambda p, f: _whole(p, f).values([["red"]] * 36),
    "values: expected a table with 36 rows": lambda p, f: _whole(p, f).returned(p[0]),
    "points: expected a table with 3 columns": lambda p, f: _whole(p, f).strands(p[:, :2], [0]),
    "roots: expected 36, one for each point": lambda p, f: _whole(p, f).strands(p, [0, 0]),
    "roots: expected rows 0 to 35": lambda p, f: _whole(p, f).strands(p, np.full(36, 36)),
    "roots: expected a list": lambda p, f: _whole(p, f).strands(p, np.zeros((36, 1), int)),
    "triangle_corners: expected a table with": lambda p, f: _corners(p, f, corners=f[:3]),
    "triangle_corners: expected rows": lambda p, f: _corners(p, f, corners=_one_off(f) * 9),
    "vertices: expected rows 0 to 35": lambda p, f: _corners(p, f, vertices=_one_off(f).ravel()),
    "^faces: expected [0-9]+, one for each corner": lambda p, f: _corners(p, f, faces=[0]),
    "^faces: expected rows": lambda p, f: _corners(p, f, faces=np.full(f.size, -1)),
}


def _whole(points: Any, faces: Any) -> Carrier:
    return Carrier(points, points, points, faces, faces)


def _one_off(faces: Any) -> Any:
    """With a row that there isn't."""
    result = faces.copy()
    result[-1, -1] = 36
    return result


def _corners(points: Any, triangles: Any, **wrong: Any) -> Any:
    corners, vertices, owners = by_corner(triangles)
    given = {"corners": corners, "vertices": vertices, "faces": owners, **wrong}
    values = points[triangles.ravel()]
    return _whole(points, triangles).corner_values(
        values, given["corners"], given["vertices"], given["faces"]
    )


@pytest.mark.parametrize("said", WRONG_CALLS)
def test_wrong_arguments_are_named(said: str) -> None:
    with pytest.raises(pointmorph.CloudError, match=said):
        WRONG_CALLS[said](*bumpy(6))


# --- Morphs ---------------------------------------------------------------------------------------


def test_a_morph_carries_both_ways() -> None:
    points, faces = grid(20, 0.5, np.float64), grid_faces(20)
    other, other_faces = grid(16, 0.5, np.float64), grid_faces(16)
    matrix = 2 * turned(0.4, (0, 0, 1))
    source = pointmorph.Cloud(points, faces=faces)
    target = pointmorph.Cloud(other @ matrix.T, faces=other_faces)
    corners = {
        f"{k}": (a, b) for k, (a, b) in enumerate([(0, 0), (19, 15), (380, 240), (399, 255)])
    }
    morph = pointmorph.morph(source, target, corners)
    ramp = 1 + other[:, :1]
    np.testing.assert_allclose(morph.carrier().values(ramp), 1 + points[:, :1], atol=0.05)
    found = morph.carrier("target").values(1 + points[:, :1])
    np.testing.assert_allclose(found, ramp, atol=0.05)
    offsets = np.tile([0.2, 0.0, 0.4], (256, 1)) @ matrix.T
    found = morph.carrier().displacements(offsets)
    assert np.abs(np.median(found, axis=0) - [0.2, 0.0, 0.4]).max() < 0.02
    back = morph.carrier("target").displacements(np.tile([0.2, 0.0, 0.4], (400, 1)))
    assert np.abs(np.median(back - offsets, axis=0)).max() < 0.04
    with pytest.raises(pointmorph.OptionError, match="side: expected source or target"):
        morph.carrier("middle")


def test_a_morph_of_polygons_and_of_points() -> None:
    offsets, corners = pointmorph.Cloud(CUBE, faces=SQUARES).faces or (None, None)
    triangles, rows = triangulate(CUBE, offsets, corners)
    assert triangles.shape == rows.shape == (12, 3)
    assert sorted(set(rows.ravel().tolist())) == list(range(24))
    points = ball(400)
    morph = pointmorph.morph(pointmorph.Cloud(points), pointmorph.Cloud(3 * points))
    carrier = morph.carrier()
    found = carrier.displacements(3 * points)  # outward, by its own size
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 0.2
    assert np.einsum("ni,ni->n", found, points).min() > 0.95


def test_a_smile_on_two_real_faces() -> None:
    """The corner of the mouth goes toward the eye, on a face that lies differently, too."""
    folder = SHARED / "face_nefertiti"
    if not folder.is_dir():
        pytest.skip("the real pair face_nefertiti is not beside this checkout")
    source, target = (formats.read(folder / f"{side}.ply").cloud() for side in ("source", "target"))
    marks = json.loads((folder / "pair.json").read_text())["features"]
    assert source.faces is not None
    assert target.faces is not None
    matrix = 3 * turned(2.0, (1, 1, 0))
    positions = source.positions @ matrix.T
    target_faces = triangulate(target.positions, *target.faces)[0]
    ends = (
        pointmorph.Cloud(positions, faces=triangulate(source.positions, *source.faces)[0]),
        pointmorph.Cloud(target.positions, faces=target_faces),
    )
    carrier = pointmorph.morph(*ends, marks).carrier()
    size = np.ptp(target.positions, axis=0).max()
    for corner, eye in (("l_mouth", "l_eye_out"), ("r_mouth", "r_eye_out")):
        row, there = marks[corner]
        up = target.positions[marks[eye][1]] - target.positions[there]
        near = np.linalg.norm(target.positions - target.positions[there], axis=1)
        offsets = np.exp(-((near / (0.08 * size)) ** 2))[:, None] * up
        moved = carrier.displacements(offsets)
        wanted = positions[marks[eye][0]] - positions[row]
        cosine = moved[row] @ wanted / np.linalg.norm(moved[row]) / np.linalg.norm(wanted)
        assert cosine > np.cos(np.radians(25))
        assert 0.6 < np.linalg.norm(moved[row]) / np.linalg.norm(wanted) < 1.6
        # Not even in the pocket of the mouth, which the other face hasn't got.
        longest = np.linalg.norm(moved, axis=1).max()
        assert longest < 1.6 * np.linalg.norm(moved[row])
