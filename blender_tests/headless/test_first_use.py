"""What someone meets who has never used it: the demo, the manual, their own language."""

import json

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Vector

pytestmark = pytest.mark.interface

PAIRS = ("ear.", "foot.F", "foot.H")
TIPS = ["nose", "tail", *(what + side for what in PAIRS for side in "LR")]


def test_the_demo_is_ready_to_be_morphed(settings, addon):
    bpy.ops.pointmorph.add_demo()
    source, target = settings.source, settings.target
    assert (source.name, target.name) == ("Hound", "Giraffe")
    assert len(source.data.vertices) != len(target.data.vertices)
    assert sorted(feature.name for feature in settings.features) == sorted(TIPS)
    for obj in (source, target):
        counts = np.bincount(np.ravel([e.vertices for e in obj.data.edges]))
        assert counts.min() > 2  # no loose points
        euler = len(obj.data.vertices) - len(obj.data.edges) + len(obj.data.polygons)
        assert euler == 2, "closed, in one piece, without a hole"
        assert obj.data.color_attributes.active_color is not None
    assert not [obj for obj in bpy.data.objects if obj.type == "META"]
    bpy.ops.pointmorph.morph()
    report = json.loads(bpy.data.objects["Hound to Giraffe"].pointmorph.report)
    verdict = addon("core.quality_words").verdict(report)
    assert verdict.line == "Good: no bad places"


def test_a_second_demo_stands_beside_the_first(settings):
    bpy.ops.pointmorph.add_demo()
    bpy.ops.pointmorph.add_demo()
    assert settings.source.name == "Hound.001"


def test_the_demo_stands_clear_of_what_is_there(settings):
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.pointmorph.add_demo()
    bpy.context.view_layer.update()

    def span(obj):
        return [sorted((obj.matrix_world @ Vector(c)).x for c in obj.bound_box)[k] for k in (0, -1)]

    assert span(settings.source)[0] > span(cube)[1]
    assert span(settings.target)[0] > span(settings.source)[1]


def test_the_demo_is_in_the_menu():
    functions = [f.__module__ for f in bpy.types.VIEW3D_MT_mesh_add._dyn_ui_initialize()]
    assert any("demo_scene" in module for module in functions)


def test_the_manual_is_found(addon, monkeypatch, tmp_path):
    manual = addon("operators.manual")
    monkeypatch.setattr(manual, "MANUAL", tmp_path / "index.html")
    monkeypatch.setattr(manual, "_SOURCES", tmp_path / "index.md")
    with pytest.raises(RuntimeError, match="reinstall the add-on"):
        bpy.ops.pointmorph.manual()


def test_the_demo_needs_object_mode():
    obj = scenes.add_mesh("Sheet", *scenes.patch(5))
    scenes.select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        bpy.ops.pointmorph.add_demo()
    bpy.ops.object.mode_set(mode="OBJECT")
