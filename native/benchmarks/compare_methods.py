"""The methods that compare_peers.py compares: from a pair of clouds and its features to pairs.

Every peer is used as its documentation shows, with its own defaults. Peers work in one place: the
target is moved, turned and scaled so that its features lie on the source's. Each method imports
what it needs itself, so that a missing package costs one row of the table only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pointmorph
from compare_measures import Floats, Ints, cloud_area, similarity
from pointmorph import Cloud, formats
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

CPD_POINTS = 2000
"""Points of each cloud that pycpd registers, since its matrices are dense; the rest follow."""


class NotApplicableError(Exception):
    """The method can't be used on this pair; the message says why."""


@dataclass(frozen=True)
class Pair:
    """What every method gets."""

    source: Cloud
    target: Cloud
    features: dict[str, tuple[int, int]]
    loop: list[str]
    faces: tuple[formats.Shape, formats.Shape] | None
    """Meshes of about as many vertices as the clouds have points; None where there are no faces."""

    @cached_property
    def marks(self) -> Ints:
        """(K, 2) rows of the features."""
        return np.array(list(self.features.values()), np.int64).reshape(-1, 2)

    @cached_property
    def start(self) -> Floats:
        """(N, 3) the source's points, scaled so that their spread is 1, about the origin."""
        return self._in_frame(self.source.positions)

    @cached_property
    def goal(self) -> Floats:
        """(M, 3) the target's points, where the features say that they belong."""
        return self.placed(self.target.positions)

    def placed(self, points: np.ndarray) -> Floats:
        """Points of the target, where the features say that they belong."""
        if len(self.marks) < 3:
            raise NotApplicableError(f"needs three features or more, found {len(self.marks)}")
        points = np.asarray(points, np.float64)
        rows = self.target.positions[self.marks[:, 1]].astype(np.float64)
        scale, turn, shift = similarity(rows, self.start[self.marks[:, 0]])
        return np.asarray(scale * points @ turn.T + shift)

    def from_source(self, points: np.ndarray) -> Floats:
        """Points of the source, in the same frame as `start`."""
        return self._in_frame(points)

    def _in_frame(self, points: np.ndarray) -> Floats:
        own = self.source.positions.astype(np.float64)
        middle = own.mean(axis=0)
        spread = np.sqrt(((own - middle) ** 2).sum(axis=1).mean())
        return np.asarray((np.asarray(points, np.float64) - middle) / spread)


def two_way(images: np.ndarray, targets: np.ndarray) -> Ints:
    """Pairs of each image with its nearest target and of each target with its nearest image."""
    forward = cKDTree(targets).query(images, workers=-1)[1]
    backward = cKDTree(images).query(targets, workers=-1)[1]
    here, there = np.arange(len(images)), np.arange(len(targets))
    both = [np.stack([here, forward], axis=-1), np.stack([backward, there], axis=-1)]
    return np.unique(np.concatenate(both), axis=0).astype(np.int64)


# --- Pointmorph -----------------------------------------------------------------------------------


def morph(pair: Pair, method: str) -> Ints:
    loop = pair.loop if method == "paper" else []
    try:
        result = pointmorph.morph(pair.source, pair.target, pair.features, loop=loop, method=method)
    except pointmorph.PointmorphError as error:
        raise NotApplicableError(str(error)) from error
    return result.pairs


# --- Peers ----------------------------------------------------------------------------------------


def procrustes(pair: Pair) -> Ints:
    """The nearest point once the features lie on one another."""
    return two_way(pair.start, pair.goal)


def bent(pair: Pair) -> Floats:
    """(N, 3) the source, bent by a thin plate so that its features meet the target's."""
    source, target = pair.start[pair.marks[:, 0]], pair.goal[pair.marks[:, 1]]
    try:
        plate = RBFInterpolator(source, target, kernel="thin_plate_spline")
    except (ValueError, np.linalg.LinAlgError) as error:
        raise NotApplicableError("needs four features or more that aren't in one plane") from error
    return np.asarray(plate(pair.start))


def thin_plate(pair: Pair) -> Ints:
    return two_way(bent(pair), pair.goal)


def coherent_point_drift(pair: Pair) -> Ints:
    """Myronenko and Song (2010), from the thin plate on."""
    import pycpd

    points, goal = bent(pair), pair.goal
    random = np.random.default_rng(0)
    few, few_goals = (
        cloud[random.choice(len(cloud), min(CPD_POINTS, len(cloud)), replace=False)]
        for cloud in (points, goal)
    )
    registration = pycpd.DeformableRegistration(X=few_goals, Y=few)
    registration.register()
    _, weights = registration.get_registration_parameters()
    squares = cdist(points, few, "sqeuclidean")
    return two_way(points + np.exp(-squares / (2 * registration.beta**2)) @ weights, goal)


def nonrigid_icp(pair: Pair) -> Ints:
    """Amberg et al. (2007), on the faces of both; the cloud rides on the source's faces."""
    import trimesh

    assert pair.faces is not None
    meshes = []
    for shape, place in zip(pair.faces, (pair.from_source, pair.placed), strict=True):
        meshes.append(trimesh.Trimesh(place(shape.positions), shape.faces, process=False))
    own, other = meshes
    marks = pair.marks
    _, _, marked = trimesh.proximity.closest_point(own, pair.start[marks[:, 0]])
    corners = trimesh.triangles.points_to_barycentric(
        own.triangles[marked], pair.start[marks[:, 0]]
    )
    moved = trimesh.registration.nricp_amberg(
        own,
        other,
        source_landmarks=(marked, corners),
        target_positions=pair.goal[marks[:, 1]],
    )
    nearest, _, face = trimesh.proximity.closest_point(own, pair.start)
    weights = trimesh.triangles.points_to_barycentric(own.triangles[face], nearest)
    images = (moved[own.faces[face]] * weights[..., None]).sum(axis=1)
    return two_way(images, pair.goal)


def functional_maps(pair: Pair) -> Ints:
    """Ovsjanikov et al. (2012) with wave kernel signatures of features, then ZoomOut (2019)."""
    from pyFM.functional import FunctionalMapping
    from pyFM.mesh import TriMesh

    first, second = (
        TriMesh(points / np.sqrt(cloud_area(points)), center=True)
        for points in (pair.start, pair.goal)
    )
    model = FunctionalMapping(first, second)
    model.preprocess(landmarks=pair.marks)
    model.fit()
    # From 50 eigenfunctions to 150, well within the 200 that are there by default.
    refined = model.zoomout_refine(nit=20, step=5)
    rank_second, rank_first = refined.shape
    own = model.mesh1.eigenvectors[:, :rank_first] @ refined.T
    return two_way(own, model.mesh2.eigenvectors[:, :rank_second])


def optimal_transport(pair: Pair) -> Ints:
    """The exact plan between equal weights, from the thin plate on; all that it joins is a pair."""
    import ot

    points, goal = bent(pair), pair.goal
    plan: Any = ot.emd([], [], ot.dist(points, goal), numItermax=10_000_000)
    return np.argwhere(plan > 0).astype(np.int64)


@dataclass(frozen=True)
class Method:
    title: str
    run: Callable[[Pair], Ints]
    modules: tuple[str, ...] = ()
    """What has to be installed besides numpy and scipy."""
    needs_faces: bool = False


METHODS: dict[str, Method] = {
    "auto": Method("Pointmorph", lambda pair: morph(pair, "auto")),
    "paper": Method("Pointmorph, `paper`", lambda pair: morph(pair, "paper")),
    "procrustes": Method("nearest after Procrustes", procrustes),
    "thin-plate": Method("thin plate", thin_plate),
    "cpd": Method("thin plate, pycpd", coherent_point_drift, ("pycpd",)),
    "nricp": Method("trimesh's non-rigid ICP", nonrigid_icp, ("trimesh", "rtree"), True),
    "functional-maps": Method("pyfmaps with ZoomOut", functional_maps, ("pyFM",)),
    "transport": Method("thin plate, POT", optimal_transport, ("ot",)),
}
