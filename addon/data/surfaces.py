"""Places on a shape in terms of its points: what lies there goes along with those around."""

import numpy as np
from mathutils.bvhtree import BVHTree
from mathutils.kdtree import KDTree

_NEIGHBORS = 3


def around(positions, triangles, places):
    """The points of a shape around places on it.

    Parameters
    ----------
    positions : (M, 3) array
    triangles : (F, 3) array of int or None
        Without them, places are between the nearest points.
    places : (N, 3) array

    Returns
    -------
    (N,) array of int or None
        The triangle of each place.
    (N, 3) array of int
        The points.
    (N, 3) array
        Their shares, which sum to 1.
    """
    if triangles is None:
        members, shares = _nearest(positions, places)
        return None, members, shares
    tree = BVHTree.FromPolygons(positions.tolist(), triangles.tolist(), all_triangles=True)
    hits = [tree.find_nearest(place) for place in places.tolist()]
    triangle = np.array([hit[2] for hit in hits])
    members = triangles[triangle]
    return triangle, members, _shares(positions[members], np.array([hit[0] for hit in hits]))


def mean(values, members, shares):
    """(N, K) float32: values of points, at places that `around` found."""
    return np.einsum("nk,nkc->nc", shares, values[members].astype(np.float64)).astype(np.float32)


def nearest(positions, places):
    """(N,) array of int and (N,) array: the point that is nearest to each place, and how far."""
    tree = _tree_of(positions)
    found = [tree.find(place)[1:] for place in places.tolist()]
    return np.array([row for row, _ in found], np.int64), np.array([away for _, away in found])


def _tree_of(positions):
    tree = KDTree(len(positions))
    for number, place in enumerate(positions.tolist()):
        tree.insert(place, number)
    tree.balance()
    return tree


def _nearest(positions, places):
    """By nearness: 1 for a point that a place lies on."""
    tree = _tree_of(positions)
    count = min(_NEIGHBORS, len(positions))
    found = [tree.find_n(place, count) for place in places.tolist()]
    members = np.array([[hit[1] for hit in hits] for hits in found])
    distances = np.array([[hit[2] for hit in hits] for hits in found])
    scale = max(float(np.ptp(positions, axis=0).max()), 1e-30)
    shares = 1.0 / np.maximum(distances, 1e-9 * scale) ** 2
    return members, shares / shares.sum(axis=1, keepdims=True)


def _shares(triangles, places):
    """(N, 3): barycentric coordinates of places on triangles; a flat one gives all to a corner."""
    a, b, c = (triangles[:, k].astype(np.float64) for k in range(3))
    u, v, w = b - a, c - a, places - a
    uu, uv, vv = ((x * y).sum(axis=1) for x, y in ((u, u), (u, v), (v, v)))
    wu, wv = (w * u).sum(axis=1), (w * v).sum(axis=1)
    area = uu * vv - uv * uv
    flat = area <= 1e-14 * uu * vv
    area[flat] = 1.0
    second = np.where(flat, 0.0, (vv * wu - uv * wv) / area)
    third = np.where(flat, 0.0, (uu * wv - uv * wu) / area)
    shares = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, 1.0)
    return shares / shares.sum(axis=1, keepdims=True)
