"""What is as it was before after Esc, after undo, or after a button was pressed once more."""

import pytest
from steps import DONE, MORPH, RESULT, RUNNING, VIEWPORT, add_pair

COPY = "'Hill as Shown' in bpy.data.objects"
SEEN = """
def seen():
    settings, active = bpy.context.scene.pointmorph, bpy.context.view_layer.objects.active
    shown = {o.name: (o.hide_get(), o.hide_render) for o in bpy.context.scene.objects}
    picked = [o and o.name for o in (settings.source, settings.target)]
    meshes = sorted(mesh.name for mesh in bpy.data.meshes if mesh.users)
    selected = sorted(o.name for o in bpy.context.view_layer.objects if o.select_get())
    name = active and active.name
    return [shown, picked, meshes, name, selected, area.spaces[0].shading.type]
"""


def add_mirrored_pair(window, side):
    """The source is morphed as shown: a copy of it."""
    add_pair(window, side)
    window.run(
        f"""
bpy.context.scene.pointmorph.show_as = "MESH"
twice = bpy.data.objects["Hill"].modifiers.new("Twice", "MIRROR")
twice.use_axis = (False, False, True)
bpy.data.objects["Hill"].select_set(True)
bpy.ops.ed.undo_push(message="A modifier")
{SEEN}
"""
    )


def press(window, operator):
    window.run(f"with in_viewport(): bpy.ops.pointmorph.{operator}('INVOKE_DEFAULT')")


@pytest.mark.computes
def test_escape_in_the_middle_takes_copies_back(window):
    add_mirrored_pair(window, 90)
    before = window.ask("seen()")
    assert "Hill" in before[4]
    press(window, "morph")
    window.wait("session().current is not None and session().current.begun")
    assert window.ask(COPY)
    assert window.ask("bpy.data.objects['Hill'].hide_get()")
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask("seen()") == before


def test_undo_after_a_morph_of_a_copy(window):
    add_mirrored_pair(window, 14)
    before = window.ask("seen()")
    window.press_button(MORPH)
    window.wait(DONE)
    after = window.ask("seen()")
    assert window.ask(COPY)
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask("seen()") == before
    window.press("ctrl+shift+z", over=VIEWPORT)
    assert window.ask("seen()") == after
    window.press("ctrl+z", over=VIEWPORT)
    window.press_button(MORPH)
    window.wait(DONE)
    assert window.ask("seen()") == after


@pytest.mark.parametrize("kind", ["MESH", "DISCS"])
@pytest.mark.parametrize("operator", ["show_confidence", "show_distortion", "show_shapes"])
def test_pressed_twice_it_is_as_before(window, operator, kind):
    add_mirrored_pair(window, 14)
    window.run(f"bpy.context.scene.pointmorph.show_as = '{kind}'")
    press(window, "morph")
    window.wait(DONE)
    window.run(f"{RESULT}.data.shape_keys.key_blocks['Morph'].value = 0.4")
    shown = f"addon('scene.presentation').kind_of({RESULT}.pointmorph.made_from or {RESULT})"
    before = window.ask("seen()"), window.ask(shown)
    press(window, operator)
    window.redraw()
    assert (window.ask("seen()"), window.ask(shown)) != before
    press(window, operator)
    window.redraw()
    assert (window.ask("seen()"), window.ask(shown)) == before
    assert window.ask(f"{RESULT}.data.shape_keys.key_blocks['Morph'].value") == pytest.approx(0.4)


def test_points_go_with_a_new_morph_that_is_deleted_at_once(window):
    add_pair(window, 14)
    window.run("bpy.context.scene.pointmorph.show_as = 'MESH'")
    press(window, "morph")
    window.wait(DONE)
    window.run("with in_viewport(): bpy.ops.object.delete('EXEC_DEFAULT', True)")
    window.wait("not [o.name for o in bpy.data.objects if o.name.startswith('Hill to')]")


@pytest.mark.parametrize("both", [True, False])
def test_a_copy_goes_with_its_morph_and_comes_back_with_it(window, both):
    add_mirrored_pair(window, 14)
    press(window, "morph")
    window.wait(DONE)
    before = window.ask("seen()")
    points = f"({RESULT}.pointmorph.made_from, {RESULT})" if both else f"({RESULT},)"
    window.run(
        f"for one in {points}:\n"
        "    one.hide_set(False)\n"
        "    one.select_set(True)\n"
        "with in_viewport(): bpy.ops.object.delete('EXEC_DEFAULT', True)"
    )
    window.wait(f"not ({COPY})")
    assert not window.ask("[o.name for o in bpy.data.objects if o.name.startswith('Hill to')]")
    assert window.ask("bpy.context.scene.pointmorph.source.name") == "Hill"
    window.press_button("show_shapes")
    assert not window.ask("bpy.data.objects['Hill'].hide_get()")
    window.press("ctrl+z", over=VIEWPORT)
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(COPY)
    assert window.ask("seen()")[1] == before[1]


@pytest.mark.parametrize("kind", ["MESH", "DISCS"])
def test_undo_and_redo_bring_nothing_back_that_is_hidden(window, kind):
    """Their steps are from right after the deletion, when it was still there."""
    add_mirrored_pair(window, 14)
    window.run(f"bpy.context.scene.pointmorph.show_as = '{kind}'")
    press(window, "morph")
    window.wait(DONE)
    window.run("with in_viewport(): bpy.ops.object.delete('EXEC_DEFAULT', True)")
    window.wait(f"not ({COPY})")
    window.run("bpy.data.objects['Dune'].location.x += 1\nbpy.ops.ed.undo_push(message='A move')")
    left = f"{COPY}, [o.name for o in bpy.data.objects if o.name.startswith('Hill to')]"
    for _ in range(2):
        window.press("ctrl+z", over=VIEWPORT)
        window.wait(f"not any(({left}))")
        window.press("ctrl+z", over=VIEWPORT)
        window.wait(f"{COPY} and {RESULT} is not None")
        window.redraw()
        assert window.ask(f"{COPY} and {RESULT}.visible_get()")
        window.press("ctrl+shift+z", over=VIEWPORT)
        window.wait(f"not any(({left}))")
        window.press("ctrl+shift+z", over=VIEWPORT)
        assert not any(window.ask(f"[{left}]"))
        assert window.ask("bpy.context.scene.pointmorph.source.name") == "Hill"
