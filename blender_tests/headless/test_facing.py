"""Objects that face different ways: in Blender, z is up."""

import bmesh
import bpy
import numpy as np
from scenes import coordinates, key, morph, pick


def star(name, radii_of):
    """A ball with radii of its own in all directions."""
    mesh = bpy.data.meshes.new(name)
    made = bmesh.new()
    bmesh.ops.create_icosphere(made, subdivisions=5, radius=1)
    made.to_mesh(mesh)
    made.free()
    ways = coordinates(mesh.vertices)
    mesh.vertices.foreach_set("co", (radii_of(ways)[:, None] * ways).astype(np.float32).ravel())
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def egg(ways):
    """With waves all over and a thin tip along x."""
    rows = np.sin(8 * np.arcsin(np.clip(ways[:, 2], -1, 1)))
    waves = 1 + 0.2 * rows * np.cos(4 * np.arctan2(ways[:, 1], ways[:, 0]))
    return waves * (1 + 2 * np.exp((ways[:, 0] - 1) / 0.03))


def box(ways):
    """With a thicker tip along y."""
    radii = (np.abs(ways) ** 6).sum(1) ** (-1 / 6)
    return radii * (1 + 2.5 * np.exp((ways[:, 1] - 1) / 0.05))


def test_what_faces_another_way_is_turned_to_it(settings):
    settings.show_as = "MESH"
    source, target = star("Egg", egg), star("Box", box)
    source.scale.z = 1.2
    pick(source, target)
    morph()
    obj = bpy.context.object
    tip = coordinates(source.data.vertices)[:, 0].argmax()
    place = key(obj, obj.data.shape_keys.key_blocks[-1].name)[tip]
    assert place @ (0, 1, 0) / np.linalg.norm(place) > 0.95
