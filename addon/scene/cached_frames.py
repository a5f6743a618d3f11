"""Frames of points as a file that Blender reads frame by frame, and the object that shows them.

Nothing of this needs the add-on once it is made: modifiers read the file and show its points.
"""

import contextlib
import os
import shutil
from pathlib import Path

import bpy
import pointmorph.files

from ..core import frame_cache
from ..data import arrays, attribute_names, creation, versions
from ..data.registration import Registration
from . import frame_files, frames_display, points_display, surface_nodes

NAME = "Frames"
_ROWS, _CACHE = "Cache Rows", "Mesh Cache"
_OF = "pointmorph_frames_of"
"""On an object that shows frames: the morph object that they are of."""


def player_of(obj):
    """The object that shows the frames which were baked of a morph object, or None."""
    return next(
        (one for one in bpy.data.objects if one.library is None and one.get(_OF) == obj), None
    )


def file_for(obj):
    """The file for frames of a morph object: that which it has, unless another object shows it."""
    player = player_of(obj)
    others = {_file_of(one) for one in bpy.data.objects if one != player}
    for number in range(len(others) + 1):
        path = frame_files.cache_path(f"{obj.name} {NAME}{f' {number}' if number else ''}")
        if path not in others:
            return path
    raise AssertionError("as many objects as files")


def show(context, obj, matrix, plan, file):
    """Shows frames of a morph object: by the object that shows earlier ones, or a new one.

    Parameters
    ----------
    matrix : Matrix
        That the morph object had when it was baked.
    plan : frame_plan.Plan
    file : (pathlib.Path, int)
        What `frame_cache.write` wrote, and what it returned.

    Returns
    -------
    Object
    """
    path, rows = file
    with creation.all_or_nothing() as created:
        player = player_of(obj)
        if player is None:
            name = f"{obj.name} {NAME}"
            mesh = frames_display.new_own_mesh(name)
            created(mesh)
            player = bpy.data.objects.new(name, mesh)
            created(player)
            player[_OF] = obj
            creation.link(context, player)
        player.matrix_world = matrix
        before = _file_of(player)
        _set_up(player, plan, rows, created)
        cache = player.modifiers[_CACHE]
        cache.filepath = _relative(path)
        player.update_tag()
    others = {_file_of(one) for one in bpy.data.objects if one != player}
    if before is not None and before != path and _is_own(before) and before not in others:
        with contextlib.suppress(OSError):
            before.unlink()
    return player


def show_surface(player, show):
    """Shows faces through the points, or the points."""
    modifier = player.modifiers[points_display.MODIFIER]
    versions.set_input(modifier, surface_nodes.SURFACE, show)
    player.update_tag()


def _set_up(player, plan, rows, created):
    """Gives an object the modifiers that it needs, in this order and before all others."""
    cache = player.modifiers.get(_CACHE)
    if cache is None:
        cache = player.modifiers.new(_CACHE, "MESH_CACHE")
    cache.cache_format = "PC2"
    cache.interpolation = "NONE"
    cache.time_mode, cache.play_mode = "FRAME", "CUSTOM"
    cache.driver_remove("eval_frame")
    driver = cache.driver_add("eval_frame").driver
    driver.type = "SCRIPTED"
    # Simple enough for Blender to compute without Python, also where scripts may not run.
    driver.expression = f"floor((frame - {plan.first}) / {plan.step})"
    vertices = frame_cache.vertex_count(rows)
    values = {
        _ROWS: (frames_display.rows_group, {frames_display.VERTICES: vertices}),
        points_display.MODIFIER: (
            frames_display.cached_group,
            {frames_display.ROWS: rows, "Frame Rate": frames_display.frame_rate()},
        ),
    }
    for name, (group, inputs) in values.items():
        modifier = player.modifiers.get(name)
        if modifier is None:
            modifier = player.modifiers.new(name, "NODES")
            modifier.node_group = group(created)
        for key, value in inputs.items():
            versions.set_input(modifier, key, value)
    for place, name in enumerate((_ROWS, _CACHE, points_display.MODIFIER)):
        player.modifiers.move(player.modifiers.find(name), place)
    arrays.activate_colors(player.data, attribute_names.COLOR)


# --- The file -------------------------------------------------------------------------------------


def _file_of(player):
    cache = player.modifiers.get(_CACHE)
    if cache is None or cache.type != "MESH_CACHE" or not cache.filepath:
        return None
    return Path(bpy.path.abspath(cache.filepath))


def _relative(path):
    """As Blender keeps it: it moves along with the .blend file."""
    if not bpy.data.filepath or path.is_relative_to(bpy.app.tempdir):
        return str(path)
    with contextlib.suppress(ValueError):  # another drive
        return bpy.path.relpath(str(path))
    return str(path)


def _is_own(path):
    """Whether a file is one of the open .blend file's, and so of no other one."""
    own = [Path(bpy.app.tempdir)]
    if bpy.data.filepath:
        own.append(frame_files.cache_folder(bpy.data.filepath))
    return path.parent in own


def is_temporary(player):
    """Whether frames are gone when Blender ends, unless the file is saved."""
    path = _file_of(player)
    return path is not None and path.is_relative_to(bpy.app.tempdir)


def _before_saving(path, *_):
    """Frames that were baked in a file that had never been saved go beside it."""
    if not path:
        return
    for player in bpy.data.objects:
        if player.get(_OF) is None or player.library is not None or not is_temporary(player):
            continue
        old = _file_of(player)
        folder = frame_files.cache_folder(path)
        with contextlib.suppress(OSError, pointmorph.PointmorphError):
            pointmorph.files.make_folder(folder)
            shutil.move(old, folder / old.name)
            player.modifiers[_CACHE].filepath = f"//{folder.name}/{old.name}"


def _after_saving(path, *_):
    """What was saved as a copy leaves the open file without a place of its own."""
    if not path or bpy.data.filepath:
        return
    for player in bpy.data.objects:
        cache = player.modifiers.get(_CACHE)
        if player.get(_OF) is not None and cache is not None and cache.filepath.startswith("//"):
            cache.filepath = os.path.join(os.path.dirname(path), cache.filepath[2:])


registration = Registration(
    handlers=(("save_pre", _before_saving), ("save_post", _after_saving)),
)
