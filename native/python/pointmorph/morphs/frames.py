"""A morph as frames: in-between clouds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.errors import OptionError
from pointmorph.base.stages import Progress
from pointmorph.shapes.clouds import Cloud, FloatArray


@dataclass(frozen=True)
class Frame:
    """An in-between cloud, with one row per pair of `Morph.pairs`."""

    positions: FloatArray
    """(M, 3)"""
    normals: FloatArray
    """(M, 3), unit length between the ends"""
    colors: FloatArray
    """(M, 4), red green blue alpha; white if neither cloud has colors"""
    radii: FloatArray
    """(M,)"""


@dataclass(frozen=True)
class ResampledFrame(Frame):
    """An in-between cloud without cracks, with as many rows as that takes."""

    ids: npt.NDArray[np.int32]
    """(M,), ascending: the row of a pair; higher for a new point, which keeps its id in all
    frames"""
    velocities: FloatArray
    """(M, 3), per unit of t; divide by the number of frames for velocities per frame"""


class AsFrames:
    """What a morph is as frames. This part of `Morph` also holds what it was made of."""

    def __init__(self, native: _pointmorph.Morph, source: Cloud, target: Cloud) -> None:
        self._native = native
        self.source = source
        self.target = target
        self.pairs: npt.NDArray[np.int64] = native.pairs()
        single = source.positions.dtype == target.positions.dtype == np.float32
        self._dtype: type[np.floating[Any]] = np.float32 if single else np.float64

    def empty_frame(self) -> Frame:
        """A frame of the right size and type to pass to `frame` as `out`."""
        m = len(self.pairs)
        return Frame(
            np.empty((m, 3), self._dtype),
            np.empty((m, 3), self._dtype),
            np.empty((m, 4), self._dtype),
            np.empty(m, self._dtype),
        )

    def _end(self, side: str) -> Frame:
        """The source or the target as a frame with a row for each of its points."""
        is_source = side == "source"
        native = self._native
        arrays = native.completed_source() if is_source else native.completed_target()
        positions = (self.source if is_source else self.target).positions
        if len(arrays["colors"]) == 0:
            arrays["colors"] = np.ones((len(positions), 4), np.float32)
        arrays["positions"] = positions
        return Frame(**{k: rows.astype(self._dtype, copy=False) for k, rows in arrays.items()})

    def frame(self, t: float, out: Frame | None = None, progress: Progress | None = None) -> Frame:
        """The in-between cloud at t, along paths of the kind that the setting `path` names.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1 (the target, bit for bit).
        out : Frame, optional
            An earlier frame of this morph to overwrite, which saves allocating memory.
        progress : callable, optional
            As in `morph`. Only the first frame on a path that isn't straight takes long.

        Returns
        -------
        Frame
            float32 if both clouds are float32, otherwise float64.

        Raises
        ------
        OptionError
            If t lies outside of [0, 1], or `out` has the wrong size or type.
        Cancelled
            If `progress` returned False.
        """
        if out is None:
            out = self.empty_frame()
        arrays = (out.positions, out.normals, out.colors, out.radii)
        for array, columns in zip(arrays, (3, 3, 4, 1), strict=True):
            fits = array.size == columns * len(self.pairs) and array.dtype == self._dtype
            if not (fits and array.flags.c_contiguous and array.flags.writeable):
                raise OptionError(
                    "out",
                    f"writable contiguous {self._dtype.__name__} arrays of {len(self.pairs)} rows",
                    f"shape {array.shape} and {array.dtype}",
                    "Pass an earlier frame of this morph, or what empty_frame() returned.",
                )
        self._write_frame(float(t), arrays, progress)
        return out

    def _write_frame(
        self, t: float, arrays: tuple[FloatArray, ...], progress: Progress | None
    ) -> None:
        """Writes the frame at t into positions, normals, colors and radii."""
        native = self._native
        write = native.frame_float32 if self._dtype is np.float32 else native.frame_float64
        if 0.0 < t < 1.0:
            native.lay_out_paths(progress)
        write(t, *arrays)

    def _lay_out_paths(self, progress: Progress | None) -> None:
        """Finds what all frames share; otherwise the first one does."""
        self._native.lay_out_paths(progress)

    def source_at(self, t: float, progress: Progress | None = None) -> npt.NDArray[np.float64]:
        """(N, 3): where the source's points are at t on their way to `source_to_target`, all at the
        same time. Takes no time if the latest frame was the one at t.

        Parameters
        ----------
        t : float
            0 to 1.
        progress : callable, optional
            As for `frame`.

        Raises
        ------
        OptionError
            If t lies outside of [0, 1].
        CloudError
            For a chain of several morphs.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
        >>> result.source_at(0.5).shape
        (900, 3)
        """
        places: npt.NDArray[np.float64] = self._native.source_at(float(t), progress)
        return places

    def resampled_frame(self, t: float, progress: Progress | None = None) -> ResampledFrame:
        """The in-between cloud at t, with new points where it would have cracks.

        New points lie on the smooth surface of the points around them and take their colors. They
        grow and shrink, so that nothing pops. The first call finds out when they appear and vanish;
        after that, calls may come in any order and from several threads.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1 (the target, bit for bit).
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        OptionError
            If t lies outside of [0, 1].
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
        >>> frame = result.resampled_frame(0.5)
        >>> bool(np.array_equal(frame.ids[:900], np.arange(900)))
        True
        """
        native = self._native
        single = self._dtype is np.float32
        make = native.resampled_frame_float32 if single else native.resampled_frame_float64
        return ResampledFrame(**make(float(t), progress))

    def inserted(self, progress: Progress | None = None) -> int:
        """The number of new points in all resampled frames together."""
        return self._native.inserted(progress)
