"""Two windows that show two scenes, and whatever is done in either of them, in any order."""

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
    area = view_of(windows[1])["area"]
    area.spaces[0].show_region_ui = True
    area.spaces[0].shading.type = "SOLID"

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
path = os.path.join(tempfile.mkdtemp(), "two.blend")
def things():
    return [
        (scene.name, sorted(obj.name for obj in scene.objects)) for scene in bpy.data.scenes
    ]
before = things()
bpy.ops.wm.save_as_mainfile(filepath=path)
with inside(0):
    bpy.ops.wm.open_mainfile(filepath=path)
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


@pytest.mark.computes
@pytest.mark.parametrize("seed", [1, 2])
def test_a_walk_over_two_windows(changed_window, seed):
    window = changed_window
    dice = random.Random(seed)
    window.run(SETUP)
    done, made = [], 0
    for _ in range(STEPS):
        words, code = step(dice, window)
        done.append(words)
        if code is None:
            window.press("Escape", over=VIEWPORT)
        elif code:
            window.run(code)
        else:
            window.wait(f"not ({RUNNING})")
        window.settle()
        made = max(made, window.run(MADE))
        assert "Traceback" not in window.log, f"{done}\n{window.log}"
    window.wait(f"not ({RUNNING})")
    assert made > 0
    window.run(SAVED)
    window.wait("things() == before")
    assert "Traceback" not in window.log, f"{done}\n{window.log}"


@pytest.mark.computes
def test_the_window_is_closed_in_which_a_morph_was_begun(changed_window):
    window = changed_window
    window.run(SETUP)
    window.run(LONG.format(side=SIDE))
    window.wait(RUNNING)
    window.run(CLOSE_SECOND)
    window.wait(f"not ({RUNNING})")
    assert window.ask("scenes.data_blocks() == before")  # it was canceled
    assert "Traceback" not in window.log, window.log
    # The other window goes on as if nothing had been.
    window.run(MORPH.format(number=0, running=RUNNING))
    window.wait(f"not ({RUNNING})")
    assert window.run(MADE) > 0
