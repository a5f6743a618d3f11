"""Errors that no one thought of, and scenes and workspaces that change while it computes."""

import pytest
from steps import DONE, MORPH, RESULT, RUNNING, VIEWPORT, add_pair
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
