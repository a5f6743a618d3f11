"""U, the unit of time: building a kd-tree with nanoflann and finding 16 neighbors of every point.

On all threads, in C++, as the library does it. `ready()` compiles it, before times are taken.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from build_tools.wheels import build_native

NEIGHBORS = 16


def ready() -> None:
    _library()


@functools.cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL(str(build_native(("pointmorph_unit",)) / "libpointmorph_unit.so"))


def find_neighbors(positions: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Rows of the 16 nearest other points, (N, 16), of more than 16 points, (N, 3)."""
    points = np.ascontiguousarray(positions, np.float64)
    found = np.empty((len(points), NEIGHBORS), np.int32)
    _library().pointmorph_unit(
        ctypes.c_void_p(points.ctypes.data),
        len(points),
        NEIGHBORS,
        ctypes.c_void_p(found.ctypes.data),
    )
    return found
