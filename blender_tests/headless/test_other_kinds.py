"""Texts, curves, metaballs and what nodes show: morphed as a mesh of it, or refused in words."""

import bpy
import numpy as np
import pytest
from modeling import show_by_nodes
from scenes import (
    add_mesh,
    coordinates,
    data_blocks,
    error_of,
    morph,
    pair,
    patch,
    pick,
    set_t,
)


def add_other(kind):
    """An object that is no mesh but has faces, turned and with a material."""
    if kind == "FONT":
        bpy.ops.object.text_add()
        bpy.context.object.data.extrude = 0.1
    elif kind == "CURVE":
        bpy.ops.curve.primitive_bezier_circle_add()
        bpy.context.object.data.bevel_depth = 0.2
    elif kind == "META":
        bpy.ops.object.metaball_add()
    else:
        bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    obj = bpy.context.object
    obj.name = "Other"
    obj.rotation_euler = (0.3, 0, 0)
    obj.location = (0, 0, 4)
    bpy.context.view_layer.update()
    return obj


def in_world(obj):
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    matrix = np.array(obj.matrix_world)
    return coordinates(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]


def test_keys_on_the_mesh_of_a_text_are_not_promised_for_the_text(settings, capfd):
    settings.show_as = "MESH"
    pick(add_other("FONT"), add_mesh("Dune", *patch(9, bump=0.8)))
    morph()
    capfd.readouterr()
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")
    said = capfd.readouterr().out
    assert 'Shape keys added to "Other as Shown"' in said
    assert "For keys on" not in said


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("kind", ["FONT", "CURVE", "META", "SURFACE"])
def test_what_is_no_mesh_is_morphed(settings, capfd, kind, side):
    settings.show_as = "MESH"
    other = add_other(kind)
    places = in_world(other)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    ball = bpy.context.object
    ball.name = "Ball"
    pick(*((other, ball), (ball, other))[side])
    shown = morph()
    assert shown.name == ("Other to Ball", "Ball to Other")[side]
    assert 'Morphed as meshes, which are copies: "Other"' in capfd.readouterr().out
    assert (settings.source, settings.target)[side].name == "Other as Shown"
    set_t(shown, side)
    bpy.context.view_layer.update()
    found = in_world(shown)
    if side == 0:
        np.testing.assert_allclose(found, places, atol=1e-5)
    else:
        low, high = places.min(axis=0), places.max(axis=0)
        assert (found > low - 0.05).all()
        assert (found < high + 0.05).all()
        assert (np.ptp(found, axis=0) > 0.6 * (high - low)).all()
    bpy.ops.pointmorph.show_shapes()
    assert not other.hide_get()
    assert not other.hide_render


@pytest.mark.parametrize("side", ["source", "target"])
@pytest.mark.parametrize(
    ("kind", "found", "node"),
    [
        ("GeometryNodeMeshToPoints", "points", "Points to Vertices"),
        ("GeometryNodeInstanceOnPoints", "instances", "Realize Instances"),
        ("GeometryNodeMeshToCurve", "curves", "Curve to Mesh"),
    ],
)
def test_what_nodes_show_in_place_of_a_mesh_is_named(settings, side, kind, found, node):
    """It was said to need more points."""
    pair()
    obj = getattr(settings, side)
    show_by_nodes(obj, kind)
    if found == "instances":
        nodes = obj.modifiers[0].node_group
        cube = nodes.nodes.new("GeometryNodeMeshCube")
        placed = next(n for n in nodes.nodes if n.bl_idname == kind)
        nodes.links.new(cube.outputs[0], placed.inputs["Instance"])
    said = error_of(bpy.ops.pointmorph.morph)
    assert f"{obj.name}: expected a mesh in the viewport, found {found}. " in said
    assert f'Add the node "{node}"' in said


def test_an_error_names_the_object_that_is_there(settings):
    """It named the copy that was morphed, which is taken back."""
    source, _ = pair()
    source.modifiers.new("Blocks", "REMESH").mode = "BLOCKS"
    said = error_of(bpy.ops.pointmorph.morph)
    assert 'Hill: expected a point with a weight above 0 in the vertex group "pm.peak"' in said
    assert "as Shown" not in said
    assert "such as Remesh, lose marks" in said


def test_metaballs_that_belong_to_others_say_to_which(settings):
    for x in (0, 1):
        bpy.ops.object.metaball_add(location=(x, 0, 0))
    pick(bpy.context.object, add_mesh("Dune", *patch(9)))
    assert 'Choose "Mball"' in error_of(bpy.ops.pointmorph.morph)
    bpy.data.objects.remove(bpy.data.objects["Mball.001"])
    first = bpy.data.objects["Mball"]
    first.data.elements[0].use_negative = True  # it shows nothing itself
    pick(first, bpy.data.objects["Dune"])
    assert "Choose another object." in error_of(bpy.ops.pointmorph.morph)


def test_what_shows_no_faces_is_refused(settings):
    bpy.ops.curve.primitive_bezier_circle_add()
    circle = bpy.context.object
    target = add_mesh("Dune", *patch(9, bump=0.8))
    pick(circle, target)
    before = data_blocks()
    assert "expected faces in the viewport, found none" in error_of(bpy.ops.pointmorph.morph)
    assert settings.source == circle
    assert not circle.hide_get()
    assert data_blocks() == before


def test_an_object_that_cannot_be_morphed_is_named(settings, addon):
    add_mesh("Dune", *patch(9, bump=0.8)).select_set(True)
    add_other("META").select_set(True)
    bpy.ops.object.camera_add()
    for obj in bpy.context.scene.objects:
        obj.select_set(True)
    reason = addon("operators.polls").morph_reason(bpy.context)
    assert reason == '"Camera" can\'t be morphed: it has no surface (Camera)'
    bpy.data.objects["Camera"].select_set(False)
    bpy.ops.object.collection_instance_add(collection=bpy.data.collections.new("Set").name)
    bpy.data.objects["Dune"].select_set(True)
    reason = addon("operators.polls").morph_reason(bpy.context)
    assert reason.endswith("make its objects real (Object > Apply > Make Instances Real)")
    bpy.data.objects.remove(bpy.context.object)
    for obj in bpy.context.scene.objects:
        obj.select_set(obj.name != "Camera")
    assert bpy.ops.pointmorph.pick_selected() == {"FINISHED"}


def test_marks_wait_for_the_mesh_of_a_text(settings, addon):
    pick(add_other("FONT"), add_mesh("Dune", *patch(9, bump=0.8)))
    assert "is no mesh" in addon("scene.feature_marks").unmarkable(bpy.context)
    assert not bpy.ops.pointmorph.propose_features.poll()
    before = data_blocks()
    assert bpy.ops.pointmorph.check_features() == {"FINISHED"}  # as it will be morphed
    assert data_blocks() == before


def test_a_source_that_is_disabled_is_refused_in_words(mirrored, settings):
    text = add_other("FONT")
    hidden = bpy.data.collections.new("Hidden")
    bpy.context.scene.collection.children.link(hidden)
    for obj in (mirrored, text):
        for collection in list(obj.users_collection):
            collection.objects.unlink(obj)
        hidden.objects.link(obj)
    bpy.context.view_layer.layer_collection.children["Hidden"].exclude = True
    for obj in (mirrored, text):
        pick(obj, settings.target)
        assert "Enable it in the Outliner" in error_of(bpy.ops.pointmorph.morph)
        assert settings.source == obj


def test_a_copy_lies_where_its_original_is(settings):
    other = add_other("FONT")
    aim = bpy.data.objects.new("Aim", None)
    bpy.context.scene.collection.objects.link(aim)
    aim.location = (5, 6, 7)
    other.constraints.new("COPY_LOCATION").target = aim
    home = bpy.data.collections.new("Home")
    bpy.context.scene.collection.children.link(home)
    for collection in list(other.users_collection):
        collection.objects.unlink(other)
    home.objects.link(other)
    bpy.context.view_layer.update()
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    pick(other, bpy.context.object)
    places = in_world(other)
    morph()
    copy = settings.source
    assert copy.users_collection == (home,)
    np.testing.assert_allclose(in_world(copy), places, atol=1e-5)
