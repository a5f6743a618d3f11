"""Transforms that the user applies (Ctrl+A) to a morph, or to what it was made from."""

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    coordinates,
    error_of,
    morph,
    pair,
    recompute,
    select,
    set_t,
    shown_points,
    surface_of,
)

pytestmark = pytest.mark.interface

TURNED = Matrix.LocRotScale((1, 2, 3), Matrix.Rotation(0.4, 3, "Z"), (2, 1, 0.5))


@pytest.fixture(params=["MESH", "POINTS"])
def shown(request, settings):
    """What shows the morph of two sheets, the first of which was placed before."""
    settings.show_as = request.param
    source, _ = pair(14, 12)
    source.matrix_world = TURNED
    obj = morph()
    bpy.context.view_layer.update()
    return obj


def seen(obj):
    """(3, N, 3): what is seen of an object in the world at the start, in the middle and at the
    end."""
    places = []
    for t in (0.0, 0.5, 1.0):
        set_t(obj, t)
        shape = surface_of(obj) if obj.pointmorph.keeps_faces else shown_points(obj)
        matrix = np.array(obj.matrix_world)
        places.append(shape @ matrix[:3, :3].T + matrix[:3, 3])
    return np.array(places)


def apply(obj, **chosen):
    """What Ctrl+A does with an object, hidden or not."""
    hidden, active = obj.hide_get(), bpy.context.view_layer.objects.active
    obj.hide_set(False)
    select(obj)
    options = {"location": True, "rotation": True, "scale": True, **chosen}
    assert bpy.ops.object.transform_apply(**options) == {"FINISHED"}
    obj.hide_set(hidden)
    select(active)


def turn(obj):
    obj.matrix_world = Matrix.LocRotScale((4, 0, 1), Matrix.Rotation(0.7, 3, "Y"), (1, 3, 1))


@pytest.mark.parametrize(
    "chosen",
    [
        {},
        {"location": False},
        {"location": False, "rotation": False},
        {"location": False, "scale": False},
    ],
)
@pytest.mark.parametrize("moved", [False, True])
def test_recompute_leaves_what_was_applied_where_it_is(shown, chosen, moved):
    if moved:
        turn(shown)
    before = seen(shown)
    apply(shown, **chosen)
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)


def test_it_is_out_of_date_until_then(shown):
    turn(shown)
    apply(shown)
    assert shown.pointmorph.state == "STALE"
    assert shown.pointmorph.stale == 'transforms were applied to "Hill to Dune"'
    recompute(shown)
    assert shown.pointmorph.state == "CURRENT"


def test_applied_twice_and_moved_in_between(shown):
    turn(shown)
    apply(shown)
    shown.rotation_euler.x = 0.5
    apply(shown)
    shown.location.z = 2
    before = seen(shown)
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)


def show_again(shown):
    kind = "MESH" if shown.pointmorph.keeps_faces else "POINTS"
    assert bpy.ops.pointmorph.show_as(kind=kind) == {"FINISHED"}


def shear(obj):
    obj.rotation_euler.z += 0.7
    apply(obj)
    obj.scale.x = 3


def animate_place(obj):
    turn(obj)
    apply(obj)
    obj.keyframe_insert("location", frame=1)


def constrain(obj):
    turn(obj)
    apply(obj)
    obj.constraints.new("LIMIT_SCALE")


def mirror(obj):
    turn(obj)
    obj.scale.x = -1
    apply(obj)
    obj.keyframe_insert("location", frame=1)


LOST = {
    shear: "with its own, they shear",
    animate_place: "something else than you moves",
    constrain: "something else than you moves",
}


@pytest.mark.parametrize("change", [*LOST, mirror])
def test_a_mesh_that_cannot_get_them_back_keeps_them(settings, change, capfd):
    """Whatever is pressed leaves it as it looks; Recompute let it jump."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.matrix_world = TURNED
    source.shape_key_add(name="Basis")
    wide = source.shape_key_add(name="Wide")
    wide.value = 0.0  # Blender 5 begins with 1
    for point in wide.data:
        point.co.x *= 2
    shown = morph()
    change(shown)
    before = seen(shown)
    side = shown.data.polygons[0].normal.copy()
    show_again(shown)
    np.testing.assert_array_equal(seen(shown), before)
    for _ in range(2):
        recompute(shown)
        assert (shown.pointmorph.state, shown.pointmorph.stale) == ("CURRENT", "")
        np.testing.assert_allclose(seen(shown), before, atol=1e-4)
        assert shown.data.polygons[0].normal.dot(side) > 0.99
    assert "were lost" not in capfd.readouterr().out
    keys = shown.data.shape_keys.key_blocks
    keys["Wide"].value = 1.0
    found = seen(shown)[0]
    source.hide_set(False)
    applied = np.reshape(shown.pointmorph.applied, (4, 4))
    expected = coordinates(source.data.shape_keys.key_blocks["Wide"].data)
    matrix = np.array(shown.matrix_world) @ applied
    np.testing.assert_allclose(found, expected @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-4)


def delete_faces(mesh, rows):
    """Their edges stay."""
    edited = bmesh.new()
    edited.from_mesh(mesh)
    edited.faces.ensure_lookup_table()
    bmesh.ops.delete(edited, geom=[edited.faces[row] for row in rows], context="FACES_ONLY")
    edited.to_mesh(mesh)
    edited.free()


def test_a_mirrored_mesh_takes_the_source_s_new_faces(settings):
    """Only their edges were compared."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    delete_faces(source.data, [])  # its edges have their final order
    shown = morph()
    mirror(shown)
    side = shown.data.polygons[0].normal.copy()
    edges = len(source.data.edges)
    delete_faces(source.data, [20])
    assert len(source.data.edges) == edges
    recompute(shown)
    assert len(shown.data.polygons) == len(source.data.polygons)
    assert shown.data.polygons[0].normal.dot(side) > 0.99


def test_its_curved_ways_are_applied_as_well(settings):
    settings.show_as, settings.path = "MESH", "auto"
    pair(14, 12)[1].rotation_euler.x = 1.2
    shown = morph()
    turn(shown)
    before = seen(shown)
    apply(shown)
    shown.keyframe_insert("location", frame=1)
    assert np.abs(seen(shown)[1] - before[1]).max() > 0.01
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    set_t(shown, 0.0)
    points = bpy.context.view_layer.objects.active
    matrix = np.array(points.matrix_world)
    found = shown_points(points) @ matrix[:3, :3].T + matrix[:3, 3]
    for side in (np.min, np.max):
        np.testing.assert_allclose(side(found, axis=0), side(before[0], axis=0), atol=1e-4)


def test_more_can_be_applied_to_a_mesh_that_keeps_some(settings):
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    shown = morph()
    animate_place(shown)
    recompute(shown)
    shown.animation_data_clear()
    shown.rotation_euler.x = 0.4
    apply(shown)
    before = seen(shown)
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)
    assert shown.rotation_euler.x != 0  # what it could get back
    animate_place(shown)
    before = seen(shown)
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)
    for vertex in source.data.vertices:
        vertex.co.z *= 1.5
    recompute(shown)
    shown.animation_data_clear()
    morph(new_result=True)
    again = bpy.context.view_layer.objects.active
    assert not any(again.pointmorph.applied)


@pytest.mark.parametrize("change", LOST)
def test_points_that_cannot_get_them_back_lose_them_and_say_so(settings, change, capfd):
    """Whatever else is pressed leaves them as they look."""
    pair(14, 12)
    shown = morph()
    change(shown)
    before = seen(shown)
    show_again(shown)
    np.testing.assert_array_equal(seen(shown), before)
    capfd.readouterr()
    recompute(shown)
    said = f'Applied transforms were lost: {LOST[change]} "Hill to Dune"'
    assert said in capfd.readouterr().out
    assert shown.pointmorph.state == "CURRENT"


def test_what_cannot_be_baked_onto_the_source_is_said(settings):
    """The source was said to have changed."""
    pair(14, 12)
    obj = morph()
    turn(obj)
    apply(obj)
    obj.keyframe_insert("location", frame=1)
    said = error_of(bpy.ops.pointmorph.bake_shape_keys, kind="SOURCE")
    assert "Hill to Dune: expected points where they were made" in said
    assert "Recompute it." in said
    recompute(obj)
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE") == {"FINISHED"}


def test_a_mirrored_morph_shows_the_same_side(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    shown = morph()
    shown.scale.x = -1
    before = seen(shown)
    apply(shown)
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)
    assert shown.data.polygons[0].normal.z > 0.5


def test_nothing_is_given_back_while_a_twin_is_edited(settings):
    """Alt D shares the points, and Edit Mode writes them when it ends."""
    settings.show_as = "MESH"
    pair(14, 12)
    shown = morph()
    shown.scale.x = 2
    apply(shown)
    select(shown)
    bpy.ops.object.duplicate(linked=True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.view_layer.objects.active = shown
    show_again(shown)
    assert tuple(shown.scale) == (1, 1, 1)


def test_a_flat_morph(settings):
    for obj in pair(14, 12):
        obj.data.transform(Matrix.Diagonal((1, 1, 0, 1)))
    settings.show_as = "MESH"
    shown = morph()
    turn(shown)
    before = seen(shown)
    apply(shown)
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)


def test_children_stay(shown):
    child = bpy.data.objects.new("Child", None)
    bpy.context.scene.collection.objects.link(child)
    turn(shown)
    child.parent = shown
    child.location = (1, 1, 1)
    apply(shown)
    before = np.array(child.matrix_world)
    recompute(shown)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(np.array(child.matrix_world), before, atol=1e-5)


def test_keys_that_were_baked_stay(settings):
    pair(14, 12)
    obj = morph()
    obj.shape_key_add(name="Mine").data[0].co.z += 1
    turn(obj)
    apply(obj)
    recompute(obj)
    keys = obj.data.shape_keys.key_blocks
    np.testing.assert_allclose(keys["Mine"].data[0].co - keys[0].data[0].co, (0, 0, 1), atol=1e-5)


def test_points_that_were_edited_are_not_taken_for_it(shown):
    key = shown.data.shape_keys.key_blocks["Morph"]
    for point in key.data:
        point.co.x += 1
    assert shown.pointmorph.state == "CURRENT"
    before = np.array(shown.matrix_world)
    recompute(shown)
    np.testing.assert_array_equal(np.array(shown.matrix_world), before)


def test_points_are_shown_where_the_mesh_lies_that_was_applied(settings):
    settings.show_as = "MESH"
    pair(14, 12)[0].matrix_world = TURNED
    shown = morph()
    shown.matrix_world = Matrix.LocRotScale((4, 0, 1), Matrix.Rotation(0.7, 3, "Y"), None) @ TURNED
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.show_as(kind="POINTS")
    points = bpy.context.view_layer.objects.active
    before = seen(points)
    bpy.ops.pointmorph.show_as(kind="MESH")
    apply(shown)
    select(shown)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    np.testing.assert_allclose(seen(points), before, atol=1e-4)


def test_keys_are_baked_onto_the_source_all_the_same(settings):
    source, _ = pair(14, 12)
    obj = morph()
    turn(obj)
    apply(obj)
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE") == {"FINISHED"}
    assert [key.name for key in source.data.shape_keys.key_blocks] == ["Basis", "Dune"]


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("which", ["source", "target"])
def test_recompute_after_a_shape_was_applied(shown, which, moved):
    """The start of a moved morph jumped to another origin."""
    if moved:
        shown.location.x += 5
    before = seen(shown)
    apply(getattr(shown.pointmorph, which))
    recompute(shown)
    after = seen(shown)
    # Points of other numbers mean another order of pairs.
    np.testing.assert_allclose(after[0].mean(axis=0), before[0].mean(axis=0), atol=0.02)
    np.testing.assert_allclose(after[0].min(axis=0), before[0].min(axis=0), atol=1e-4)
    np.testing.assert_allclose(after[2].max(axis=0), before[2].max(axis=0), atol=1e-3)


def test_undo_and_redo_of_what_was_applied(shown):
    name = shown.name
    turn(shown)
    before = seen(shown)
    bpy.ops.ed.undo_push(message="before")
    select(shown)
    bpy.ops.object.transform_apply("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    shown = bpy.data.objects[name]
    assert shown.pointmorph.state == "CURRENT"
    bpy.ops.ed.redo()
    shown = bpy.data.objects[name]
    assert shown.pointmorph.state == "STALE"
    recompute(shown)
    np.testing.assert_allclose(seen(shown), before, atol=1e-4)
