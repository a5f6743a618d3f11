"""What an earlier version made, in the same file."""

import bpy
import numpy as np
import pytest
from scenes import error_of, key, morph, pair, select, shown_points

pytestmark = pytest.mark.interface

GROUPS = ("Pointmorph Points", "Pointmorph Follow", "Pointmorph Colors")


def earlier_group(name):
    """One that leaves the geometry as it is, with its inputs in another order."""
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for kind, label in (("Geometry", "Geometry"), ("Float", "Radius Scale"), ("Float", "t")):
        group.interface.new_socket(label, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = (group.nodes.new(f"NodeGroup{side}") for side in ("Input", "Output"))
    group.links.new(start.outputs["Geometry"], end.inputs["Geometry"])
    return group


def change_target(target):
    for vertex in target.data.vertices:
        vertex.co.z += 0.2


@pytest.mark.makes_nodes
def test_its_nodes_are_not_taken_for_those_of_this_one(settings, addon):
    for name in GROUPS:
        earlier_group(name)
    source, target = pair()
    target.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    obj = morph()
    assert bpy.ops.pointmorph.show_as(kind="DISCS") == {"FINISHED"}
    assert addon("scene.points_display").shows_discs(obj)
    assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}
    mesh = bpy.context.view_layer.objects.active
    assert bpy.ops.pointmorph.transfer_attributes(weights=False) == {"FINISHED"}
    colors = addon("data.versions").group_inputs(mesh.modifiers["Colors"].node_group)
    assert {"From", "To"} <= set(colors)
    bpy.data.objects.remove(mesh)
    select(obj)
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    change_target(target)
    obj.data.shape_keys.key_blocks["Morph"].value = 1.0
    obj.modifiers["Points"].show_viewport = False
    bpy.context.view_layer.update()
    shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices
    assert np.abs(np.array([v.co for v in shown]) - key(obj, "Morph")).max() > 0.1
    groups = len(bpy.data.node_groups)
    select(source)
    morph(new_result=True)
    assert len(bpy.data.node_groups) == groups  # the new ones are shared


def test_marked_nodes_of_another_version_stay_with_what_has_them(settings):
    source, _ = pair()
    first = morph()
    groups = [modifier.node_group for modifier in first.modifiers]
    for group in groups:
        name, _, version = group["pointmorph_version"].rpartition(": ")
        assert version not in ("", "1")  # the number that earlier versions wrote
        group["pointmorph_version"] = f"{name}: 1"
    select(source)
    second = morph(new_result=True)
    assert [modifier.node_group for modifier in first.modifiers] == groups
    assert not set(groups) & {modifier.node_group for modifier in second.modifiers}


def test_a_morph_gets_the_nodes_of_this_version_when_it_is_computed_again(settings, addon):
    versions = addon("data.versions")
    _, target = pair()
    obj = morph()
    modifier = obj.modifiers["Points"]
    obj.driver_remove(versions.input_path(modifier, "t"))
    modifier.node_group = earlier_group("Pointmorph Points")
    t = obj.data.shape_keys.key_blocks["Morph"]
    addon("data.nodes").drive_input(obj, modifier, "t", t)
    versions.set_input(modifier, "Radius Scale", 2.0)
    obj.keyframe_insert(versions.input_path(modifier, "Radius Scale"), frame=1)
    change_target(target)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert {"t", "Discs", "Show Distortion"} <= set(versions.group_inputs(modifier.node_group))
    assert versions.input_value(modifier, "Radius Scale") == 2.0
    assert versions.curve_of(obj, versions.input_path(modifier, "Radius Scale")) is not None
    t.value = 0.75
    bpy.context.view_layer.update()
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert versions.input_value(evaluated.modifiers["Points"], "t") == 0.75
    middle = 0.25 * key(obj, "Basis") + 0.75 * key(obj, "Morph")
    np.testing.assert_allclose(shown_points(obj), middle, atol=1e-6)


def test_a_mesh_of_an_earlier_version_can_be_staggered_once_it_is_computed_again(settings, addon):
    stagger, versions = addon("scene.stagger"), addon("data.versions")
    settings.show_as = "MESH"
    _, target = pair()
    mesh = morph()
    points = mesh.pointmorph.made_from
    for obj in (mesh, points):  # there was no such modifier
        modifier = obj.modifiers["Path"]
        for name in versions.plain_inputs(modifier.node_group):
            obj.driver_remove(versions.input_path(modifier, name))
        obj.modifiers.remove(modifier)
    change_target(target)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    stagger.choose(mesh, "Height", Overlap=0.4)
    bpy.context.view_layer.update()
    assert stagger.timing_of(bpy.context, points).overlap == pytest.approx(0.4)
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=2) == {"FINISHED"}
    points.driver_remove(versions.input_path(points.modifiers["Path"], "Stagger"))
    versions.set_choice(
        points.modifiers["Path"], "Stagger", addon("scene.stagger_nodes").KINDS, "Off"
    )
    points.update_tag()
    assert "Recompute the morph" in error_of(bpy.ops.pointmorph.bake_shape_keys)
    points.modifiers.remove(points.modifiers["Path"])
    assert "Recompute the morph" in error_of(bpy.ops.pointmorph.bake_shape_keys)
