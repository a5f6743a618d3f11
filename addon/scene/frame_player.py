"""Baked frames as meshes: those with faces, in the scene, and those that USD and Alembic files are
written from.

Each frame is a mesh, all in one collection that isn't in the scene; an object of its own shows the
one of the present frame, points as a point cloud. Frames of points in the scene are files instead:
see `cached_frames`.
"""

import bpy
import numpy as np

from ..core import frame_plan
from ..core.stepping import finish
from ..data import arrays, attribute_names, creation
from . import frame_players, frames_display, morph_object, points_display

COLLECTION = "Frames"
_OF = "pointmorph_faces_of"
"""On an object that shows frames with faces: the morph object that they are of."""


def read(obj):
    """What `read_steps` returns, at once."""
    return finish(read_steps(obj))


def read_steps(obj):
    """A generator that yields often and returns what a morph object holds.

    Raises
    ------
    CloudError
        When the object lacks what it was made with.
    """
    mesh = obj.data
    keys, rows = morph_object.stage_keys(obj), morph_object.stage_rows(obj)
    names = morph_object.stage_names(obj)
    shapes, pairs, maps = [], [], []
    for stage, key, row, name in zip(morph_object.stages(obj), keys, rows, names, strict=True):
        yield
        shapes.append({"name": name, **morph_object.read_stage(obj, stage, key, row)})
    for number, (onward, back) in enumerate(morph_object.map_names(obj)):
        yield
        known = onward in mesh.attributes and back in mesh.attributes
        of_ends = zip(rows[number:], (onward, back), strict=False)
        maps.append(
            tuple(arrays.by_row(row, arrays.read_vectors(mesh, name)) for row, name in of_ends)
            if known
            else None
        )
        pairs.append(np.stack(rows[number : number + 2], axis=1))
    return frame_plan.Held(shapes, pairs, maps)


def build(context, name, matrix, plan, frames, content):
    """Makes the object that shows the frames of the object `name`, with the matrix that this had;
    all of it or nothing. Returns the object.

    `content` says how the format wants it: see `frame_formats.Content`.
    """
    name = f"{name} {COLLECTION}"
    with creation.all_or_nothing() as created:
        collection = bpy.data.collections.new(name)
        created(collection)
        for number, frame in enumerate(frames):
            # In the order of their names: that of the instances.
            mesh = bpy.data.meshes.new(f"{name} {number:06d}")
            created(mesh)
            arrays.fill_mesh(mesh, frame.positions, frame.faces if plan.faces else None)
            arrays.write_attribute(mesh, attribute_names.VELOCITY, frame.velocities)
            if content.byte_colors:
                arrays.write_corner_colors(mesh, attribute_names.COLOR, frame.colors)
            else:
                arrays.write_attribute(mesh, attribute_names.COLOR, frame.colors)
            arrays.activate_colors(mesh, attribute_names.COLOR)
            if not plan.faces:
                arrays.write_attribute(mesh, attribute_names.NORMAL, frame.normals)
                arrays.write_attribute(mesh, attribute_names.RADIUS, frame.radii)
                arrays.write_attribute(mesh, content.id_name, frame.ids)
            one = bpy.data.objects.new(mesh.name, mesh)
            created(one)
            collection.objects.link(one)
        new = frames_display.new_own_mesh if plan.faces else bpy.data.pointclouds.new
        data = new(name)
        created(data)
        player = bpy.data.objects.new(name, data)
        created(player)
        player.matrix_world = matrix
        frames_display.add_frames_modifier(player, collection, plan, created)
        creation.link(context, player)
    return player


def player_of(scene, obj):
    """The object in a scene that shows frames with faces of a morph object, or None."""
    return frame_players.found(scene, obj, _OF)


def show(context, obj, player):
    """Makes what `build` made show the frames of a morph object: the object that shows earlier
    ones of it gets them, if there is one. Returns the object that shows them."""
    before = player_of(context.scene, obj)
    matrix = player.matrix_world.copy()
    if before is None or points_display.points_modifier(before) is None:
        frame_players.belongs(player, obj, _OF)
        frame_players.place(player, matrix)
        return player
    old = _frames(before)
    name = frames_display.frames_collection(before).name
    frames_display.share_frames(before, player)
    frame_players.belongs(before, obj, _OF)
    frame_players.place(before, matrix)
    bpy.data.batch_remove([player, player.data, *old])
    frames_display.frames_collection(before).name = name
    return before


def remove(player):
    """Takes the frames out of the file again."""
    bpy.data.batch_remove([player, player.data, *_frames(player)])


def _frames(player):
    collection = frames_display.frames_collection(player)
    if collection is None:
        return []
    objects = list(collection.objects)
    return [*objects, *(one.data for one in objects), collection]
