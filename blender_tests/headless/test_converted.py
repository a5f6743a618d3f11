"""Morphs that the user makes plain meshes, or no meshes (Object > Convert)."""

import bpy
import numpy as np
import pytest
from scenes import (
    add_mesh,
    coordinates,
    morph,
    pair,
    patch,
    recompute,
    select,
    set_t,
    surface_of,
)

pytestmark = pytest.mark.interface


@pytest.fixture(params=["MESH", "DISCS", "POINTS"])
def shown(request, settings):
    """What shows a morph half-way."""
    settings.show_as = request.param
    pair(14, 12)
    obj = morph()
    set_t(obj, 0.5)
    return obj


@pytest.fixture
def mesh(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    obj = morph()
    set_t(obj, 0.5)
    return obj


def convert(obj, keep=False):
    """What Blender makes of an object."""
    select(obj)
    assert bpy.ops.object.convert(target="MESH", keep_original=keep) == {"FINISHED"}
    bpy.context.view_layer.update()
    return bpy.context.view_layer.objects.active


def drivers(*blocks):
    data = [block.animation_data for block in blocks]
    return [curve.data_path for one in data if one is not None for curve in one.drivers]


@pytest.mark.parametrize("keep", [False, True])
def test_it_is_no_morph_any_more(addon, shown, keep):
    made = convert(shown, keep)
    object_of = addon("scene.morph_object")
    assert not object_of.is_made(made)
    known = made.pointmorph
    assert (known.state, known.keeps_faces, known.recipe, known.report) == ("", False, "", "")
    assert (known.source, known.target, known.made_from, known.mesh) == (None,) * 4
    assert drivers(made) == []
    left = {a.name for a in made.data.attributes if a.name.startswith(("path", "source_"))}
    assert not left
    assert addon("operators.made_objects").made_object(bpy.context) != made


@pytest.mark.parametrize("kind", ["CURVE", "GREASEPENCIL", "POINTCLOUD"])
def test_what_is_no_mesh_any_more_is_no_morph(addon, mesh, kind):
    """Looking at it ended every panel, in Blenders that make points or strokes of it."""
    kinds = bpy.ops.object.convert.get_rna_type().properties["target"].enum_items
    if kind not in kinds:
        pytest.skip(f"this Blender converts to {', '.join(kinds.keys())}")
    points = mesh.pointmorph.made_from
    select(mesh)
    assert bpy.ops.object.convert(target=kind) == {"FINISHED"}
    bpy.context.view_layer.update()
    made = bpy.context.view_layer.objects.active
    assert made.type == kind
    known = made.pointmorph
    assert (known.state, known.keeps_faces, known.recipe) == ("", False, "")
    assert (known.source, known.made_from) == (None, None)
    assert drivers(made) == []
    assert addon("operators.made_objects").made_object(bpy.context) == points
    assert addon("scene.morph_object").shown_of(points) == points
    recompute(points)
    assert points.pointmorph.state == "CURRENT"
    left = addon("scene.left_copies")
    left._look()
    left._stop()


def test_what_is_only_moved_is_not_looked_at(addon, monkeypatch):
    """Thousands of objects may be dragged at once."""
    obj = add_mesh("Prop", *patch(4))
    bpy.context.view_layer.update()
    asked = []
    monkeypatch.setattr(addon("scene.converted"), "_is_converted", asked.append)
    obj.location.x += 1
    bpy.context.view_layer.update()
    assert asked == []
    obj.data.update()
    bpy.context.view_layer.update()
    assert asked == [obj]


def test_points_leave_an_empty_mesh(settings):
    settings.show_as = "POINTS"
    pair(14, 12)
    assert not len(convert(morph()).data.vertices)


def test_it_keeps_its_form(mesh):
    before = surface_of(mesh)
    made = convert(mesh)
    np.testing.assert_allclose(coordinates(made.data.vertices), before, atol=1e-6)


def test_its_morph_is_recomputed_without_it(mesh):
    points = mesh.pointmorph.made_from
    made = convert(mesh)
    before = coordinates(made.data.vertices)
    points.pointmorph.source.data.vertices[5].co.z += 0.3
    recompute(points)
    np.testing.assert_array_equal(coordinates(made.data.vertices), before)
    assert made.data.shape_keys is None
    assert not made.modifiers


def test_its_original_goes_on_as_before(mesh):
    points = mesh.pointmorph.made_from
    made = convert(mesh, keep=True)
    assert made != mesh
    assert points.pointmorph.mesh == mesh
    recompute(mesh)
    assert mesh.pointmorph.state == "CURRENT"
    assert made.data.shape_keys is None


def test_its_points_go_by_themselves(addon, mesh):
    points = mesh.pointmorph.made_from
    convert(mesh)
    assert addon("scene.morph_object").shown_of(points) == points
    of_slider = [path for path in drivers(points.data.shape_keys) if path.endswith("value")]
    assert of_slider == []
    for curve in points.animation_data.drivers:
        assert mesh not in {v.targets[0].id for v in curve.driver.variables}
    bpy.ops.pointmorph.show_as(kind="MESH")
    assert addon("scene.morph_object").shown_of(points) not in (points, mesh)


def test_its_points_go_as_with_a_mesh_that_was_deleted(addon, mesh):
    left = addon("scene.left_copies")
    left._forget()
    left._look()
    name = mesh.pointmorph.made_from.name
    made = convert(mesh)
    left._look()
    left._stop()
    assert name not in bpy.data.objects
    assert made.name in bpy.data.objects


def test_it_morphs_as_any_other_mesh(mesh, settings):
    target = settings.target
    made = convert(mesh)
    settings.source = made
    again = morph()
    assert again.pointmorph.source == made
    assert again.pointmorph.target == target
    assert again.pointmorph.state == "CURRENT"


def test_undo_brings_the_morph_back(mesh):
    name = mesh.name
    bpy.ops.ed.undo_push(message="before")
    select(mesh)
    bpy.ops.object.convert("EXEC_DEFAULT", True, target="MESH")
    bpy.context.view_layer.update()
    assert bpy.data.objects[name].pointmorph.state == ""
    bpy.ops.ed.undo()
    mesh = bpy.data.objects[name]
    assert mesh.pointmorph.state == "CURRENT"
    recompute(mesh)
