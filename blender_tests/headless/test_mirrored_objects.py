"""Objects with a negative scale morph as those do whose mesh was mirrored."""

import json

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_group,
    assert_same,
    content,
    coordinates,
    members,
    morph,
    pair,
    pick,
    select,
    triangles,
)

MIRROR = Matrix.Diagonal((-1, 1, 1, 1))


def ball(name, bump):
    """A ball that bulges to one side, its faces outward."""
    mesh = bpy.data.meshes.new(name)
    made = bmesh.new()
    bmesh.ops.create_uvsphere(made, u_segments=16, v_segments=12, radius=1)
    for vertex in made.verts:
        vertex.co *= 1 + bump * max(0, vertex.co.x) + 0.3 * max(0, vertex.co.y + vertex.co.z)
    bmesh.ops.triangulate(made, faces=made.faces)  # quads that are turned have other diagonals
    made.to_mesh(mesh)
    made.free()
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


@pytest.fixture
def balls(settings):
    """Two of them, with marks that leave no doubt which side belongs to which."""
    settings.show_as = "MESH"
    found = ball("Hill", 0.5), ball("Dune", 1.0)
    for obj in found:
        places = coordinates(obj.data.vertices)
        for axis, name in enumerate("xyz"):
            add_group(obj, f"pm.{name}", {int(places[:, axis].argmax()): 1.0})
            add_group(obj, f"pm.-{name}", {int(places[:, axis].argmin()): 1.0})
    pick(*found)
    return found


def apply(obj):
    """The same form with the mesh itself mirrored, its faces outward."""
    places, faces = coordinates(obj.data.vertices), triangles(obj.data)
    mesh = bpy.data.meshes.new("Twin")
    mesh.from_pydata((places * (-1, 1, 1)).tolist(), [], faces[:, [0, 2, 1]].tolist())
    groups = [(group.name, members(obj, group.index)) for group in obj.vertex_groups]
    obj.vertex_groups.clear()
    obj.data = mesh
    for name, weights in groups:
        add_group(obj, name, weights)
    obj.matrix_world = Matrix()


def report_of(shown):
    return json.loads(shown.pointmorph.made_from.pointmorph.report)


def told_of_inside(shown):
    return [words for words in report_of(shown)["warnings"] if "inward" in words]


@pytest.mark.parametrize("which", [(0,), (1,), (0, 1)])
def test_a_mirrored_object_is_read_as_its_applied_twin(addon, balls, which):
    """The library is asked the same."""
    read_request = addon("scene.panel_request").read_request
    for number in which:
        balls[number].matrix_world = MIRROR
    bpy.context.view_layer.update()
    asked = read_request(bpy.context)
    assert not told_of_inside(morph())
    for number in which:
        apply(balls[number])
    bpy.context.view_layer.update()
    twin = read_request(bpy.context)
    for one, other in ((asked.source, twin.source), (asked.target, twin.target)):
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-6)
        np.testing.assert_array_equal(one.triangles, other.triangles)
        np.testing.assert_allclose(one.normals, other.normals, atol=1e-5)
    assert asked.features == twin.features


def test_a_mirrored_parent_counts_as_well(balls):
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (1, -1, 1)
    balls[0].parent = parent
    bpy.context.view_layer.update()
    assert not told_of_inside(morph())


def test_faces_that_point_inward_are_told_of_on_a_mirrored_object(balls):
    balls[0].data.flip_normals()
    balls[0].matrix_world = MIRROR
    assert told_of_inside(morph()) == ["The faces of Hill pointed inward: they were reversed."]


def test_its_points_are_computed_again_from_themselves(settings):
    """They hold the faces as they were morphed."""
    source, target = pair()
    source.matrix_world = MIRROR
    target.matrix_world = MIRROR
    obj = morph()
    before = content(obj)
    bpy.data.objects.remove(source)
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert_same(content(obj), before)


def test_the_source_is_subdivided(balls):
    source, _ = balls
    source.matrix_world = MIRROR
    shown = morph()
    before = len(source.data.vertices)
    select(shown)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert len(source.data.vertices) > before
    # All faces still show their outside: the volume is that of the form.
    found = bmesh.new()
    found.from_mesh(source.data)
    assert found.calc_volume(signed=True) > 1
    assert all(edge.is_contiguous for edge in found.edges)
    found.free()
    assert shown.pointmorph.state == "CURRENT"


def test_normal_maps_mean_the_same(addon):
    """What goes along V on a mesh is seen to go along V where the mesh is mirrored."""
    tangents, transforms = addon("core.tangents"), addon("core.transforms")
    positions = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32)
    uvs = np.array([[0, 0], [1, 0], [0.3, 1]])
    matrix = np.diag([-1.0, 1, 1, 1])
    corners = np.array([[0, 1, 2]])
    found = []
    for moved in (np.eye(4), matrix):
        triangles = transforms.move_faces(moved, corners)
        places = transforms.move_positions(moved, positions)
        normals = np.tile([0.0, 0, 1], (1, 3, 1))
        frames = tangents.frames_of_corners(places, triangles, normals, uvs[triangles])
        found.append(np.array(frames.at(np.array([0]), np.full((1, 3), 1 / 3)))[:, 0])
    np.testing.assert_allclose(found[1], found[0] @ matrix[:3, :3], atol=1e-6)
