"""What only a window shows of morph objects that are made again: undo, and that Blender goes on."""

import pytest
from steps import DONE, MORPH, RESULT, RUNNING, VIEWPORT, add_pair, finished

SECOND = 'bpy.data.objects.get("Hill to Dune.001")'


def morph(window):
    window.run("scenes.pair(14, 12); scenes.select(bpy.data.objects['Hill'])")
    window.run("bpy.ops.pointmorph.morph('EXEC_DEFAULT')")
    window.run("bpy.ops.ed.undo_push(message='A morph')")


def recompute(window):
    window.run("with in_viewport(): bpy.ops.pointmorph.recompute('INVOKE_DEFAULT')")
    window.wait(f"not ({RUNNING})")


HEIGHT = f"{RESULT}.data.shape_keys.key_blocks['Basis'].data[0].co.z"
STATE = f"{RESULT}.pointmorph.state"


def test_a_recompute_is_one_step_to_undo_and_to_redo(window):
    morph(window)
    before = window.ask(HEIGHT)
    window.run("[setattr(v.co, 'z', v.co.z + 1) for v in bpy.data.objects['Hill'].data.vertices]")
    window.run("bpy.ops.ed.undo_push(message='An edit')")
    assert window.ask(STATE) == "STALE"
    recompute(window)
    after = window.ask(HEIGHT)
    assert abs(after - before - 1) < 1e-6
    assert window.ask(STATE) == "CURRENT"
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(HEIGHT) == before
    assert window.ask(STATE) == "STALE"
    window.press("ctrl+shift+z", over=VIEWPORT)
    assert window.ask(HEIGHT) == after
    assert window.ask(STATE) == "CURRENT"


@pytest.mark.computes
def test_a_recompute_that_is_stopped_leaves_everything(window):
    window.run("area.spaces[0].show_object_viewport_pointcloud = False")
    window.run("scenes.pair(120, 110); scenes.select(bpy.data.objects['Hill'])")
    window.run("bpy.ops.pointmorph.morph('EXEC_DEFAULT')")
    before = window.ask(HEIGHT)
    window.run("[setattr(v.co, 'z', v.co.z + 1) for v in bpy.data.objects['Hill'].data.vertices]")
    window.run("with in_viewport(): bpy.ops.pointmorph.recompute('INVOKE_DEFAULT')")
    assert window.ask(RUNNING)
    assert not window.ask("bpy.ops.pointmorph.recompute.poll()")
    assert not window.ask("bpy.ops.pointmorph.morph_chain.poll()")
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask(HEIGHT) == before
    assert window.ask(STATE) == "STALE"


def test_follow_mesh_and_chain_from_the_viewport(window):
    morph(window)
    window.run(f"scenes.select({RESULT})")
    window.run("with in_viewport(): bpy.ops.pointmorph.follow('INVOKE_DEFAULT')")
    assert window.ask(f"[m.name for m in {RESULT}.modifiers]") == ["Path", "Follow", "Points"]
    window.run("with in_viewport(): bpy.ops.pointmorph.follow('INVOKE_DEFAULT')")
    window.run("with in_viewport(): bpy.ops.pointmorph.make_mesh('INVOKE_DEFAULT')")
    assert window.ask("bpy.context.object.name") == "Hill to Dune Mesh"
    window.run("scenes.add_mesh('Fell', *scenes.patch(13))")
    window.run("scenes.mark(bpy.data.objects['Fell'], 'peak', 0, 0)")
    window.run("scenes.mark(bpy.data.objects['Fell'], 'slope', 0.5, 0.3)")
    window.run("scenes.select(bpy.data.objects['Fell'])")
    window.run("with in_viewport(): bpy.ops.pointmorph.add_to_chain('INVOKE_DEFAULT')")
    window.run("with in_viewport(): bpy.ops.pointmorph.morph_chain('INVOKE_DEFAULT')")
    assert window.ask(RUNNING)
    window.wait(f"not ({RUNNING})")
    assert window.ask("bpy.context.object.name") == "Hill to Fell to Dune"
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask("'Hill to Fell to Dune' not in bpy.data.objects")


def test_a_local_view_shows_what_belongs_to_what_it_shows(window):
    """Of a mesh that was isolated, the points and the originals weren't to be seen."""
    add_pair(window, 14)
    window.run(
        """
scenes.add_mesh("Other", *scenes.patch(5)).location.x = 9
scene = bpy.context.scene
scene.pointmorph.show_as = "MESH"
scenes.select(scenes.morph())
with in_viewport(): bpy.ops.view3d.localview()
seen = lambda: sorted(o.name for o in scene.objects if o.visible_in_viewport_get(area.spaces[0]))
"""
    )
    assert window.ask("seen()") == ["Hill to Dune"]
    for kind, shown in (("POINTS", "Hill to Dune Points"), ("MESH", "Hill to Dune")):
        window.run(f"with in_viewport(): bpy.ops.pointmorph.show_as(kind='{kind}')")
        assert window.ask("seen()") == [shown]
    window.run("with in_viewport(): bpy.ops.pointmorph.show_shapes()")
    assert window.ask("seen()") == ["Dune", "Hill", "Hill to Dune"]
    window.run("with in_viewport(): bpy.ops.view3d.localview()")
    assert window.ask("seen()") == ["Dune", "Hill", "Hill to Dune", "Other"]


def test_two_clicks_animate_two_objects_and_more_change_it(window):
    """Of two selected objects: Morph, Key Morph. Another click on Morph keeps the keys; Alt-click
    makes a second result."""
    add_pair(window, 30)
    window.run(
        """
scene = bpy.context.scene
scene.pointmorph.show_as = "MESH"
scene.pointmorph.source = scene.pointmorph.target = None
bpy.data.objects["Dune"].select_set(True)
bpy.context.view_layer.objects.active = bpy.data.objects["Dune"]
bpy.data.objects["Dune"].location.x = 2.5
with in_viewport(): bpy.ops.view3d.view_all()
bpy.ops.ed.undo_push(message="Two objects")
"""
    )
    window.screenshot("clicks_0_two_objects")
    window.press_button(MORPH)
    window.wait(DONE)
    window.press_button("key_morph")
    curve = (
        f"addon('data.versions').curve_of({RESULT}.data.shape_keys, 'key_blocks[\"Morph\"].value')"
    )
    keys = f"[tuple(point.co) for point in {curve}.keyframe_points]"
    assert window.ask(keys) == [[1, 0], [49, 1]]
    window.run("scene.frame_set(25)")
    window.leave_sidebar()
    window.screenshot("clicks_1_keyed")
    window.run("scene.frame_set(1)")
    window.run("for v in bpy.data.objects['Hill'].data.vertices: v.co.z += 0.3")
    window.run("bpy.ops.ed.undo_push(message='An edit')")
    window.wait(f"{RESULT}.pointmorph.state == 'STALE'")
    window.screenshot("clicks_2_out_of_date")
    place = window.find(MORPH)
    window.click(place)
    window.wait(f"{DONE} and {RESULT}.pointmorph.state == 'CURRENT'")
    assert window.ask(f"{SECOND} is None")
    assert window.ask(keys) == [[1, 0], [49, 1]]
    window.leave_sidebar()
    window.screenshot("clicks_3_again")
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"{RESULT}.pointmorph.state") == "STALE"
    window.click(place, holding="alt")
    window.wait(finished(SECOND))
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"{SECOND} is None")
