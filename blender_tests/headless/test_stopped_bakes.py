"""Bakes that are killed: no broken file, and the next one leaves what an undisturbed one does."""

import random
import sys

import bpy
import pytest
from stopped_bakes import KINDS, WAYS, Bakes


@pytest.mark.computes
@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes in another way")
@pytest.mark.parametrize("kind", KINDS)
def test_a_killed_bake_breaks_nothing_and_the_next_one_finishes_it(module, tmp_path, kind):
    if kind == "USD" and bpy.app.version < (4, 5):
        pytest.skip("point clouds in USD need Blender 4.5")
    bakes = Bakes(module, kind, tmp_path)
    assert bakes.whole
    chance = random.Random(f"kills of {kind}")
    for way in WAYS:
        bakes.stop(way, chance)
    bakes.finish(kind)
    assert not bakes.finds
