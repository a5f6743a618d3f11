"""Marks features on objects, and takes marks off."""

import bmesh
import numpy as np

from ..core.features import PREFIX, description
from ..data import arrays
from ..data.feature_list import feature_names, named
from . import marked_points


def say_what_was_found(scene, request):
    """Writes into the list of features what each of them is."""
    for item in scene.pointmorph.features:
        if item.marked_name in request.features:
            found = description(request.features[item.marked_name])
            if item.found != found:
                item.found = found


def next_name(settings, objects):
    for feature in settings.features:
        if not any(feature.name in feature_names(obj) for obj in objects):
            return feature.name
    taken = {feature.name for feature in settings.features}
    number = 1
    while f"feature {number}" in taken:
        number += 1
    return f"feature {number}"


def mark(obj, name, rows, weights=None):
    """Makes the feature's vertex group (of a point cloud: attribute) hold these points only."""
    unmark(obj, name)
    if obj.type == "POINTCLOUD":
        arrays.mark_points(obj.data, PREFIX + name, rows, weights)
    elif weights is None:
        _fill_group(obj, obj.vertex_groups.new(name=PREFIX + name), rows)
    else:
        group = obj.vertex_groups.new(name=PREFIX + name)
        for row, weight in zip(rows, weights, strict=True):
            group.add([row], weight, "REPLACE")
    if len(rows) == 1:
        marked_points.note(obj, name, rows[0])


def _fill_group(obj, group, rows):
    if obj.mode == "EDIT":
        mesh = bmesh.from_edit_mesh(obj.data)
        layer = mesh.verts.layers.deform.verify()
        mesh.verts.ensure_lookup_table()
        for row in rows:
            mesh.verts[row][layer][group.index] = 1.0
        bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)
    else:
        group.add(rows, 1.0, "REPLACE")


def members(obj, names):
    """By name, the points of features that are marked on an object: rows and weights."""
    if obj.type == "POINTCLOUD":
        values = {n: arrays.read_attribute(obj.data.attributes[PREFIX + n]) for n in names}
        found = {n: (np.arange(len(v)), v) for n, v in values.items()}
    else:
        groups = {obj.vertex_groups[PREFIX + name].index: name for name in names}
        found = arrays.vertex_groups(obj.data, groups)
    return {n: (rows[weights > 0], weights[weights > 0]) for n, (rows, weights) in found.items()}


def unmark(obj, name):
    """Takes a feature off an object."""
    if name in feature_names(obj):
        marks = named(obj)
        marks.remove(marks[PREFIX + name])


def unmarkable(context):
    """Why features can't be marked in Object Mode; None when they can."""
    settings = context.scene.pointmorph
    for obj in (settings.source, settings.target):
        if obj.mode == "EDIT":
            return "Switch to Object Mode first"
        if obj.type in arrays.MADE_TYPES:
            return f'"{obj.name}" is no mesh: Morph makes one, where features can be marked'
        if obj.library is not None or obj.data.library is not None:
            return f'"{obj.name}" is linked from another file: make it local to mark features on it'
        if obj.type == "POINTCLOUD" and not len(obj.data.points):
            return f'The points of "{obj.name}" come from a modifier: apply it to mark features'
    return None
