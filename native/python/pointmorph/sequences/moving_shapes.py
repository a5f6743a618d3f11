"""Frames of a morph whose shapes move and deform while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.errors import CloudError
from pointmorph.base.option_table import is_straight
from pointmorph.morphs.frames import Frame, ResampledFrame
from pointmorph.morphs.morphing import Morph, restore
from pointmorph.sequences import frame_sequences, surfaces
from pointmorph.sequences.chains import Chain
from pointmorph.shapes.clouds import Cloud, FloatArray

_NEIGHBORS = 8
_CACHED = 4  # frames whose pairs are kept, because the frames next to them need these, too
# How much the rotation and growth of a whole neighborhood count beside the stretch that its points
# show in each direction. Across the surface they show none.
_STIFFNESS = 0.01

_Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ShapeState:
    """A moving shape in one frame."""

    positions: FloatArray
    """(N, 3)"""
    normals: FloatArray
    """(N, 3), unit length"""


class MovingSequence(frame_sequences.FrameSequence):
    """The frames of a morph whose shapes look different in each frame.

    In each frame, pairs move between the states that both shapes have in it, along the path that
    the settings name. New points are those of the morph at rest: they keep their ids, appear and
    vanish as they do there, and move with the pairs around them. Radii grow with the shapes.

    Parameters
    ----------
    morph : Morph
        Computed from the shapes at rest.
    times : sequence of float
        t of each frame, 0 to 1.
    states : sequence of sequence of ShapeState
        For each frame, the state of the source, of the target, and for a chain of each shape
        between.
    settings : mapping
        Settings of the library, as for `pointmorph.restore`.
    **numbering
        As for `frame_sequences.FrameSequence`. Frames always have ids and velocities.

    Raises
    ------
    CloudError
        If a state and its shape differ in the number of points.
    """

    def __init__(
        self,
        morph: Morph,
        times: Sequence[float],
        states: Sequence[Sequence[ShapeState]],
        settings: Mapping[str, Any],
        **numbering: Unpack[frame_sequences.Numbering],
    ) -> None:
        super().__init__(morph, times, **numbering)
        self._states = states
        self._settings = settings
        # A chain is staggered as a whole.
        self._own = settings if len(morph.parts) == 1 else {**settings, "stagger": "none"}
        self._shapes = [morph.parts[0].source, *(part.target for part in morph.parts)]
        for number, frame in zip(self.numbers, states, strict=True):
            for shape, state in zip(self._shapes, frame, strict=True):
                if len(state.positions) != len(shape.positions):
                    raise CloudError(
                        shape.name,
                        f"{len(shape.positions):,} points in every frame",
                        f"{len(state.positions):,} in frame {number}",
                        "Disable what adds or removes points over the frames.",
                    )
        self._neighbors = lru_cache(maxsize=None)(self._find_neighbors)
        self._pairs_of = lru_cache(maxsize=_CACHED)(self._find_pairs)

    def _arrays(self) -> Iterator[npt.NDArray[Any]]:
        yield from super()._arrays()
        for frame in self._states:
            for state in frame:
                yield state.positions
                yield state.normals

    def frame(self, k: int, stopped: Callable[[], bool] = lambda: False) -> ResampledFrame:
        """Frame k, with ids, and with velocities per frame.

        Parameters
        ----------
        k : int
        stopped : callable, optional
            Asked again and again; the work ends when it returns True.

        Raises
        ------
        Cancelled
            If `stopped` returned True.
        """
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
        members = _pointmorph.nearest_rows(plain.positions, rest.positions[new], _NEIGHBORS)
        places = rest.positions[new].astype(np.float64)
        shares = _shares(plain, members, places, rest.normals[new])
        moved, matrices = _moved_along(places, members, shares, plain.positions, pairs.positions)

        def mean(values: FloatArray) -> _Doubles:
            found: _Doubles = np.einsum("nk,nk...->n...", shares, values[members])
            return found

        # A new point also moves on the surface of the pairs; that motion rotates and grows with
        # the surface.
        own = rest.velocities * self._grows[k]
        at_rest = self._velocities_at_rest(rest, rows, count) * self._grows[k]
        speed = mean(velocities) + _transformed(matrices, own[new] - mean(at_rest))
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
        """(count, 3): of all pairs, 0 for hidden ones."""
        found = np.zeros((count, 3))
        found[rows] = rest.velocities[rest.ids < count]
        return found

    def surface(
        self, k: int, frame: Frame, stopped: Callable[[], bool] = lambda: False
    ) -> surfaces.Surface:
        morph, t = self._part(k)
        return surfaces.Surfaces(morph).through(frame, t, stopped)

    def _part(self, k: int) -> tuple[Morph, float]:
        """The morph that frame k belongs to, with its shapes as they are then, and t in it."""
        count = len(self.morph.parts)
        if isinstance(self.morph, Chain) and self.morph.is_staggered:
            parts = [self._morph_in(k, number) for number in range(count)]
            return Chain(parts, self._settings), self.times[k]
        number, t = frame_sequences.part_at(self.times[k], count)
        return self._morph_in(k, number), t

    def _find_pairs(self, k: int) -> Frame:
        morph, t = self._part(k)
        return morph.frame(t)

    def _velocities(self, k: int) -> FloatArray:
        """(M, 3): of the pairs, per frame, from the frame before to the frame after."""
        before, after = max(k - 1, 0), min(k + 1, len(self.times) - 1)
        if before == after:
            return np.zeros_like(self._pairs_of(k).positions)
        offset = self._pairs_of(after).positions - self._pairs_of(before).positions
        frames = self.numbers[after] - self.numbers[before]
        velocities: FloatArray = offset / offset.dtype.type(frames)
        return velocities

    def _morph_in(self, k: int, number: int) -> Morph:
        """One part of the morph, with its shapes as they are in frame k."""
        part = self.morph.parts[number]
        states = self._states[k][number : number + 2]
        clouds: list[Cloud] = []
        for side, (shape, state) in enumerate(zip((part.source, part.target), states, strict=True)):
            radii = shape.radii
            if radii is not None:
                radii = (radii * self._growth(number + side, state)).astype(radii.dtype)
            clouds.append(
                Cloud(
                    state.positions,
                    state.normals,
                    shape.colors,
                    radii,
                    delay=shape.delay,
                    name=shape.name,
                )
            )
        maps = None
        if not is_straight(**self._own):
            maps = (
                self._moved_images(part.source_to_target, part.target, states[1]),
                self._moved_images(part.target_to_source, part.source, states[0]),
            )
        return restore(clouds[0], clouds[1], part.pairs, maps, **self._own)

    def _growth(self, number: int, state: ShapeState) -> _Doubles:
        """(N,): distance of each point from its neighbors, relative to that at rest."""
        rest = self._shapes[number].positions
        near = self._neighbors(number)
        if near.shape[1] == 0:
            return np.ones(len(rest))
        distances = (
            np.square(places[near].astype(np.float64) - places[:, None]).sum(axis=(1, 2))
            for places in (state.positions, rest)
        )
        return np.sqrt(_ratio(*distances))

    def _find_neighbors(self, number: int) -> npt.NDArray[np.int32]:
        return _pointmorph.nearest_neighbors(self._shapes[number].positions, _NEIGHBORS)

    @staticmethod
    def _moved_images(images: FloatArray, shape: Cloud, state: ShapeState) -> _Doubles:
        """(N, 3): the images of a map onto a shape that has moved."""
        places = images.astype(np.float64)
        members = _pointmorph.nearest_rows(shape.positions, places, _NEIGHBORS)
        shares = _shares(shape, members, places)
        return _moved_along(places, members, shares, shape.positions, state.positions)[0]


def _ratio(values: npt.NDArray[Any], others: npt.NDArray[Any]) -> _Doubles:
    """values / others; 1 where the other is 0."""
    values, others = values.astype(np.float64), others.astype(np.float64)
    result: _Doubles = np.divide(values, others, out=np.ones_like(values), where=others > 0.0)
    return result


def _shares(
    shape: Frame | Cloud,
    members: npt.NDArray[np.int32],
    places: _Doubles,
    normals: FloatArray | None = None,
) -> _Doubles:
    """(Q, k) weights, with sum 1, of the points around each place. Given normals, points whose
    normals point the other way, as on the back of a thin part, don't count."""
    squared = np.square(shape.positions[members] - places[:, None]).sum(axis=2)
    scale = np.maximum(squared.mean(axis=1, keepdims=True), 1e-100)
    weights: _Doubles = 1.0 / (squared / scale + 0.01)
    if normals is not None and shape.normals is not None:
        same = np.einsum("qkc,qc->qk", shape.normals[members], normals) > 0.0
        weights *= np.where(same.sum(axis=1, keepdims=True) >= 3, same, True)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights


def _moved_along(
    places: _Doubles,
    members: npt.NDArray[np.int32],
    shares: _Doubles,
    before: FloatArray,
    after: FloatArray,
) -> tuple[_Doubles, _Doubles]:
    """(Q, 3): places moved along with the points around them; (Q, 3, 3): how these rotate and
    stretch."""
    around = [points[members].astype(np.float64) for points in (before, after)]
    centers = [np.einsum("qk,qkc->qc", shares, points) for points in around]
    start, end = (points - at[:, None] for points, at in zip(around, centers, strict=True))
    spread = np.einsum("qk,qka,qkb->qab", shares, start, start)
    across = np.einsum("qk,qka,qkb->qab", shares, end, start)
    left, _, right = np.linalg.svd(across)
    rotations = left @ right
    left[..., -1] *= np.sign(_determinants(rotations, _cofactors(rotations)))[:, None]
    size = np.trace(spread, axis1=1, axis2=2)
    growth = np.sqrt(_ratio(np.einsum("qk,qka,qka->q", shares, end, end), size))
    stiff = (_STIFFNESS * size + 1e-100)[:, None, None]
    rotations = growth[:, None, None] * (left @ right)
    matrices = (across + stiff * rotations) @ _inverses(spread + stiff * np.eye(3))
    return centers[1] + _transformed(matrices, places - centers[0]), matrices


def _inverses(matrices: _Doubles) -> _Doubles:
    """(Q, 3, 3): of matrices with positive traces. NumPy's own wait for a lock at each matrix where
    several threads ask: on busy cores, 25 s for 6000 of them instead of 0.001 s."""
    size = np.trace(matrices, axis1=1, axis2=2)[:, None, None]
    cofactors = _cofactors(matrices / size)
    determinants = _determinants(matrices / size, cofactors)[:, None, None]
    result: _Doubles = cofactors.transpose(0, 2, 1) / determinants / size
    return result


def _cofactors(matrices: _Doubles) -> _Doubles:
    """(Q, 3, 3)"""
    a, b, c = (matrices[:, :, k] for k in range(3))
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)


def _determinants(matrices: _Doubles, cofactors: _Doubles) -> _Doubles:
    """(Q,)"""
    result: _Doubles = np.einsum("qk,qk->q", matrices[:, 0], cofactors[:, 0])
    return result


def _transformed(matrices: _Doubles, vectors: npt.NDArray[Any]) -> _Doubles:
    result: _Doubles = np.einsum("qab,qb->qa", matrices, vectors)
    return result


def _normals(matrices: _Doubles, normals: FloatArray) -> _Doubles:
    """(Q, 3): normals of a transformed surface. Cofactors need no inverse."""
    found = _transformed(_cofactors(matrices), normals)
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(length > 0.0, found / np.where(length > 0.0, length, 1.0), normals)
