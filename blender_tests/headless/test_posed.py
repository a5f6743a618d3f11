"""Characters that armatures pose: morphed at rest, and computed again in a pose."""

import json

import bpy
import numpy as np
import pytest
from modeling import add_armature
from scenes import (
    key,
    morph,
    pair,
    select,
)


def test_a_pose_that_would_be_there_twice_is_named(settings, capfd):
    """A morph of two characters at rest, which its rig moves, computed again in a pose."""
    settings.show_as = "MESH"
    source, target = pair(14, 12)
    for obj in (source, target):
        add_armature(obj, (0, 0, 0))
    shown = morph()
    assert [m.type for m in shown.modifiers] == ["NODES", "ARMATURE"]
    rigs = [obj for obj in bpy.context.scene.objects if obj.type == "ARMATURE"]
    places = key(shown, "Morph").copy()
    for posed in (rigs[:1], rigs):
        for rig in posed:
            rig.pose.bones["Bone"].location = (0, 0, 0.5)
        bpy.context.view_layer.update()
        select(shown)
        bpy.ops.pointmorph.recompute()
        np.testing.assert_array_equal(key(shown, "Morph"), places)  # the target is as it was
    assert bpy.ops.pointmorph.morph() == {"FINISHED"}  # it has a result
    assert settings.source == source
    assert bpy.context.view_layer.objects.active == shown
    assert len(bpy.context.scene.objects) == 6
    np.testing.assert_array_equal(key(shown, "Morph"), places)
    target.location.x = 2
    bpy.ops.pointmorph.recompute()
    np.testing.assert_allclose(key(shown, "Morph"), places + (2, 0, 0), atol=0.01)
    target.location.x = 0
    assert "Rest Position" not in capfd.readouterr().out
    for rig in rigs:
        rig.data.pose_position = "REST"
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.recompute()
    assert "Rest Position" not in capfd.readouterr().out


def two_characters(settings, target_pose=(0, 0, 0)):
    """A morph of two characters, the first of which is at rest; the target and both rigs."""
    settings.show_as = "MESH"
    source, target = pair(14, 12)
    add_armature(source, (0, 0, 0))
    add_armature(target, target_pose)
    shown = morph()
    rigs = [m.object for one in (source, target) for m in one.modifiers]
    return shown, target, rigs


def raise_vertices(target):
    for vertex in target.data.vertices:
        vertex.co.z *= 1.5


def show_key(target):
    target.shape_key_add(name="Basis")
    wide = target.shape_key_add(name="Wide")
    wide.value = 1.0
    for point in wide.data:
        point.co.x *= 2


def refine(target):
    target.modifiers.new("Rounder", "SUBSURF")


def mirror_over(target):
    target.modifiers.new("Twice", "MIRROR").use_axis = (False, False, True)


@pytest.mark.parametrize("change", [raise_vertices, show_key, refine, mirror_over])
def test_recompute_in_a_pose_sees_what_changed_of_the_target(settings, capfd, change):
    """It took the target as it was, and said nothing, but where vertices were edited."""
    shown, target, rigs = two_characters(settings)
    before = key(shown, "Morph").copy()
    for rig in rigs:
        rig.pose.bones["Bone"].location = (0, 0, 0.5)
    change(target)
    bpy.context.view_layer.update()
    select(shown)
    bpy.ops.pointmorph.recompute()
    posed = key(shown, "Morph").copy()
    assert "Rest Position" not in capfd.readouterr().out
    assert {rig.data.pose_position for rig in rigs} == {"POSE"}
    for rig in rigs:
        rig.data.pose_position = "REST"
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.recompute()
    np.testing.assert_array_equal(posed, key(shown, "Morph"))
    assert np.abs(posed - before).max() > 0.01


def test_recompute_of_a_target_that_was_posed_on_purpose(settings, capfd):
    """It is taken in that pose; in another one, that is said."""
    shown, _, rigs = two_characters(settings, (0, 0, 1))
    before = key(shown, "Morph").copy()
    rigs[0].pose.bones["Bone"].location = (0, 0, 0.5)
    bpy.context.view_layer.update()
    select(shown)
    bpy.ops.pointmorph.recompute()
    np.testing.assert_array_equal(key(shown, "Morph"), before)
    assert "Rest Position" not in capfd.readouterr().out
    rigs[1].pose.bones["Bone"].location = (0, 0, 2)
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.recompute()
    assert "Rest Position, and recompute" in capfd.readouterr().out
    np.testing.assert_allclose(key(shown, "Morph"), before - (0, 1, 0), atol=0.05)


def test_recompute_does_not_take_an_earlier_versions_target_for_one_at_rest(settings, capfd):
    """Which didn't note whether it was posed."""
    shown, _, rigs = two_characters(settings, (0, 0, 1))
    before = key(shown, "Morph").copy()
    for one in (shown, shown.pointmorph.made_from):
        recipe = json.loads(one.pointmorph.recipe)
        del recipe["shapes"][1]["pose"]
        one.pointmorph.recipe = json.dumps(recipe)
    rigs[0].pose.bones["Bone"].location = (0, 0, 0.5)
    bpy.context.view_layer.update()
    select(shown)
    bpy.ops.pointmorph.recompute()
    np.testing.assert_array_equal(key(shown, "Morph"), before)
    assert "Rest Position, and recompute" in capfd.readouterr().out
