"""Kinds of figures that benchmarks make: of one piece, closed, and the truth is true."""

from __future__ import annotations

import itertools

import bench_kinds
import bench_rows
import made_figures
import made_kinds
import numpy as np
import numpy.typing as npt
import pytest
from bench_kinds import Found
from compare_measures import cloud_area
from made_bodies import Body, is_inside
from made_shapes import Floats, Part, icosphere, rotation, surface_of
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

POINTS = 3000
KINDS = pytest.mark.parametrize("kind", made_kinds.KINDS)
DIRECTIONS, _ = icosphere(3)


def draws(kind: str, seed: int) -> tuple[list[Part], list[Part]]:
    """What `kind_pair` samples, the second one before it is bent."""
    random = np.random.default_rng(seed)
    return made_kinds.KINDS[kind](random), made_kinds.KINDS[kind](random)


def touching(parts: list[Part]) -> npt.NDArray[np.bool_]:
    """(P, P) whether each reaches into each other one."""
    surfaces = [surface_of(part, DIRECTIONS) for part in parts]
    reaches = np.array([[is_inside(part, at).any() for part in parts] for at in surfaces])
    either: npt.NDArray[np.bool_] = reaches | reaches.T
    return either


def limbs_of(parts: list[Part]) -> list[list[int]]:
    """Parts of the same name, from the first joint to the last."""
    names = [part.name for part in parts]
    of = {name: [k for k, other in enumerate(names) if other == name] for name in names}
    return [joints for joints in of.values() if len(joints) > 1]


@KINDS
def test_parts_are_of_one_piece_and_limbs_hang_together_at_their_joints(kind: str) -> None:
    for seed in range(2000, 2004):
        for parts in draws(kind, seed):
            touch = touching(parts)
            assert csgraph.connected_components(touch)[0] == 1
            for joints in limbs_of(parts):
                assert touch[joints[:-1], joints[1:]].all(), parts[joints[0]].name


@KINDS
def test_samples_of_joints_that_follow_each_other_meet(kind: str) -> None:
    source, target = made_kinds.kind_pair(kind, 2001, POINTS)
    limbs = limbs_of(draws(kind, 2001)[0])
    assert len(limbs) > 0 or kind == "teddies"  # Their limbs have no joints.
    for body in (source, target):
        spacing = np.sqrt(cloud_area(body.positions) / POINTS)
        for joints in limbs:
            for first, second in itertools.pairwise(joints):
                here, there = (body.positions[body.parts == part] for part in (first, second))
                if min(len(here), len(there)) < 10:
                    continue  # Hidden in others, as joints near a body are.
                assert cKDTree(here).query(there)[0].min() < 3 * spacing


def test_parts_that_are_apart_and_a_leg_that_is_off_would_be_noticed() -> None:
    ball = Part("ball", (0, 0, 0), (1, 1, 1), 1.0)
    near, far = (Part("ball", (x, 0, 0), (1, 1, 1), 1.0) for x in (1.9, 2.1))
    assert touching([ball, near])[0, 1]
    assert not touching([ball, far])[0, 1]
    assert limbs_of([ball, Part("foot", (0, 0, 0), (1, 1, 1)), near]) == [[0, 2]]


@KINDS
def test_clouds_are_closed(kind: str) -> None:
    """Over a closed surface the normals add up to nothing, and their products with the places to
    as much of the identity as it holds; both as near as so many samples come to it."""
    for body in made_kinds.kind_pair(kind, 2002, POINTS):
        assert len(body.positions) == POINTS
        np.testing.assert_allclose(np.linalg.norm(body.normals, axis=1), 1)
        places = body.positions - body.positions.mean(axis=0)
        products = places[:, :, None] * body.normals[:, None]
        volume = np.trace(products.mean(axis=0)) / 3
        assert volume > 0
        for samples, sums in ((body.normals, 0), (products, volume * np.eye(3))):
            error = samples.std(axis=0) / np.sqrt(POINTS)
            assert (np.abs(samples.mean(axis=0) - sums) < 5 * error).all()


def levels(part: Part, positions: Floats) -> Floats:
    """1 on the surface of a part, less in it."""
    at = np.abs((positions - part.middle) @ rotation(part.turn)) / part.half
    of_powers: Floats = (at ** (2 / part.exponent)).sum(axis=1) ** (part.exponent / 2)
    return of_powers


@KINDS
def test_the_truth_lies_on_the_same_part_of_the_other_build(kind: str) -> None:
    source, target = made_kinds.kind_pair(kind, 2003, POINTS)
    parts, others = draws(kind, 2003)
    assert [part.name for part in parts] == [part.name for part in others]
    assert all(part.name for part in parts)
    # The source is as it is drawn: chords of the faces dip below the surface by little.
    for body, positions in ((source, source.positions), (target, target.truth)):
        for k in np.unique(body.parts):
            level = levels(parts[k], positions[body.parts == k])
            assert level.max() < 1 + 1e-9
            assert level.min() > 0.97
    # The target is bent, so that only samples tell where its parts are.
    spacing = np.sqrt(cloud_area(target.positions) / POINTS)
    for k in np.unique(target.parts):
        rows = source.is_shared & (source.parts == k)
        there = target.positions[target.parts == k]
        if rows.any() and len(there) >= 10:
            assert np.median(cKDTree(there).query(source.truth[rows])[0]) < spacing
    away = cKDTree(target.positions).query(source.truth[source.is_shared])[0]
    assert away.max() < 4 * spacing
    assert source.is_shared.mean() > 0.8


@KINDS
def test_builds_differ_and_the_same_seed_makes_the_same_bits(kind: str) -> None:
    first, again, another = (made_kinds.kind_pair(kind, seed, 500) for seed in (2000, 2000, 2001))
    for body, same, other in zip(first, again, another, strict=True):
        for name, values in vars(body).items():
            np.testing.assert_array_equal(values, getattr(same, name))
        assert not np.array_equal(body.positions, other.positions)
    # Not by a turn, a scale or a pose alone: parts are of other proportions.
    halves = [np.array([part.half for part in parts]) for parts in draws(kind, 2000)]
    ratios = halves[1] / halves[0]
    assert ratios.max() > 1.05 * ratios.min()


def test_rims_of_glasses_close() -> None:
    parts, _ = draws("glasses", 2000)
    touch = touching(parts)
    rims = [joints for joints in limbs_of(parts) if parts[joints[0]].name.startswith("rim")]
    assert len(rims) == 2
    for joints in rims:
        assert touch[joints[-1], joints[0]]


def test_handles_of_pliers_meet_at_the_pivot_alone() -> None:
    for seed in range(2000, 2020):
        for parts in draws("pliers", seed):
            touch = touching(parts)
            here, there = (
                [k for k, part in enumerate(parts) if part.name == f"handle {side}"]
                for side in (-1, 1)
            )
            assert not touch[np.ix_(here[1:], there[1:])].any()


def test_unlike_beasts_are_farther_apart_than_beasts() -> None:
    apart = {}
    for figure in (made_figures.beast, made_figures.unlike_beast):
        drawn = [figure(*(np.random.default_rng(seed) for _ in range(2))) for seed in range(30)]
        halves = np.array([[part.half for part in parts] for parts in drawn])
        legs = np.array([part.name.startswith("leg") for part in drawn[0]])
        # A leg of one is so many times as long as that of another.
        lengths = halves[:, legs, 2].sum(axis=1)
        apart[figure] = lengths.max() / lengths.min()
    assert apart[made_figures.unlike_beast] > 1.8 * apart[made_figures.beast]


def test_legs_of_unlike_beasts_touch_none_across() -> None:
    for seed in range(2000, 2020):
        for parts in draws("unlike-beasts", seed):
            legs = [part for part in parts if part.name.startswith("leg")]
            is_left = np.array([part.name.endswith("-1") for part in legs])
            assert not touching(legs)[np.ix_(is_left, ~is_left)].any()


def shifted(body: Body, share: float, by: float) -> Floats:
    """The true images, but for a share of those points that both have."""
    images = body.truth.copy()
    rows = np.flatnonzero(body.is_shared)
    images[rows[: round(share * len(rows))]] += (by, 0, 0)
    return images


def test_points_that_are_off_are_counted_both_ways() -> None:
    bodies = made_kinds.kind_pair("teddies", 2000, 1000)
    size = float(np.sqrt(cloud_area(bodies[1].positions)))
    images = shifted(bodies[0], 0.4, 0.2 * size), shifted(bodies[1], 0.0, 0.0)
    away = bench_rows.from_truth(bodies, images)
    assert away[0].mean() == pytest.approx(0.08, rel=0.01)
    assert (away[0] > bench_rows.OFF).mean() == pytest.approx(0.4, abs=0.01)
    assert away[1].max() == 0.0
    figures = bench_rows.of_truth(bodies, images)
    assert figures["wrong"] == pytest.approx(20, abs=1)


def test_a_line_tells_maps_that_are_off_from_the_others() -> None:
    found = [Found(1, 0.01, 0.01, 0.9, 1.0), Found(2, 0.05, 0.03, 0.9, 2.0),
             Found(3, 0.06, 0.04, 0.99, 3.0), Found(4, 0.5, 0.2, 0.7, 4.0)]  # fmt: skip
    line = bench_kinds.line("ants", found)
    assert line == "| ants | 4 | 1 | 1 | 0.0200 | 2.50 | 3: 6 % 0.99, 4: 50 % 0.70 |"
    assert "| snakes | 1 | 1 | 0 |  |" in bench_kinds.line("snakes", found[3:])
