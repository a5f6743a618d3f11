"""Blender's own shapes, morphed as anybody would try first."""

import pytest
from steps import KEY, MORPH, RUNNING, VIEWPORT, finished

# The others are tried without a window.
SHAPES = {("cube", "ico_sphere"): ("Cube", "Icosphere")}


def add(window, kinds):
    source, target = kinds
    window.run(
        f"""
bpy.ops.mesh.primitive_{target}_add(location=(3, 0, 0))
bpy.ops.mesh.primitive_{source}_add()
scenes.pick(bpy.context.object, bpy.data.objects["{SHAPES[kinds][1]}"])
with in_viewport(): bpy.ops.view3d.view_all()
bpy.ops.ed.undo_push(message="Two shapes")
"""
    )
    window.open_tab()


def far(mesh, name):
    """The expression for how far the vertices of a mesh's key lie from an object's surface."""
    return (
        f"max((bpy.data.objects['{name}'].closest_point_on_mesh("
        f"bpy.data.objects['{name}'].matrix_world.inverted() @ ({mesh}.matrix_world @ point.co))[1]"
        f" - bpy.data.objects['{name}'].matrix_world.inverted() @ ({mesh}.matrix_world @ point.co))"
        f".length for point in {mesh}.data.shape_keys.key_blocks['Morph'].data)"
    )


@pytest.mark.parametrize("kinds", SHAPES)
def test_two_clicks_make_a_mesh_that_becomes_the_target(window, kinds):
    source, target = SHAPES[kinds]
    add(window, kinds)
    result = f'bpy.data.objects.get("{source} to {target}")'
    window.press_button(MORPH)
    window.wait(finished(result))
    window.screenshot(f"{source}_points")
    window.open_panel("POINTMORPH_PT_more")
    window.press_button("make_mesh")
    assert window.ask(f"{result}.hide_get()")
    mesh = f'bpy.data.objects.get("{source} to {target} Mesh")'
    window.wait(f"{mesh} is not None")
    assert window.ask("session().problem is None")
    assert window.ask(far(mesh, target)) < 0.02
    window.run(f"{mesh}.data.shape_keys.key_blocks['Morph'].value = 1")
    window.settle()
    window.screenshot(f"{source}_mesh")

    # It has too few vertices: the panel says so, and one click gives it more and computes it again.
    before = window.ask(f"len(bpy.data.objects['{source}'].data.vertices)")
    more = f"len(bpy.data.objects['{source}'].data.vertices)"
    window.press_button("subdivide_source")
    window.wait(f"not ({RUNNING}) and {result}.pointmorph.state == 'CURRENT'")
    after = window.ask(more)
    assert after > 2 * before
    assert window.ask(f"len({mesh}.data.vertices) == {more}")
    assert window.ask(f"{result}.pointmorph.too_fine") == ""
    window.settle()
    window.screenshot(f"{source}_finer")

    # Two steps to undo: the morph, then the vertices.
    seen = f"({more}, len({mesh}.data.vertices), {result}.pointmorph.too_fine)"
    for key, expected in (
        ("ctrl+z", [after, before, target]),
        ("ctrl+z", [before, before, target]),
        ("ctrl+shift+z", [after, before, target]),
        ("ctrl+shift+z", [after, after, ""]),
    ):
        window.press(key, over=VIEWPORT)
        assert window.ask(seen) == expected


@pytest.mark.computes
def test_escape_leaves_what_is_done(window):
    add(window, ("cube", "ico_sphere"))
    result = 'bpy.data.objects.get("Cube to Icosphere")'
    window.press_button(MORPH)
    window.wait(finished(result))
    count = "len(bpy.data.objects['Cube'].data.vertices)"
    begin = "with in_viewport(): bpy.ops.pointmorph.subdivide_source('INVOKE_DEFAULT')"
    window.run(begin)
    assert window.ask(RUNNING)
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask(count) == 8
    assert window.ask(f"{result}.pointmorph.state") == "CURRENT"
    # The source is subdivided, and the morph is being recomputed.
    window.run(begin)
    window.wait(f"{count} > 8")
    assert window.ask(RUNNING)
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask(count) > 90
    assert window.ask(f"{result}.pointmorph.too_fine") == "Icosphere"
    window.wait(f"{result}.pointmorph.state == 'STALE'")
    assert window.ask("session().problem is None")


def test_one_click_shows_the_mesh_and_another_its_points(window):
    add(window, ("cube", "ico_sphere"))
    window.run("bpy.context.scene.pointmorph.show_as = 'MESH'")
    result = 'bpy.data.objects.get("Cube to Icosphere")'
    window.press_button(MORPH)
    window.wait(finished(result))
    assert window.ask(f"len({result}.data.polygons)") == 6
    assert window.ask(f"bpy.context.view_layer.objects.active == {result}")
    for name in ("Cube", "Icosphere", "Cube to Icosphere Points"):
        assert window.ask(f"bpy.data.objects['{name}'].hide_get()"), name
    x, y = window.find(KEY)
    window.drag((x - 60, y), (x + 40, y))
    slider = "data.shape_keys.key_blocks['Morph'].value"
    value = window.ask(f"{result}.{slider}")
    assert 0.3 < value <= 1
    window.settle()
    window.screenshot("mesh_first")
    # Beside the first of three buttons in a row.
    left, y = window.find("show_as(kind='MESH'")
    window.click((left + 75, y))
    points = "bpy.data.objects['Cube to Icosphere Points']"
    assert not window.ask(f"{points}.hide_get()")
    assert window.ask(f"{result}.hide_get()")
    assert window.ask(f"{points}.{slider}") == pytest.approx(value)
    window.screenshot("points_next")
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"{points}.hide_get()")
    window.press_button("show_shapes")
    assert not window.ask("bpy.data.objects['Cube'].hide_get()")


def test_what_staggers_is_chosen_in_the_panel(window):
    told = len(window.log)  # also of other tests' errors
    add(window, ("cube", "ico_sphere"))
    window.run("bpy.context.scene.pointmorph.show_as = 'MESH'")
    window.press_button(MORPH)
    window.wait(finished('bpy.data.objects.get("Cube to Icosphere")'))
    window.open_panel("POINTMORPH_PT_stagger")
    module = "next(m for n, m in sys.modules.items() if n.endswith('.scene.stagger'))"
    window.run(f"import sys; stagger = {module}")
    for kind in ("Height", "Noise", "Object", "Vertex Group"):
        window.run(f"stagger.choose(bpy.data.objects['Cube to Icosphere'], '{kind}')")
        window.settle()
        assert "Error" not in window.log[told:]
        window.screenshot(f"stagger_{kind.split()[0].lower()}")
    window.close_panel("POINTMORPH_PT_stagger")
