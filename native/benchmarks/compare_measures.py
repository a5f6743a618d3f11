"""How good a correspondence is, by measures that any method's pairs can be held against.

A correspondence is a list of pairs (source row, target row). Lengths on a surface are divided by
the square root of its area, so figures of different models can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from pointmorph import Cloud
from pointmorph.meshes import Shape, sampling, vertex_normals
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

GEODESIC_NEIGHBORS = 16
"""Edges a point in the graphs on which distances along a surface are measured."""
TEAR_NEIGHBORS = 6
"""Neighbours of a point that must not be torn from it; they also give the local spacing."""
TIMES = (0.1, 0.25, 0.5, 0.75, 0.9)
DENSE = 60_000
"""Points with which a mesh is filled up for distances along it."""
JACOBIANS = 8_000
"""Points, at most, at which the map's derivative is fitted."""


@dataclass(frozen=True)
class Surface:
    """One side of a pair: the cloud, and what distances and areas are measured on."""

    positions: Floats
    """(N, 3)"""
    normals: Floats
    """(N, 3), unit length"""
    area: float
    dense: Floats
    """(D, 3) more points of the same surface; none for a bare cloud"""
    dense_normals: Floats

    @classmethod
    def of(cls, cloud: Cloud, shape: Shape) -> Surface:
        """The cloud that is mapped, and the shape that it was taken from."""
        positions = cloud.positions.astype(np.float64)
        normals = None if cloud.normals is None else cloud.normals.astype(np.float64)
        none = np.empty((0, 3))
        if shape.faces is None:
            known = estimated_normals(positions) if normals is None else _unit(normals)
            return cls(positions, known, cloud_area(positions), none, none)
        if normals is None:
            normals = vertex_normals(shape.positions, shape.faces).astype(np.float64)
        dense = sampling.sample(shape, DENSE)[0] if len(positions) < DENSE else None
        return cls(
            positions,
            _unit(normals),
            mesh_area(shape),
            none if dense is None else dense.positions.astype(np.float64),
            none if dense is None or dense.normals is None else dense.normals.astype(np.float64),
        )

    def moved(self, scale: float, turn: Floats, shift: Floats) -> Surface:
        """Every point p at scale * turn p + shift."""
        return Surface(
            scale * self.positions @ turn.T + shift,
            self.normals @ turn.T,
            scale**2 * self.area,
            scale * self.dense @ turn.T + shift,
            self.dense_normals @ turn.T,
        )


class Yardstick:
    """Measures correspondences of one pair of clouds. What all have in common is computed once.

    Parameters
    ----------
    source, target : Surface
        The target is put where the source is by the features, if there are three or more, so that
        straight in-betweens say something about the map and not about how the models lie.
    features : (K, 2) array of int64
        Rows that every method was told.
    landmarks : (L, 2) array of int64
        Rows that belong together as well and that no method was told.
    """

    def __init__(self, source: Surface, target: Surface, features: Ints, landmarks: Ints) -> None:
        if len(features) >= 3:
            rows = target.positions[features[:, 1]], source.positions[features[:, 0]]
            target = target.moved(*similarity(*rows))
        self._sides = (source, target)
        self._features = len(features)
        self._marks = np.concatenate([features, landmarks])
        self._distances = [
            surface_distances(side, self._marks[:, k]) for k, side in enumerate(self._sides)
        ]
        self._spacings = [local_spacing(side.positions) for side in self._sides]

    def measure(self, pairs: Ints, seed: int = 0) -> dict[str, float | None]:
        """All measures; None where there is nothing to measure.

        landmarks, landmarks_max
            Distance along the surface from a held-out landmark to where its counterpart is sent,
            over √area, both ways; several partners count by their mean.
        features_max
            The same for the features: how far the worst one is missed.
        tears
            Share of neighbours between which the straight in-between cloud is open by more than
            the spacing; of both clouds and all `TIMES` the largest.
        dirichlet, dirichlet_back
            Mean square stretch between clouds of equal area, from source to target and back. 1 for
            an isometry, more for any other map that covers the surface.
        stretch_p99
            The 99th percentile of the stretch, the worse of both ways.
        flips
            Share of places where the map turns the surface over; mean of both ways.
        covered
            Share of the points that are in a pair, the lesser of both clouds.
        """
        random = np.random.default_rng(seed)
        ways = (pairs, pairs[:, ::-1])
        smooth = [smoothness(self._sides[k], self._sides[1 - k], ways[k], random) for k in (0, 1)]
        errors = np.array([self.misses(k, ways[k]) for k in (0, 1)])
        held, given = errors[:, self._features :], errors[:, : self._features]
        return {
            "landmarks": float(held.mean()) if held.size else None,
            "landmarks_max": float(held.max()) if held.size else None,
            "features_max": float(given.max()) if given.size else None,
            "tears": self._tears(pairs, random),
            "dirichlet": smooth[0].dirichlet,
            "dirichlet_back": smooth[1].dirichlet,
            "stretch_p99": max(way.stretch_p99 for way in smooth),
            "flips": (smooth[0].flips + smooth[1].flips) / 2,
            "covered": min(
                len(np.unique(way[:, 0])) / len(side.positions)
                for side, way in zip(self._sides, ways, strict=True)
            ),
        }

    def misses(self, side: int, pairs: Ints) -> Floats:
        """How far the partners of each mark of one side are from its counterpart on the other."""
        here, there = self._sides[side], self._sides[1 - side]
        paired = np.unique(pairs[:, 0])
        rows = self._marks[:, side]
        # A mark without a partner goes where the nearest paired point goes.
        stand_ins = paired[cKDTree(here.positions[paired]).query(here.positions[rows])[1]]
        distances = self._distances[1 - side]
        misses: list[float] = [
            float(distances[mark, pairs[pairs[:, 0] == row, 1]].mean())
            for mark, row in enumerate(stand_ins)
        ]
        return np.array(misses) / np.sqrt(there.area)

    def _tears(self, pairs: Ints, random: np.random.Generator) -> float:
        (a, b), (spacing_a, spacing_b) = self._sides, self._spacings
        edges = [
            neighbor_pairs(side.positions, pairs[:, k], random)
            for k, side in enumerate(self._sides)
        ]
        worst = 0.0
        for t in TIMES:
            points = (1 - t) * a.positions[pairs[:, 0]] + t * b.positions[pairs[:, 1]]
            spacing = (1 - t) * spacing_a[pairs[:, 0]] + t * spacing_b[pairs[:, 1]]
            tree = cKDTree(points)
            for first, second in edges:
                middle = (points[first] + points[second]) / 2
                gap = tree.query(middle, workers=-1)[0]
                worst = max(worst, float((gap > spacing[first] + spacing[second]).mean()))
        return worst


# --- Surfaces -------------------------------------------------------------------------------------


def similarity(points: Floats, onto: Floats) -> tuple[float, Floats, Floats]:
    """Scale, rotation and shift that bring points (N, 3) nearest to others, without a reflection.

    Least squares (Umeyama 1991): scale * rotation @ p + shift is near q.
    """
    middle, goal = points.mean(axis=0), onto.mean(axis=0)
    left, spread, right = np.linalg.svd((onto - goal).T @ (points - middle))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = left @ np.diag(signs) @ right
    scale = float((spread * signs).sum() / ((points - middle) ** 2).sum())
    return scale, turn, goal - scale * turn @ middle


def mesh_area(shape: Shape) -> float:
    assert shape.faces is not None
    a, b, c = (shape.positions[shape.faces[:, k]].astype(np.float64) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def neighbors(positions: Floats, count: int) -> tuple[Floats, Ints]:
    """Plain distances and rows (N, count) of the nearest points, the point itself left out."""
    distances, rows = cKDTree(positions).query(positions, count + 1, workers=-1)
    return distances[:, 1:], rows[:, 1:].astype(np.int64)


def cloud_area(positions: Floats) -> float:
    """Of a bare cloud, from its density: a disk that reaches the k-th neighbour holds k points."""
    count = 12
    reach = neighbors(positions, count)[0][:, -1]
    return float((np.pi * reach**2 / count).sum())


def local_spacing(positions: Floats) -> Floats:
    """(N,) mean distance to the nearest neighbours."""
    return np.asarray(neighbors(positions, TEAR_NEIGHBORS)[0].mean(axis=1))


def estimated_normals(positions: Floats) -> Floats:
    """(N, 3) normals of local planes; the sense spreads from the outermost point of each piece."""
    count = 12
    _, rows = neighbors(positions, count)
    local = positions[rows] - positions[rows].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))[1][:, :, 0].copy()
    first = np.repeat(np.arange(len(positions)), count)
    second = rows.ravel()
    bend = 1.0001 - np.abs((normals[first] * normals[second]).sum(axis=1))
    size = (len(positions), len(positions))
    graph = sp.csr_matrix((bend, (first, second)), size)
    tree = csgraph.minimum_spanning_tree(graph.maximum(graph.T))
    pieces, piece_of = csgraph.connected_components(tree, directed=False)
    for piece in range(pieces):
        members = np.flatnonzero(piece_of == piece)
        root = members[positions[members, 2].argmax()]
        if normals[root, 2] < 0:
            normals[root] *= -1
        order, parent = csgraph.breadth_first_order(tree, root, directed=False)
        for row in order[1:]:
            if normals[row] @ normals[parent[row]] < 0:
                normals[row] *= -1
    return normals


def surface_distances(surface: Surface, rows: Ints) -> Floats:
    """(len(rows), N) distances along the surface, by shortest paths from point to point.

    About 3 % too long. Edges between opposed normals, through thin parts, don't count; what can't
    be reached is as far as the crow flies.
    """
    if len(rows) == 0:
        return np.empty((0, len(surface.positions)))
    positions = np.concatenate([surface.positions, surface.dense])
    normals = np.concatenate([surface.normals, surface.dense_normals])
    lengths, near = neighbors(positions, min(GEODESIC_NEIGHBORS, len(positions) - 1))
    first = np.repeat(np.arange(len(positions)), near.shape[1])
    second, length = near.ravel(), np.maximum(lengths.ravel(), 1e-12)
    kept = (normals[first] * normals[second]).sum(axis=1) > -0.1
    size = (len(positions), len(positions))
    graph = sp.csr_matrix((length[kept], (first[kept], second[kept])), size)
    here = surface.positions
    distances: Floats = csgraph.dijkstra(graph.maximum(graph.T), indices=rows)[:, : len(here)]
    straight = np.linalg.norm(here[None] - here[rows][:, None], axis=2)
    return np.where(np.isfinite(distances), distances, straight)


def _unit(vectors: Floats) -> Floats:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-30))


# --- Maps -----------------------------------------------------------------------------------------


def representatives(rows: Ints, size: int, random: np.random.Generator) -> Ints:
    """(size,) for each point one pair that holds it, or -1. One of several: a mean hides tears."""
    order = random.permutation(len(rows))
    chosen = np.full(size, -1)
    chosen[rows[order]] = order
    return chosen


def neighbor_pairs(positions: Floats, rows: Ints, random: np.random.Generator) -> tuple[Ints, Ints]:
    """Pairs whose points, given as rows, are neighbours or one and the same."""
    _, near = neighbors(positions, TEAR_NEIGHBORS)
    first = np.repeat(np.arange(len(rows)), TEAR_NEIGHBORS)
    second = representatives(rows, len(positions), random)[near[rows].ravel()]
    order = np.argsort(rows, kind="stable")
    same = rows[order[:-1]] == rows[order[1:]]
    first = np.concatenate([first, order[:-1][same]])
    second = np.concatenate([second, order[1:][same]])
    return first[second >= 0], second[second >= 0]


@dataclass(frozen=True)
class Smoothness:
    dirichlet: float
    stretch_p99: float
    flips: float


def smoothness(
    here: Surface, there: Surface, pairs: Ints, random: np.random.Generator
) -> Smoothness:
    """Stretch of edges, and sign of local 2x2 Jacobians, of the map that the pairs stand for.

    Both clouds are scaled to unit area. Edges join points of one sheet that are 2 to 4 spacings
    apart, so that the half spacing by which pairs snap to samples doesn't count.
    """
    from_points = here.positions / np.sqrt(here.area)
    to_points = there.positions / np.sqrt(there.area)
    spacing = 1 / np.sqrt(len(from_points))
    chosen = representatives(pairs[:, 0], len(from_points), random)
    image = np.where(chosen >= 0, pairs[chosen, 1], -1)
    centers = np.flatnonzero(image >= 0)
    centers = random.choice(centers, min(JACOBIANS, len(centers)), replace=False)
    count = min(48, len(from_points) - 1)
    length, near = cKDTree(from_points).query(from_points[centers], count, workers=-1)
    one_sheet = (here.normals[near] * here.normals[centers][:, None]).sum(axis=2) > 0.5
    used = (length > 2 * spacing) & (length < 4 * spacing) & (image[near] >= 0) & one_sheet
    before = from_points[near] - from_points[centers][:, None]
    after = to_points[image[near]] - to_points[image[centers]][:, None]
    stretch = np.linalg.norm(after, axis=2) / np.maximum(np.linalg.norm(before, axis=2), 1e-12)

    flat_before = _in_plane(before, here.normals[centers]) * used[..., None]
    flat_after = _in_plane(after, there.normals[image[centers]]) * used[..., None]
    gram = np.einsum("nki,nkj->nij", flat_before, flat_before)
    trace = np.trace(gram, axis1=1, axis2=2)
    sound = (used.sum(axis=1) >= 6) & (np.linalg.det(gram) > 1e-4 * trace**2)
    mixed = np.einsum("nki,nkj->nij", flat_after[sound], flat_before[sound])
    jacobians = mixed @ np.linalg.inv(gram[sound])
    if not (used.any() and sound.any()):
        return Smoothness(float("nan"), float("nan"), float("nan"))
    return Smoothness(
        float((stretch[used] ** 2).mean()),
        float(np.percentile(stretch[used], 99)),
        float((np.linalg.det(jacobians) < 0).mean()),
    )


def _in_plane(vectors: Floats, normals: Floats) -> npt.NDArray[Any]:
    """(N, K, 2): vectors (N, K, 3) in frames that turn the same way round their normals (N, 3)."""
    up = np.where(np.abs(normals[:, [2]]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = _unit(np.cross(normals, up))
    second = np.cross(normals, first)
    return np.stack([(vectors * axis[:, None]).sum(axis=2) for axis in (first, second)], axis=-1)
