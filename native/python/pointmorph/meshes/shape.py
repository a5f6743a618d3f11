"""What a file holds: points, and often faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pointmorph.meshes.geometry import boundary_loops, parts
from pointmorph.shapes.clouds import Cloud, FloatArray


@dataclass
class Shape:
    """The contents of a file, with rows in the file's order."""

    name: str
    positions: FloatArray
    """(N, 3)"""
    normals: FloatArray | None = None
    """(N, 3)"""
    colors: npt.NDArray[np.float32] | None = None
    """(N, 4), 0 to 1"""
    radii: FloatArray | None = None
    """(N,)"""
    faces: npt.NDArray[np.int64] | None = None
    """(F, 3) rows of positions; None for a point cloud"""
    rigid: FloatArray | None = None
    fixed: FloatArray | None = None
    delay: FloatArray | None = None
    """(N,), 0 to 1; see `Cloud`"""

    def cloud(self) -> Cloud:
        """The vertices, in order, and the faces; of an open mesh also its longest boundary."""
        boundary = labels = None
        if self.faces is not None:
            labels = parts(self.faces, self.positions)
            loops = boundary_loops(self.faces, len(self.positions))
            boundary = loops[0] if loops else None
        return Cloud(
            self.positions,
            self.normals,
            self.colors,
            self.radii,
            faces=self.faces,
            rigid=self.rigid,
            fixed=self.fixed,
            delay=self.delay,
            name=self.name,
            boundary=boundary,
            parts=labels,
        )
