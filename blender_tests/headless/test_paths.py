"""The way that a morph is seen to go: on the slider, and in a Blender without the add-on."""

import json

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_mesh,
    animate,
    attribute,
    key,
    mark,
    morph,
    pair,
    patch,
    played,
    select,
    set_t,
    shown_points,
    surface_of,
)

pytestmark = pytest.mark.interface

TURN = 2.2


@pytest.fixture
def turned(settings):
    """Two sheets of one form, the second turned by 126°; what shows their morph."""
    for name, turn in (("Hill", 0.0), ("Dune", TURN)):
        obj = add_mesh(name, *patch(20))
        obj.matrix_world = Matrix.Rotation(turn, 4, "X")
        for number, (x, y) in enumerate([(0, 0), (0.8, 0.7), (-0.9, 0.4), (-0.6, -0.8), (0.7, -1)]):
            mark(obj, str(number), x, y)
    settings.source, settings.target = bpy.data.objects["Hill"], bpy.data.objects["Dune"]
    settings.show_as, settings.path = "MESH", "auto"
    return morph()


def size(rows):
    return np.linalg.norm(rows - rows.mean(axis=0))


def curve(obj, value, addon):
    modifier = obj.modifiers["Path"]
    addon("data.versions").set_input(modifier, "Curve", value)
    obj.update_tag()
    bpy.context.view_layer.update()


@pytest.mark.parametrize("kind", ["MESH", "POINTS"])
def test_what_turns_keeps_its_size_on_the_slider(turned, addon, kind):
    obj = turned if kind == "MESH" else turned.pointmorph.made_from
    shown = surface_of if kind == "MESH" else shown_points
    bpy.ops.pointmorph.show_as(kind=kind)
    start = key(obj, "Basis")
    for t in (0.1, 0.35, 0.5, 0.8):
        set_t(turned, t)
        assert size(shown(obj)) == pytest.approx(size(start), rel=0.01)
        turn = np.array(Matrix.Rotation(t * TURN, 3, "X"))
        assert np.abs(shown(obj) - start @ turn.T).max() < 0.06
    for t, name in ((0.0, "Basis"), (1.0, "Morph")):
        set_t(turned, t)
        np.testing.assert_allclose(shown(obj), key(obj, name), atol=1e-6)
    set_t(turned, 0.5)
    curve(turned, 0.0, addon)  # which the points follow
    np.testing.assert_allclose(shown(obj), (start + key(obj, "Morph")) / 2, atol=1e-6)
    assert size(shown(obj)) < 0.8 * size(start)


def test_the_slider_shows_what_is_baked(turned):
    """The polynomial through the places that are kept is what the library computes at any t."""
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=7) == {"FINISHED"}
    source = bpy.data.objects["Hill"]
    points = turned.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    assert bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=7) == {"FINISHED"}
    for step in range(1, 7):
        set_t(turned, step / 7)
        name = f"Dune {100 * step / 7:.3g} %"
        np.testing.assert_allclose(surface_of(turned), key(source, name), atol=1e-3)
        np.testing.assert_allclose(shown_points(points), key(points, name), atol=2e-3)


def test_normals_turn_along(turned):
    points = turned.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    normals = attribute(points.data, "source_normal")
    set_t(turned, 0.5)
    half = np.array(Matrix.Rotation(0.5 * TURN, 3, "X"))
    shown = shown_points(points, "Normal")
    assert (shown * (normals @ half.T)).sum(axis=1).min() > 0.95


def test_straight_where_that_is_asked_for(settings, turned):
    settings.path = "linear"
    select(turned)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    set_t(turned, 0.5)
    middle = (key(turned, "Basis") + key(turned, "Morph")) / 2
    np.testing.assert_allclose(surface_of(turned), middle, atol=1e-6)
    settings.path = "rigid"
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert size(surface_of(turned)) == pytest.approx(size(key(turned, "Basis")), rel=0.01)


def test_a_straight_path_of_what_is_turned_is_warned_of(settings, turned):
    assert not any("turned" in w for w in json.loads(turned.pointmorph.report)["warnings"])
    settings.path = "linear"
    select(turned)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    said = " ".join(json.loads(turned.pointmorph.report)["warnings"])
    assert "126°" in said
    assert "rigid" in said


def test_a_chain_goes_from_turn_to_turn(settings):
    names = ("Hill", "Dune", "Fell")
    for number, name in enumerate(names):
        obj = add_mesh(name, *patch(16))
        obj.matrix_world = Matrix.Rotation(number * 1.5, 4, "X")
        for mark_number, (x, y) in enumerate([(0, 0), (0.8, 0.7), (-0.9, 0.4), (-0.6, -0.8)]):
            mark(obj, str(mark_number), x, y)
    settings.show_as, settings.path = "MESH", "auto"
    settings.source, settings.target = bpy.data.objects["Hill"], bpy.data.objects["Fell"]
    settings.via.add().object = bpy.data.objects["Dune"]
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    mesh = bpy.context.view_layer.objects.active
    points = mesh.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    for t in (0.4, 1.0, 1.5, 2.0):
        set_t(mesh, t)
        turn = np.array(Matrix.Rotation(t * 1.5, 3, "X"))
        for shown, obj in ((surface_of(mesh), mesh), (shown_points(points), points)):
            assert np.abs(shown - key(obj, "Basis") @ turn.T).max() < 0.1


def test_what_follows_its_shapes_goes_straight_between_them(turned):
    points = turned.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    assert [m.name for m in points.modifiers] == ["Path", "Follow", "Points"]
    set_t(turned, 0.5)
    middle = (key(points, "Basis") + key(points, "Morph")) / 2
    np.testing.assert_allclose(shown_points(points), middle, atol=1e-5)
    normals = [attribute(points.data, f"{side}_normal") for side in ("source", "target")]
    mixed = normals[0] + normals[1]
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    assert (shown_points(points, "Normal") * mixed).sum(axis=1).min() > 0.9


def test_a_path_comes_before_modifiers_of_the_source(settings):
    source, _ = pair()
    source.modifiers.new("Finer", "SUBSURF")
    settings.show_as = "MESH"
    assert [m.name for m in morph().modifiers] == ["Path", "Finer"]


def test_a_modifier_of_the_same_name_and_a_source_that_morphs_itself(settings, turned):
    """Each object has one modifier of its own, whose t is its own slider's."""
    turned.modifiers.new("Path", "SUBSURF")
    select(turned)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert [m.type for m in turned.modifiers] == ["NODES", "SUBSURF"]
    turned.modifiers.remove(turned.modifiers[1])
    for obj in (turned, bpy.data.objects["Dune"]):
        obj.hide_set(False)
    settings.source, settings.target = turned, bpy.data.objects["Hill"]
    again = morph()
    assert [m.type for m in again.modifiers] == ["NODES"]
    driver = again.animation_data.drivers[0].driver.variables[0].targets[0]
    assert len(again.animation_data.drivers) == 1
    assert driver.id == again.data.shape_keys


# --- Without the add-on ---------------------------------------------------------------------------


def test_it_plays_without_the_add_on(turned, tmp_path):
    animate(turned)
    points = turned.pointmorph.made_from
    points.hide_set(False)
    path = tmp_path / "played.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    found = played(path, turned.name, points.name)
    for frame in (1, 7, 13, 20):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_array_equal(found[f"{turned.name} {frame}"], surface_of(turned))
        np.testing.assert_array_equal(found[f"{points.name} {frame}"], shown_points(points))
    assert size(found[f"{turned.name} 13"]) == pytest.approx(
        size(found[f"{turned.name} 1"]), rel=0.01
    )
