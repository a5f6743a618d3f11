"""Figures that benchmarks make, and people among them, who aren't to be turned round."""

from __future__ import annotations

import made_figures
import numpy as np
import pointmorph
import pytest
from compare_measures import cloud_area
from made_bodies import Body, body_pair


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


@pytest.mark.parametrize("seed", [2, 4])
def test_a_person_whose_arms_are_held_otherwise_is_not_turned_round(seed: int) -> None:
    source, target = body_pair(lambda r: made_figures.person(r, r), seed, 10_000, 0.5)
    morph = pointmorph.morph(cloud(source), cloud(target))
    away = np.linalg.norm(morph.source_to_target - source.truth, axis=1)[source.is_shared]
    assert away.mean() < 0.03 * np.sqrt(cloud_area(target.positions))
