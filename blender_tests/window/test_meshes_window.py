"""Blender's own shapes, morphed as anybody would try first."""

import pytest
from steps import MORPH, RUNNING, VIEWPORT, finished

SHAPES = {
    ("cube", "ico_sphere"): ("Cube", "Icosphere"),
    ("cylinder", "uv_sphere"): ("Cylinder", "Sphere"),
    ("cone", "monkey"): ("Cone", "Suzanne"),
}


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
    window.press_button("make_mesh")
    assert window.ask(f"{result}.hide_get()")
    mesh = f'bpy.data.objects.get("{source} to {target} Mesh")'
    window.wait(f"{mesh} is not None")
    assert window.ask("session().problem is None")
    assert window.ask(far(mesh, target)) < 0.02
    window.run(f"{mesh}.data.shape_keys.key_blocks['Morph'].value = 1")
    window.settle()
    window.screenshot(f"{source}_mesh")

    # It has too few vertices: the panel says so, and offers more.
    before = window.ask(f"len(bpy.data.objects['{source}'].data.vertices)")
    window.press_button("subdivide_source")
    more = f"len(bpy.data.objects['{source}'].data.vertices)"
    assert window.ask(more) > 2 * before
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(more) == before
    window.press("ctrl+shift+z", over=VIEWPORT)
    assert window.ask(more) > 2 * before
    window.press_button("pointmorph.recompute(")
    window.wait(f"not ({RUNNING}) and {result}.pointmorph.state == 'CURRENT'")
    assert window.ask(f"len({mesh}.data.vertices) == {more}")
    assert window.ask(f"{result}.pointmorph.too_fine") == ""
    window.settle()
    window.screenshot(f"{source}_finer")
