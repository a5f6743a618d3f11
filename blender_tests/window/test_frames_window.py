"""Bakes, recomputes and transfers in a window: Blender goes on, Esc stops, the same goes on."""

import json
import subprocess
import time

import numpy as np
import pytest
from steps import RESULT, RUNNING, SIDE, VIEWPORT, add_pair, finished
from test_waiting import STOPWATCH

BAKE = "pointmorph.bake_frames("
FRAMES = 'bpy.data.objects.get("Hill to Dune Frames")'
COUNTS = f"[len(frame['id']) for frame in scenes.baked_frames({FRAMES})]"
WAITING = "len(list(store.glob('*.npz'))) if store.exists() else 0"


def morphed(window, side, tmp_path=None):
    """A morph object that is active and, with a folder, a file that is saved in it."""
    window.run("area.spaces[0].show_object_viewport_pointcloud = False")
    add_pair(window, side)
    window.run("bpy.ops.pointmorph.morph('EXEC_DEFAULT')")
    window.run("bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 24")
    window.run(f"scenes.select({RESULT})")
    if tmp_path is not None:
        path = str(tmp_path / "shot.blend")
        window.run(f"bpy.ops.wm.save_as_mainfile(filepath={path!r})")
        store = str(tmp_path / "blendcache_shot" / "Hill_to_Dune.frames")
        window.run(f"import pathlib; store = pathlib.Path({store!r})")
    window.run("bpy.context.scene.pointmorph.bake_as = 'FRAMES'")
    window.run("bpy.ops.ed.undo_push(message='A morph')")


def test_a_bake_that_esc_stopped_goes_on(changed_window, tmp_path):
    window = changed_window
    window.run("area.spaces[0].show_object_viewport_mesh = False")
    morphed(window, 70, tmp_path)
    window.run("bpy.context.scene.frame_end = 240")
    window.run("bpy.context.scene.pointmorph.path = 'rigid'")  # takes its time
    window.run("before = scenes.data_blocks()")
    window.press_button(BAKE)
    window.wait(f"({WAITING}) >= 1")
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask("sorted(scenes.data_blocks() ^ before)") == []
    kept = window.ask(WAITING)
    assert 0 < kept < 240
    window.run("times = {p.name: p.stat().st_mtime_ns for p in store.glob('*.npz')}")
    window.press_button(BAKE)
    window.wait(f"({WAITING}) > {kept}")
    assert window.ask("all((store / n).stat().st_mtime_ns == t for n, t in times.items())")
    window.screenshot("bake_running")
    window.wait(finished(FRAMES))
    assert len(window.ask(COUNTS)) == 240
    assert not window.ask("store.exists()")
    window.screenshot("bake_done")
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"{FRAMES} is None")
    assert window.ask(f"not {RESULT}.hide_render")


MOVE = """
for obj in (bpy.data.objects["Hill"], bpy.data.objects["Dune"]):
    for frame, x in ((1, 0.0), (24, 2.0)):
        obj.location.x = x
        obj.keyframe_insert("location", frame=frame)
bpy.context.scene.frame_set(5)
"""


def test_moving_shapes_are_read_between_redraws(window):
    """The scene is in its own frame again, whether the bake was stopped or not."""
    morphed(window, 60)
    window.run(MOVE)
    window.run("with in_viewport(): bpy.ops.pointmorph.follow('INVOKE_DEFAULT')")
    window.run("bpy.context.scene.frame_end = 2000")
    window.run("bpy.ops.ed.undo_push(message='Follow')")
    window.press_button(BAKE)
    window.wait(f"{RUNNING} and not session().current.begun")
    window.wait("bpy.context.scene.frame_current > 20")
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask("bpy.context.scene.frame_current") == 5
    assert window.ask(f"{FRAMES} is None")
    window.run("bpy.context.scene.frame_end = 12")
    window.press_button(BAKE)
    window.wait(finished(FRAMES))
    assert window.ask("bpy.context.scene.frame_current") == 5
    assert len(window.ask(COUNTS)) == 12


TRANSFER = "with in_viewport(): bpy.ops.pointmorph.transfer_attributes('INVOKE_DEFAULT')"


def test_a_transfer_is_one_step_to_undo(window):
    morphed(window, 60)
    window.run(
        """
dune = bpy.data.objects["Dune"]
scenes.add_attribute(
    dune.data, "Col", "FLOAT_COLOR", [[1.0, 0.0, 0.0, 1.0]] * len(dune.data.vertices)
)
scenes.add_group(dune, "bone", {0: 0.5, 1: 1.0})
dune.modifiers.new("Cast", "CAST")
bpy.ops.ed.undo_push(message="Colours")
meshes = len(bpy.data.meshes)
"""
    )
    window.run(TRANSFER)
    window.wait(f"not ({RUNNING})")
    assert window.ask(f"'target.Col' in {RESULT}.data.attributes")
    assert window.ask(f"[g.name for g in {RESULT}.vertex_groups]") == ["target.bone"]
    assert window.ask("len(bpy.data.meshes) == meshes")
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"'target.Col' not in {RESULT}.data.attributes")
    window.run(TRANSFER)
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask("len(bpy.data.meshes) == meshes")


SHOWN = "bpy.context.view_layer.objects.active"
KEYS = f"list({SHOWN}.data.shape_keys.key_blocks.keys())"


def test_a_smile_is_one_step_to_undo_and_said_in_words(window):
    morphed(window, 40)
    window.run("bpy.ops.pointmorph.show_as(kind='MESH')")
    window.run(
        """
dune = bpy.data.objects["Dune"]
dune.shape_key_add(name="Basis")
smile = dune.shape_key_add(name="Smile")
for point in smile.data:
    point.co.z += 0.3
smile.value = 0.0
dune.data.uv_layers.new(name="Skin")
scenes.add_group(dune, "jaw", {0: 0.5, 1: 1.0})
bpy.context.scene.pointmorph.transfer_uvs = True
bpy.ops.ed.undo_push(message="A smile")
"""
    )
    window.open_panel("POINTMORPH_PT_more")
    window.press("Escape", over=VIEWPORT)  # what a click in search of it may have begun
    window.press_button("transfer_attributes(")
    window.wait(f"not ({RUNNING})")
    window.screenshot("transfer_done")
    made = ["target.Smile", "target.Smile at the end"]
    assert [name for name in window.ask(KEYS) if name.startswith("target")] == made
    assert window.ask(f"'target.Skin' in {SHOWN}.data.uv_layers")
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(KEYS) == ["Basis", "Morph"]
    assert window.ask(f"'target.Skin' not in {SHOWN}.data.uv_layers")


def test_shapes_are_read_in_turns(window, output):
    """Blender goes on between them."""
    window.run("area.spaces[0].show_object_viewport_mesh = False")
    morphed(window, SIDE)
    window.run("scenes.add_group(bpy.data.objects['Dune'], 'bone', {0: 0.5, 1: 1.0})")
    window.run(
        "values = [[1.0, 0.0, 0.0, 1.0]] * len(bpy.data.objects['Dune'].data.vertices)\n"
        "scenes.add_attribute(bpy.data.objects['Dune'].data, 'Col', 'FLOAT_COLOR', values)"
    )
    figures = {}
    calls = {
        "bake": "bake_frames('INVOKE_DEFAULT', frame_start=1, frame_end=3, resample=False)",
        "transfer": "transfer_attributes('INVOKE_DEFAULT')",
        "recompute": "recompute('INVOKE_DEFAULT')",
    }
    for name, call in calls.items():
        window.run(f"scenes.select({RESULT})")
        window.run(STOPWATCH)
        if name == "recompute":  # its reading alone
            window.run("with in_viewport(): bpy.ops.pointmorph." + call + "\n")
            window.wait("session().current is None or session().current.begun")
            window.press("Escape", over=VIEWPORT)
        else:
            window.run("with in_viewport(): bpy.ops.pointmorph." + call)
        window.wait(f"not ({RUNNING})")
        figures[name] = window.run(
            "while undo: undo.pop()()\n"
            "turns = ours.get('reading the scene, a turn', [])\n"
            "answer = {'turns of reading': len(turns), 'longest, ms': round(1000 * max(turns))}"
        )
    (output / "reading.json").write_text(json.dumps(figures, indent=2))
    print(json.dumps(figures, indent=2))
    assert all(figure["turns of reading"] for figure in figures.values())


SHADING = """
shading = area.spaces[0].shading
shading.type, shading.color_type = {!r}, "VERTEX"
modifier = {}.modifiers["Points"]
for name in ("Spheres", "Discs"):
    addon("data.versions").set_input(modifier, name, name == {!r})
modifier.id_data.update_tag()
"""


@pytest.mark.parametrize(("shading", "alpha"), [("SOLID", 0.3), ("MATERIAL", 1.0)])
def test_colours_in_the_viewport(window, shading, alpha):
    """Red and green points, in solid shading, which shows no alpha, and in the material preview."""
    window.run(
        f"""
for obj in scenes.pair(30, 28):
    p = scenes.coordinates(obj.data.vertices)
    colors = [[1, 0, 0, 1] if x < 0 else [0, 1, 0, {alpha}] for x in p[:, 0]]
    scenes.add_attribute(obj.data, "Paint", "FLOAT_COLOR", colors)
    obj.data.color_attributes.active_color = obj.data.color_attributes["Paint"]
bpy.ops.pointmorph.morph('EXEC_DEFAULT')
for name in ("Hill", "Dune"):
    bpy.data.objects[name].hide_set(True)
"""
    )
    window.run("with in_viewport(): bpy.ops.view3d.view_all()")
    for kind in ("Spheres", "Discs"):
        window.run(SHADING.format(shading, RESULT, kind))
        window.leave_sidebar()
        name, patience = f"colours_{shading.lower()}_{kind.lower()}", 120.0
        end = time.monotonic() + (patience if shading == "MATERIAL" else 0.0)
        while min(colored(window.screenshot(name))) <= 2000:  # it compiles shaders
            assert time.monotonic() < end, kind
    window.run("area.spaces[0].shading.type = 'SOLID'")


def colored(path):
    """How many pixels of the viewport are red, and green."""
    program = ("convert", str(path), "-crop", "400x680+10+90", "-depth", "8", "rgb:-")
    pixels = subprocess.run(program, capture_output=True, check=True).stdout
    values = np.frombuffer(pixels, np.uint8).reshape(-1, 3).astype(int)
    red, green, _ = values.T
    return int((red > green + 50).sum()), int((green > red + 50).sum())
