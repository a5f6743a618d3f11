"""Shapes that the tests share, and the real pairs where they are there."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
PATCH_PAIRS = ("nefertiti_demosthenes", "face_nefertiti")


def grid(side: int, height: float = 0.0, dtype: type = np.float32) -> np.ndarray:
    """side² points over [−1, 1]², flat or with a soft bump."""
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    z = height * np.exp(-3 * (x**2 + y**2))
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(dtype)


def grid_faces(side: int) -> np.ndarray:
    """Two triangles a cell, normals up."""
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.stack([corner, corner + side, corner + side + 1], axis=-1)
    upper = np.stack([corner, corner + side + 1, corner + 1], axis=-1)
    return np.concatenate([lower, upper])


@pytest.fixture(params=PATCH_PAIRS)
def patch_pair(request: pytest.FixtureRequest) -> tuple[Path, dict[str, tuple[int, int]]]:
    """Folder and features of a real pair of open patches."""
    folder = SHARED / request.param
    if not folder.is_dir():
        pytest.skip(f"the real pair {request.param} is not beside this checkout")
    features = json.loads((folder / "pair.json").read_text())["features"]
    return folder, {name: tuple(pair) for name, pair in features.items()}
