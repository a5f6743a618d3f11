"""A model's own file for each frame, with its vertices moved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pointmorph.base.stages import Progress
from pointmorph.morphs.denser_meshes import DenserMesh
from pointmorph.morphs.frames import Frame
from pointmorph.morphs.morphing import Morph
from pointmorph.morphs.motion import Motion
from pointmorph.sequences.source_meshes import SourceMesh
from pointmorph.shapes.clouds import FloatArray


class OwnMeshWriter:
    """Writes the mesh of one side for the frames of a sequence, wrapped along the morph's path.

    Parameters
    ----------
    morph : Morph
    mesh : SourceMesh
        The file of that side.
    side : str
        source or target.
    times : sequence of float
        t of each frame.
    """

    def __init__(self, morph: Morph, mesh: SourceMesh, side: str, times: Sequence[float]) -> None:
        self.suffix = mesh.suffix
        self._morph = morph
        self._mesh = mesh
        self._side = side
        self._times = times
        self._moving: Motion | None = None

    @property
    def denser(self) -> DenserMesh | None:
        """What is written instead of the mesh itself, if anything."""
        return self._mesh.denser

    def prepare(self, tolerance: float | None, progress: Progress | None = None) -> None:
        """Wraps the mesh, which the first frame does otherwise.

        Parameters
        ----------
        tolerance : float or None
            If given, the mesh gets more faces where it needs them; see `Morph.denser`.
        progress : callable, optional
            As for `pointmorph.morph`.
        """
        if tolerance is None:
            wrapped = self._morph.wrapped if self._side == "source" else self._morph.wrapped_target
            wrapped(0.0, progress)
            return
        denser = self._morph.denser(self._side, tolerance=tolerance, progress=progress)
        self._mesh.denser = denser
        self._moving = denser.motion(self._morph._settings()["path"], progress)

    def write(self, path: Path, k: int, frame: Frame, stopped: Callable[[], bool]) -> None:
        """See `sequences.MeshWriter`."""
        t = self._times[k]

        def going(*_: object) -> bool:
            return not stopped()

        if self._moving is not None:
            positions = self._moving.at(self._own_times(t), going)
        elif self._side == "source":
            positions = self._morph.wrapped(t, going)
        else:
            positions = self._morph.wrapped_target(t, going)
        self._mesh.write(path, positions)

    def _own_times(self, t: float) -> float | FloatArray:
        """How far the vertices of a denser mesh have gone at t: each by itself in a staggered
        morph."""
        assert self.denser is not None
        times = self._morph.vertex_times(t, self._side)
        share = self.denser.extended(times) if np.ptp(times) else float(times[0])
        return share if self._side == "source" else 1.0 - share
