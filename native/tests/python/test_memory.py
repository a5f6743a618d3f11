"""How much memory a morph takes at most; see `memory_bounds`."""

from __future__ import annotations

import sys

import memory_bounds
import pytest

POINTS = 16_000


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says how much is in use")
@pytest.mark.parametrize("kind", memory_bounds.BOUNDS)
def test_memory_stays_within_its_bound(kind: str) -> None:
    taken, points = memory_bounds.peak_of(kind, POINTS)
    assert 0 < taken < memory_bounds.bound(kind, points)
