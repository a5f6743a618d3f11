"""Paths other than straight ones, for a cloud whose end positions are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.errors import CloudError, OptionError
from pointmorph.base.option_table import options
from pointmorph.base.stages import Progress
from pointmorph.shapes.clouds import Cloud, Faces, FloatArray


class Motion:
    """The path of a cloud to its end positions: it rotates and bends instead of shrinking.

    Parameters
    ----------
    positions, normals, images : (N, 3) array_like
        Where each point starts, its unit normal, and where it ends: `Morph.source_to_target`, for
        instance.
    path : str
        A choice of the setting `path`; see `pointmorph.options`.
    faces : (F, K) array of int, or sequence of polygons, optional
        Of a mesh: on the path rigid, each face turns and stretches by its own share, and doesn't
        turn over.
    progress : callable, optional
        As for `pointmorph.morph`.

    Raises
    ------
    CloudError
        If the arrays differ in shape or hold numbers that aren't finite.
    OptionError
        If the path is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> quarter = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    >>> turned = np.roll(quarter, -1, axis=0)
    >>> motion = pointmorph.Motion(quarter, quarter, turned, "similarity")
    >>> np.linalg.norm(motion.at(0.5), axis=1).round(6).tolist()
    [1.0, 1.0, 1.0, 1.0]
    """

    def __init__(
        self,
        positions: npt.ArrayLike,
        normals: npt.ArrayLike,
        images: npt.ArrayLike,
        path: str,
        progress: Progress | None = None,
        *,
        faces: Faces | None = None,
    ) -> None:
        paths = next(option.choices for option in options() if option.name == "path")
        if path not in paths:
            expected = f"{', '.join(paths[:-1])} or {paths[-1]}"
            raise OptionError("path", expected, repr(path), "Choose one of them.")
        arrays = tuple(np.asarray(rows, np.float64) for rows in (positions, normals, images))
        for name, rows in zip(("positions", "normals", "images"), arrays, strict=True):
            if rows.ndim != 2 or rows.shape[1] != 3 or rows.shape != arrays[0].shape:
                raise CloudError(
                    name,
                    f"an array of {len(arrays[0])} rows and 3 columns",
                    f"the shape {rows.shape}",
                    "Pass one row per point.",
                )
            if len(rows) == 0 or not np.isfinite(rows).all():
                raise CloudError(
                    name,
                    "finite numbers for at least one point",
                    "none, NaN or infinity",
                    "Remove those points.",
                )
        self._ends = arrays[0], arrays[2]
        self._pointwise: _pointmorph.PointwisePath | None = None
        self._at: Callable[[float, Progress | None], FloatArray] | None = None
        polygons = None if faces is None else Cloud(arrays[0], faces=faces).faces
        if path != "linear" and polygons is not None:
            mesh = _pointmorph.MeshMotion(arrays[0], arrays[2], polygons, path, progress)
            self._at = mesh.at
        elif path != "linear":
            cloud = _pointmorph.Motion(arrays[0], arrays[1], arrays[2], path, progress)
            self._at = lambda t, _: cloud.at(t)[0]

    def at(self, t: float | FloatArray, progress: Progress | None = None) -> FloatArray:
        """The positions at t.

        Parameters
        ----------
        t : float or (N,) array
            0 to 1; the positions are exact at both ends. An array gives each point a time of its
            own.
        progress : callable, optional
            As for `pointmorph.morph`; asked where faces take long.

        Returns
        -------
        (N, 3) array of float64

        Raises
        ------
        OptionError
            If t lies outside of [0, 1].
        """
        start, end = self._ends
        times = np.asarray(t, np.float64)
        if times.shape not in ((), (len(start),)) or not ((times >= 0) & (times <= 1)).all():
            expected = f"a number from 0 to 1, or {len(start)} of them"
            raise OptionError("t", expected, str(t), "Choose a value from that range.")
        if times.ndim == 0:
            return self._at_once(float(times), progress)
        if self._at is None:
            share = times[:, None]
            return np.where(share < 1, start + share * (end - start), end)
        if self._pointwise is None:
            self._pointwise = _pointmorph.PointwisePath(
                start, end, lambda own: self._at_once(own, progress)
            )
        return self._pointwise.at(times)

    def _at_once(self, t: float, progress: Progress | None) -> FloatArray:
        start, end = self._ends
        if t in (0, 1):
            return (end if t else start).copy()
        return start + t * (end - start) if self._at is None else self._at(t, progress)
