"""What is pressed on a duplicate of a morph is about the duplicate."""

import json

import bpy
import numpy as np
import pytest
from scenes import (
    content,
    morph,
    pair,
    recompute,
    select,
    set_t,
    shown_points,
    slider,
    surface_of,
)

pytestmark = pytest.mark.interface


@pytest.fixture
def shown(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    return morph()


@pytest.fixture(params=[False, True], ids=["Shift D", "Alt D"])
def twin(request, shown):
    """A duplicate of what shows a morph, moved aside, and active."""
    select(shown)
    assert bpy.ops.object.duplicate(linked=request.param) == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    copy.location.x += 5
    bpy.context.view_layer.update()
    return copy


def state(obj, addon):
    """What is seen of a morph by its mesh and by its points."""
    points = (obj.pointmorph.mesh and obj) or obj.pointmorph.made_from
    shows = addon("scene.points_display").shows
    colored = [name for name in ("distortion", "confidence") if shows(points, name)]
    return obj.hide_get(), points.hide_get(), tuple(points.location), colored


@pytest.mark.parametrize("attribute", ["confidence", "distortion"])
def test_colors_are_those_of_the_duplicate(addon, shown, twin, attribute):
    before = state(shown, addon)
    first = shown.pointmorph.made_from
    press = getattr(bpy.ops.pointmorph, f"show_{attribute}")
    assert press() == {"FINISHED"}
    points = bpy.context.view_layer.objects.active
    assert points not in (first, twin)
    assert points == twin.pointmorph.made_from
    assert (twin.hide_get(), points.hide_get()) == (True, False)
    assert addon("scene.points_display").shows(points, attribute)
    assert state(shown, addon) == before
    np.testing.assert_allclose(points.location, twin.location, atol=1e-6)
    assert press() == {"FINISHED"}
    assert bpy.context.view_layer.objects.active == twin
    assert (twin.hide_get(), points.hide_get()) == (False, True)
    assert state(shown, addon) == before


def test_colors_of_the_original_stay_its_own(addon, shown, twin):
    select(shown)
    bpy.ops.pointmorph.show_confidence()
    before = state(shown, addon)
    select(twin)
    assert bpy.ops.pointmorph.show_confidence() == {"FINISHED"}
    assert addon("scene.points_display").shows(twin.pointmorph.made_from, "confidence")
    assert state(shown, addon) == before


def test_its_points_go_by_its_slider(shown, twin):
    bpy.ops.pointmorph.show_as(kind="POINTS")
    points = bpy.context.view_layer.objects.active
    set_t(twin, 1.0)
    if slider(shown) != slider(twin):
        assert slider(shown).value == 0.0
    assert slider(points).value == 1.0
    end = content(points)["Morph"]
    np.testing.assert_allclose(shown_points(points), end, atol=1e-6)
    set_t(twin, 0.0)
    np.testing.assert_allclose(shown_points(points), content(points)["Basis"], atol=1e-6)


def test_frames_and_keys_are_baked_of_it(shown, twin):
    first = shown.pointmorph.made_from
    keys = len(first.data.shape_keys.key_blocks)
    assert bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS") == {"FINISHED"}
    own = twin.pointmorph.made_from
    assert len(own.data.shape_keys.key_blocks) == keys + 1
    if own.data != first.data:
        assert len(first.data.shape_keys.key_blocks) == keys
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=2) == {"FINISHED"}
    player = bpy.context.view_layer.objects.active
    assert player.name == f"{twin.name} Frames"
    np.testing.assert_allclose(player.location, twin.location, atol=1e-6)
    assert twin.hide_get()
    assert not shown.hide_get()


def test_places_are_shown_on_it(settings, shown, twin):
    points = shown.pointmorph.made_from
    report = json.loads(points.pointmorph.report)
    report["worst"] = [{"source": 0, "advice": "at the corner"}]
    points.pointmorph.report = json.dumps(report)
    set_t(twin, 1.0)
    assert bpy.ops.pointmorph.go_to_place() == {"FINISHED"}
    cursor = np.array(bpy.context.scene.cursor.location)
    rows = np.flatnonzero(
        np.array([value.value for value in points.data.attributes["source_row"].data]) == 0
    )
    np.testing.assert_allclose(cursor, content(points)["Morph"][rows[0]] + (5, 0, 0), atol=1e-5)


def test_both_are_computed_again(shown, twin):
    bpy.ops.pointmorph.show_as(kind="POINTS")
    bpy.ops.pointmorph.show_as(kind="MESH")
    shown.pointmorph.source.data.vertices[0].co.z += 0.1
    for obj in (twin, shown):
        recompute(obj)
        assert obj.pointmorph.state == "CURRENT"
    np.testing.assert_allclose(surface_of(twin), surface_of(shown), atol=1e-6)
    np.testing.assert_allclose(twin.location.x - shown.location.x, 5, atol=1e-6)


def test_undo_takes_its_points_back(shown, twin):
    names = {obj.name for obj in bpy.data.objects}
    name = twin.name
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.pointmorph.show_confidence("EXEC_DEFAULT", True)
    assert len(bpy.data.objects) > len(names)
    bpy.ops.ed.undo()
    assert {obj.name for obj in bpy.data.objects} == names
    assert not bpy.data.objects[name].hide_get()
