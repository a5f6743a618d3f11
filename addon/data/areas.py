"""Has parts of the window drawn again."""

import contextlib

import bpy


def redraw_viewports():
    """Has all 3D viewports drawn anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def local_views():
    """The spaces of the 3D viewports that show some objects alone."""
    return [
        area.spaces.active
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "VIEW_3D" and area.spaces.active.local_view is not None
    ]


def put_in_local_views(obj, copy):
    """Shows a new object where a local view shows the one in whose place it is."""
    for space in local_views():
        with contextlib.suppress(RuntimeError):  # it isn't in this view layer
            if obj.visible_get(viewport=space):
                copy.local_view_set(space, True)


def redraw_sidebars():
    """Has the sidebars of all 3D viewports drawn anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()
