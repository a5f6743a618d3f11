"""Runs in the Blender with a window before each test: an empty scene, names that tests use.

The scene has the settings' defaults and a 3D viewport with a sidebar: alone and side by side where
the window is small.
"""

import os
import sys
import time

import bpy
import remembering
import scenes  # noqa: F401, tests use it

if bpy.context.object and bpy.context.object.mode == "EDIT":
    bpy.ops.object.mode_set(mode="OBJECT")
for kind in (
    "objects",
    "collections",
    "meshes",
    "pointclouds",
    "node_groups",
    "materials",
    "actions",
    "cameras",
):
    bpy.data.batch_remove(getattr(bpy.data, kind))
for name in bpy.context.scene.pointmorph.bl_rna.properties.keys():  # noqa: SIM118, not a dict
    if name not in ("rna_type", "name"):
        bpy.context.scene.pointmorph.property_unset(name)
bpy.context.scene.pointmorph.show_as = "POINTS"
bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 250
bpy.context.scene.frame_set(1)
window = bpy.context.window_manager.windows[0]
is_small = window.width < 1000
area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
area.spaces[0].shading.type = "SOLID"
area.spaces[0].shading.color_type = "MATERIAL"
area.spaces[0].overlay.show_floor = False  # every pixel costs time without a graphics card
area.spaces[0].overlay.show_axis_x = area.spaces[0].overlay.show_axis_y = False
area.spaces[0].overlay.show_outline_selected = not is_small
area.spaces[0].show_region_ui = True
area.spaces[0].show_region_toolbar = area.spaces[0].show_region_tool_header = not is_small
area.spaces[0].show_gizmo_navigate = not is_small
bpy.context.preferences.system.use_region_overlap = not is_small
area.spaces[0].show_object_viewport_mesh = True
area.spaces[0].show_object_viewport_pointcloud = True
viewport = next(region for region in area.regions if region.type == "WINDOW")
sidebar = next(region for region in area.regions if region.type == "UI")


def in_viewport():
    return bpy.context.temp_override(window=window, area=area, region=viewport)


def addon(name):
    ends = (f".pointmorph.{name}", f"pointmorph_addon.{name}")
    return sys.modules[next(n for n in sys.modules if n.endswith(ends))]


def session():
    return addon("core.background_job")


def remember(remembers):
    chains, compute = addon("data.chains"), addon("core.computation").compute
    remembered = remembering.Memory(os.environ["POINTMORPH_COMPUTED"]).remembering(compute)

    def known(request, progress, earlier=None):
        if earlier and earlier.start_for(request):
            return compute(request, progress, earlier)
        return remembered(request, progress)

    chains.compute = known if remembers else compute


waited_for, drawn_at, turns, asked = set(), 0.0, 0, []


def redraw(*regions):
    waited_for.update(region.type for region in regions)
    for region in regions:
        region.tag_redraw()


def is_drawn():
    return not waited_for


def _note_drawn():
    global drawn_at, turns
    waited_for.discard(bpy.context.region.type)
    if bpy.context.region.type == "UI":
        drawn_at, turns = time.monotonic(), 0


def rests():
    # A panel that glides, 0.3 s long, is drawn again and again; so it is where progress is shown.
    global turns
    turns, now = turns + 1, time.monotonic()
    asked.append(now)
    has_settled = turns > 5 and now - drawn_at > 0.06
    return has_settled or (len(asked) > 15 and now - asked[0] > 0.35)


def region_at(x, y):
    top = window.height - sidebar.y - sidebar.height
    return sidebar if x >= sidebar.x and y >= top else viewport


panels = set()


def _note(name):
    def draw(self, context):
        panels.add(name)

    return draw


def hovered():
    with bpy.context.temp_override(window=window, area=area, region=sidebar):
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
        elif bpy.ops.ui.copy_data_path_button.poll():
            bpy.ops.ui.copy_data_path_button(full_path=True)
        else:
            return ""
    return window_manager.clipboard


def hover_down(x, top, bottom, what, near):
    """Moves the mouse from row to row, and notes in calls what lies there."""
    global hovering, calls
    calls = []
    rows = range(top, bottom, 15)  # rows are 20 high, some buttons less
    places = iter(sorted(rows, key=lambda y: abs(y - near)))
    hovering = next(places)

    def step():
        global hovering
        if moved:
            with bpy.context.temp_override(window=window):
                bpy.ops.wm.where_is_the_mouse("INVOKE_DEFAULT")
            there = abs(mouse[0] - x) <= 1 and abs(mouse[1] - window.height + hovering) <= 1
            moved.append(there)
            # Blender has heard of it, and in the turn after that, so has the button.
            if sum(moved) < 2 and len(moved) < 100:
                return 0.01
            calls.append((hovering, hovered()))
            hovering = None if what and what in calls[-1][1] else next(places, None)
        if hovering is None:
            return None
        moved[:] = [False]
        window.cursor_warp(x, window.height - hovering)
        return 0.01

    moved = []  # since the mouse was moved: whether Blender knew, each turn
    bpy.app.timers.register(step, first_interval=0.0)


window_manager = bpy.context.window_manager
for name in dir(bpy.types):
    if name.startswith("POINTMORPH_PT_") and not hasattr(getattr(bpy.types, name), "is_noted"):
        getattr(bpy.types, name).append(_note(name))
        getattr(bpy.types, name).is_noted = True

session().problem = None
session().forget()

mouse = [0, 0]


class WhereIsTheMouse(bpy.types.Operator):
    bl_idname = "wm.where_is_the_mouse"
    bl_label = "Where Is the Mouse?"
    bl_options = {"INTERNAL"}

    def invoke(self, context, event):
        mouse[:] = event.mouse_x, event.mouse_y
        return {"FINISHED"}


if "counting" not in globals():
    bpy.utils.register_class(WhereIsTheMouse)
    counting = [
        bpy.types.SpaceView3D.draw_handler_add(lambda: _note_drawn(), (), kind, "POST_PIXEL")
        for kind in ("WINDOW", "UI")
    ]
