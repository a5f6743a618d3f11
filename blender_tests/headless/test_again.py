"""Morph on a pair that has a result computes it again; Key Morph animates it."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from panel_drawing import Layout, drawing_context
from scenes import (
    add_mesh,
    coordinates,
    error_of,
    mark,
    morph,
    pair,
    patch,
    select,
    shown_points,
    slider,
)

pytestmark = pytest.mark.interface


@pytest.fixture
def shown(settings):
    """What shows the morph of a pair of meshes."""
    settings.show_as = "MESH"
    pair(14, 12)
    return morph()


def results():
    return [
        obj.name for obj in bpy.data.objects if "source_row" in getattr(obj.data, "attributes", ())
    ]


def curve_of(addon, obj):
    return addon("data.versions").curve_of(obj.data.shape_keys, slider(obj).path_from_id("value"))


def keys_of(addon, obj):
    return [tuple(point.co) for point in curve_of(addon, obj).keyframe_points]


# --- Morph again ----------------------------------------------------------------------------------


def test_morph_computes_the_result_that_is_there_again(addon, shown):
    """With its keys, materials and modifiers, from the objects as they are now."""
    source = shown.pointmorph.source
    shown.data.materials.append(bpy.data.materials.new("Mine"))
    shown.modifiers.new("Mine", "CAST").factor = 0.0
    bpy.ops.pointmorph.key_morph(start=5, end=25)
    bpy.ops.pointmorph.show_shapes()
    for vertex in source.data.vertices:
        vertex.co.z += 0.2
    before = len(bpy.data.objects)
    assert morph() == shown
    assert len(bpy.data.objects) == before
    assert shown.name == "Hill to Dune"
    assert shown.pointmorph.state == "CURRENT"
    assert keys_of(addon, shown) == [(5, 0), (25, 1)]
    assert shown.data.materials[-1].name == "Mine"
    assert "Mine" in shown.modifiers
    assert source.hide_get()
    np.testing.assert_allclose(
        coordinates(shown.data.shape_keys.key_blocks[0].data),
        coordinates(source.data.vertices),
        atol=1e-6,
    )


def test_morph_again_takes_the_settings_that_are_there_now(settings, shown):
    settings.transfer_neighbors = 20
    assert shown.pointmorph.state == "STALE"
    morph()
    assert '"transfer_neighbors": 20' in shown.pointmorph.recipe
    assert shown.pointmorph.state == "CURRENT"


def test_a_second_result_is_made_on_request(shown):
    again = morph(new_result=True)
    assert again.name == "Hill to Dune.001"
    assert len(results()) == 2
    # From now on, the active one is meant.
    select(shown)
    assert morph() == shown
    select(again)
    assert morph() == again
    select(again.pointmorph.source)
    assert morph() == again
    assert len(results()) == 2


def test_other_objects_get_a_result_of_their_own(settings, shown):
    settings.source, settings.target = settings.target, settings.source
    assert morph() != shown
    assert len(results()) == 2


def test_a_result_whose_slider_was_removed_is_no_result(shown):
    shown.shape_key_remove(slider(shown))
    assert morph() != shown
    assert len(results()) == 2


def test_a_mesh_that_was_deleted_comes_back(shown):
    points = shown.pointmorph.made_from
    bpy.data.objects.remove(shown)
    again = morph()
    assert again.name == "Hill to Dune"
    assert points.name == "Hill to Dune Points"
    slider(again).value = 0.5
    bpy.ops.pointmorph.show_as(kind="POINTS")
    keys = points.data.shape_keys.key_blocks
    middle = (coordinates(keys[0].data) + coordinates(keys["Morph"].data)) / 2
    np.testing.assert_allclose(shown_points(points), middle, atol=1e-6)


def test_a_mesh_whose_points_are_gone_is_computed_again(shown):
    bpy.data.objects.remove(shown.pointmorph.made_from)
    for vertex in shown.pointmorph.source.data.vertices:
        vertex.co.z += 0.2
    assert morph() == shown
    assert shown.pointmorph.state == "CURRENT"


def test_a_mesh_that_somebody_works_on_is_asked_for(shown, capfd):
    select(shown)
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    try:
        assert f'Switch "{shown.name}" to Object Mode' in error_of(bpy.ops.pointmorph.morph)
        # The points may be computed again all the same.
        points = shown.pointmorph.made_from
        bpy.context.scene.tool_settings.lock_object_mode = False
        points.hide_set(False)
        bpy.context.view_layer.objects.active = points
        before = coordinates(slider(shown).data)
        shown.pointmorph.target.data.vertices[0].co.z += 0.5
        assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
        np.testing.assert_array_equal(coordinates(slider(shown).data), before)
        assert f'"{shown.name}" was left unchanged' in capfd.readouterr().out
    finally:
        bpy.context.view_layer.objects.active = shown
        bpy.ops.object.mode_set(mode="OBJECT")


def test_what_is_shown_stays_shown(settings, shown):
    points = shown.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="DISCS")
    assert morph() == points
    assert bpy.context.evaluated_depsgraph_get() is not None
    evaluated = points.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(evaluated.polygons) == len(points.data.vertices)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    assert settings.show_as == "POINTS"
    assert morph() == points
    assert len(shown_points(points)) == len(points.data.vertices)


def test_one_button_goes_through_the_shapes_in_between(settings):
    pair(14, 12)
    straight = morph()
    between = add_mesh("Mound", *patch(13, bump=0.2))
    mark(between, "peak", 0, 0)
    mark(between, "slope", 0.5, 0.3)
    settings.via.add().object = between
    chain = morph()
    assert chain != straight
    assert chain.name == "Hill to Mound to Dune"
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    assert bpy.context.view_layer.objects.active == chain
    settings.via.clear()
    assert morph() == straight
    settings.via.add()
    assert "every shape in between" in error_of(bpy.ops.pointmorph.morph)


def test_use_selected_takes_any_number_of_shapes(settings):
    objects = [add_mesh(name, *patch(8)) for name in ("c", "a", "d", "b")]
    for obj in objects:
        obj.select_set(True)
    bpy.context.view_layer.objects.active = objects[1]
    bpy.ops.pointmorph.pick_selected()
    assert settings.target.name == "a"
    assert settings.source.name == "b"
    assert [item.object.name for item in settings.via] == ["c", "d"]
    for obj in objects[2:]:
        obj.select_set(False)
    bpy.ops.pointmorph.pick_selected()
    assert (settings.source.name, settings.target.name) == ("c", "a")
    assert len(settings.via) == 0


# --- Key Morph ------------------------------------------------------------------------------------


@pytest.mark.parametrize("selected", ["others", "the same", "one other", "the result"])
def test_the_panel_says_that_others_are_selected(addon, settings, selected):
    """Morph takes what is chosen: it computed the first two again, whatever was selected."""
    settings.show_as = "MESH"
    first = pair()
    obj = morph()
    others = [add_mesh(name, *patch(7)) for name in ("Other", "Another")]
    objects = {
        "others": others,
        "the same": first,
        "one other": [first[0], others[0]],
        "the result": [obj, others[0]],
    }
    for one in bpy.context.scene.objects:
        one.hide_set(False)
        one.select_set(one in objects[selected])
    said = drawn_words(addon)
    assert any("press Use Selected" in text for text in said) == ("other" in selected)


def test_the_panel_says_that_many_selected_objects_are_a_chain(addon):
    """Those who had selected all parts of a car got a morph of its wheels."""
    for number in range(3):
        add_mesh(f"Part {number}", *patch(7)).select_set(number < 2)
    assert drawn_words(addon) == []
    bpy.data.objects["Part 2"].select_set(True)
    (said,) = drawn_words(addon)
    assert "goes through the 3 selected objects one after another" in said
    assert "Join Copies" in said


def drawn_words(addon):
    """What the panel Morph says."""
    said = []
    panels = addon("ui.panels")
    panel = SimpleNamespace(_draw_between=None)
    say, panels.say = panels.say, lambda layout, context, text, icon: said.append(text)
    try:
        panels.POINTMORPH_PT_morph._draw_shapes(panel, Layout(), drawing_context())
    finally:
        panels.say = say
    return said


def test_the_slider_is_keyed_from_frame_to_frame(addon, shown):
    scene = bpy.context.scene
    scene.frame_set(7)
    assert (shown.pointmorph.key_start, shown.pointmorph.key_end) == (7, 55)
    assert bpy.ops.pointmorph.key_morph() == {"FINISHED"}
    assert keys_of(addon, shown) == [(7, 0), (55, 1)]
    first = curve_of(addon, shown).keyframe_points[0]
    assert (first.interpolation, first.easing) == ("SINE", "EASE_IN_OUT")
    values = {}
    for frame in (1, 19, 31, 55, 60):
        scene.frame_set(frame)
        values[frame] = slider(shown).value
    assert (values[1], values[55], values[60]) == (0, 1, 1)
    assert values[31] == pytest.approx(0.5)
    assert 0.1 < values[19] < 0.2


def test_its_own_keys_are_replaced_and_others_stay(addon, shown):
    bpy.ops.pointmorph.key_morph(start=10, end=20, easing="LINEAR")
    slider(shown).value = 0.25
    slider(shown).keyframe_insert("value", frame=90)
    bpy.context.scene.frame_set(40)
    assert shown.pointmorph.key_start == 10
    shown.pointmorph.key_end = 50
    shown.pointmorph.key_easing = "CUBIC"
    bpy.ops.pointmorph.key_morph()
    assert keys_of(addon, shown) == [(10, 0), (50, 1), (90, 0.25)]
    assert curve_of(addon, shown).keyframe_points[0].interpolation == "CUBIC"
    assert slider(shown).value == pytest.approx(curve_of(addon, shown).evaluate(40))
    bpy.ops.pointmorph.recompute()
    bpy.ops.pointmorph.key_morph(start=1, end=30)
    assert keys_of(addon, shown) == [(1, 0), (30, 1), (90, 0.25)]


def test_the_points_follow_the_keys(shown):
    points = shown.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    bpy.ops.pointmorph.key_morph(start=1, end=11, easing="LINEAR")
    bpy.context.scene.frame_set(6)
    assert slider(points).value == pytest.approx(0.5)


def test_a_chain_is_keyed_to_its_last_shape(addon, settings):
    pair(14, 12)
    between = add_mesh("Mound", *patch(13, bump=0.2))
    mark(between, "peak", 0, 0)
    mark(between, "slope", 0.5, 0.3)
    settings.via.add().object = between
    chain = morph()
    bpy.ops.pointmorph.key_morph(start=1, end=21)
    assert keys_of(addon, chain) == [(1, 0), (21, 2)]


def test_reasons_why_it_cannot_be_keyed(settings):
    assert "Morph first" in error_of(bpy.ops.pointmorph.key_morph)
    pair()
    obj = morph()
    with pytest.raises(RuntimeError, match="a frame after the first, 9"):
        bpy.ops.pointmorph.key_morph(start=9, end=9)
    slider(obj).driver_add("value")
    assert "remove it first" in error_of(bpy.ops.pointmorph.key_morph)


# --- Animation of points that a mesh comes to show ------------------------------------------------


def test_keys_of_the_points_go_to_the_mesh(addon):
    points = show_points_first()
    bpy.ops.pointmorph.key_morph(start=5, end=25, easing="CUBIC")
    curve = curve_of(addon, points)
    curve.modifiers.new("CYCLES").mode_after = "MIRROR"
    shown = show_mesh()
    assert curve_of(addon, points) is None
    assert keys_of(addon, shown) == [(5, 0), (25, 1)]
    copy = curve_of(addon, shown)
    assert [p.interpolation for p in copy.keyframe_points] == 2 * ["CUBIC"]
    assert copy.modifiers[0].mode_after == "MIRROR"
    bpy.context.scene.frame_set(30)
    assert 0 < slider(shown).value == slider(points).value < 1
    known = shown.pointmorph
    assert (known.key_start, known.key_end, known.key_easing) == (5, 25, "CUBIC")
    bpy.ops.pointmorph.key_morph(start=1, end=10)
    assert keys_of(addon, shown) == [(1, 0), (10, 1)]


def show_points_first():
    """A morph of meshes that is shown by points, and has no mesh yet."""
    bpy.context.scene.pointmorph.show_as = "POINTS"
    pair(14, 12)
    return morph()


def show_mesh():
    assert bpy.ops.pointmorph.show_as(kind="MESH") == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def test_a_driver_of_the_points_goes_to_the_mesh():
    points = show_points_first()
    driver = slider(points).driver_add("value").driver
    driver.expression = "frame / 10"
    shown = show_mesh()
    bpy.context.scene.frame_set(5)
    assert slider(shown).value == slider(points).value == pytest.approx(0.5)
    assert "remove it first" in error_of(bpy.ops.pointmorph.key_morph)


def test_points_whose_mesh_was_deleted_have_their_own_slider(addon, shown):
    points = shown.pointmorph.made_from
    bpy.data.objects.remove(shown)
    select(points)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    bpy.ops.pointmorph.key_morph(start=5, end=25)
    again = show_mesh()
    assert (again.name, points.name) == ("Hill to Dune", "Hill to Dune Points")
    assert keys_of(addon, again) == [(5, 0), (25, 1)]
