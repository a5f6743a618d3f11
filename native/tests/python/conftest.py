"""The real pairs, where they are beside this checkout."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[4] / "shared" / "data"
PATCH_PAIRS = ("nefertiti_demosthenes", "face_nefertiti")


@pytest.fixture(params=PATCH_PAIRS)
def patch_pair(request: pytest.FixtureRequest) -> tuple[Path, dict[str, tuple[int, int]]]:
    """Folder and features of a real pair of open patches."""
    folder = SHARED / request.param
    if not folder.is_dir():
        pytest.skip(f"the real pair {request.param} is not beside this checkout")
    features = json.loads((folder / "pair.json").read_text())["features"]
    return folder, {name: tuple(pair) for name, pair in features.items()}


@pytest.fixture(params=("torus_kitten", "man_woman"))
def real_pair(request: pytest.FixtureRequest) -> Path:
    """Folder of a real pair of closed meshes."""
    folder = SHARED / request.param
    if not folder.is_dir():
        pytest.skip(f"the real pair {request.param} is not beside this checkout")
    return folder
