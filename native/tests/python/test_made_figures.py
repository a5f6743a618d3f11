"""Figures that benchmarks make, and people among them, who aren't to be turned round."""

from __future__ import annotations

import bench_figures
import made_figures
import numpy as np
import pointmorph
import pytest
from compare_measures import cloud_area
from made_bodies import Body, Family, body_pair, rotation_vector
from made_shapes import Part, Random, rotation


def cloud(body: Body) -> pointmorph.Cloud:
    return pointmorph.Cloud(body.positions, normals=body.normals)


@pytest.mark.parametrize("kind", made_figures.FIGURES)
def test_poses_of_a_build_keep_the_lengths_of_their_parts(kind: str) -> None:
    source, target = made_figures.figure_pair(made_figures.FIGURES[kind], 1, 2000)
    scale = np.sqrt(cloud_area(target.positions) / cloud_area(source.positions))
    for part in np.unique(source.parts):
        of = source.parts == part
        if of.sum() < 20:
            continue
        here, there = source.positions[of], source.truth[of]
        before = np.linalg.norm(here - here[0], axis=1)
        after = np.linalg.norm(there - there[0], axis=1)
        np.testing.assert_allclose(after, scale * before, atol=0.15 * scale * before.max())


def test_a_rotation_vector_makes_the_rotation_again_half_turns_too() -> None:
    for vector in ((0.3, -0.2, 1.0), (np.pi, 0.0, 0.0), (0.0, 0.0, 0.0), (1.2, 1.7, -2.2)):
        turn = rotation(vector) @ rotation((0.0, 0.4, 0.0))
        np.testing.assert_allclose(rotation(rotation_vector(turn)), turn, atol=1e-9)


@pytest.mark.parametrize("kind", made_figures.ACROSS)
def test_the_asymmetry_of_a_map_is_what_it_is_made_to_be(kind: str) -> None:
    source, target = made_figures.symmetric_pair(kind, 1, 3000)
    here, there = bench_figures.mirrors(kind, source)
    np.testing.assert_allclose(here(here(source.positions)), source.positions, atol=1e-12)
    again = there(there(target.positions))
    np.testing.assert_allclose(again, target.positions, atol=1e-2 * np.ptp(target.positions))
    spacing = np.sqrt(cloud_area(target.positions) / len(target.positions))
    off = bench_figures.asymmetries(source, source.truth, here, there) / spacing
    assert off.mean() < 0.05  # the true map takes sides to sides
    # Of a map that is off by the same vector everywhere: twice its part across the mirror.
    shift = np.array((3.0, -2.0, 1.0)) * spacing
    across = np.linalg.norm(shift - (there(shift[None]) - there(np.zeros((1, 3))))[0])
    moved = bench_figures.asymmetries(source, source.truth + shift, here, there)
    assert np.median(moved) == pytest.approx(across, rel=0.02)


def alike(random: Random) -> list[Part]:
    return made_figures.person(random, random)


@pytest.mark.parametrize(
    ("family", "seed", "points", "strength"),
    [
        (alike, 2, 10_000, 0.5),
        (alike, 4, 10_000, 0.5),
        (alike, 1019, 4000, 0.4),
        (alike, 1034, 4000, 0.4),
        (made_figures.unlike(made_figures.person), 2003, 4000, 0.4),
        (made_figures.unlike(made_figures.person), 2024, 4000, 0.4),
    ],
)
def test_a_person_whose_arms_are_held_otherwise_is_not_turned_round(
    family: Family, seed: int, points: int, strength: float
) -> None:
    source, target = body_pair(family, seed, points, strength)
    morph = pointmorph.morph(cloud(source), cloud(target))
    away = np.linalg.norm(morph.source_to_target - source.truth, axis=1)[source.is_shared]
    assert away.mean() < 0.03 * np.sqrt(cloud_area(target.positions))


def with_dust(body: Body, seed: int) -> pointmorph.Cloud:
    """As a scanner gives it: bare points, and one in a hundred anywhere in the box around."""
    low, high = body.positions.min(axis=0), body.positions.max(axis=0)
    random = np.random.default_rng(seed)
    dust = random.uniform(low, high, (len(body.positions) // 100, 3))
    return pointmorph.Cloud(np.vstack([body.positions, dust]))


def test_a_person_among_stray_points_is_not_turned_round() -> None:
    source, target = body_pair(made_figures.any_build(made_figures.person), 2002, 4000, 0.3)
    morph = pointmorph.morph(with_dust(source, 1), with_dust(target, 2))
    away = np.linalg.norm(morph.source_to_target[: len(source.positions)] - source.truth, axis=1)
    assert away[source.is_shared].mean() < 0.03 * np.sqrt(cloud_area(target.positions))
    assert sum("stray points" in warning for warning in morph.report["warnings"]) == 2
