"""The target's hair, on the mesh that morphs into it or on the source."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import add_group, read
from transferring_scenes import from_source, shown, transfer, unwrap, words

pytestmark = pytest.mark.interface


def add_hair(target, count=20):
    """Strands of four points, straight up from faces, in a space of their own."""
    curves = bpy.data.hair_curves.new("Fur")
    curves.add_curves([4] * count)
    hair = bpy.data.objects.new("Fur", curves)
    bpy.context.scene.collection.objects.link(hair)
    hair.matrix_world = Matrix.LocRotScale((1, 1, 1), None, (0.5, 0.5, 0.5))
    bpy.context.view_layer.update()
    roots = read(target.data.polygons, "center", 3)[3 : 3 + 5 * count : 5]
    steps = np.linspace(0, 0.3, 4)[None, :, None] * [[[0.2, 0.0, 1.0]]]
    local = (roots[:, None] + steps).reshape(-1, 3)
    to_hair = np.array(hair.matrix_world.inverted() @ target.matrix_world)
    points = local @ to_hair[:3, :3].T + to_hair[:3, 3]
    curves.position_data.foreach_set("vector", points.astype(np.float32).reshape(-1))
    curves.surface = target
    radius = curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(4 * count, 0.01, np.float32))
    return hair, local


def strand_points(curves):
    return read(curves.position_data, "vector", 3)


@pytest.mark.parametrize("source_has_uvs", [True, False])
def test_hair_goes_with_the_mesh(settings, turned, source_has_uvs):
    """At the start it stands on the source, at the end where the target's is."""
    _, target, copy = turned
    unwrap(target, "Skin")
    if source_has_uvs:
        unwrap(copy)
    hair, local = add_hair(target)
    before = strand_points(hair.data)
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    assert np.array_equal(strand_points(hair.data), before)
    assert (made.data.surface, made.parent) == (copy, copy)
    assert made.data.surface_uv_map == ("UVMap" if source_has_uvs else "target.Skin")
    np.testing.assert_allclose(strand_points(made.data), local, atol=5e-5)
    uvs = read(made.data.attributes["surface_uv_coordinate"].data, "vector", 2)
    np.testing.assert_allclose(uvs, 0.5 + 0.45 * local[::4, :2], atol=2e-3)
    radius = read(made.data.attributes["radius"].data, "value", 1)
    np.testing.assert_allclose(radius, 0.01 * 0.5 / 2, rtol=1e-3)
    assert 'the hair object "target.Fur"' in words(copy)
    there = from_source(target, local)
    for t, wanted in ((0.0, local), (1.0, there)):
        copy.data.shape_keys.key_blocks["Morph"].value = t
        grown = shown(made)
        found = strand_points(grown)
        roots = np.abs(found[::4] - wanted[::4]).max()
        assert roots < 0.01
        along, known = found[3::4] - found[::4], wanted[3::4] - wanted[::4]
        lengths = np.linalg.norm(along, axis=1), np.linalg.norm(known, axis=1)
        np.testing.assert_allclose(*lengths, rtol=0.02)
        cosine = (along * known).sum(axis=1) / (lengths[0] * lengths[1])
        assert cosine.min() > 0.98
        radius = read(grown.attributes["radius"].data, "value", 1)
        np.testing.assert_allclose(radius, 0.0025 * (1.0 + t), rtol=0.02)


def test_hair_once_more_and_on_the_source(turned):
    source, target, copy = turned
    for obj in (source, target, copy):
        unwrap(obj)
    _, local = add_hair(target)
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    made.data.materials.clear()
    curves = len(bpy.data.hair_curves)
    transfer(copy)
    assert bpy.data.objects["target.Fur"] == made
    assert len(bpy.data.hair_curves) == curves
    made.name = "Mine"
    transfer(copy, onto="SOURCE")
    other = bpy.data.objects["target.Fur"]
    assert (other.data.surface, len(other.modifiers)) == (source, 0)
    assert np.abs(strand_points(other.data) - local).max() < 0.1
    assert np.allclose(other.matrix_world, source.matrix_world)


def surface_nodes():
    """A group of nodes about a surface, as Blender's own for hair are."""
    group = bpy.data.node_groups.new("Trim", "GeometryNodeTree")
    for name, kind in (("G", "Geometry"), ("Surface", "Object"), ("UV", "Vector"),
                       ("Name", "String"), ("Size", "Float")):  # fmt: skip
        group.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    group.interface.new_socket("G", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    ends = [group.nodes.new(f"NodeGroup{way}") for way in ("Input", "Output")]
    group.links.new(ends[0].outputs[0], ends[1].inputs[0])
    return group


def test_hair_of_the_target_is_about_the_other_surface_then(addon, turned):
    """Modifiers, constraints and deltas of the hair that were about the target."""
    _, target, copy = turned
    unwrap(target, "Skin")
    unwrap(copy)
    hair, _ = add_hair(target)
    modifier = hair.modifiers.new("Trim", "NODES")
    modifier.node_group = surface_nodes()
    inputs = addon("data.versions")
    inputs.set_input(modifier, "Surface", target)
    inputs.set_input(modifier, "Name", "Skin")
    inputs.set_input_attribute(modifier, "UV", "Skin")
    hair.constraints.new("COPY_LOCATION").target = target
    hair.delta_location = (0, 0, 5)
    hair.delta_scale = (2, 2, 2)
    before = hair.matrix_world.copy()
    bpy.context.view_layer.update()
    hair.constraints[0].influence = 0.0
    hair.matrix_world = before
    bpy.context.view_layer.update()
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    own = made.modifiers["Trim"]
    assert inputs.input_value(own, "Surface") == copy
    assert inputs.input_value(own, "Name") == "UVMap"
    assert inputs.input_attribute(own, "UV") == "UVMap"
    assert inputs.input_attribute(own, "Size") is None
    assert inputs.input_value(modifier, "Surface") == target
    assert inputs.input_attribute(modifier, "UV") == "Skin"
    assert len(made.constraints) == 0
    bpy.context.view_layer.update()
    assert np.allclose(made.matrix_world, copy.matrix_world)


def test_hair_is_known_by_what_it_is(turned):
    """Not by names: the copy may be renamed, and so may the target's."""
    _, target, copy = turned
    unwrap(copy)
    unwrap(target)
    hair, _ = add_hair(target)
    transfer(copy)
    made = bpy.data.objects["target.Fur"]
    made.name, hair.name = "Mine", "Pelt"
    transfer(copy)
    assert made.name == "Mine"
    assert "target.Pelt" not in bpy.data.objects
    assert '"Mine"' in words(copy)
    bpy.data.objects.new("target.Other", None)
    other, _ = add_hair(target)
    other.name = "Other"
    transfer(copy)
    assert '"target.Other.001"' in words(copy)


@pytest.mark.parametrize("how", ["gone", "fewer"])
def test_hair_that_changes_meanwhile(addon, turned, how, monkeypatch):
    """Nothing is written then."""
    _, target, copy = turned
    unwrap(copy)
    add_group(target, "bone", {0: 1.0})
    hair, _ = add_hair(target)
    module = addon("scene.attribute_transfer")
    write = module.write

    def late(*arguments):
        if how == "gone":
            bpy.data.objects.remove(hair)
        else:
            hair.data = bpy.data.hair_curves.new("Bald")
        return write(*arguments)

    monkeypatch.setattr(module, "write", late)
    with pytest.raises(RuntimeError, match="Fur: expected an object that doesn't change"):
        transfer(copy)
    assert "target.bone" not in copy.vertex_groups


def test_hair_needs_a_uv_map(turned):
    _, target, copy = turned
    add_hair(target)
    transfer(copy)
    assert '"target.Fur" isn\'t attached: "Hill to Dune" has no UV map' in words(copy)
