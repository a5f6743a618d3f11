"""A sheet and the same turned and twice as large, for tests of what the target hands over."""

import json

import bpy
import numpy as np
from mathutils import Matrix
from scenes import add_mesh, coordinates, mark, morph, patch, pick, select

MARKS = (("a", -1, -1), ("b", 1, -1), ("c", 1, 1), ("d", -1, 1), ("e", 0, 0))
PLACE = (3, 0, 0)
TURN = Matrix.Rotation(2.0, 3, (1, 2, 3)).to_quaternion()


def add_key(obj, name, offsets):
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis")
    block = obj.shape_key_add(name=name, from_mix=False)
    block.value = 0.0
    positions = coordinates(obj.data.vertices) + offsets
    block.data.foreach_set("co", positions.astype(np.float32).reshape(-1))
    return block


def smile(positions):
    """(N, 3): up and outward around a place."""
    near = np.exp(-8 * ((positions[:, :2] - 0.3) ** 2).sum(axis=1))
    return near[:, None] * [[0.1, 0.3, 0.2]]


def transfer(obj, **options):
    select(obj)
    return bpy.ops.pointmorph.transfer_attributes(**options)


def from_source(target, positions):
    """Places on the target in the source's space, which only lies elsewhere than the world's."""
    matrix = np.array(target.matrix_world)
    return positions @ matrix[:3, :3].T + matrix[:3, 3] - PLACE


def shown(obj):
    bpy.context.view_layer.update()
    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def turned_pair(settings):
    """A sheet, and the same turned and twice as large, with a mesh that goes exactly there."""
    source, target = (add_mesh(name, *patch(12)) for name in ("Hill", "Dune"))
    for obj in (source, target):
        for name, x, y in MARKS:
            mark(obj, name, x, y)
    source.matrix_world = Matrix.Translation(PLACE)
    target.matrix_world = Matrix.LocRotScale((-2, 1, 0), TURN, (2, 2, 2))
    pick(source, target)
    settings.domain = "disk"
    settings.show_as = "MESH"
    settings.path = "linear"
    settings.blend_textures = False
    bpy.context.view_layer.update()
    copy = morph()
    exactly_there(copy, target)
    return source, target, copy


def exactly_there(copy, target, shift=(0, 0, 0)):
    """Makes the map of a mesh the one that is known."""
    positions = from_source(target, coordinates(target.data.vertices) + shift)
    block = copy.data.shape_keys.key_blocks["Morph"]
    block.data.foreach_set("co", positions.astype(np.float32).reshape(-1))
    copy.data.update()


def words(obj):
    recipe = json.loads(obj.pointmorph.recipe)
    return " / ".join(recipe["transferred"]["words"])


def unwrap(obj, name="UVMap"):
    corners = np.array([loop.vertex_index for loop in obj.data.loops])
    uvs = 0.5 + 0.45 * coordinates(obj.data.vertices)[corners][:, :2]
    layer = obj.data.uv_layers.new(name=name)
    layer.data.foreach_set("uv", uvs.astype(np.float32).reshape(-1))
