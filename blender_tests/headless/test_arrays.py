"""Arrays between Blender and numpy."""

import bpy
import numpy as np
import pytest
from modeling import primitive

pytestmark = pytest.mark.interface


def _known(obj):
    """What Blender finds out of the places of vertices."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found = []
    for one in (obj, evaluated):
        normals = np.empty(3 * len(one.data.vertices), np.float32)
        one.data.vertex_normals.foreach_get("vector", normals)
        found += [normals, np.array(one.bound_box)]
    return found


def test_blender_learns_of_the_places_that_vertices_are_moved_to(addon):
    arrays = addon("data.arrays")
    obj = primitive("uv_sphere")
    _known(obj)  # as nobody should still see them
    copy = obj.data.copy()
    at_rest = arrays.vertex_positions(obj.data)
    places = at_rest * (2.0, 3.0, 0.5) + (7.0, 0.0, 0.0)
    arrays.move_vertices(obj.data, places)
    bpy.context.view_layer.update()

    assert np.array_equal(arrays.vertex_positions(obj.data), places.astype(np.float32))
    assert np.array_equal(arrays.vertex_positions(copy), at_rest)  # although they share memory
    other = bpy.data.objects.new("Other", copy)
    bpy.context.collection.objects.link(other)
    for vertex, place in zip(copy.vertices, places, strict=True):
        vertex.co = place
    bpy.context.view_layer.update()
    for ours, theirs in zip(_known(obj), _known(other), strict=True):
        assert np.array_equal(ours, theirs)
    assert np.array(obj.bound_box)[:, 0].max() > 8.0


def test_meshes_without_vertices_can_be_filled_and_moved(addon):
    arrays = addon("data.arrays")
    mesh = bpy.data.meshes.new("Empty")
    arrays.fill_mesh(mesh, np.zeros((0, 3)))
    arrays.move_vertices(mesh, np.zeros((0, 3)))
    assert len(mesh.vertices) == 0
