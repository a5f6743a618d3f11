"""Meshes that the tests share."""

from __future__ import annotations

import numpy as np


def grid(side: int, height: float = 0.0, dtype: type = np.float32) -> np.ndarray:
    """side² points over the square from -1 to 1, flat or with a soft bump."""
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    z = height * np.exp(-3 * (x**2 + y**2))
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(dtype)


def grid_faces(side: int) -> np.ndarray:
    """Two triangles a cell, normals up."""
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.stack([corner, corner + side, corner + side + 1], axis=-1)
    upper = np.stack([corner, corner + side + 1, corner + 1], axis=-1)
    return np.concatenate([lower, upper])
