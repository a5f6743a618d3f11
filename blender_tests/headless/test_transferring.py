"""The target's shape keys, on the mesh that morphs into it or on the source."""

import json

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_attribute,
    add_group,
    add_mesh,
    coordinates,
    error_of,
    key,
    mark,
    morph,
    pair,
    patch,
    select,
)
from transferring_scenes import MARKS, add_key, from_source, shown, smile, transfer, words

pytestmark = pytest.mark.interface


def test_a_smile_is_turned_and_scaled(turned):
    """At the start it's that of the source, at the end the target's own."""
    source, target, copy = turned
    own = coordinates(source.data.vertices)
    add_key(target, "Smile", smile(own))
    add_key(target, "Nothing", 0 * own)
    assert transfer(copy) == {"FINISHED"}
    keys = copy.data.shape_keys.key_blocks
    assert list(keys.keys()) == ["Basis", "Morph", "target.Smile", "target.Smile at the end"]
    np.testing.assert_allclose(key(copy, "target.Smile") - own, smile(own), atol=2e-6)
    assert source.data.shape_keys is None
    keys["target.Smile"].value = 1.0
    for t in (0.0, 0.5, 1.0):
        keys["Morph"].value = t
        found = coordinates(shown(copy).vertices)
        there = from_source(target, own + smile(own))
        wanted = (1 - t) * (own + smile(own)) + t * there
        np.testing.assert_allclose(found, wanted, atol=1e-5)
    assert 'the shape key "target.Smile"' in words(copy)


def test_once_more_takes_the_same_keys(turned):
    _, target, copy = turned
    block = add_key(target, "Smile", smile(coordinates(target.data.vertices)))
    block.slider_max, block.slider_min = 3.0, -2.0
    transfer(copy)
    keys = copy.data.shape_keys.key_blocks
    keys["target.Smile"].value = 2.0
    for point in block.data:
        point.co.z += 1
    transfer(copy)
    assert len(keys) == 4
    assert (keys["target.Smile"].slider_min, keys["target.Smile"].slider_max) == (-2.0, 3.0)
    assert keys["target.Smile"].value == 2.0
    moved = key(copy, "target.Smile") - key(copy, "Basis")
    assert moved[:, 2].min() > 0.9


def test_a_second_key_may_be_0(turned):
    """It's a share of the first one's value, whatever range this has."""
    _, target, copy = turned
    block = add_key(target, "Smile", smile(coordinates(target.data.vertices)))
    block.slider_max, block.slider_min = 0.9, 0.3
    transfer(copy)
    keys = copy.data.shape_keys.key_blocks
    first, end = keys["target.Smile"], keys["target.Smile at the end"]
    np.testing.assert_allclose((first.slider_min, first.slider_max), (0.3, 0.9), rtol=1e-6)
    np.testing.assert_allclose((end.slider_min, end.slider_max), (0.0, 0.9), rtol=1e-6)


def test_one_after_the_other_and_all_again(turned):
    """Colors and keys, then keys, then colors; a recompute repeats all, in each prefix."""
    _, target, copy = turned
    add_attribute(target.data, "Red", "FLOAT_COLOR", np.tile([1, 0, 0, 1], (144, 1)))
    add_group(target, "bone", {0: 1.0})
    add_key(target, "Smile", smile(coordinates(target.data.vertices)))
    nothing = {"colors": False, "weights": False, "keys": False, "hair": False}
    for wanted in (("colors", "keys"), ("keys",), ("colors",)):
        assert transfer(copy, **{**nothing, **dict.fromkeys(wanted, True)}) == {"FINISHED"}
    assert transfer(copy, **{**nothing, "weights": True, "prefix": "new."}) == {"FINISHED"}
    copy.vertex_groups.remove(copy.vertex_groups["new.bone"])
    copy.data.attributes.remove(copy.data.attributes["target.Red"])
    before = key(copy, "target.Smile")
    for point in target.data.shape_keys.key_blocks["Smile"].data:
        point.co.y += 0.5
    bpy.ops.pointmorph.recompute()
    assert "target.Red" in copy.data.attributes
    assert "new.bone" in copy.vertex_groups
    assert "target.bone" not in copy.vertex_groups
    assert np.linalg.norm(key(copy, "target.Smile") - before, axis=1).min() > 0.2
    said = words(copy)
    assert "target.Red" in said
    assert "new.bone" in said


def test_keys_on_the_source_itself(turned):
    """The source gets plain keys, and what shows the morph none."""
    source, target, copy = turned
    own = coordinates(source.data.vertices)
    add_key(target, "Smile", smile(own))
    assert transfer(copy, onto="SOURCE", colors=False, weights=False) == {"FINISHED"}
    keys = source.data.shape_keys.key_blocks
    assert list(keys.keys()) == ["Basis", "target.Smile"]
    assert keys["target.Smile"].value == 0.0
    # The map of the pairs is what was found, not quite the one that is known.
    moved = key(source, "target.Smile") - own
    assert np.abs(moved - smile(own)).max() < 0.06
    assert "target.Smile" not in copy.data.shape_keys.key_blocks
    assert copy.pointmorph.state == "CURRENT"
    keys["target.Smile"].value = 1.0
    source.pointmorph.keep_modifiers = True  # the basis is what morphs
    assert transfer(copy, onto="SOURCE") == {"FINISHED"}
    assert len(keys) == 2
    # A new morph has the source's keys, and gets the target's in their place.
    other = morph(new_result=True)
    assert "target.Smile" in other.data.shape_keys.key_blocks
    assert transfer(other) == {"FINISHED"}
    assert "target.Smile at the end" in other.data.shape_keys.key_blocks


def test_a_group_limits_a_key_and_keys_stand_on_others(turned):
    _, target, copy = turned
    own = coordinates(target.data.vertices)
    first = add_key(target, "Open", smile(own))
    second = add_key(target, "Wide", 2 * smile(own))
    second.relative_key = first
    half = target.vertex_groups.new(name="half")
    half.add(list(range(72)), 0.5, "REPLACE")
    first.vertex_group = "half"
    transfer(copy, weights=False)
    share = np.where(np.arange(144) < 72, 0.5, 0.0)[:, None]
    base = key(copy, "Basis")
    np.testing.assert_allclose(key(copy, "target.Open") - base, share * smile(own), atol=2e-6)
    np.testing.assert_allclose(key(copy, "target.Wide") - base, smile(own), atol=2e-6)


def test_keys_of_a_target_that_is_subdivided(settings):
    """Its keys have the vertices of the cage, the morph those that the viewport shows."""
    settings.show_as = "MESH"
    _, target = pair(14, 10)
    target.modifiers.new("Finer", "SUBSURF").levels = 1
    add_key(target, "Up", np.tile([0, 0, 0.5], (100, 1)))
    copy = morph()
    transfer(copy)
    moved = key(copy, "target.Up") - key(copy, "Basis")
    assert np.median(np.abs(np.linalg.norm(moved, axis=1) - 0.5)) < 0.1
    assert np.median(moved[:, 2]) > 0.35


@pytest.mark.parametrize("kind", ["SIMPLE_DEFORM", "ARMATURE", "NODES"])
def test_keys_of_a_target_that_is_posed_and_subdivided(settings, kind):
    """The cage goes where what deforms it takes it; what can't be told from other modifiers is
    refused."""
    settings.show_as = "MESH"
    _, target = pair(14, 10)
    pose(target, kind)
    target.modifiers.new("Finer", "SUBSURF").levels = 1
    places = coordinates(target.data.vertices)
    near = (np.linalg.norm(places - places[44], axis=1) < 0.3).astype(float)
    add_key(target, "Up", near[:, None] * [[0, 0, 0.5]])
    bpy.context.view_layer.update()
    posed = coordinates(shown(target).vertices)
    copy = morph()
    if kind == "NODES":
        select(copy)
        said = error_of(bpy.ops.pointmorph.transfer_attributes)
        assert "Dune: expected modifiers that add vertices without moving the mesh" in said
        assert transfer(copy, onto="RESULT", keys=False, hair=False, weights=False, colors=False,
                        uvs=True) == {"FINISHED"}  # fmt: skip
        return
    transfer(copy)
    assert [m.show_viewport for m in target.modifiers] == [True, True]
    assert np.array_equal(coordinates(shown(target).vertices), posed)
    moved = np.linalg.norm(key(copy, "target.Up") - key(copy, "Basis"), axis=1)
    landing = key(copy, "Morph") + np.array(copy.location)
    middle = landing[moved > 0.5 * moved.max()].mean(axis=0)
    target.modifiers["Finer"].show_viewport = False
    there = coordinates(shown(target).vertices)[44]
    assert np.linalg.norm(middle - there) < 0.2


def pose(obj, kind):
    """Moves a mesh by far with a modifier of that kind."""
    if kind == "NODES":
        obj.data.uv_layers.new(name="Skin")
        group = bpy.data.node_groups.new("Lift", "GeometryNodeTree")
        for way in ("INPUT", "OUTPUT"):
            group.interface.new_socket("G", in_out=way, socket_type="NodeSocketGeometry")
        ends = [group.nodes.new(f"NodeGroup{way}") for way in ("Input", "Output")]
        move = group.nodes.new("GeometryNodeTransform")
        move.inputs["Translation"].default_value = (0, 0, 3)
        group.links.new(ends[0].outputs[0], move.inputs[0])
        group.links.new(move.outputs[0], ends[1].inputs[0])
        obj.modifiers.new("Lift", "NODES").node_group = group
    elif kind == "SIMPLE_DEFORM":
        bend = obj.modifiers.new("Bend", "SIMPLE_DEFORM")
        bend.deform_method, bend.deform_axis, bend.angle = "BEND", "Y", 2.5
    else:
        bones = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
        bpy.context.scene.collection.objects.link(bones)
        select(bones)
        bpy.ops.object.mode_set(mode="EDIT")
        bone = bones.data.edit_bones.new("all")
        bone.head, bone.tail = (-1, 0, 0), (-1, 1, 0)
        bpy.ops.object.mode_set(mode="OBJECT")
        bones.pose.bones["all"].rotation_mode = "XYZ"
        bones.pose.bones["all"].rotation_euler = (0, 1.2, 0)
        add_group(obj, "all", dict.fromkeys(range(len(obj.data.vertices)), 1.0))
        obj.modifiers.new("Rig", "ARMATURE").object = bones


def test_recompute_transfers_keys_again(turned, capfd):
    source, target, copy = turned
    add_key(target, "Smile", smile(coordinates(target.data.vertices)))
    transfer(copy)
    before = key(copy, "target.Smile")
    for point in target.data.shape_keys.key_blocks["Smile"].data:
        point.co.y += 0.5
    select(copy)
    bpy.ops.pointmorph.recompute()
    assert np.linalg.norm(key(copy, "target.Smile") - before, axis=1).min() > 0.2
    positions, faces = patch(14)
    mesh = bpy.data.meshes.new("Finer")
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    source.data = mesh
    source.vertex_groups.clear()
    for name, x, y in MARKS:
        mark(source, name, x, y)
    capfd.readouterr()
    bpy.ops.pointmorph.recompute()
    assert "no longer has an effect" not in capfd.readouterr().out
    assert len(key(copy, "target.Smile")) == 196
    assert np.linalg.norm(key(copy, "target.Smile") - key(copy, "Basis"), axis=1).max() > 0.3


def test_names_of_ones_own_stay(turned):
    _, target, copy = turned
    own = coordinates(target.data.vertices)
    add_key(target, "Smile", smile(own))
    mine = add_key(copy, "target.Smile", 0 * own)
    said = error_of(bpy.ops.pointmorph.transfer_attributes)
    assert 'Hill to Dune: expected no other shape key named "target.Smile"' in said
    assert np.array_equal(key(copy, mine.name), key(copy, "Basis"))


def test_points_say_what_they_cannot_take(turned):
    _, target, copy = turned
    add_key(target, "Smile", smile(coordinates(target.data.vertices)))
    pairs = copy.pointmorph.made_from
    bpy.context.view_layer.objects.active = pairs
    pairs.hide_set(False)
    select(pairs)
    said = error_of(bpy.ops.pointmorph.transfer_attributes)
    assert "Shape keys and hair need faces: show the morph as a mesh first" in said


def test_a_chain_ends_as_its_last_shape(settings):
    settings.show_as = "MESH"
    _, target = pair()
    middle = add_mesh("Mid", *patch(11, bump=0.2))
    for name, x, y in (("peak", 0, 0), ("slope", 0.5, 0.3)):
        mark(middle, name, x, y)
    settings.via.add().object = middle
    add_key(target, "Up", np.tile([0, 0, 0.5], (100, 1)))
    target.matrix_world = Matrix.Rotation(0.7, 4, "X")
    bpy.context.view_layer.update()
    copy = morph()
    transfer(copy)
    keys = copy.data.shape_keys.key_blocks
    keys["target.Up"].value = 1.0
    t = keys[json.loads(copy.pointmorph.recipe)["keys"][0]]
    t.value = 2.0
    with_key = coordinates(shown(copy).vertices)
    keys["target.Up"].value = 0.0
    moved = with_key - coordinates(shown(copy).vertices)
    wanted = np.array(target.matrix_world)[:3, :3] @ [0, 0, 0.5]
    np.testing.assert_allclose(moved, np.tile(wanted, (len(moved), 1)), atol=1e-4)
