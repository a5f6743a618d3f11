"""A shape key on one mesh for each mesh of a collection."""

import bpy
import numpy as np
import pytest
from mathutils import Euler
from modeling import add_armature
from scenes import (
    add_group,
    add_mesh,
    coordinates,
    data_blocks,
    error_of,
    key,
    mark,
    morph,
    patch,
    pick,
    select,
)


def bake(**options):
    return bpy.ops.pointmorph.bake_collection(collection="Heads", **options)


def keys(obj):
    return obj.data.shape_keys.key_blocks


@pytest.fixture
def template(settings):
    """The active mesh; the collection Heads has three others, and itself."""
    settings.domain = "disk"
    heads = bpy.data.collections.new("Heads")
    bpy.context.scene.collection.children.link(heads)
    made = [add_mesh("Base", *patch(9))]
    for number, name in enumerate(("Dune", 'Hill "2"', "Ridge")):
        made.append(add_mesh(name, *patch(7 + number, bump=0.3 * number, turn=number)))
        made[-1].location = (3 * number + 2, 1, 0)
    for obj in made:
        mark(obj, "peak", 0, 0)
        mark(obj, "slope", 0.5, 0.3)
        bpy.context.scene.collection.objects.unlink(obj)
        heads.objects.link(obj)
    made[0].location, made[0].rotation_euler = (1, 2, 3), Euler((0.2, 0, 0.5))
    made[0].scale = (1, 1, 2)
    select(made[0])
    return made[0]


@pytest.mark.parametrize("in_place", [True, False])
def test_each_mesh_becomes_the_key_that_its_morph_bakes(template, in_place):
    assert bake(in_place=in_place) == {"FINISHED"}
    assert keys(template).keys() == ["Basis", "Dune", "Hill _2_", "Ridge"]
    assert [k.value for k in keys(template)][1:] == [0, 0, 0]
    found = [key(template, name) for name in keys(template).keys()[1:]]
    for name, positions in zip(("Dune", 'Hill "2"', "Ridge"), found, strict=True):
        target = bpy.data.objects[name]
        if in_place:
            target.location = template.location
        pick(template, target)
        morph()
        bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")
        np.testing.assert_allclose(positions, key(template, keys(template)[-1].name), atol=1e-6)


def test_baked_anew_keys_keep_their_sliders_and_drivers(template):
    template.shape_key_add(name="Basis")
    own = template.shape_key_add(name="Dune")  # the user's, before
    before = key(template, "Dune")
    bake()
    assert keys(template).keys() == ["Basis", "Dune", "Dune.001", "Hill _2_", "Ridge"]
    slider = keys(template)["Dune.001"]
    slider.value = 0.25
    keys(template)["Ridge"].driver_add("value").driver.expression = "0.5"
    ridge = key(template, "Ridge")
    bpy.data.objects["Ridge"].data.transform(
        ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 3, 0), (0, 0, 0, 1))
    )
    second = key(template, "Dune.001")
    bpy.data.objects["Dune"].data.transform(
        ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 2, 0), (0, 0, 0, 1))
    )
    bake()
    assert keys(template).keys() == ["Basis", "Dune", "Dune.001", "Hill _2_", "Ridge"]
    assert np.array_equal(key(template, own.name), before)
    assert slider.value == 0.25
    assert len(template.data.shape_keys.animation_data.drivers) == 1
    assert not np.allclose(key(template, "Ridge"), ridge, atol=0.01)
    assert not np.allclose(key(template, "Dune.001"), second, atol=0.01)


def lifted(obj, name, height, where=lambda co: True):
    """Gives an object a shape key that lifts some of its vertices."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis")
    block = obj.shape_key_add(name=name)
    block.value = 0.0
    for point in block.points:
        if where(point.co):
            point.co.z += height
    return block


def at(obj, **values):
    """(N, 3): the vertices as shown with these sliders, the others at 0."""
    for block in keys(obj)[1:]:
        if not block.name.endswith("at the end"):
            block.value = values.get(block.name.replace(".", "_"), 0.0)
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return coordinates(obj.evaluated_get(depsgraph).data.vertices)


def test_the_meshes_own_keys_and_weights_come_along(template):
    bpy.context.preferences.filepaths.use_scripts_auto_execute = True
    dune, ridge = bpy.data.objects["Dune"], bpy.data.objects["Ridge"]
    dune.scale = (1, 1, 0.5)
    lifted(dune, "Up", 0.4)
    lifted(dune, 'Left "corner"', 0.8, lambda co: co.x < 0)
    lifted(dune, "Nothing", 0.0)
    lifted(ridge, "Up", 1.0).vertex_group = "half"
    add_group(ridge, "half", dict.fromkeys(range(len(ridge.data.vertices)), 0.5))
    add_group(template, "Ridge.half", {0: 1.0})  # the user's, before
    assert bake(keys=True, weights=True) == {"FINISHED"}
    names = ["Dune", "Dune.Up", "Dune.Left _corner_", "Hill _2_", "Ridge", "Ridge.Up"]
    made = [name for name in keys(template).keys()[1:] if not name.endswith("at the end")]
    assert made == names
    # Once the template is the target, it moves as the target does.
    turn = np.linalg.inv(np.array(template.matrix_world)[:3, :3]).T
    for name, offset in (("Dune", [0, 0, 0.2]), ("Ridge", [0, 0, 0.5])):
        moved = at(template, **{name: 1.0, f"{name}_Up": 1.0}) - at(template, **{name: 1.0})
        np.testing.assert_allclose(moved, np.tile(offset @ turn, (81, 1)), atol=2e-3)
    # As it is itself, across its own surface: a sheet as large, less bumpy.
    moved = at(template, Dune_Up=1.0) - at(template)
    assert moved[:, 2].min() > 0
    left = at(template, **{"Dune_Left _corner_": 1.0}) - at(template)
    sides = [left[coordinates(template.data.vertices)[:, 0] * side > 0.3] for side in (-1, 1)]
    assert np.linalg.norm(sides[0], axis=1).mean() > 5 * np.linalg.norm(sides[1], axis=1).mean()
    assert template.vertex_groups.keys()[-2:] == ["Ridge.half", "Ridge.half.001"]
    group = template.vertex_groups["Ridge.half.001"]
    weights = [group.weight(row) for row in range(81)]
    np.testing.assert_allclose(weights, 0.5, atol=1e-6)

    keys(template)["Dune.Up"].value = 0.25
    before = key(template, "Ridge.Up")
    keys(ridge)["Up"].points[40].co.z += 0.5
    bake(keys=True, weights=True)
    made = [name for name in keys(template).keys()[1:] if not name.endswith("at the end")]
    assert made == names
    assert keys(template)["Dune.Up"].value == 0.25
    assert not np.allclose(key(template, "Ridge.Up"), before, atol=0.01)
    assert template.vertex_groups.keys()[-2:] == ["Ridge.half", "Ridge.half.001"]


def test_a_pose_that_would_be_there_twice_is_named(template, capfd):
    """Keys go on a mesh that its armature bends after them."""
    for obj in (template, bpy.data.objects["Dune"]):
        add_armature(obj, (0, 0, 0.5))
    select(template)
    assert bake() == {"FINISHED"}
    said = capfd.readouterr().out
    assert '"Dune" was taken as it is posed now, and the armature of "Base" poses it once' in said
    for rig in bpy.data.armatures:
        rig.pose_position = "REST"
    assert bake() == {"FINISHED"}
    assert "Rest Position" not in capfd.readouterr().out


def test_names_that_would_be_the_same_are_made_apart(template):
    heads = bpy.data.collections["Heads"]
    dune = bpy.data.objects["Dune"]
    for obj in list(heads.objects)[2:]:
        heads.objects.unlink(obj)
    lifted(dune, "Up", 0.4)
    lifted(dune, "U" * 60, 0.2)
    twin = dune.copy()
    twin.name = "Dune.Up"
    twin.data = dune.data.copy()
    heads.objects.link(twin)
    for _ in range(2):
        assert bake(keys=True) == {"FINISHED"}
        made = [name for name in keys(template).keys()[1:] if not name.endswith("at the end")]
        assert len(made) == 6
        assert {"Dune", "Dune.Up", "Dune.Up.001", "Dune.Up.Up"} <= set(made)


def test_a_mesh_that_cannot_be_had_is_left_out(template):
    flat = add_mesh("Apart", [(0, 0, 0), (1, 0, 0)])
    empty = add_mesh("Empty", [])
    for obj in (flat, empty):
        bpy.data.collections["Heads"].objects.link(obj)
    assert bake() == {"FINISHED"}
    assert keys(template).keys() == ["Basis", "Dune", "Hill _2_", "Ridge"]


def test_features_that_only_one_has_are_not_used(template):
    mark(template, "ear", -0.5, -0.3)
    mark(bpy.data.objects["Dune"], "tail", 0.5, -0.5)
    assert bake() == {"FINISHED"}
    assert len(keys(template)) == 4


def test_nothing_changes_where_nothing_can_be_done(template):
    heads = bpy.data.collections["Heads"]
    for obj in list(heads.objects)[1:]:
        heads.objects.unlink(obj)
    assert "no mesh in it" in error_of(bpy.ops.pointmorph.bake_collection, collection="Heads")
    assert "Choose another" in error_of(bpy.ops.pointmorph.bake_collection, collection="None")
    heads.objects.link(add_mesh("Empty", []))
    before = data_blocks()
    assert "Empty" in error_of(bpy.ops.pointmorph.bake_collection, collection="Heads")
    assert data_blocks() == before
    assert template.data.shape_keys is None
    bpy.context.view_layer.objects.active = None
    assert "active object" in error_of(bpy.ops.pointmorph.bake_collection, collection="Heads")
