"""Whether the faces of a mesh are small enough to show the surface that it was wrapped onto."""

from dataclasses import dataclass

import numpy as np
from mathutils.bvhtree import BVHTree
from pointmorph.morphs.verdicts import GOOD_MESH

FAR = 0.005
"""Distance from which on a place counts as not shown, in √area of the surface."""
_VISIBLE = 0.01  # of the surface is farther than what can't be seen: the percentile of the verdict
_LONG = 2.0  # sides of a face that is too large for what it misses, in distances from that
_LEAST, _MOST = 5_000, 20_000  # samples of a surface, about
_FINE = 40_000  # triangles of a mesh that isn't asked: to look takes long, and they are small


@dataclass(frozen=True)
class Surface:
    """Faces, and points that stand for all of them.

    Attributes
    ----------
    positions : (N, 3) array
    triangles : (F, 3) array of int
    samples : (S, 3) array
    shares : (S,) array
        Of the area, for each sample.
    scale : float
        √area
    """

    positions: np.ndarray
    triangles: np.ndarray
    samples: np.ndarray
    shares: np.ndarray
    scale: float


def tree_of(positions, triangles):
    """Mathutils' tree of triangles."""
    return BVHTree.FromPolygons(positions.tolist(), triangles.tolist(), all_triangles=True)


def surface(positions, triangles):
    """A Surface from arrays; None without an area."""
    corners = positions[triangles].astype(np.float64)
    sides = corners[:, 1:] - corners[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    total = float(areas.sum())
    if not total > 0.0:
        return None
    step = 1 + len(triangles) // _MOST
    within = _centers(int(np.ceil((_LEAST / len(triangles)) ** 0.5)))
    samples = np.einsum("ck,fkd->fcd", within, corners[::step]).reshape(-1, 3)
    shares = np.repeat(areas[::step], len(within))
    return Surface(positions, triangles, samples, shares / shares.sum(), total**0.5)


def _centers(count):
    """(count², 3): barycentric coordinates of the centers of so many parts of a triangle."""
    u, v = (x.reshape(-1) for x in np.mgrid[:count, :count])
    upright, reversed_ = u + v < count, u + v < count - 1
    first = np.stack([u, v], axis=1)
    places = np.concatenate([first[upright] + 1 / 3, first[reversed_] + 2 / 3]) / count
    return np.column_stack([1.0 - places.sum(axis=1), places])


def missed(places, triangles, onto):
    """What a mesh shows of the samples of a surface.

    Parameters
    ----------
    places : (N, 3) array
        Of the mesh's vertices, once it lies on the surface.
    triangles : (F, 3) array of int
        Of the mesh.
    onto : Surface

    Returns
    -------
    (S,) array of int
        The triangle that is the closest to each sample.
    (S,) array of bool
        Whether it's far away, and so large that smaller ones would be closer. Nowhere if the
        verdict on the mesh calls what it misses invisible.
    """
    tree = tree_of(places, triangles)
    found = [tree.find_nearest(sample)[2:] for sample in onto.samples.tolist()]
    nearest = np.array([face for face, _ in found])
    distances = np.array([distance for _, distance in found])
    corners = places[triangles].astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    seen = onto.shares[distances > GOOD_MESH["uncovered"] * onto.scale].sum() > _VISIBLE
    far = seen & (distances > FAR * onto.scale) & (longest[nearest] > _LONG * distances)
    return nearest, far


def missed_share(places, triangles, target):
    """Share of a shape's surface that a mesh which was wrapped onto it has too few vertices for.

    Parameters
    ----------
    places, triangles
        As for `missed`; None for a shape without faces.
    target : computation.Shape
    """
    if triangles is None or target.triangles is None or len(triangles) > _FINE:
        return 0.0
    onto = surface(target.positions, target.triangles)
    if onto is None:
        return 0.0
    _, far = missed(places, triangles, onto)
    return float(onto.shares[far].sum())
