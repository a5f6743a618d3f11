"""Sampled shapes, the input of a morph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import CloudError

Faces = npt.NDArray[np.integer[Any]] | Sequence[Sequence[int]]
FloatArray = npt.NDArray[np.floating[Any]]
SIDES = ("source", "target")


class Cloud:
    """A sampled shape: points on a surface, with optional attributes.

    Parameters
    ----------
    positions : (N, 3) array of float32 or float64
        Points in any unit of length. Frames have the same type.
    normals : (N, 3) array, optional
        Outward normals of any length but zero. Estimated if missing.
    colors : (N, 4) array, optional
        Red, green, blue and alpha, 0 to 1.
    radii : (N,) array, optional
        Size of each point, in the unit of the positions. If missing, the spacing of the points.
    faces : (F, K) array of int, or sequence of polygons, optional
        Rows of the corners of each face, in order around it. With faces, the shape is their surface
        and `positions` are its vertices: see `morph`.
    rigid : (N,) array, optional
        With faces: how much each vertex keeps its shape when the mesh is wrapped, 0 to 1, for eyes,
        teeth or armor. Connected vertices turn, move and grow as one.
    fixed : (N,) array, optional
        With faces: how much each vertex stays where it is when the mesh is wrapped, 0 to 1.
    delay : (N,) array, optional
        Of the source: when each point goes, 0 (first) to 1 (last), for `stagger="delay"`.
    name : str
        Name of the shape, for error messages.
    boundary : sequence of int, optional
        Rows of the boundary of an open patch, in order along it, in either direction. Found
        automatically if missing.
    parts : sequence of int, optional
        One label per point, the same for connected points. Found automatically if missing; the
        faces of a mesh give better labels (`pointmorph.meshes.parts`).

    Raises
    ------
    CloudError
        If an array has the wrong shape or type. `pointmorph.morph` checks the values.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> cloud = pointmorph.Cloud(np.zeros((10, 3), np.float32), name="ten points")
    >>> len(cloud)
    10
    """

    def __init__(
        self,
        positions: npt.ArrayLike,
        normals: npt.ArrayLike | None = None,
        colors: npt.ArrayLike | None = None,
        radii: npt.ArrayLike | None = None,
        *,
        faces: Faces | None = None,
        rigid: npt.ArrayLike | None = None,
        fixed: npt.ArrayLike | None = None,
        delay: npt.ArrayLike | None = None,
        name: str = "cloud",
        boundary: Sequence[int] | npt.NDArray[np.integer[Any]] | None = None,
        parts: Sequence[int] | npt.NDArray[np.integer[Any]] | None = None,
    ) -> None:
        self.name = name
        points = np.asarray(positions)
        if points.dtype not in (np.float32, np.float64):
            points = self._numbers(points, "positions").astype(np.float64)
        self.positions: FloatArray = self._shaped(points, "positions", 3)
        self.normals = self._attribute(normals, "normals", 3)
        self.colors = self._attribute(colors, "colors", 4)
        self.radii = self._attribute(radii, "radii", None)
        self.faces = None if faces is None or len(faces) == 0 else self._polygons(faces)
        self.rigid = self._attribute(rigid, "rigid", None)
        self.fixed = self._attribute(fixed, "fixed", None)
        self.delay = self._attribute(delay, "delay", None)
        self.boundary = self._whole_numbers(boundary, "a list of rows as boundary")
        self.parts = self._whole_numbers(parts, "a list of labels as parts")

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        present = [a for a in ("normals", "colors", "radii") if getattr(self, a) is not None]
        extra = f" with {', '.join(present)}" if present else ""
        return f"<Cloud {self.name!r}: {len(self)} points{extra}>"

    def _numbers(self, values: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
        if not (
            np.issubdtype(values.dtype, np.integer) or np.issubdtype(values.dtype, np.floating)
        ):
            raise CloudError(
                self.name, f"numbers as {what}", f"type {values.dtype}", "Convert the array."
            )
        return values

    def _shaped(self, values: npt.NDArray[Any], what: str, width: int | None) -> npt.NDArray[Any]:
        if values.size == 0 and values.ndim <= 2 and what == "positions":
            return values.reshape(0, 3)
        if values.ndim != (1 if width is None else 2) or (width and values.shape[1] != width):
            raise CloudError(
                self.name,
                f"{what} of shape {'(N,)' if width is None else f'(N, {width})'}",
                f"shape {values.shape}",
                "Reshape the array to one row per point.",
            )
        return np.ascontiguousarray(values)

    def _attribute(
        self, values: npt.ArrayLike | None, what: str, width: int | None
    ) -> FloatArray | None:
        if values is None:
            return None
        array = self._shaped(self._numbers(np.asarray(values), what), what, width)
        if len(array) != len(self):
            raise CloudError(
                self.name,
                f"{what} for each of {len(self)} points",
                f"{len(array)}",
                "Pass one row per point, or None.",
            )
        return array

    def _whole_numbers(
        self, rows: Sequence[int] | npt.NDArray[np.integer[Any]] | None, what: str
    ) -> list[int]:
        if rows is None:
            return []
        array = np.asarray(rows)
        if array.ndim != 1 or (array.size and not np.issubdtype(array.dtype, np.integer)):
            raise CloudError(
                self.name,
                what,
                f"type {array.dtype} of shape {array.shape}",
                "Pass whole numbers: rows, counted from 0, or one label per point.",
            )
        return [int(row) for row in array]

    def _polygons(self, faces: Faces) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
        """Offsets and corners, as the native library takes them."""
        if isinstance(faces, np.ndarray) and faces.ndim == 2:
            corners = faces.reshape(-1)
            offsets = np.arange(len(faces) + 1, dtype=np.int64) * faces.shape[1]
        else:
            lengths = [len(face) for face in faces]
            offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
            corners = np.concatenate([np.asarray(face).reshape(-1) for face in faces])
        if not np.issubdtype(corners.dtype, np.integer):
            raise CloudError(
                self.name,
                "rows of vertices as faces",
                f"type {corners.dtype}",
                "Pass whole numbers, counted from 0.",
            )
        if corners.size and not 0 <= corners.min() <= corners.max() < len(self):
            raise CloudError(
                self.name,
                f"faces with rows from 0 to {len(self) - 1}",
                f"rows {corners.min()} to {corners.max()}",
                "Count vertices from 0.",
            )
        return offsets, np.ascontiguousarray(corners, np.int32)

    def _fields(self) -> dict[str, Any]:
        """The cloud as the native library takes it."""
        return {
            "name": self.name,
            "positions": self.positions,
            "normals": self.normals,
            "colors": self.colors,
            "radii": self.radii,
            "faces": self.faces,
            "rigid": self.rigid,
            "fixed": self.fixed,
            "delay": self.delay,
            "boundary": self.boundary,
            "parts": self.parts,
        }
