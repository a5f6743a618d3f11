"""Frames of points as a file that Blender reads frame by frame, and the object that shows them.

Nothing of this needs the add-on once it is made: modifiers read the file and show its points.
"""

import bpy

from ..core import frame_cache
from ..data import arrays, attribute_names, creation, nodes, versions
from . import (
    cache_files,
    disc_faces,
    frame_players,
    frames_display,
    morph_object,
    point_shapes,
    points_display,
    surface_nodes,
)

_ROWS = "Cache Rows"
_SURFACE_ASKED = "pointmorph_surface"
"""On an object that shows frames: whether a bake with Faces turned its surface on."""


def player_of(scene, obj):
    """The object in a scene that shows the frames which were baked of a morph object, or None."""
    return frame_players.found(scene, obj, cache_files.OF)


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
        player = player_of(context.scene, obj)
        if player is None:
            name = f"{morph_object.shown_of(obj).name} {cache_files.NAME}"
            mesh = frames_display.new_own_mesh(name)
            created(mesh)
            player = bpy.data.objects.new(name, mesh)
            created(player)
            creation.link(context, player)
        _set_up(player, plan, rows, created)
        frame_players.belongs(player, obj, cache_files.OF)
        frame_players.place(player, matrix)
        player.modifiers[cache_files.MODIFIER].filepath = cache_files.relative(path)
        player.update_tag()
    return player


def show_surface(player, faces):
    """Shows faces through the points if a bake asks for them; otherwise no longer, if one did. Who
    turned them on in the modifier keeps them."""
    if faces or player.get(_SURFACE_ASKED):
        modifier = player.modifiers[points_display.MODIFIER]
        versions.set_input(modifier, surface_nodes.SURFACE, faces)
        player[_SURFACE_ASKED] = faces
        player.update_tag()


def separate_copies(scene, depsgraph):
    """Gives copies of objects that show frames, which were made just now, discs of their own: they
    are turned on and off by themselves."""
    for update in depsgraph.updates:
        player = update.id.original
        if not isinstance(player, bpy.types.Object) or cache_files.OF not in player:
            continue
        points = player.modifiers.get(points_display.MODIFIER)
        group = points.node_group if points is not None and points.type == "NODES" else None
        if group is None or not player.is_editable:
            continue
        if point_shapes.FACES not in versions.group_inputs(group):  # of an earlier version
            continue
        faces = versions.input_value(points, point_shapes.FACES)
        if faces is not None and not disc_faces.is_switched_by(faces, player):
            with creation.all_or_nothing() as created:
                rows = versions.input_value(points, frames_display.ROWS)
                _give_faces(player, rows, created)


def _give_faces(player, rows, created):
    """The faces of discs for an object with so many points in a frame at most, made ahead."""
    points = player.modifiers[points_display.MODIFIER]
    known = versions.input_value(points, point_shapes.FACES)
    switch = versions.input_path(points, point_shapes.DISCS)
    faces = disc_faces.at_most(known, rows, player, switch, created)
    versions.set_input(points, point_shapes.FACES, faces)
    disc_faces.remove_unused()


def _set_up(player, plan, rows, created):
    """Gives an object the modifiers that it needs, in this order and before all others."""
    cache = player.modifiers.get(cache_files.MODIFIER)
    if cache is None:
        cache = player.modifiers.new(cache_files.MODIFIER, "MESH_CACHE")
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
        if modifier.node_group is None:
            modifier.node_group = group(created)
        else:  # perhaps of an earlier version
            nodes.swap_group(player, modifier, group(created))
        for key, value in inputs.items():
            versions.set_input(modifier, key, value)
    _give_faces(player, rows, created)
    for place, name in enumerate((_ROWS, cache_files.MODIFIER, points_display.MODIFIER)):
        player.modifiers.move(player.modifiers.find(name), place)
    arrays.activate_colors(player.data, attribute_names.COLOR)
