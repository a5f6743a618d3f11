"""Errors that no one thought of, and scenes and workspaces that change while it computes."""

import subprocess

import numpy as np
import pytest
from steps import DONE, MORPH, RESULT, RUNNING, VIEWPORT, add_pair
from test_frames_window import BAKE, morphed
from test_window import start_long

BROKEN = """
import importlib
module = importlib.import_module(session().__package__.removesuffix(".core") + ".{module}")
kept = module.{name}
def broken(*args, **kwargs):
    raise ValueError("no one thought of this")
module.{name} = broken
"""


@pytest.mark.parametrize(
    ("module", "name"), [("data.chains", "compute_all"), ("scene.morph_builder", "build")]
)
def test_an_unexpected_error_leaves_blender_as_it_was(window, module, name):
    add_pair(window, 30)
    window.run("before = scenes.data_blocks()")
    window.run(BROKEN.format(module=module, name=name))
    window.press_button(MORPH)
    window.wait(f"session().problem is not None and not ({RUNNING})")
    window.run(f"module.{name} = kept")
    assert "no one thought of this" in window.ask("session().problem[1]")
    window.screenshot(f"unexpected_{name}")
    assert window.ask("scenes.data_blocks() == before")
    # Blender's own report lies over the button until the mouse has been elsewhere.
    window.leave_sidebar()
    window.press("Escape", over=VIEWPORT)
    window.press_button(MORPH)
    window.wait(DONE)


@pytest.mark.computes
def test_the_scene_and_the_workspace_change_while_it_computes(changed_window):
    window = changed_window
    start_long(window)
    window.run("began = bpy.context.scene.name")
    window.run("bpy.context.window.scene = bpy.data.scenes.new('Another')")
    window.run("bpy.context.window.workspace = bpy.data.workspaces['Modeling']")
    window.wait(f"not ({RUNNING})")
    assert window.ask(f"[s.name for s in {RESULT}.users_scene] == [began]")
    # Blender doesn't tell what the status bar shows.
    window.run("bpy.context.window.workspace = bpy.data.workspaces['Layout']")
    window.run("bpy.context.window.scene = bpy.data.scenes[began]")
    window.screenshot("status_after")


BROKEN_LATER = """
import threading
ended = threading.Event()
module = addon("{module}")
kept = module.{name}
def broken(*args, **kwargs):
    ended.wait()
    raise ValueError("no one thought of this")
module.{name} = broken
"""


def shade(window, place, name):
    """The gray values of a button around the mouse, which stays where it is."""
    x, y = place
    program = ("convert", str(window.screenshot(name)), "-crop", f"40x12+{x - 20}+{y - 6}")
    pixels = subprocess.run([*program, "-depth", "8", "gray:-"], capture_output=True, check=True)
    return np.frombuffer(pixels.stdout, np.uint8).reshape(12, 40).astype(int)


@pytest.mark.parametrize(
    ("button", "module", "name"),
    [(MORPH, "data.chains", "compute_all"), (BAKE, "core.frame_cache", "write")],
)
def test_a_button_is_as_before_after_an_error(window, button, module, name):
    """Blender keeps a button that is grayed as it is while the mouse is over it, so none is."""
    if button == MORPH:
        add_pair(window, 30)
    else:
        morphed(window, 24)
    place = window.find(button)
    before = shade(window, place, f"button_before_{name}")
    window.run(BROKEN_LATER.format(module=module, name=name))
    window.click(place)
    window.wait(RUNNING)
    window.redraw()
    assert button not in window.under(place)
    window.run("ended.set()")
    window.wait(f"session().problem is not None and not ({RUNNING})")
    window.run(f"module.{name} = kept")
    window.press("Escape", over=place)  # Blender's own report lies over the button
    window.rest()
    if button not in window.under(place):  # the message has moved it away
        place = window.find(button)
    after = shade(window, place, f"button_after_{name}")
    assert np.abs(after - before).mean() < 4.0
    assert np.ptp(before) > 20  # letters
