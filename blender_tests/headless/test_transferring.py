"""What the target has, on the mesh that morphs into it or on the source: shape keys, UV maps, hair;
and the source's weights on the target."""

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
    pick,
    read,
    select,
)

pytestmark = pytest.mark.interface

MARKS = (("a", -1, -1), ("b", 1, -1), ("c", 1, 1), ("d", -1, 1), ("e", 0, 0))
PLACE = (3, 0, 0)
TURN = Matrix.Rotation(2.0, 3, (1, 2, 3)).to_quaternion()


def add_key(obj, name, offsets):
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis")
    block = obj.shape_key_add(name=name, from_mix=False)
    block.value = 0.0
    positions = coordinates(obj.data.vertices) + offsets
    block.data.foreach_set("co", positions.astype(np.float32).reshape(-1))
    return block


def smile(positions):
    """(N, 3): up and outward around a place."""
    near = np.exp(-8 * ((positions[:, :2] - 0.3) ** 2).sum(axis=1))
    return near[:, None] * [[0.1, 0.3, 0.2]]


def transfer(obj, **options):
    select(obj)
    return bpy.ops.pointmorph.transfer_attributes(**options)


def from_source(target, positions):
    """Places on the target in the source's space, which only lies elsewhere than the world's."""
    matrix = np.array(target.matrix_world)
    return positions @ matrix[:3, :3].T + matrix[:3, 3] - PLACE


def shown(obj):
    bpy.context.view_layer.update()
    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


@pytest.fixture
def turned(settings):
    """A sheet, and the same turned and twice as large, with a mesh that goes exactly there."""
    source, target = (add_mesh(name, *patch(12)) for name in ("Hill", "Dune"))
    for obj in (source, target):
        for name, x, y in MARKS:
            mark(obj, name, x, y)
    source.matrix_world = Matrix.Translation(PLACE)
    target.matrix_world = Matrix.LocRotScale((-2, 1, 0), TURN, (2, 2, 2))
    pick(source, target)
    settings.domain = "disk"
    settings.show_as = "MESH"
    settings.path = "linear"
    settings.blend_textures = False
    bpy.context.view_layer.update()
    copy = morph()
    exactly_there(copy, target)
    return source, target, copy


def exactly_there(copy, target, shift=(0, 0, 0)):
    """Makes the map of a mesh the one that is known."""
    positions = from_source(target, coordinates(target.data.vertices) + shift)
    block = copy.data.shape_keys.key_blocks["Morph"]
    block.data.foreach_set("co", positions.astype(np.float32).reshape(-1))
    copy.data.update()


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


def words(obj):
    recipe = json.loads(obj.pointmorph.recipe)
    return " / ".join(recipe["transferred"]["words"])


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
    keys["target.Smile"].value = 1.0  # the basis is what morphs
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
        assert "Dune: expected a mesh that lies where the viewport shows it" in said
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
    assert "has no effect any more" not in capfd.readouterr().out
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


# --- UV maps --------------------------------------------------------------------------------------


def test_uvs_keep_their_seams(turned):
    """Two islands, far apart: the same map has the same UVs at all corners."""
    _, target, copy = turned
    corners = np.array([loop.vertex_index for loop in target.data.loops])
    uvs = coordinates(target.data.vertices)[corners][:, :2] * 0.2 + 0.25
    middle = read(target.data.polygons, "center", 3)[:, 0]
    uvs[np.repeat(middle > 0.1, 4)] += 0.5
    layer = target.data.uv_layers.new(name="Skin")
    layer.data.foreach_set("uv", uvs.astype(np.float32).reshape(-1))
    transfer(copy, uvs=True)
    found = read(copy.data.uv_layers["target.Skin"].data, "uv", 2)
    np.testing.assert_allclose(found, uvs, atol=1e-5)
    assert "squeezed" not in words(copy)
    # Elsewhere, a face goes with one side.
    exactly_there(copy, target, shift=[0.07, 0, 0])
    transfer(copy, uvs=True)
    found = read(copy.data.uv_layers["target.Skin"].data, "uv", 2).reshape(-1, 4, 2)
    assert np.ptp(found, axis=1).max() < 0.06
    assert 'faces lie across a seam of the UV map "Skin"' in words(copy)


@pytest.mark.parametrize("by_pairs", [False, True])
def test_uv_maps_come_only_where_they_are_wanted(turned, by_pairs):
    _, target, copy = turned
    unwrap(target, "Skin")
    add_group(target, "bone", {0: 1.0})
    obj = copy.pointmorph.made_from if by_pairs else copy
    obj.hide_set(False)
    transfer(obj)
    assert "target.bone" in obj.vertex_groups
    assert "target.Skin" not in obj.data.attributes
    transfer(obj, uvs=True)
    assert obj.data.attributes["target.Skin"].domain == ("POINT" if by_pairs else "CORNER")


def test_no_room_for_another_uv_map(turned):
    _, target, copy = turned
    for number in range(8):
        copy.data.uv_layers.new(name=f"Own {number}")
    target.data.uv_layers.new(name="Skin")
    add_group(target, "bone", {0: 1.0})
    transfer(copy, uvs=True)
    assert 'has no room for the UV map "target.Skin"' in words(copy)
    assert "target.bone" in copy.vertex_groups


# --- The other way --------------------------------------------------------------------------------


@pytest.mark.parametrize("by_pairs", [False, True])
def test_weights_of_the_source_on_the_target(turned, by_pairs):
    source, target, copy = turned
    ramp = np.clip(0.5 + 0.4 * coordinates(source.data.vertices)[:, 0], 0, 1)
    add_group(source, "bone", dict(enumerate(ramp.tolist())))
    obj = copy
    if by_pairs:
        obj = copy.pointmorph.made_from
        obj.hide_set(False)
    transfer(obj, back=True)
    assert [group.name for group in target.vertex_groups][5:] == ["source.bone"]
    index = target.vertex_groups["source.bone"].index
    found = np.array([next((e.weight for e in v.groups if e.group == index), 0.0)
                      for v in target.data.vertices])  # fmt: skip
    np.testing.assert_allclose(found, ramp, atol=0.1 if by_pairs else 1e-5)
    assert 'To "Dune": the vertex group "source.bone"' in words(obj)
    # Once more, it's neither carried to and fro nor in its own way.
    transfer(obj, back=True)
    assert len(target.vertex_groups) == 6
    assert not [g.name for g in obj.vertex_groups if "source.bone" in g.name]


@pytest.mark.parametrize("prefix", ["", "target.", "x."])
def test_weights_to_and_fro_twice(turned, prefix):
    source, target, copy = turned
    add_group(source, "leg", {0: 1.0})
    add_group(target, "arm", {0: 1.0})
    copy.vertex_groups.clear()
    for _ in range(2):
        assert transfer(copy, back=True, prefix=prefix) == {"FINISHED"}
        back = prefix.replace("target", "source") + "leg"
        assert [group.name for group in target.vertex_groups][5:] == ["arm", back]
        assert [group.name for group in copy.vertex_groups] == [f"{prefix}arm"]
    # Only who asks for it changes the target.
    target.vertex_groups.remove(target.vertex_groups[back])
    bpy.ops.pointmorph.recompute()
    assert back not in target.vertex_groups
    assert f"{prefix}arm" in copy.vertex_groups


# --- Hair -----------------------------------------------------------------------------------------


def add_hair(target, count=20):
    """Strands of four points, straight up from faces, in a space of their own."""
    curves = bpy.data.hair_curves.new("Fur")
    curves.add_curves([4] * count)
    hair = bpy.data.objects.new("Fur", curves)
    bpy.context.scene.collection.objects.link(hair)
    hair.matrix_world = Matrix.LocRotScale((1, 1, 1), None, (0.5, 0.5, 0.5))
    bpy.context.view_layer.update()
    roots = read(target.data.polygons, "center", 3)[3 : 3 + 5 * count : 5]
    steps = np.linspace(0, 0.3, 4)[None, :, None] * [[[0.2, 0.0, 1.0]]]
    local = (roots[:, None] + steps).reshape(-1, 3)
    to_hair = np.array(hair.matrix_world.inverted() @ target.matrix_world)
    points = local @ to_hair[:3, :3].T + to_hair[:3, 3]
    curves.position_data.foreach_set("vector", points.astype(np.float32).reshape(-1))
    curves.surface = target
    radius = curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(4 * count, 0.01, np.float32))
    return hair, local


def unwrap(obj, name="UVMap"):
    corners = np.array([loop.vertex_index for loop in obj.data.loops])
    uvs = 0.5 + 0.45 * coordinates(obj.data.vertices)[corners][:, :2]
    layer = obj.data.uv_layers.new(name=name)
    layer.data.foreach_set("uv", uvs.astype(np.float32).reshape(-1))


def strand_points(curves):
    return read(curves.position_data, "vector", 3)


@pytest.mark.parametrize("source_has_uvs", [True, False])
def test_hair_goes_with_the_mesh(settings, turned, source_has_uvs):
    """At the start it stands on the source, at the end where the target's is."""
    _, target, copy = turned
    unwrap(target, "Skin")
    if source_has_uvs:
        unwrap(copy)
    hair, local = add_hair(target)
    before = strand_points(hair.data)
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    assert np.array_equal(strand_points(hair.data), before)
    assert (made.data.surface, made.parent) == (copy, copy)
    assert made.data.surface_uv_map == ("UVMap" if source_has_uvs else "target.Skin")
    np.testing.assert_allclose(strand_points(made.data), local, atol=5e-5)
    uvs = read(made.data.attributes["surface_uv_coordinate"].data, "vector", 2)
    np.testing.assert_allclose(uvs, 0.5 + 0.45 * local[::4, :2], atol=2e-3)
    radius = read(made.data.attributes["radius"].data, "value", 1)
    np.testing.assert_allclose(radius, 0.01 * 0.5 / 2, rtol=1e-3)
    assert 'the hair object "target.Fur"' in words(copy)
    there = from_source(target, local)
    for t, wanted in ((0.0, local), (1.0, there)):
        copy.data.shape_keys.key_blocks["Morph"].value = t
        grown = shown(made)
        found = strand_points(grown)
        roots = np.abs(found[::4] - wanted[::4]).max()
        assert roots < 0.01
        along, known = found[3::4] - found[::4], wanted[3::4] - wanted[::4]
        lengths = np.linalg.norm(along, axis=1), np.linalg.norm(known, axis=1)
        np.testing.assert_allclose(*lengths, rtol=0.02)
        cosine = (along * known).sum(axis=1) / (lengths[0] * lengths[1])
        assert cosine.min() > 0.98
        radius = read(grown.attributes["radius"].data, "value", 1)
        np.testing.assert_allclose(radius, 0.0025 * (1.0 + t), rtol=0.02)


def test_hair_once_more_and_on_the_source(turned):
    source, target, copy = turned
    for obj in (source, target, copy):
        unwrap(obj)
    _, local = add_hair(target)
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    made.data.materials.clear()
    curves = len(bpy.data.hair_curves)
    transfer(copy)
    assert bpy.data.objects["target.Fur"] == made
    assert len(bpy.data.hair_curves) == curves
    made.name = "Mine"
    transfer(copy, onto="SOURCE")
    other = bpy.data.objects["target.Fur"]
    assert (other.data.surface, len(other.modifiers)) == (source, 0)
    assert np.abs(strand_points(other.data) - local).max() < 0.1
    assert np.allclose(other.matrix_world, source.matrix_world)


def surface_nodes():
    """A group of nodes about a surface, as Blender's own for hair are."""
    group = bpy.data.node_groups.new("Trim", "GeometryNodeTree")
    for name, kind in (("G", "Geometry"), ("Surface", "Object"), ("UV", "Vector"),
                       ("Name", "String"), ("Size", "Float")):  # fmt: skip
        group.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    group.interface.new_socket("G", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    ends = [group.nodes.new(f"NodeGroup{way}") for way in ("Input", "Output")]
    group.links.new(ends[0].outputs[0], ends[1].inputs[0])
    return group


def test_hair_of_the_target_is_about_the_other_surface_then(addon, turned):
    """Modifiers, constraints and deltas of the hair that were about the target."""
    _, target, copy = turned
    unwrap(target, "Skin")
    unwrap(copy)
    hair, _ = add_hair(target)
    modifier = hair.modifiers.new("Trim", "NODES")
    modifier.node_group = surface_nodes()
    inputs = addon("data.versions")
    inputs.set_input(modifier, "Surface", target)
    inputs.set_input(modifier, "Name", "Skin")
    inputs.set_input_attribute(modifier, "UV", "Skin")
    hair.constraints.new("COPY_LOCATION").target = target
    hair.delta_location = (0, 0, 5)
    hair.delta_scale = (2, 2, 2)
    before = hair.matrix_world.copy()
    bpy.context.view_layer.update()
    hair.constraints[0].influence = 0.0
    hair.matrix_world = before
    bpy.context.view_layer.update()
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    own = made.modifiers["Trim"]
    assert inputs.input_value(own, "Surface") == copy
    assert inputs.input_value(own, "Name") == "UVMap"
    assert inputs.input_attribute(own, "UV") == "UVMap"
    assert inputs.input_attribute(own, "Size") is None
    assert inputs.input_value(modifier, "Surface") == target
    assert inputs.input_attribute(modifier, "UV") == "Skin"
    assert len(made.constraints) == 0
    bpy.context.view_layer.update()
    assert np.allclose(made.matrix_world, copy.matrix_world)


def test_hair_is_known_by_what_it_is(turned):
    """Not by names: the copy may be renamed, and so may the target's."""
    _, target, copy = turned
    unwrap(copy)
    unwrap(target)
    hair, _ = add_hair(target)
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    made.name, hair.name = "Mine", "Pelt"
    transfer(copy)
    assert made.name == "Mine"
    assert "target.Pelt" not in bpy.data.objects
    assert '"Mine"' in words(copy)
    bpy.data.objects.new("target.Other", None)
    other, _ = add_hair(target)
    other.name = "Other"
    transfer(copy)
    assert '"target.Other.001"' in words(copy)


@pytest.mark.parametrize("how", ["gone", "fewer"])
def test_hair_that_changes_meanwhile(addon, turned, how, monkeypatch):
    """Nothing is written then."""
    _, target, copy = turned
    unwrap(copy)
    add_group(target, "bone", {0: 1.0})
    hair, _ = add_hair(target)
    module = addon("scene.attribute_transfer")
    write = module.write

    def late(*arguments):
        if how == "gone":
            bpy.data.objects.remove(hair)
        else:
            hair.data = bpy.data.hair_curves.new("Bald")
        return write(*arguments)

    monkeypatch.setattr(module, "write", late)
    with pytest.raises(RuntimeError, match="Fur: expected an object that doesn't change"):
        transfer(copy)
    assert "target.bone" not in copy.vertex_groups


def test_hair_needs_a_uv_map(turned):
    _, target, copy = turned
    add_hair(target)
    transfer(copy)
    assert '"target.Fur" isn\'t attached: "Hill to Dune" has no UV map' in words(copy)


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


def test_values_by_place_on_the_source(turned):
    source, target, copy = turned
    place = coordinates(target.data.vertices)
    ramp = np.clip(0.5 + 0.4 * place[:, 1], 0, 1)
    add_group(target, "bone", dict(enumerate(ramp.tolist())))
    transfer(copy, onto="SOURCE", prefix="")
    index = source.vertex_groups["bone"].index
    found = np.array([next((e.weight for e in v.groups if e.group == index), 0.0)
                      for v in source.data.vertices])  # fmt: skip
    assert np.abs(found - ramp).max() < 0.1
    assert "bone" not in copy.vertex_groups
