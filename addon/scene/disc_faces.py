"""The faces of discs, made once for as many points as there are: in each frame, geometry nodes have
but to put them where they belong.

A mesh object that is in no scene makes them with its modifier. Blender keeps what it shows until it
changes, and a file holds no more of it than the number. All discs lie in the origin, so each corner
knows its disc and where in it it is.

Where a morph is appended, Blender puts what it needs into the scene and viewports: so these objects
are at least disabled in renders.
"""

import bpy
import numpy as np

from ..data import arrays, attribute_names, nodes, versions

NAME = "Pointmorph Discs"
_ONE, _ALL = ".Pointmorph Disc", ".Pointmorph Discs"  # lists to choose from leave these out
CORNERS = 6
_FACE = "disc_face"
ROW = "disc_row"  # of a corner: the number of its disc
ACROSS, ALONG = "disc_across", "disc_along"  # and its place in it, three times the same number
COUNT = "Count"


def of(count, created):
    """The object that shows so many discs."""
    group = shared_group(created)
    for obj in bpy.data.objects:
        is_free = _is_of(obj, group) and obj.animation_data is None
        if is_free and versions.input_value(obj.modifiers[0], COUNT) == count:
            return obj
    obj = _new(group, created)
    versions.set_input(obj.modifiers[0], COUNT, count)
    return obj


def at_most(known, count, player, switch, created):
    """The object that shows so many discs while `switch`, a property of `player` by its path, is
    on, and one at most while it is off: `known`, if it is such an object of this player, or a new
    one."""
    group = shared_group(created)
    if known is None or not _is_of(known, group) or not is_switched_by(known, player):
        known = _new(group, created)
    nodes.drive_count(known, COUNT, player, switch, count)
    return known


def is_switched_by(faces, player):
    """Whether it is this player, and not one that it is a copy of, that decides how many discs an
    object shows."""
    data = faces.animation_data
    curves = () if data is None else data.drivers
    targets = [t for c in curves for v in c.driver.variables for t in v.targets]
    return any(target.id == player for target in targets)


def _new(group, created):
    obj = bpy.data.objects.new(_ALL, _one_disc(group).data)
    created(obj)
    obj.hide_render = True
    obj.modifiers.new(NAME, "NODES").node_group = group
    return obj


def leave_scenes():
    """Takes these objects out of the collections that they were appended to."""
    for group in bpy.data.node_groups:
        if not nodes.is_shared(group, NAME):
            continue
        for obj in bpy.data.objects:
            if obj.library is None and (_is_of(obj, group) or obj == _one_disc(group)):
                for home in obj.users_collection:
                    if home.is_editable and home.override_library is None:
                        home.objects.unlink(obj)


def remove_unused():
    """Takes what nothing has out of the file."""
    groups = [group for group in bpy.data.node_groups if nodes.is_shared(group, NAME)]
    unused = [o for o in bpy.data.objects if not o.users and any(_is_of(o, g) for g in groups)]
    bpy.data.batch_remove(unused)
    for group in groups:
        if not group.users:
            one = _one_disc(group)
            bpy.data.batch_remove([group] if one is None else [group, one, one.data])


def _is_of(obj, group):
    modifiers = obj.modifiers
    return (
        obj.library is None
        and len(modifiers) == 1
        and modifiers[0].type == "NODES"
        and modifiers[0].node_group == group
    )


def shared_group(created):
    """The group of nodes that makes `Count` discs."""
    group = nodes.shared_group(NAME, lambda name: _group(name, created))
    if _one_disc(group) is None:  # somebody deleted it
        _info(group).inputs["Object"].default_value = _new_one(created)
    return group


def _group(name, created):
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketInt", COUNT, "Number of discs", min_value=1)
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")
    build = nodes.Builder(group)
    count = build.node("NodeGroupInput").outputs[COUNT]
    one = _new_one(created)
    first = build.node("GeometryNodeObjectInfo", {"Object": one}, transform_space="ORIGINAL")
    first = first.outputs["Geometry"]
    others = build.node(
        "GeometryNodeDuplicateElements",
        {"Geometry": first, "Amount": build.math("SUBTRACT", count, 1.0)},
        domain="FACE",
    )
    # The first part says which colors are active; the last one that is linked comes first.
    all_discs = build.node("GeometryNodeJoinGeometry")
    for part in (others.outputs["Geometry"], first):
        build.tree.links.new(part, all_discs.inputs[0])
    # The number of the face, since a number of nodes isn't whole beyond 2^24 corners.
    index = build.node("GeometryNodeInputIndex").outputs["Index"]
    shown = build.stored(all_discs.outputs[0], _FACE, "INT", index, domain="FACE")
    shown = build.stored(shown, ROW, "INT", build.attribute(_FACE, "INT"))
    build.node("NodeGroupOutput", {"Geometry": build.without(shown, _FACE)})
    return group


def _one_disc(group):
    """The object that `Count` copies are made of; None if it was deleted."""
    return _info(group).inputs["Object"].default_value


def _info(group):
    return next(node for node in group.nodes if node.bl_idname == "GeometryNodeObjectInfo")


def _new_one(created):
    one = bpy.data.objects.new(_ONE, _new_mesh(created))
    created(one)
    one.hide_render = True
    return one


def _new_mesh(created):
    """One disc of radius 1 that faces up."""
    angles = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    places = np.stack([np.cos(angles), np.sin(angles), np.zeros(CORNERS)], axis=1)
    mesh = bpy.data.meshes.new(_ONE)
    created(mesh)
    mesh.from_pydata(places.tolist(), [], [list(range(CORNERS))])
    arrays.activate_colors(mesh, attribute_names.COLOR)
    for axis, name in enumerate((ACROSS, ALONG)):
        values = np.repeat(places[:, axis : axis + 1], 3, axis=1).astype(np.float32)
        arrays.write_attribute(mesh, name, values)
    return mesh
