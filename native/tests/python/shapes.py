"""Meshes that the tests share."""

from __future__ import annotations

import numpy as np

CUBE = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
SQUARES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


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


def ball(count: int) -> np.ndarray:
    """An even spiral of points on the unit sphere."""
    i = np.arange(count)
    z, a = 1 - (2 * i + 1) / count, i * np.pi * (3 - 5**0.5)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)


def around(points: np.ndarray) -> dict[str, int]:
    """Rows nearest to four places around the equator, anticlockwise seen from above."""
    places = {"front": (1, 0, 0), "left": (0, 1, 0), "back": (-1, 0, 0), "right": (0, -1, 0)}
    return {name: int(np.argmax(points @ np.array(place))) for name, place in places.items()}


def torus(tube: float, turns: int, across: int) -> np.ndarray:
    """(turns·across, 3), `turns` points around the axis in each of `across` circles."""
    u, v = np.meshgrid(np.arange(turns) * 2 * np.pi / turns, np.arange(across) * 2 * np.pi / across)
    r = 1 + tube * np.cos(v)
    return np.stack([r * np.cos(u), r * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)


def around_torus(turns: int, across: int) -> dict[str, int]:
    """Rows of nine points of such a torus: three around the axis, by three across. Both numbers are
    multiples of three."""
    return {f"{a}{b}": across // 3 * b * turns + turns // 3 * a for a in range(3) for b in range(3)}
