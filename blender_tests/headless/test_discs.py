"""Discs in the surface, whose faces are made ahead."""

import bpy
import numpy as np
import pytest
from painted_scenes import flat_uvs
from scenes import (
    add_attribute,
    add_group,
    animate,
    attribute,
    coordinates,
    data_blocks,
    groups,
    morph,
    pair,
    played,
    read,
    recompute,
    select,
    set_t,
    surface_of,
)

pytestmark = pytest.mark.interface


@pytest.fixture
def discs(settings):
    """A morph in two colors that is shown as discs."""
    for obj, color in zip(pair(), ((1, 0, 0, 1), (0, 0, 1, 0.5)), strict=True):
        count = len(obj.data.vertices)
        obj.data.color_attributes.active_color = add_attribute(
            obj.data, "Col", "FLOAT_COLOR", np.tile(color, (count, 1))
        )
    settings.show_as = "DISCS"
    return morph()


@pytest.fixture
def faces_of(addon):
    """The object that has the faces of a morph object's discs, or None."""
    versions = addon("data.versions")
    return lambda obj: versions.input_value(obj.modifiers["Points"], "Faces of Discs")


def shown(obj):
    """Places of the corners, colors and normals of the discs of an object."""
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    count = len(mesh.polygons)
    corners = read(mesh.loops, "vertex_index", 1, np.int32)
    np.testing.assert_array_equal(corners, np.arange(6 * count))
    assert mesh.color_attributes.active_color.name == "Color"
    return (
        surface_of(obj).reshape(count, 6, 3),
        attribute(mesh, "Color").reshape(count, 6, 4),
        read(mesh.polygons, "normal", 3),
    )


@pytest.mark.parametrize("ahead", [True, False])
def test_they_lie_in_the_surface_in_the_colors_of_the_points(discs, faces_of, addon, ahead):
    if not ahead:
        addon("data.versions").set_input(discs.modifiers["Points"], "Faces of Discs", None)
    assert (faces_of(discs) is not None) == ahead
    set_t(discs, 0.25)
    discs.update_tag()
    places, colors, normals = shown(discs)
    middle = [read(end.data, "co", 3) for end in discs.data.shape_keys.key_blocks]
    np.testing.assert_allclose(places.mean(axis=1), 0.75 * middle[0] + 0.25 * middle[1], atol=1e-6)
    np.testing.assert_allclose(colors, np.tile((0.75, 0, 0.25, 0.875), (len(places), 6, 1)))
    radii = [attribute(discs.data, f"{side}_radius") for side in ("source", "target")]
    radii = np.repeat((0.75 * radii[0] + 0.25 * radii[1])[:, None], 6, axis=1)
    arms = places - places.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(np.linalg.norm(arms, axis=2), radii, rtol=1e-4)
    ends = [attribute(discs.data, f"{side}_normal") for side in ("source", "target")]
    expected = 0.75 * ends[0] + 0.25 * ends[1]
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=1e-4)


def test_a_disc_whose_point_has_no_normal_faces_up(discs):
    for side in ("source", "target"):
        discs.data.attributes[f"{side}_normal"].data[3].vector = (0.0, 0.0, 0.0)
    discs.update_tag()
    np.testing.assert_allclose(shown(discs)[2][3], (0, 0, 1), atol=1e-6)


def test_faces_are_there_while_discs_are_shown_and_shared(discs, faces_of):
    before = data_blocks()
    name = faces_of(discs).name
    assert name not in bpy.context.scene.objects
    assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    assert faces_of(discs) is None
    assert data_blocks() == before - {f"{kind}: {name}" for kind in ("objects", "all_ids")}
    assert bpy.ops.pointmorph.show_as(kind="DISCS") == {"FINISHED"}
    assert data_blocks() == before
    again = morph(new_result=True)
    assert again != discs
    assert faces_of(again) == faces_of(discs)


def test_there_are_as_many_once_the_morph_is_computed_again(discs, faces_of, settings, addon):
    select(discs)
    twin = discs.copy()
    bpy.context.scene.collection.objects.link(twin)
    settings.target.data.vertices.add(1)
    settings.target.data.vertices[-1].co = (0.01, 0.01, 0.9)
    count = len(discs.data.vertices)
    recompute(discs)
    assert len(discs.data.vertices) != count
    for obj in (discs, twin):
        modifier = faces_of(obj).modifiers[0]
        assert addon("data.versions").input_value(modifier, "Count") == len(discs.data.vertices)
        assert len(shown(obj)[0]) == len(discs.data.vertices)


def test_discs_are_made_again_when_the_one_they_are_made_of_is_gone(discs, faces_of):
    expected = surface_of(discs)
    bpy.data.objects.remove(bpy.data.objects[".Pointmorph Disc"])
    assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    assert bpy.ops.pointmorph.show_as(kind="DISCS") == {"FINISHED"}
    np.testing.assert_array_equal(surface_of(discs), expected)
    other = bpy.data.objects[".Pointmorph Disc"]
    bpy.data.objects.remove(other)
    again = morph(new_result=True)
    assert len(surface_of(again)) == len(expected)


def test_each_corner_knows_its_disc(discs, faces_of):
    """As faces do, whose numbers are whole ones."""
    mesh = faces_of(discs).evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    rows = read(mesh.attributes["disc_row"].data, "value", 1, np.int32)
    np.testing.assert_array_equal(rows.ravel(), np.repeat(np.arange(len(mesh.polygons)), 6))
    assert "disc_face" not in mesh.attributes


def test_the_wrong_number_of_faces_is_not_taken(discs, faces_of, addon):
    expected = surface_of(discs)
    addon("data.versions").set_input(faces_of(discs).modifiers[0], "Count", 5)
    faces_of(discs).update_tag()
    np.testing.assert_array_equal(surface_of(discs), expected)


def test_materials_can_read_how_far_each_point_is(discs, addon):
    addon("scene.stagger").choose(discs, "Height")
    set_t(discs, 0.5)
    mesh = discs.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert mesh.attributes["morph_t"].domain == "FACE"
    times = attribute(mesh, "morph_t")
    assert times.min() < 0.1 < 0.9 < times.max()
    np.testing.assert_allclose(attribute(mesh, "morph_ahead"), times - 0.5, atol=1e-6)
    assert attribute(mesh, "morph_delay").max() == pytest.approx(1.0)


def test_they_have_what_was_transferred(discs, settings):
    target = settings.target
    height = coordinates(target.data.vertices)[:, 2]
    add_group(target, "High", dict(enumerate(height.tolist())))
    add_attribute(target.data, "Warm", "FLOAT_COLOR", np.tile((0.2, 0.4, 0.6, 1), (len(height), 1)))
    flat_uvs(target, "Skin")
    select(discs)
    assert bpy.ops.pointmorph.transfer_attributes(uvs=True, prefix="t.") == {"FINISHED"}

    def check():
        mesh = discs.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        weights = groups(discs)["t.High"]
        landed = [weights.get(row, 0.0) for row in range(len(discs.data.vertices))]
        assert np.ptp(landed) > 0.1
        for name, values in (("t.High", landed), ("t.Skin", attribute(discs.data, "t.Skin"))):
            assert mesh.attributes[name].domain == "FACE"
            np.testing.assert_allclose(attribute(mesh, name), values, atol=1e-6)
        assert "t.Warm" in mesh.color_attributes
        found = attribute(mesh, "t.Warm")
        np.testing.assert_allclose(found, np.tile((0.2, 0.4, 0.6, 1), (len(found), 1)), atol=1e-6)
        shown(discs)  # in their own colors

    check()
    recompute(discs)
    check()


@pytest.mark.parametrize("turned_on", ["", "Discs"])
def test_they_play_without_the_add_on(discs, tmp_path, turned_on):
    """Also where they are turned on there."""
    animate(discs)
    if turned_on:
        assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    path = tmp_path / "discs.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    found = played(path, discs.name, turned_on=turned_on)
    assert bpy.ops.pointmorph.show_as(kind="DISCS") == {"FINISHED"}
    for frame in (1, 7, 13, 20):
        bpy.context.scene.frame_set(frame)
        expected = surface_of(discs)
        assert len(expected) == 6 * len(discs.data.vertices)
        np.testing.assert_array_equal(found[f"{discs.name} {frame}"], expected)
