"""Files that earlier versions of the add-on have saved, kept as they are: this one goes on."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
from scenes import coordinates, key, morph, patch, select, slider

pytestmark = pytest.mark.interface

KEPT = Path(__file__).resolve().parents[2] / "native" / "tests" / "kept"
FILES = sorted(KEPT.glob("*/morph.blend"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.parent.name)
def test_a_kept_morph_goes_on(path, addon):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    obj, source = bpy.data.objects["Hill to Dune"], bpy.data.objects["Hill"]
    assert addon("scene.morph_object").is_result(obj)
    assert json.loads(obj.pointmorph.report)["pairs"] == len(obj.data.vertices)
    assert slider(obj).value == pytest.approx(0.4)
    assert source.data.shape_keys.key_blocks.keys() == ["Basis", "Dune 50 %", "Dune"]
    expected = patch(9)[0]
    np.testing.assert_array_equal(coordinates(source.data.vertices), expected)
    assert {tuple(p) for p in key(obj, "Basis").tolist()} == {tuple(p) for p in expected.tolist()}

    # Its map is computed again, from another target, into the same object.
    for vertex in bpy.data.objects["Dune"].data.vertices:
        vertex.co.z += 0.2
    before = key(obj, "Morph")
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert np.abs(key(obj, "Morph").mean(axis=0) - before.mean(axis=0))[2] == pytest.approx(
        0.2, abs=0.02
    )
    assert bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS") == {"FINISHED"}
    select(source)
    assert morph(new_result=True) is not obj


def test_there_are_kept_files():
    assert FILES
