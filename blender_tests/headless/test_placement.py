"""Where the mesh that shows a morph lies, and with it the points."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import coordinates, morph, pair, recompute, set_t, surface_of


@pytest.fixture
def shown(settings):
    """What shows the morph of a pair of meshes, whose source was placed before."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.matrix_world = Matrix.LocRotScale((1, 2, 3), None, (2, 1, 0.5))
    obj = morph()
    bpy.context.view_layer.update()
    return obj


def place(obj):
    bpy.context.view_layer.update()
    return np.array(obj.matrix_world)


def corners(obj, value):
    """The vertices of what shows a morph, in the world, at a value of the slider."""
    set_t(obj, value)
    return in_world(place(obj), surface_of(obj))


def in_world(matrix, positions):
    return positions @ matrix[:3, :3].T + matrix[:3, 3]


OTHER = Matrix.LocRotScale((4, 0, 1), Matrix.Rotation(0.7, 3, "Y"), (1, 3, 1))


# --- Recompute after the source was placed otherwise ----------------------------------------------


def test_the_mesh_goes_along_with_its_source(shown):
    source = shown.pointmorph.source
    source.matrix_world = OTHER
    recompute(shown)
    np.testing.assert_allclose(place(shown), np.array(OTHER), atol=1e-6)
    start = in_world(place(source), coordinates(source.data.vertices))
    np.testing.assert_allclose(corners(shown, 0.0), start, atol=1e-5)
    fresh = morph(new_result=True)
    np.testing.assert_allclose(corners(shown, 1.0), corners(fresh, 1.0), atol=1e-5)


def test_where_the_user_moved_the_mesh_it_stays(shown):
    source = shown.pointmorph.source
    shown.location = (9, 9, 9)
    source.scale = (3, 3, 3)
    recompute(shown)
    np.testing.assert_allclose(place(shown)[:3, 3], (9, 9, 9), atol=1e-6)
    np.testing.assert_allclose(np.diag(place(shown))[:3], (3, 3, 3), atol=1e-6)


def test_a_mesh_of_a_parent_goes_along_with_it(settings):
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(source.parent)
    shown = morph()
    source.parent.matrix_world = OTHER
    recompute(shown)
    np.testing.assert_allclose(place(shown), place(source), atol=1e-6)
    source.scale = (2, 2, 2)
    recompute(shown)
    np.testing.assert_allclose(place(shown), place(source), atol=1e-5)


def test_a_mesh_that_is_animated_is_left_to_its_keys(shown):
    shown.keyframe_insert("scale", frame=1)
    shown.pointmorph.source.scale = (3, 3, 3)
    recompute(shown)
    np.testing.assert_allclose(shown.scale, (2, 1, 0.5))


# --- What is hidden lies where the user moved what is seen ----------------------------------------


TURN = Matrix.Rotation(0.7, 3, "Y")


@pytest.fixture
def moved(shown):
    """What shows a morph, turned and moved."""
    shown.matrix_world = Matrix.LocRotScale((4, 0, 1), TURN, (2, 1, 0.5))
    bpy.context.view_layer.update()
    return shown


FRAME = np.array(Matrix.LocRotScale((4, 0, 1), TURN, None))
"""Of its points."""


@pytest.mark.parametrize("kind", ["POINTS", "DISCS"])
def test_points_are_shown_where_the_mesh_was_moved(moved, kind):
    points = moved.pointmorph.made_from
    assert bpy.ops.pointmorph.show_as(kind=kind) == {"FINISHED"}
    np.testing.assert_allclose(place(points), FRAME, atol=1e-6)


def test_the_mesh_is_shown_where_the_points_were_moved(moved):
    points = moved.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    points.location = (0, 0, 9)
    bpy.ops.pointmorph.show_as(kind="MESH")
    np.testing.assert_allclose(place(moved)[:3, 3], (0, 0, 9), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(place(moved)[:3, :3], axis=0), (2, 1, 0.5), atol=1e-6)


def test_a_mesh_is_made_where_the_points_were_moved(settings):
    pair(14, 12)[0].scale = (2, 2, 2)
    points = morph()
    points.location = (0, 0, 9)
    bpy.ops.pointmorph.show_as(kind="MESH")
    shown = bpy.context.view_layer.objects.active
    expected = np.array(Matrix.LocRotScale((0, 0, 9), None, (2, 2, 2)))
    np.testing.assert_allclose(place(shown), expected, atol=1e-6)


def test_frames_are_baked_where_the_mesh_was_moved(moved):
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3, step=2) == {"FINISHED"}
    player = bpy.context.view_layer.objects.active
    assert player not in (moved, moved.pointmorph.made_from)
    np.testing.assert_allclose(place(player), FRAME, atol=1e-6)


def test_delays_by_place_are_those_of_the_mesh_that_was_moved(moved, addon):
    """Turned about, what was at the top goes first."""
    stagger = addon("scene.stagger")
    points = moved.pointmorph.made_from
    stagger.choose(moved, "Height")
    before = stagger.timing_of(bpy.context, points).delays
    moved.rotation_mode = "XYZ"
    moved.rotation_euler = (np.pi, 0, 0)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    bpy.context.view_layer.update()
    after = stagger.timing_of(bpy.context, points).delays
    assert np.corrcoef(before, after)[0, 1] < 0.5


def test_the_cursor_goes_where_the_mesh_was_moved(moved, monkeypatch, addon):
    report = {"mesh": {"worst": []}, "worst": [{"source": 0, "advice": "Look."}]}
    monkeypatch.setattr(addon("scene.recipes"), "report_of", lambda obj: report)
    assert bpy.ops.pointmorph.go_to_place() == {"FINISHED"}
    np.testing.assert_allclose(bpy.context.scene.cursor.location, corners(moved, 0.0)[0], atol=1e-5)
