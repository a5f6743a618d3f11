"""A morph as meshes: vertices along the map, and what else follows it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import OptionError
from pointmorph.base.stages import Progress
from pointmorph.meshes.geometry import triangulate
from pointmorph.morphs.carrying import Carrier
from pointmorph.morphs.denser_meshes import DenserMesh
from pointmorph.morphs.frames import AsFrames
from pointmorph.shapes.clouds import SIDES, FloatArray


class AsMeshes(AsFrames):
    """Where the map of a morph takes points and vertices. A part of `Morph`."""

    @cached_property
    def source_to_target(self) -> FloatArray:
        """(N, 3): where the map takes each source point; smooth, not snapped to target points."""
        return self._native.source_to_target(None).astype(self._dtype)

    @cached_property
    def target_to_source(self) -> FloatArray:
        """(M, 3): where the map takes each target point; smooth, not snapped to source points."""
        return self._native.target_to_source(None).astype(self._dtype)

    @property
    def has_mesh(self) -> bool:
        """Whether the source has faces for `wrapped`. With method paper it has none."""
        return self._native.has_mesh()

    def wrapped(self, t: float = 1.0, progress: Progress | None = None) -> FloatArray:
        """The vertices of the source's mesh at t: with its own faces, the mesh on its way.

        At 1 the mesh is wrapped onto the target: its faces lie smoothly on the target's surface,
        into its tips and hollows, as far as it has vertices for them. The first call wraps it;
        after that, calls are quick and may come from several threads.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1. In between, vertices travel as the setting `path`
            says.
        progress : callable, optional
            As for `morph`.

        Returns
        -------
        (N, 3) array
            In the order of the source's vertices, and of their type.

        Raises
        ------
        CloudError
            Unless `has_mesh`.
        OptionError
            If t lies outside of [0, 1].
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-1, 1, 12))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> corner = np.arange(132).reshape(11, 12)[:, :-1].reshape(-1, 1)
        >>> faces = corner + [0, 1, 13, 12]
        >>> ends = [pointmorph.Cloud(size * plane, faces=faces) for size in (1, 2)]
        >>> result = pointmorph.morph(*ends, {"corner": (0, 0), "other": (11, 11)})
        >>> result.wrapped(1).shape
        (144, 3)
        """
        wrapped: FloatArray = self._native.wrapped(float(t), progress)
        return wrapped.astype(self.source.positions.dtype, copy=False)

    @property
    def has_target_mesh(self) -> bool:
        """Whether the target has faces for `wrapped_target`. With method paper it has none."""
        return self._native.has_target_mesh()

    def wrapped_target(self, t: float = 0.0, progress: Progress | None = None) -> FloatArray:
        """The vertices of the target's mesh at t: with its own faces, the mesh on its way.

        Like `wrapped`, the other way round: at 0 the target's mesh is wrapped onto the source, at 1
        it is where it is, bit for bit.

        Parameters
        ----------
        t : float
            0 to 1.
        progress : callable, optional
            As for `morph`.

        Returns
        -------
        (M, 3) array
            In the order of the target's vertices, and of their type.

        Raises
        ------
        CloudError
            Unless `has_target_mesh`.
        OptionError
            If t lies outside of [0, 1].
        Cancelled
            If `progress` returned False.
        """
        wrapped: FloatArray = self._native.wrapped_target(float(t), progress)
        return wrapped.astype(self.target.positions.dtype, copy=False)

    def vertex_times(self, t: float, side: str = "source") -> npt.NDArray[np.float64]:
        """How far each vertex of the source's or the target's mesh has gone at t.

        Parameters
        ----------
        t : float
            0 to 1.
        side : str
            source or target.

        Returns
        -------
        (N,) array
            0 (still the source) to 1 (the target already): t itself unless the setting `stagger`
            lets some go first.

        Raises
        ------
        OptionError
            If there is no such side.
        """
        _check_side(side)
        return self._native.vertex_times(side == "source", float(t))

    def denser(
        self,
        side: str = "source",
        *,
        tolerance: float = 0.002,
        most_vertices: int = 200_000,
        progress: Progress | None = None,
    ) -> DenserMesh:
        """The mesh of one model with more faces where the other has what it can't show.

        Only there: faces that lie off the other model once they are wrapped onto it, or that it
        reaches beyond, are cut, until they fit or are small.

        Parameters
        ----------
        side : str
            source or target: whose mesh.
        tolerance : float
            How far faces may lie off, in √area of the other model.
        most_vertices : int
            It ends before there are more. There are at most eight new ones for each of the other
            model, or 500, about, in any case.
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        CloudError
            If that model has no faces.
        OptionError
            If an argument is out of range.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))
        >>> corner = np.arange(20).reshape(4, 5)[:, :-1].reshape(-1, 1)
        >>> faces = corner + [0, 1, 6, 5]
        >>> flat, high = (np.stack([x, y, h * x**2], axis=-1).reshape(-1, 3) for h in (0, 0.5))
        >>> ends = [pointmorph.Cloud(rows, faces=faces) for rows in (flat, high)]
        >>> mesh = pointmorph.morph(*ends).denser(tolerance=0.01)
        >>> bool(np.allclose(mesh.extended(flat), mesh.positions))
        True
        """
        _check_side(side)
        if not 1e-4 <= tolerance <= 1:
            raise OptionError(
                "tolerance", "a number from 0.0001 to 1", f"{tolerance}", "Try 0.002."
            )
        cloud = self.source if side == "source" else self.target
        most = min(max(int(most_vertices), len(cloud)), 2**31 - 1)
        faces, parents, ends, wrapped = self._native.denser(
            side == "source", float(tolerance), most, progress
        )
        mesh = DenserMesh(faces, parents, ends, wrapped, wrapped)
        return replace(mesh, positions=mesh.extended(cloud.positions))

    def carrier(self, side: str = "source", progress: Progress | None = None) -> Carrier:
        """Carries what the other shape has to the points of this one, along the map.

        Weights and colors, UVs, displacements such as those of shape keys, and strands of hair: see
        `Carrier`. With faces, vertices take it from where they are `wrapped`; else from where the
        map takes them.

        Parameters
        ----------
        side : str
            source or target: the shape that gets it.
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        OptionError
            If there is no such side.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
        >>> up = np.tile([0.0, 0, 1], (900, 1))
        >>> bool(np.allclose(result.carrier().displacements(up), 0.5 * up))
        True
        """
        _check_side(side)
        if side == "source":
            taker, giver = self.source, self.target
            meshed = self.has_mesh
            images = self.wrapped(1.0, progress) if meshed else self.source_to_target
        else:
            taker, giver = self.target, self.source
            meshed = self.has_target_mesh
            images = self.wrapped_target(0.0, progress) if meshed else self.target_to_source
        own, others = (
            None if cloud.faces is None else triangulate(cloud.positions, *cloud.faces)[0]
            for cloud in (taker, giver)
        )
        return Carrier(taker.positions, images, giver.positions, own, others)


def _check_side(side: str) -> None:
    """Raises OptionError unless it is one of the two."""
    if side not in SIDES:
        raise OptionError("side", "source or target", repr(side), "Choose one of them.")
