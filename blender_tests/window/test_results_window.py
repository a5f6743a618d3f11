"""What only a window shows of morph objects that are made again: undo, and that Blender goes on."""

VIEWPORT = (400, 600)
RESULT = 'bpy.data.objects.get("Hill to Dune")'
RUNNING = "session().current is not None"


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
    assert window.ask(f"[m.name for m in {RESULT}.modifiers]") == ["Follow", "Points"]
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
