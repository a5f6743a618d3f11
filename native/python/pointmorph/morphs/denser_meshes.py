"""A mesh with more faces where the other model has what it can't show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pointmorph.shapes.clouds import FloatArray

if TYPE_CHECKING:
    from pointmorph.base.stages import Progress
    from pointmorph.morphs.motion import Motion


@dataclass(frozen=True)
class DenserMesh:
    """What `Morph.denser` returns: the mesh of one model, with vertices in the middle of edges.

    The N vertices of the mesh come first, in order; K more follow. No vertex lies in the middle of
    a face's side. Vertices that share a place, as along the seams of a UV map, still do.
    """

    faces: npt.NDArray[np.int32]
    """(F, 3), rows of vertices"""
    parents: npt.NDArray[np.int64]
    """(F,): the row of the cloud's face that each is a piece of"""
    ends: npt.NDArray[np.int64]
    """(K, 2), rows of vertices: each further vertex is halfway between these, which come before"""
    positions: FloatArray
    """(N + K, 3): where the vertices are on their own model"""
    wrapped: FloatArray
    """(N + K, 3): where they end on the other model"""

    def extended(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Values of all vertices, from values of the mesh's own: UVs, weights, colors, positions.

        Parameters
        ----------
        values : (N, ...) array_like
            Numbers.

        Returns
        -------
        (N + K, ...) array
            Of type float64, or of that of `values` if these are floats.
        """
        given = np.asarray(values)
        if not np.issubdtype(given.dtype, np.floating):
            given = given.astype(np.float64)
        result = np.empty((len(given) + len(self.ends), *given.shape[1:]), given.dtype)
        result[: len(given)] = given
        for first, last in self._generations(len(given)):
            ends = self.ends[first - len(given) : last - len(given)]
            result[first:last] = 0.5 * (result[ends[:, 0]] + result[ends[:, 1]])
        return result

    def motion(self, path: str = "auto", progress: Progress | None = None) -> Motion:
        """The vertices on their way from `positions` (at 0) to `wrapped` (at 1).

        Parameters
        ----------
        path : str
            A choice of the setting `path`; see `pointmorph.options`.
        progress : callable, optional
            As for `pointmorph.morph`.
        """
        from pointmorph.morphs.motion import Motion

        return Motion(
            self.positions, self.positions, self.wrapped, path, progress, faces=self.faces
        )

    def _generations(self, count: int) -> Iterator[tuple[int, int]]:
        """Rows of further vertices all of which depend on earlier ones only."""
        latest = self.ends.max(axis=1, initial=-1)
        first, total = count, count + len(self.ends)
        while first < total:
            blocked = np.flatnonzero(latest[first - count :] >= first)
            last = total if len(blocked) == 0 else first + int(blocked[0])
            yield first, last
            first = last
