"""Vertex groups as arrays of weights, one for each vertex."""

import bpy
import numpy as np

from ..core.features import PREFIX
from ..data import arrays


def read_steps(obj, mesh, prefix="", without=()):
    """A generator that yields often and returns (name, (N, 1) weights) of an object's groups.

    Parameters
    ----------
    mesh : Mesh
        Its own, or what the viewport shows of it.
    prefix, without : str, collection of str
        Names that begin so, and these names, are left out, as features are.
    """
    groups = {
        group.index: group.name
        for group in obj.vertex_groups
        if not group.name.startswith(PREFIX)
        and not (prefix and group.name.startswith(prefix))
        and group.name not in without
    }
    result = []
    weights = yield from arrays.vertex_group_steps(mesh, groups)
    for name, (members, values) in weights.items():
        whole = np.zeros((len(mesh.vertices), 1), np.float32)
        whole[members, 0] = values
        result.append((name, whole))
    return result


def write(obj, name, weights):
    """A vertex group in place of one of that name; by way of an attribute, which takes a hundredth
    of the time that a call for each vertex does."""
    group = obj.vertex_groups.get(name)
    if group is not None:
        obj.vertex_groups.remove(group)
    arrays.write_attribute(obj.data, name, weights)
    obj.data.attributes.active = obj.data.attributes[name]
    with bpy.context.temp_override(object=obj, active_object=obj):
        bpy.ops.geometry.attribute_convert(mode="VERTEX_GROUP")
