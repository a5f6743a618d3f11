"""Where one model ends and the other goes on: left as it is, or stretched over the other."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Any

import made_models
import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from compare_measures import cloud_area
from made_bodies import Body
from made_figures import FIGURES, limb_numbers
from scipy.spatial import cKDTree

Array = npt.NDArray[Any]
RINGS, SIDES = 40, 32


def whole() -> tuple[Array, Array]:
    """An egg three times as long as wide, and bent: positions (V, 3) and faces, ring by ring."""
    angles = np.linspace(0.02 * np.pi, 0.98 * np.pi, RINGS)
    around = 2 * np.pi * np.arange(SIDES) / SIDES
    along = -3 * np.cos(angles)
    positions = np.stack(
        [
            np.sin(angles)[:, None] * np.cos(around) + 0.1 * along[:, None] ** 2,
            0.7 * np.sin(angles)[:, None] * np.sin(around),
            np.broadcast_to(along[:, None], (RINGS, SIDES)),
        ],
        axis=2,
    ).reshape(-1, 3)
    rows = np.arange(RINGS * SIDES).reshape(RINGS, SIDES)
    here, there = rows[:-1], rows[1:]
    quads = np.stack([here, np.roll(here, -1, 1), np.roll(there, -1, 1), there], axis=2)
    quads = quads.reshape(-1, 4)
    # Both ends are closed.
    caps = [[*rows[0][::-1]], [*rows[-1]]]
    triangles = [[cap[0], cap[k], cap[k + 1]] for cap in caps for k in range(1, SIDES - 1)]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], np.array(triangles)])
    return positions, faces


def part(positions: Array, faces: Array, last_ring: int) -> tuple[Array, Array]:
    kept = faces[(faces < last_ring * SIDES).all(axis=1)]
    return positions[: last_ring * SIDES], kept


def turned(positions: Array) -> Array:
    c, s = np.cos(0.7), np.sin(0.7)
    return positions @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T * 2.0 + 5.0


MARKS = {
    f"{ring} {side}": (ring * SIDES + side, ring * SIDES + side)
    for ring in (6, 16)
    for side in (0, 8, 16, 24)
}


@pytest.fixture(scope="module")
def morphs() -> dict[str, pointmorph.Morph]:
    positions, faces = whole()
    points, kept = part(positions, faces, 26)
    source = pointmorph.Cloud(points, faces=kept, name="half")
    target = pointmorph.Cloud(turned(positions), faces=faces, name="egg")
    return {
        choice: pointmorph.morph(source, target, MARKS, missing_parts=choice)
        for choice in ("leave", "stretch")
    }


def off(morph: pointmorph.Morph) -> float:
    """Mean distance of the images from where the points belong, in lengths of the source."""
    positions, _ = whole()
    truth = turned(positions)[: len(morph.source_to_target)]
    return float(np.linalg.norm(morph.source_to_target - truth, axis=1).mean() / 2.0)


def test_what_is_there_stays_where_it_belongs(morphs: dict[str, pointmorph.Morph]) -> None:
    assert off(morphs["leave"]) < 0.05
    assert off(morphs["leave"]) < 0.5 * off(morphs["stretch"])


def test_every_point_is_still_in_a_pair(morphs: dict[str, pointmorph.Morph]) -> None:
    for morph in morphs.values():
        pairs = np.asarray(morph.pairs)
        assert set(pairs[:, 0]) == set(range(26 * SIDES))
        assert set(pairs[:, 1]) == set(range(RINGS * SIDES))


def test_what_is_missing_comes_out_of_the_border(morphs: dict[str, pointmorph.Morph]) -> None:
    positions, _ = whole()
    border = positions[25 * SIDES : 26 * SIDES]
    back = morphs["leave"].target_to_source[30 * SIDES :]
    gaps = np.linalg.norm(back[:, None] - border[None], axis=2).min(axis=1)
    assert np.percentile(gaps, 95) < 0.25  # rings are .2 apart there


def test_it_is_said(morphs: dict[str, pointmorph.Morph]) -> None:
    said = [w for w in morphs["leave"].report["warnings"] if "half ends where egg goes on" in w]
    assert len(said) == 1
    assert not [w for w in morphs["stretch"].report["warnings"] if "goes on" in w]


def test_the_time_it_takes_is_that_of_a_stage(morphs: dict[str, pointmorph.Morph]) -> None:
    assert morphs["leave"].report["stages"]["missing parts"] > 0.0
    assert pointmorph.stage_label("missing parts") == "Finding missing parts"
    assert "missing parts" not in morphs["stretch"].report["stages"]


def test_the_wrapped_mesh_is_not_dragged_over_it(morphs: dict[str, pointmorph.Morph]) -> None:
    positions, faces = whole()
    _, kept = part(positions, faces, 26)
    before = np.linalg.norm(positions[kept[:, 0]] - positions[kept[:, 2]], axis=1) * 2.0

    def largest(morph: pointmorph.Morph) -> float:
        after = morph.wrapped(1.0)
        edges = np.linalg.norm(after[kept[:, 0]] - after[kept[:, 2]], axis=1)
        return float((edges / before).max())

    assert largest(morphs["leave"]) < 1.6 < 2.0 < largest(morphs["stretch"])
    # It misses nothing that it should have.
    assert morphs["leave"].mesh_quality.uncovered < 0.01
    assert morphs["leave"].mesh_quality.grade == "good"
    # The egg's own mesh ends as a whole, closed: it is the half that lacks something.
    assert np.isfinite(morphs["leave"].wrapped_target(0.0)).all()


SPIKES = np.array([(1.2, 0, 0), (0, 0.9, 0.2), (-0.3, -0.5, 0.6), (-0.5, 0.2, -0.8)])


def spiky(count: int, seed: int, lost: int | None = None) -> Array:
    """A ball with four spikes of different lengths, or without one of them: (N, 3)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    ball = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    ball = ball @ np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0].T
    lengths = np.linalg.norm(SPIKES, axis=1)
    cosines = ball @ (SPIKES / lengths[:, None]).T
    positions = ball * (0.5 + np.exp((cosines - 1) / 0.06) @ lengths)[:, None]
    if lost is None:
        return positions
    along = positions @ SPIKES[lost] / lengths[lost]
    return positions[~((cosines[:, lost] > 0.8) & (along > 0.75))]


@pytest.mark.parametrize("lost", [0, 1, 2])
@pytest.mark.parametrize("is_source", [True, False])
def test_without_marks_a_part_lies_where_it_belongs(lost: int, is_source: bool) -> None:
    part, whole = spiky(3000, 1, lost), spiky(3000, 2)
    c, s = np.cos(2.0), np.sin(2.0)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [
        [1, 0, 0],
        [0, -0.6, -0.8],
        [0, 0.8, -0.6],
    ]
    clouds = [pointmorph.Cloud(part), pointmorph.Cloud(whole @ turn.T)]
    morph = pointmorph.morph(*(clouds if is_source else clouds[::-1]))
    images = morph.source_to_target if is_source else morph.target_to_source
    assert np.linalg.norm(images - part @ turn.T, axis=1).mean() < 0.03
    assert morph.report["confidence"] > 0.9


# Each is morphed in both directions.
alone_pair, cut_pair = cache(made_models.alone_pair), cache(made_models.cut_pair)


def named(name: str, shape: Body) -> pointmorph.Cloud:
    return pointmorph.Cloud(shape.positions, normals=shape.normals, name=name)


@pytest.mark.parametrize(("seed", "farthest"), [(1, 0.4), (5, 0.3)])
@pytest.mark.parametrize("is_source", [True, False])
def test_a_head_alone_goes_to_the_head_of_another_body(
    is_source: bool, seed: int, farthest: float
) -> None:
    head, body = alone_pair(seed, 6000)
    clouds = [named("head", head), named("body", body)]
    morph = pointmorph.morph(*(clouds if is_source else clouds[::-1]))
    images = morph.source_to_target if is_source else morph.target_to_source
    size = np.linalg.norm(head.positions - head.positions.mean(axis=0), axis=1).mean()
    there = head.truth - head.truth.mean(axis=0)
    scale = np.linalg.norm(there, axis=1).mean() / size
    off = np.linalg.norm(images - head.truth, axis=1)[head.is_shared] / (scale * size)
    assert off.mean() < 0.15  # about a spacing of the body's points
    # Nothing else of the body is drawn over the head: all of it lies at the neck.
    back = morph.target_to_source if is_source else morph.source_to_target
    neck = head.truth[cKDTree(body.positions[~body.is_shared]).query(head.truth)[0] < 0.4 * size]
    neck = head.positions[cKDTree(neck).query(head.truth)[0] < 1e-9]
    rest = np.linalg.norm(body.truth - head.positions.mean(axis=0), axis=1) > 2.5 * size
    assert cKDTree(neck).query(back[rest])[0].max() < farthest * size
    limbs, of_part = limb_numbers(FIGURES["beasts"], seed)
    names = [limbs[limb] for limb in of_part]
    drawn_to = head.parts[cKDTree(head.positions).query(back[rest])[1]]
    assert {names[part] for part in np.unique(drawn_to)} == {"neck"}
    said = [w for w in morph.report["warnings"] if "head ends where body goes on" in w]
    assert len(said) == 1
    assert morph.report["likely_right"] > 0.8
    assert set(np.asarray(morph.pairs)[:, 0 if is_source else 1]) == set(range(6000))
    assert set(np.asarray(morph.pairs)[:, 1 if is_source else 0]) == set(range(6000))


# Halves that were drawn over the hips, one whose piece with what lies around it is most of the
# body, two with an arm on a leg or a hand that isn't covered where they lie rigidly, and a head so
# small that few balls fit between the spacing of the body and its rim.
@pytest.mark.parametrize("seed", [2, 10, 14, 18, 19, 74])
def test_what_is_alone_is_as_large_as_on_the_whole(seed: int) -> None:
    part, body = alone_pair(seed, 8000)
    morph = pointmorph.morph(named("part", part), named("body", body))
    spacing = np.sqrt(cloud_area(body.positions) / len(body.positions))
    off = np.linalg.norm(morph.source_to_target - part.truth, axis=1)[part.is_shared]
    assert off.mean() < 1.5 * spacing
    assert (off > 0.1 * np.sqrt(cloud_area(body.positions))).mean() < 0.05
    assert morph.report["confidence"] > 0.8


@pytest.mark.parametrize("is_source", [True, False])
def test_a_leg_that_is_missing_grows_where_it_was(is_source: bool) -> None:
    cut, whole = cut_pair(1, 8000)
    clouds = [named("cut", cut), named("whole", whole)]
    morph = pointmorph.morph(*(clouds if is_source else clouds[::-1]))
    back = morph.target_to_source if is_source else morph.source_to_target
    twelfth = cKDTree(cut.positions).query(cut.positions, 13)[0][:, -1]
    spacing = np.sqrt(np.pi / 12) * np.median(twelfth)
    away = cKDTree(cut.positions).query(whole.truth)[0]
    leg = away > 5 * spacing
    assert leg.sum() > 500
    # Around what the leg grew from, not on the leg beside it.
    root = whole.truth[~whole.is_shared & (away < 2 * spacing)]
    hip = root[np.linalg.norm(root - whole.truth[leg][away[leg].argmin()], axis=1) < 20 * spacing]
    gaps = cKDTree(hip).query(back[leg])[0]
    assert np.percentile(gaps, 95) < 8 * spacing
    assert sum("cut ends where whole goes on" in w for w in morph.report["warnings"]) == 1
    confidence = morph.measure_confidence()
    of_whole = confidence.target if is_source else confidence.source
    assert of_whole[leg].mean() > 0.9  # that it's missing is sure


def test_a_tail_whose_hole_is_too_small_is_named() -> None:
    cut, whole = cut_pair(2, 8000)
    morph = pointmorph.morph(named("cut", cut), named("whole", whole))
    confidence = morph.measure_confidence()
    tail = cKDTree(cut.positions).query(whole.truth)[0] > 0.2
    assert tail.sum() > 80
    assert np.median(confidence.target[tail]) < 0.4 < 0.9 < np.median(confidence.target)
    said = [
        d["advice"] for d in morph.report["doubtful"] if "comes near a part of whole" in d["advice"]
    ]
    assert len(said) == 1
    assert "no counterpart" in said[0]


def revolved(profile: list[tuple[float, float]], number: int = 48) -> pointmorph.Cloud:
    """A profile of radius and height, turned around the z axis; lines are cut every .07."""
    ends = np.array(profile)
    steps = [
        np.linspace(a, b, int(np.hypot(*(b - a)) / 0.07) + 1, endpoint=False)
        for a, b in itertools.pairwise(ends)
    ]
    radius, height = np.concatenate([*steps, ends[-1:]]).T
    angle = np.linspace(0, 2 * np.pi, number, endpoint=False)
    places = [np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))]
    points = np.stack([*places, np.repeat(height[:, None], number, axis=1)], axis=-1)
    k, j = np.mgrid[: len(radius) - 1, :number]
    corners = [number * k + j, number * k + (j + 1) % number]
    faces = np.stack([*corners, corners[1] + number, corners[0] + number], axis=-1)
    return pointmorph.Cloud(points.reshape(-1, 3), faces=faces.reshape(-1, 4))


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    "profile",
    [
        [(1.1, 0), (0.8, 0.3), (0.35, 0.9), (0.2, 1)],  # a skirt
        [(1, 0.05), (0.9, 0), (0.5, 0.05), (0.45, 0.3), (0.4, 0.6), (0.2, 0.68), (0.02, 0.7)],
    ],
)
def test_an_open_shape_is_no_part_of_one_that_is_unlike(
    profile: list[tuple[float, float]], swapped: bool
) -> None:
    """It fits some piece of the other best on its side, or upside down."""
    band = revolved([(1, 0), (1.1, 0.5), (1, 0.5), (0.9, 0), (1, 0)])
    ends = [band, revolved(profile)] if swapped else [revolved(profile), band]
    morph = pointmorph.morph(*ends)
    heights = morph.source.positions[:, 2], morph.source_to_target[:, 2]
    assert np.corrcoef(*heights)[0, 1] > 0.8


def sheet(side: int) -> pointmorph.Cloud:
    """A square of squares, flat."""
    u, v = np.meshgrid(np.linspace(-2, 2, side), np.linspace(-2, 2, side), indexing="ij")
    rows = np.arange(side * side).reshape(side, side)
    faces = np.stack([rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]], axis=2)
    positions = np.stack([u, v, 0 * u], axis=2).reshape(-1, 3)
    return pointmorph.Cloud(positions, faces=faces.reshape(-1, 4), name="Sheet")


@pytest.mark.parametrize("is_source", [True, False])
def test_a_flat_sheet_is_no_part_of_a_body(is_source: bool) -> None:
    """Though it fits any flat place of it, and best where it is as small as a spot."""
    positions, faces = whole()
    body = pointmorph.Cloud(positions, faces=faces, name="Body")
    pair = (sheet(30), body) if is_source else (body, sheet(30))
    morph = pointmorph.morph(*pair)
    assert not [text for text in morph.report["warnings"] if "ends where" in text]
    there = np.asarray(morph.wrapped(1.0))
    extents = np.ptp(pair[1].positions, axis=0)
    covered = np.ptp(there, axis=0)[extents > 0] / extents[extents > 0]
    assert covered.min() > 0.85


@pytest.mark.parametrize("denser", [False, True])
@pytest.mark.parametrize("height", [1.8, 5.0])
def test_what_is_beyond_an_opening_spans_it(height: float, denser: bool) -> None:
    """As of a barrel that becomes a lid: nothing of it hangs out of the lid below."""
    barrel = revolved(
        [(0.02, 0), (0.8, 0), (1, height / 2), (0.8, height), (0.02, height)],
        32,
    )
    lid = revolved([(1.2, 0), (1.2, 0.3), (0.02, 0.3)], 32)
    morph = pointmorph.morph(barrel, lid)
    end = np.asarray(morph.denser().wrapped if denser else morph.wrapped(1.0))
    assert end[:, 2].min() > -0.05
    assert end[:, 2].max() < 0.33
    assert np.ptp(end[:, 0]) > 2.3
