"""Frames of a morph whose shapes move and deform meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph, sequences, surfaces
from pointmorph.clouds import Cloud, FloatArray
from pointmorph.errors import CloudError
from pointmorph.morphing import Frame, Morph, ResampledFrame, restore

_AROUND = 8
_KEPT = 4  # frames whose pairs are remembered: each asks for its neighbours'
# How much a neighbourhood's own turn and growth count beside what its points say about each
# direction: nothing is said about that across the surface.
_STIFFNESS = 0.01

_Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Where the points of a shape are in one frame."""

    positions: FloatArray
    """(N, 3)"""
    normals: FloatArray
    """(N, 3), unit length"""


class MovingSequence(sequences.FrameSequence):
    """The frames of a morph each of whose shapes is in a pose of its own in every frame.

    Pairs lie between where their points are in that frame, along the paths of the settings. New
    points are those of the morph at rest, so that they keep their ids and come and go as there;
    they go along with the pairs around. Radii grow with the shapes.

    Parameters
    ----------
    morph : Morph
        As it was computed, at rest.
    times : sequence of float
        t of each frame, 0 to 1.
    poses : sequence of sequence of Pose
        For each frame, one for the source, the target, and of a chain for each shape between.
    settings : mapping
        Of the library, as `restore` takes them.
    first, step, resample
        As for `sequences.FrameSequence`. Frames have ids and velocities in any case.

    Raises
    ------
    CloudError
        When a pose has another number of points than its shape.
    """

    def __init__(
        self,
        morph: Morph,
        times: Sequence[float],
        poses: Sequence[Sequence[Pose]],
        settings: Mapping[str, Any],
        *,
        first: int = 0,
        step: int = 1,
        resample: bool = True,
    ) -> None:
        super().__init__(morph, times, first=first, step=step, resample=resample)
        self._poses = poses
        self._settings = settings
        self._shapes = [morph.parts[0].source, *(part.target for part in morph.parts)]
        for number, frame in zip(self.numbers, poses, strict=True):
            for shape, pose in zip(self._shapes, frame, strict=True):
                if len(pose.positions) != len(shape.positions):
                    raise CloudError(
                        shape.name,
                        f"{len(shape.positions):,} points in every frame",
                        f"{len(pose.positions):,} in frame {number}",
                        "Keep what adds or removes points out of the frames.",
                    )
        self._near = lru_cache(maxsize=None)(self._find_near)
        self._pairs_of = lru_cache(maxsize=_KEPT)(self._find_pairs)

    def _arrays(self) -> Iterator[npt.NDArray[Any]]:
        yield from super()._arrays()
        for frame in self._poses:
            for pose in frame:
                yield pose.positions
                yield pose.normals

    def frame(self, k: int, stopped: Callable[[], bool] = lambda: False) -> ResampledFrame:
        """Frame k, with velocities by frame: from the one before to the one after."""
        pairs = self._pairs_of(k)
        count = len(pairs.positions)
        velocities = self._velocities(k)
        if not self._resample:
            ids = np.arange(count, dtype=np.int32)
            return ResampledFrame(**vars(pairs), ids=ids, velocities=velocities)
        rest = self.morph.resampled_frame(self.times[k], lambda *_: not stopped())
        plain = self.morph.frame(self.times[k])
        growth = _ratio(pairs.radii, plain.radii)
        kept = rest.ids < count
        rows, new = rest.ids[kept], ~kept
        members = _pointmorph.nearest_rows(plain.positions, rest.positions[new], _AROUND)
        places = rest.positions[new].astype(np.float64)
        shares = _shares(plain, members, places, rest.normals[new])
        moved, matrices = _carried(places, members, shares, plain.positions, pairs.positions)

        def mean(values: FloatArray) -> _Doubles:
            found: _Doubles = np.einsum("nk,nk...->n...", shares, values[members])
            return found

        # Their own speed on the surface of the pairs, which turns and grows, on that surface's.
        own = rest.velocities * self._grows[k]
        at_rest = self._velocities_at_rest(rest, rows, count) * self._grows[k]
        speed = mean(velocities) + _turned(matrices, own[new] - mean(at_rest))
        dtype = rest.positions.dtype

        def joined(of_pairs: FloatArray, of_new: FloatArray) -> FloatArray:
            whole = np.empty((len(rest.ids), *of_pairs.shape[1:]), dtype)
            whole[kept], whole[new] = of_pairs[rows], of_new
            return whole

        radii = rest.radii.copy()
        radii[kept] *= growth[rows]
        radii[new] *= mean(growth)
        return replace(
            rest,
            positions=joined(pairs.positions, moved),
            normals=joined(pairs.normals, _normals(matrices, rest.normals[new])),
            radii=radii,
            velocities=joined(velocities, speed),
        )

    @staticmethod
    def _velocities_at_rest(
        rest: ResampledFrame, rows: npt.NDArray[np.int32], count: int
    ) -> _Doubles:
        """Of all pairs, 0 for those that are hidden."""
        found = np.zeros((count, 3))
        found[rows] = rest.velocities[rest.ids < count]
        return found

    def surface(
        self, k: int, frame: Frame, stopped: Callable[[], bool] = lambda: False
    ) -> surfaces.Surface:
        number, t = self._part(k)
        return surfaces.Surfaces(self._posed(k, number)).through(frame, t, stopped)

    def _part(self, k: int) -> tuple[int, float]:
        """The number of the morph that frame k is in, and t there."""
        return sequences.part_at(self.times[k], len(self.morph.parts))

    def _find_pairs(self, k: int) -> Frame:
        number, t = self._part(k)
        return self._posed(k, number).frame(t)

    def _velocities(self, k: int) -> FloatArray:
        """(M, 3): of the pairs, by frame."""
        before, after = max(k - 1, 0), min(k + 1, len(self.times) - 1)
        if before == after:
            return np.zeros_like(self._pairs_of(k).positions)
        way = self._pairs_of(after).positions - self._pairs_of(before).positions
        velocities: FloatArray = way / way.dtype.type(self.numbers[after] - self.numbers[before])
        return velocities

    def _posed(self, k: int, number: int) -> Morph:
        """One of the parts of the morph with its shapes as they are in frame k."""
        part = self.morph.parts[number]
        poses = self._poses[k][number : number + 2]
        clouds: list[Cloud] = []
        for side, (shape, pose) in enumerate(zip((part.source, part.target), poses, strict=True)):
            radii = shape.radii
            if radii is not None:
                radii = (radii * self._growth(number + side, pose)).astype(radii.dtype)
            clouds.append(Cloud(pose.positions, pose.normals, shape.colors, radii, name=shape.name))
        maps = None
        if self._settings.get("path", "linear") != "linear":
            maps = (
                self._landing(part.source_to_target, part.target, poses[1]),
                self._landing(part.target_to_source, part.source, poses[0]),
            )
        return restore(clouds[0], clouds[1], part.pairs, maps, **self._settings)

    def _growth(self, stage: int, pose: Pose) -> _Doubles:
        """(N,): how much farther from its neighbours a point is than at rest."""
        rest = self._shapes[stage].positions
        near = self._near(stage)
        if near.shape[1] == 0:
            return np.ones(len(rest))
        ways = (
            np.square(places[near].astype(np.float64) - places[:, None]).sum(axis=(1, 2))
            for places in (pose.positions, rest)
        )
        return np.sqrt(_ratio(*ways))

    def _find_near(self, stage: int) -> npt.NDArray[np.int32]:
        return _pointmorph.nearest_neighbors(self._shapes[stage].positions, _AROUND)

    @staticmethod
    def _landing(images: FloatArray, shape: Cloud, pose: Pose) -> _Doubles:
        """Where the points of the other shape land on one that moves."""
        places = images.astype(np.float64)
        members = _pointmorph.nearest_rows(shape.positions, places, _AROUND)
        shares = _shares(shape, members, places)
        return _carried(places, members, shares, shape.positions, pose.positions)[0]


def _ratio(values: npt.NDArray[Any], others: npt.NDArray[Any]) -> _Doubles:
    """1 where the other is 0."""
    values, others = values.astype(np.float64), others.astype(np.float64)
    result: _Doubles = np.divide(values, others, out=np.ones_like(values), where=others > 0.0)
    return result


def _shares(
    shape: Frame | Cloud,
    members: npt.NDArray[np.int32],
    places: _Doubles,
    normals: FloatArray | None = None,
) -> _Doubles:
    """(Q, k): how much each point around a place counts, in all 1; those of another sheet not."""
    squared = np.square(shape.positions[members] - places[:, None]).sum(axis=2)
    scale = np.maximum(squared.mean(axis=1, keepdims=True), 1e-100)
    weights: _Doubles = 1.0 / (squared / scale + 0.01)
    if normals is not None and shape.normals is not None:
        same = np.einsum("qkc,qc->qk", shape.normals[members], normals) > 0.0
        weights *= np.where(same.sum(axis=1, keepdims=True) >= 3, same, True)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights


def _carried(
    places: _Doubles,
    members: npt.NDArray[np.int32],
    shares: _Doubles,
    before: FloatArray,
    after: FloatArray,
) -> tuple[_Doubles, _Doubles]:
    """Where places go with the points around, and (Q, 3, 3) how these turn and stretch."""
    around = [points[members].astype(np.float64) for points in (before, after)]
    centers = [np.einsum("qk,qkc->qc", shares, points) for points in around]
    start, end = (points - at[:, None] for points, at in zip(around, centers, strict=True))
    spread = np.einsum("qk,qka,qkb->qab", shares, start, start)
    across = np.einsum("qk,qka,qkb->qab", shares, end, start)
    left, _, right = np.linalg.svd(across)
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    size = np.trace(spread, axis1=1, axis2=2)
    growth = np.sqrt(_ratio(np.einsum("qk,qka,qka->q", shares, end, end), size))
    stiff = (_STIFFNESS * size + 1e-100)[:, None, None]
    turned = growth[:, None, None] * (left @ right)
    matrices = (across + stiff * turned) @ np.linalg.inv(spread + stiff * np.eye(3))
    return centers[1] + _turned(matrices, places - centers[0]), matrices


def _turned(matrices: _Doubles, vectors: npt.NDArray[Any]) -> _Doubles:
    result: _Doubles = np.einsum("qab,qb->qa", matrices, vectors)
    return result


def _normals(matrices: _Doubles, normals: FloatArray) -> _Doubles:
    """Normals of a surface that is taken along: by the cofactors, which need no inverse."""
    a, b, c = (matrices[:, :, k] for k in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
    found = _turned(cofactors, normals)
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(length > 0.0, found / np.where(length > 0.0, length, 1.0), normals)
