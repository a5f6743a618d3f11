"""Colors of procedural textures: another Blender bakes them, and this one goes on."""

import pytest
from steps import MORPH, RUNNING, VIEWPORT, add_pair, finished

CHECKS = """
import painted_scenes
for name, kind in (("Hill", "ShaderNodeTexNoise"), ("Dune", "ShaderNodeTexChecker")):
    made = painted_scenes.material(name)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    links.new(nodes.new(kind).outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    bpy.data.objects[name].data.materials.append(made)
bpy.context.scene.pointmorph.show_as = "MESH"
addon("scene.baked_colors")._known.clear()
before = scenes.data_blocks()

def children():
    import os, pathlib
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            if f"PPid:\\t{os.getpid()}\\n" in (folder / "status").read_text():
                yield (folder / "cmdline").read_text()
        except OSError:  # it has ended
            pass
"""
OTHER = "asked.blend"
RESULT = 'bpy.data.objects.get("Hill to Dune")'
BAKING = "session().current is not None and session().current.waits_for == 'Baking colors'"


@pytest.fixture
def checked(window):
    add_pair(window, 24)
    window.run(CHECKS)
    window.press_button(MORPH)
    window.wait(BAKING)
    return window


def test_blender_goes_on_while_colors_are_baked(checked):
    assert checked.ask("scenes.data_blocks() == before")  # nothing of it is to be seen
    checked.picture("baking_colors")
    checked.wait(finished(RESULT))
    assert checked.ask("session().problem is None")
    assert checked.ask("'Hill to Dune Color' in bpy.data.images")
    checked.screenshot("baked_colors")


def test_escape_stops_the_other_blender(checked):
    assert checked.ask(f"any({OTHER!r} in words for words in children())")
    checked.press("Escape", over=VIEWPORT)
    checked.wait(f"not ({RUNNING})")
    assert checked.ask(f"{RESULT} is None and scenes.data_blocks() == before")
    checked.wait(f"not any({OTHER!r} in words for words in children())")
