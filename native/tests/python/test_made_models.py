"""Models that benchmarks make: what they lack is gone, hollows are hollow, the truth is true."""

from __future__ import annotations

import bench_rows
import made_models
import numpy as np
import pytest
from compare_measures import cloud_area, similarity
from made_bodies import body_pair, visible
from made_bodies import car as family
from made_shapes import Part, icosphere, surface_of
from scipy.spatial import cKDTree


def test_a_hollow_part_shows_where_it_takes_away_and_hides_what_it_takes() -> None:
    parts = [
        Part("ball", (0, 0, 0), (1, 1, 1), 1.0),
        Part("hole", (1, 0, 0), (0.5, 0.5, 0.5), 1.0, is_hollow=True),
        Part("pea", (1, 0, 0), (0.1, 0.1, 0.1), 1.0),
    ]
    directions, _ = icosphere(2)
    positions = np.concatenate([surface_of(part, directions) for part in parts])
    of = np.repeat(np.arange(3), len(directions))
    seen = visible(parts, of, positions)
    in_ball = np.linalg.norm(positions, axis=1) < 1 - 1e-9
    in_hole = np.linalg.norm(positions - (1, 0, 0), axis=1) < 0.5 - 1e-9
    np.testing.assert_array_equal(seen[of == 0], ~in_hole[of == 0])
    np.testing.assert_array_equal(seen[of == 1], in_ball[of == 1])
    assert seen[of == 2].all()


def test_the_normals_of_a_mouth_point_into_it() -> None:
    source, _, _ = made_models.head_pair(0, 6000)
    names = [part.name for part in made_models.head(np.random.default_rng(0))]
    of = source.parts == names.index("mouth")
    assert of.sum() > 20
    middle = source.positions[of].mean(axis=0)
    into = ((middle - source.positions[of]) * source.normals[of]).sum(axis=1) > 0
    assert into.mean() > 0.95


def test_marks_of_heads_are_where_the_truth_is() -> None:
    source, target, marks = made_models.head_pair(1, 6000)
    assert set(marks) == set(made_models.HEAD_MARKS)
    for here, there in marks.values():
        assert source.parts[here] == target.parts[there]
        off = np.linalg.norm(target.positions[there] - source.truth[here])
        assert off < 0.05 * np.ptp(target.positions, axis=0).max()


@pytest.mark.parametrize("seed", range(len(made_models.LOST)))
def test_what_is_cut_from_a_beast_has_no_counterpart(seed: int) -> None:
    source, target = made_models.cut_pair(seed, 3000)
    names, limbs = made_models.limb_numbers(made_models.FIGURES["beasts"], seed)
    lost = {names.index(name) for name in made_models.LOST[seed]}
    assert lost
    assert not lost & set(limbs[source.parts].tolist())
    assert lost <= set(limbs[target.parts].tolist())
    assert not target.is_shared[np.isin(limbs[target.parts], list(lost))].any()


@pytest.mark.parametrize("seed", range(len(made_models.ALONE)))
def test_parts_alone_are_whole_parts_and_know_their_place(seed: int) -> None:
    source, target = made_models.alone_pair(seed, 1500)
    assert len(source.positions) == len(target.positions) == 1500
    # Nothing of the target that is shared is another part's, and much of it isn't shared.
    assert set(target.parts[target.is_shared]) <= set(source.parts)
    assert 0.02 < target.is_shared.mean() < 0.8
    # What is shared lies where the other's parts are.
    spacing = np.sqrt(cloud_area(target.positions) / 1500)
    away = cKDTree(target.positions).query(source.truth[source.is_shared])[0]
    assert away.max() < 4 * spacing


def test_tips_are_cut_from_the_ends_of_a_mesh() -> None:
    corners, faces = icosphere(3)
    positions = corners * (6.0, 1.0, 1.0)
    pair = made_models.lopped_pair(positions, faces, 3, np.random.default_rng(0))
    lost = pair.target.parts == 1
    np.testing.assert_array_equal(pair.source.faces, faces[~lost])
    left = np.abs(positions[pair.source.faces][..., 0])
    assert left.max() < 4.5  # Both ends are gone, of three tips,
    assert len(pair.source.faces) > 0.4 * len(faces)  # and no more than tips.


def test_a_row_is_met_where_all_its_figures_are() -> None:
    row = bench_rows.ROWS["lopped"]
    good = {"landmarks": 0.01, "worst": 0.09, "tears": 0.2, "said": 100.0}
    assert row.is_met(good)
    assert not row.is_met({**good, "worst": 0.11})
    assert not row.is_met({**good, "said": 83.0})


def test_places_of_bodies_belong_together_and_marks_are_not_among_them() -> None:
    source, target = body_pair(family, 3, 3000)
    marks = np.array([[10, 20], [30, 40]])
    task = bench_rows.of_bodies("cars", source, target, marks=marks)
    assert len(task.places) > 0.9 * bench_rows.PLACES
    assert not np.isin(task.places[:, 0], marks[:, 0]).any()
    spacing = np.sqrt(task.surfaces[1].area / 3000)
    # The target is placed onto the source, and the truth with it.
    scale, turn, shift = similarity(source.truth[source.is_shared],
                                    source.positions[source.is_shared])  # fmt: skip
    truth = scale * source.truth[task.places[:, 0]] @ turn.T + shift
    off = np.linalg.norm(task.surfaces[1].positions[task.places[:, 1]] - truth, axis=1)
    assert off.max() < spacing
