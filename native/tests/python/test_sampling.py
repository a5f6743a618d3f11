"""Even samples of meshes."""

from __future__ import annotations

import numpy as np
import pointmorph
import pytest
from pointmorph.meshes import Shape, sample
from shapes import grid, grid_faces


def sheet() -> Shape:
    positions = grid(21)
    colors = np.ones((441, 4), np.float32)
    colors[:, 0] = (positions[:, 0] + 1) / 2
    return Shape("sheet", positions, None, colors, None, grid_faces(21))


def nearest_distance(points: np.ndarray) -> np.ndarray:
    apart = np.linalg.norm(points[:, None].astype(float) - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1)


def test_count_kept_vertices_and_attributes() -> None:
    shape = sheet()
    cloud, rows = sample(shape, 600, keep=[0, 220, 440, 220])
    assert len(cloud) == 600
    np.testing.assert_array_equal(cloud.positions[rows], shape.positions[[0, 220, 440, 220]])
    assert cloud.positions.dtype == np.float32
    np.testing.assert_allclose(cloud.positions[:, 2], 0, atol=1e-7)
    np.testing.assert_allclose(cloud.normals, np.tile([0, 0, 1], (600, 1)), atol=1e-6)
    np.testing.assert_allclose(cloud.colors[:, 0], (cloud.positions[:, 0] + 1) / 2, atol=1e-6)


def test_points_keep_their_distance() -> None:
    cloud, _ = sample(sheet(), 600)
    spacing = 2 / np.sqrt(600)
    # independent uniform points come as close as 2 % of the spacing
    assert np.percentile(nearest_distance(cloud.positions), 1) > 0.5 * spacing


def test_the_boundary_is_sampled_in_order() -> None:
    cloud, rows = sample(sheet(), 600, keep=[0, 10])
    loop = cloud.positions[cloud.boundary]
    assert np.all(np.isclose(np.abs(loop[:, :2]).max(axis=1), 1, atol=1e-6))
    steps = np.linalg.norm(loop - np.roll(loop, -1, axis=0), axis=1)
    assert steps.sum() == pytest.approx(8, rel=0.02)
    assert steps.max() < 2 * 2 / np.sqrt(600)
    assert len(set(cloud.boundary)) == len(cloud.boundary)
    assert set(rows.tolist()) <= set(cloud.boundary)


def test_same_seed_same_sample() -> None:
    a, b, c = (sample(sheet(), 300, seed=seed)[0].positions for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_clouds_are_thinned() -> None:
    shape = Shape("cloud", grid(40))
    cloud, rows = sample(shape, 400, keep=[7, 3])
    assert len(cloud) == 400
    np.testing.assert_array_equal(cloud.positions[rows], shape.positions[[7, 3]])
    with pytest.raises(pointmorph.OptionError, match="no faces"):
        sample(shape, 1601)


def test_bad_calls_are_refused() -> None:
    with pytest.raises(pointmorph.OptionError, match="boundary"):
        sample(sheet(), 3)
    with pytest.raises(pointmorph.CloudError, match="keep"):
        sample(sheet(), 300, keep=[441])
    flat = Shape("line", np.zeros((3, 3)), faces=np.array([[0, 1, 2]]))
    with pytest.raises(pointmorph.CloudError, match="area"):
        sample(flat, 10)
