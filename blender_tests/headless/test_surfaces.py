"""Places in terms of the points around."""

import numpy as np
import pytest
from scenes import patch

pytestmark = pytest.mark.interface


@pytest.fixture
def surfaces(addon):
    return addon("data.surfaces")


def triangles_of(faces):
    return np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def test_on_triangles_linear_functions_are_exact(surfaces):
    positions, faces = patch(12)
    triangles = triangles_of(faces)
    rng = np.random.default_rng(2)
    shares = rng.dirichlet((1, 1, 1), 500)
    chosen = rng.integers(0, len(triangles), 500)
    places = np.einsum("nk,nkc->nc", shares, positions[triangles[chosen]])
    values = positions @ rng.normal(size=(3, 5)) + rng.normal(size=5)
    found, members, weights = surfaces.around(positions, triangles, places)
    assert np.array_equal(members, triangles[found])
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    assert weights.min() >= 0
    expected = np.einsum("nk,nkc->nc", shares, values[triangles[chosen]])
    np.testing.assert_allclose(surfaces.mean(values, members, weights), expected, atol=1e-5)


@pytest.mark.parametrize("with_faces", [False, True])
def test_on_a_point_it_is_that_point(surfaces, with_faces):
    positions, faces = patch(12)
    triangles = triangles_of(faces) if with_faces else None
    values = np.random.default_rng(3).normal(size=(len(positions), 2)).astype(np.float32)
    _, members, weights = surfaces.around(positions, triangles, positions)
    np.testing.assert_allclose(surfaces.mean(values, members, weights), values, atol=1e-4)


def test_between_points_means_stay_within_their_values(surfaces):
    positions, _ = patch(12)
    places = positions[:-1] * 0.3 + positions[1:] * 0.7
    values = positions[:, :1]
    triangle, members, weights = surfaces.around(positions, None, places)
    assert triangle is None
    found = surfaces.mean(values, members, weights)
    assert (found >= values[members].min(axis=1) - 1e-6).all()
    assert (found <= values[members].max(axis=1) + 1e-6).all()


def test_flat_triangles_and_few_points(surfaces):
    positions = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    for triangles in (np.array([[0, 1, 2]]), None):
        _, members, weights = surfaces.around(positions, triangles, positions + [[0, 0, 0.1]])
        assert np.isfinite(surfaces.mean(positions, members, weights)).all()
    _, members, weights = surfaces.around(positions[:1], None, positions)
    assert np.array_equal(members, [[0], [0], [0]])
    assert np.array_equal(weights, [[1], [1], [1]])
