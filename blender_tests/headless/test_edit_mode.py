"""What is edited or painted, read as it is morphed."""

import bpy
import numpy as np
import pointmorph
import pytest
from scenes import add_mesh, data_blocks, morph, pair, patch, pick, row_pairs, select


def test_reading_a_curve_in_edit_mode_leaves_it_there(addon, settings):
    bpy.ops.curve.primitive_bezier_circle_add()
    curve = bpy.context.object
    curve.data.dimensions, curve.data.fill_mode = "2D", "BOTH"
    target = add_mesh("Dune", *patch(9, bump=0.8))
    pick(curve, target)
    select(curve)
    bpy.ops.object.mode_set(mode="EDIT")
    request = addon("scene.panel_request").read_request(bpy.context)
    assert len(request.source.triangles)
    assert curve.mode == "EDIT"
    assert not curve.hide_get()
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("edited", [0, 1])
def test_what_is_edited_is_read_as_it_is_morphed(addon, mirrored, settings, edited):
    """In Edit Mode, the viewport may show it without modifiers."""
    shapes = mirrored, settings.target
    shapes[1].modifiers.new("Half", "MIRROR").use_axis = (False, False, True)
    for shape in shapes:
        for modifier in shape.modifiers:
            modifier.show_in_editmode = False
    read = addon("scene.panel_request").read_request
    request = read(bpy.context)
    expected = [shape.positions for shape in (request.source, request.target)]
    assert [len(places) for places in expected] == [128, 162]
    select(shapes[edited])
    bpy.ops.object.mode_set(mode="EDIT")
    before = data_blocks()
    request = read(bpy.context)
    assert data_blocks() == before
    assert shapes[edited].mode == "EDIT"
    for shape, places in zip((request.source, request.target), expected, strict=True):
        np.testing.assert_array_equal(shape.positions, places)
    assert [request.source.name, request.target.name] == ["Half", "Dune"]
    bpy.ops.object.mode_set(mode="OBJECT")


def test_recompute_reads_what_is_edited_as_morph_does(settings):
    source, target = pair()
    for shape in (source, target):
        shape.vertex_groups.clear()
    modifier = target.modifiers.new("Twice", "MIRROR")
    modifier.use_axis, modifier.show_in_editmode = (False, False, True), False
    obj = morph()
    assert len(np.unique(row_pairs(obj)[:, 1])) == 200
    bpy.ops.pointmorph.show_shapes()
    select(target)
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert len(np.unique(row_pairs(obj)[:, 1])) == 200
    assert obj.pointmorph.state == "CURRENT"


def test_an_error_names_what_is_edited_and_not_the_copy_that_is_read(addon, mirrored, settings):
    mirrored.vertex_groups.new(name="Nothing")
    mirrored.modifiers.new("None", "MASK").vertex_group = "Nothing"
    select(mirrored)
    bpy.ops.object.mode_set(mode="EDIT")
    before = data_blocks()
    with pytest.raises(pointmorph.CloudError, match=r"^Half: "):
        addon("scene.panel_request").read_request(bpy.context)
    assert data_blocks() == before
    bpy.ops.object.mode_set(mode="OBJECT")


def test_recompute_leaves_edit_mode_of_several_objects(settings):
    _, target = pair()
    target.vertex_groups.clear()
    bpy.data.objects["Hill"].vertex_groups.clear()
    other = add_mesh("Other", *patch(3))
    modifier = target.modifiers.new("Twice", "MIRROR")
    modifier.use_axis, modifier.show_in_editmode = (False, False, True), False
    obj = morph()
    bpy.ops.pointmorph.show_shapes()
    select(target)
    select(other)
    target.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    assert (target.mode, bpy.context.view_layer.objects.active) == ("EDIT", other)
    assert bpy.ops.pointmorph.recompute(name=obj.name) == {"FINISHED"}
    assert target.mode == other.mode == "OBJECT"
    assert len(np.unique(row_pairs(obj)[:, 1])) == 200


@pytest.mark.parametrize("mode", ["WEIGHT_PAINT", "SCULPT"])
def test_recompute_leaves_a_brush_in_the_hand(settings, mode):
    source, _ = pair()
    obj = morph()
    bpy.ops.pointmorph.show_shapes()
    select(source)
    bpy.ops.object.mode_set(mode=mode)
    assert bpy.ops.pointmorph.recompute(name=obj.name) == {"FINISHED"}
    assert source.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
