"""Two windows that show two scenes, and whatever is done in either of them, in any order.

After each step, the sidebars of both must have drawn what holds now, by themselves: their own
scene, whether something is computed, and no problem.
"""

import random

import pytest
from steps import RUNNING, SIDE, VIEWPORT

STEPS = 60

SETUP = """
def view_of(shown):
    area = next(area for area in shown.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    return {"window": shown, "area": area, "region": region}

def inside(number):
    windows = bpy.context.window_manager.windows
    return bpy.context.temp_override(**view_of(windows[min(number, len(windows) - 1)]))

def open_second():
    with inside(0):
        bpy.ops.wm.window_new_main()
    windows = bpy.context.window_manager.windows
    # Undo may have gone back to before it was made.
    windows[1].scene = bpy.data.scenes.get("Second") or bpy.data.scenes.new("Second")
    last_drawn.pop(windows[1].as_pointer(), None)  # of one that was closed
    area = view_of(windows[1])["area"]
    area.spaces[0].show_region_ui = True
    area.spaces[0].shading.type = "SOLID"

def show_tabs():
    # A region has tabs once it was drawn.
    for shown in bpy.context.window_manager.windows:
        area = view_of(shown)["area"]
        region = next(region for region in area.regions if region.type == "UI")
        if region.active_panel_category != "Pointmorph":
            try:
                region.active_panel_category = "Pointmorph"
            except TypeError:
                pass
            region.tag_redraw()

def state(scene):
    return scene.name, session().current is not None, session().problem

def are_up_to_date():
    show_tabs()
    windows = bpy.context.window_manager.windows
    return all(last_drawn.get(shown.as_pointer()) == state(shown.scene) for shown in windows)

def note_drawn(self, context):
    last_drawn[context.window.as_pointer()] = state(context.scene)

def note_problem():
    if session().problem is not None:
        problems.append(session().problem)

if "last_drawn" not in globals():
    bpy.types.POINTMORPH_PT_morph.append(note_drawn)
last_drawn, problems = {}, []

def add_shapes(side):
    scenes.pair(side, side - 3, "auto")

def results():
    return [obj for obj in bpy.context.scene.objects if " to " in obj.name]

open_second()
for number in (0, 1):
    with inside(number):
        add_shapes(14)
        bpy.ops.ed.undo_push(message="Two sheets")
"""

MORPH = """
with inside({number}):
    shapes = [o for o in bpy.context.scene.objects if o.type == "MESH" and " to " not in o.name]
    if len(shapes) > 1 and not ({running}):
        scenes.pick(*shapes[:2])
        if bpy.ops.pointmorph.morph.poll():
            bpy.ops.pointmorph.morph("INVOKE_DEFAULT")
"""
SLIDE = """
with inside({number}):
    for obj in results():
        if obj.data.shape_keys:
            obj.data.shape_keys.key_blocks[1].value = {share}
"""
HISTORY = """
with inside({number}):
    if bpy.ops.ed.{way}.poll():
        bpy.ops.ed.{way}()
"""
ADD = """
with inside({number}):
    add_shapes({side})
    bpy.ops.ed.undo_push(message="Two more sheets")
"""
DELETE = """
with inside({number}):
    for obj in list(bpy.context.scene.objects)[:1]:
        bpy.data.objects.remove(obj)
    bpy.ops.ed.undo_push(message="Deleted")
"""
SWAP = """
windows = bpy.context.window_manager.windows
if len(windows) > 1:
    windows[0].scene, windows[1].scene = windows[1].scene, windows[0].scene
"""
OPTION = """
with inside({number}):
    bpy.context.scene.pointmorph.path = "{path}"
"""
CLOSE_OR_OPEN = """
if len(bpy.context.window_manager.windows) > 1:
    with inside(1):
        bpy.ops.wm.window_close()
else:
    open_second()
"""
# Blender's own operator would ask whether to save.
SAVED = """
import os, tempfile
import numpy as np

def things():
    # All that the scenes hold, as numbers.
    return {scene.name: [contents(obj) for obj in scene.objects] for scene in bpy.data.scenes}

def contents(obj):
    if obj.type != "MESH":
        return obj.name
    keys = obj.data.shape_keys.key_blocks if obj.data.shape_keys else []
    return obj.name, numbers(obj.data.vertices), [(key.value, numbers(key.data)) for key in keys]

def numbers(points):
    places = np.empty(3 * len(points), np.float32)
    points.foreach_get("co", places)
    return places.tobytes()

path = os.path.join(tempfile.mkdtemp(), "two.blend")
before, shown_before = things(), len(bpy.context.window_manager.windows)
bpy.ops.wm.save_as_mainfile(filepath=path)
for scene in bpy.data.scenes:
    scene["not saved"] = 1
with inside(0):
    bpy.ops.wm.open_mainfile(filepath=path)
"""
RELOADED = """
answer = (
    bpy.data.filepath == path
    and not any("not saved" in scene for scene in bpy.data.scenes)
    and len(bpy.context.window_manager.windows) == shown_before
)
"""


def step(dice, window):
    """What is done next, in words, and the code that does it: None where that is a key, empty where
    it is to wait for the end of what runs."""
    number = dice.randrange(2)
    steps = {
        "morph": (MORPH, {"running": RUNNING}),
        "slide": (SLIDE, {"share": dice.random()}),
        "undo": (HISTORY, {"way": "undo"}),
        "redo": (HISTORY, {"way": "redo"}),
        "add": (ADD, {"side": dice.randrange(8, 40)}),
        "delete": (DELETE, {}),
        "swap scenes": (SWAP, {}),
        "option": (OPTION, {"path": dice.choice(["auto", "linear", "rigid"])}),
        "close or open": (CLOSE_OR_OPEN, {}),
        "cancel": (None, {}),
        "wait": ("", {}),
    }
    often = ["morph", "morph", "wait", "close or open", *steps]
    name = dice.choice(often)
    code, values = steps[name]
    return f"{name} in {number}", code and code.format(number=number, **values)


MADE = """
answer = sum(" to " in obj.name for scene in bpy.data.scenes for obj in scene.objects)
"""
LONG = """
if len(bpy.context.window_manager.windows) < 2:
    open_second()
bpy.context.window_manager.windows[0].scene = bpy.data.scenes["Scene"]
bpy.context.window_manager.windows[1].scene = bpy.data.scenes["Second"]
with inside(1):
    add_shapes({side})
    bpy.ops.ed.undo_push(message="Two large sheets")
    before = scenes.data_blocks()
    bpy.ops.pointmorph.morph("INVOKE_DEFAULT")
"""
CLOSE_SECOND = """
with inside(1):
    bpy.ops.wm.window_close()
"""


def check(window, done):
    """That all is as it should be after what was done."""
    window.settle()
    window.wait("are_up_to_date()")
    window.run("note_problem()")
    assert window.ask("problems") == [], done
    assert "Traceback" not in window.log, f"{done}\n{window.log}"


def wait_for_end(window):
    window.wait(f"not ({RUNNING})")


@pytest.mark.computes
@pytest.mark.parametrize("seed", [1, 2])
def test_a_walk_over_two_windows(changed_window, seed):
    window = changed_window
    dice = random.Random(seed)
    window.run(SETUP)
    check(window, ["set up"])
    done, made = [], 0
    for _ in range(STEPS):
        words, code = step(dice, window)
        done.append(words)
        if code is None:
            window.press("Escape", over=VIEWPORT)
        elif code:
            window.run(f"note_problem()\n{code}\nnote_problem()")
        if not code or code == CLOSE_OR_OPEN:
            wait_for_end(window)
        check(window, done)
        made = max(made, window.run(MADE))
    wait_for_end(window)
    assert made > 0
    window.run(SAVED)
    assert window.run(RELOADED)
    assert window.ask("things() == before")
    check(window, done)


@pytest.mark.computes
def test_the_window_is_closed_in_which_a_morph_was_begun(changed_window):
    window = changed_window
    window.run(SETUP)
    window.run(LONG.format(side=SIDE))
    window.wait(RUNNING)
    check(window, ["begun"])
    window.run(CLOSE_SECOND)
    wait_for_end(window)
    assert window.ask("scenes.data_blocks() == before")  # it was canceled
    check(window, ["closed"])
    # The other window goes on as if nothing had been, and so does a new one.
    window.run(MORPH.format(number=0, running=RUNNING))
    wait_for_end(window)
    check(window, ["morphed"])
    made = window.run(MADE)
    assert made > 0
    window.run("open_second()")
    check(window, ["opened again"])
    assert window.ask("len(bpy.context.window_manager.windows)") == 2
    window.run(MORPH.format(number=1, running=RUNNING))
    wait_for_end(window)
    check(window, ["morphed in the new window"])
    assert window.run(MADE) > made
