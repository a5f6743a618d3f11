"""Buttons, expressions and scenes that tests with a window share."""

import os

SIDE = int(os.environ.get("POINTMORPH_WINDOW_SIDE", "90"))
"""Vertices a side of sheets that keep the library busy for a moment.

Tests that also write down how long Blender was held up take this size: 347 makes as many points as
koala_spot_big has.
"""

VIEWPORT = (200, 600)
"""A place in the viewport where nothing lies that takes clicks."""

MORPH = "pointmorph.morph("
KEY = "key_blocks["
BAKE_SOURCE = "bake_shape_keys(kind='SOURCE'"
SHOW_DISTORTION = "show_distortion"

RESULT = 'bpy.data.objects.get("Hill to Dune")'
RUNNING = "session().current is not None"


def finished(result):
    """The expression that is true when the object is there and nothing runs any more."""
    return f"{result} is not None and not ({RUNNING})"


DONE = finished(RESULT)

PIXEL = """
from bpy_extras.view3d_utils import location_3d_to_region_2d
def pixel(name, row):
    obj = bpy.data.objects[name]
    view = area.spaces[0].region_3d
    spot = location_3d_to_region_2d(viewport, view, obj.matrix_world @ obj.data.vertices[row].co)
    return round(viewport.x + spot.x), round(window.height - viewport.y - spot.y)
"""


def add_pair(window, side):
    """Makes a pair of sheets with so many vertices a side, and opens the tab."""
    window.run(f"scenes.pair({side}, {side - 3}, 'auto'); scenes.select(bpy.data.objects['Hill'])")
    window.run("with in_viewport(): bpy.ops.view3d.view_all()")
    window.run("bpy.ops.ed.undo_push(message='A pair of sheets')")
    window.open_tab()
