"""A person's way through the add-on, by mouse and keyboard. Look at the pictures, too."""

import time

import pytest
from steps import (
    BAKE_SOURCE,
    DONE,
    KEY,
    MORPH,
    PIXEL,
    RESULT,
    RUNNING,
    SHOW_DISTORTION,
    SIDE,
    VIEWPORT,
    add_pair,
)


def start_long(window):
    """Starts, with the button, a morph that takes a moment."""
    # Balls would keep a renderer without a graphics card busy for longer than the morph.
    window.run("area.spaces[0].show_object_viewport_mesh = False")
    window.run("area.spaces[0].show_object_viewport_pointcloud = False")
    add_pair(window, SIDE)
    window.run("before = scenes.data_blocks()")
    window.press_button(MORPH)
    window.wait(RUNNING)


def test_morph_drag_bake_undo(window):
    add_pair(window, 40)
    window.screenshot("panel_before")
    window.run("before = scenes.data_blocks()")

    window.press_button(MORPH)
    window.wait(DONE)
    window.screenshot("panel_after")
    assert window.ask(f"bpy.context.view_layer.objects.active == {RESULT}")
    value = f'{RESULT}.data.shape_keys.key_blocks["Morph"].value'
    assert window.ask(value) == 0

    x, y = window.find(KEY)
    window.drag((x - 60, y), (x + 40, y))
    assert 0.3 < window.ask(value) <= 1
    window.screenshot("dragged")
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(value) == 0

    window.press_button(BAKE_SOURCE)
    keys = "bpy.data.objects['Hill'].data.shape_keys"
    assert window.ask(f"[key.name for key in {keys}.key_blocks]") == ["Basis", "Dune"]
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"{keys} is None")

    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(f"{RESULT} is None")
    assert window.ask("scenes.data_blocks() == before")
    window.press("ctrl+shift+z", over=VIEWPORT)
    assert window.ask(f"{RESULT} is not None")
    assert window.ask(value) == 0


def test_a_new_mark_starts_from_the_last_map(window):
    add_pair(window, 40)
    stages = "list(json.loads(bpy.data.objects['{}'].pointmorph.report)['stages'])"
    window.run("import json")
    window.press_button(MORPH)
    window.wait(DONE)
    assert "pose" in window.ask(stages.format("Hill to Dune"))  # two marks leave it open
    window.run("[scenes.mark(bpy.data.objects[n], 'foot', -0.6, -0.5) for n in ('Hill', 'Dune')]")
    window.press_button(MORPH)
    window.wait(f"'pose' not in {stages.format('Hill to Dune')} and not ({RUNNING})")
    assert window.ask("'Hill to Dune.001' not in bpy.data.objects")


SHADINGS = """
shadings = []
quality = addon("operators.quality").POINTMORPH_OT_show_distortion
undo = [lambda shade=quality._shade: setattr(quality, "_shade", staticmethod(shade))]
quality._shade = staticmethod(
    lambda context, _, show: shadings.append((context.space_data.type, show))
)
"""


def test_distortion_is_one_click_and_its_end_another(window):
    add_pair(window, 40)
    window.press_button(MORPH)
    window.wait(DONE)
    # The material preview that it switches to takes a minute without a graphics card:
    # headless/test_quality.py tests the switch.
    window.run(SHADINGS)
    window.open_panel("POINTMORPH_PT_quality")
    for shown in (True, False):
        window.press_button(SHOW_DISTORTION)
        assert window.ask("shadings[-1]") == ["VIEW_3D", shown]
        assert window.ask(f"addon('scene.points_display').shows({RESULT}, 'distortion')") == shown
    window.run("while undo: undo.pop()()")
    window.close_panel("POINTMORPH_PT_quality")


def test_settings_and_the_state_of_features(window):
    add_pair(window, 30)
    window.run("scenes.mark(bpy.data.objects['Dune'], 'left ear', .7, .7)")
    window.open_panel("POINTMORPH_PT_settings")
    window.screenshot("settings")
    window.close_panel("POINTMORPH_PT_settings")
    window.press_button(MORPH)
    window.wait("session().problem is not None")
    assert window.ask(f"{RESULT} is None and not ({RUNNING})")
    window.screenshot("error")


def test_two_vertices_become_a_feature(window):
    """In Edit Mode of both objects, by the buttons beside the list."""
    add_pair(window, 20)
    window.run(
        """
for obj in (bpy.data.objects["Hill"], bpy.data.objects["Dune"]):
    obj.select_set(True)
"""
    )
    window.press("Tab", over=VIEWPORT)
    window.press("alt+a", over=VIEWPORT)
    window.run(
        """
import bmesh
for obj in (bpy.data.objects["Hill"], bpy.data.objects["Dune"]):
    edited = bmesh.from_edit_mesh(obj.data)
    edited.verts.ensure_lookup_table()
    edited.verts[5].select_set(True)
    bmesh.update_edit_mesh(obj.data)
bpy.ops.ed.undo_push(message="Select")
"""
    )
    names = "[feature.name for feature in bpy.context.scene.pointmorph.features]"
    weights = """[
    len(vertex[edited.verts.layers.deform.verify()])
    for obj in (bpy.data.objects["Hill"], bpy.data.objects["Dune"])
    for edited in [bmesh.from_edit_mesh(obj.data)]
    for vertex in list(edited.verts)[5:6]
]"""
    window.press_button("add_feature")
    assert window.ask(names) == ["peak", "slope", "feature 1"]
    assert window.ask(weights) == [1, 1]
    window.screenshot("feature_added")
    # In Edit Mode, undo brings the weights back; before Blender 4.5 it leaves the empty groups.
    window.press("ctrl+z", over=VIEWPORT)
    assert window.ask(weights) == [0, 0]
    window.press("ctrl+shift+z", over=VIEWPORT)
    assert window.ask(weights) == [1, 1]
    window.press_button("remove_feature")
    assert window.ask(names) == ["peak", "slope"]
    window.press("Tab", over=VIEWPORT)
    assert window.ask("bpy.context.mode") == "OBJECT"


def test_what_a_feature_is_opens_beside_the_list(window):
    add_pair(window, 30)
    window.run(
        """
import bpy
for name, side in (("Hill", 30), ("Dune", 27)):
    obj = bpy.data.objects[name]
    obj.vertex_groups.remove(obj.vertex_groups["pm.slope"])
    middle = side // 3 * side
    scenes.add_group(obj, "pm.ridge", dict.fromkeys(range(middle + 5, middle + side - 5), 1.0))
    patch = [row for row in range(side * side) if row % side < 8 and row // side > side - 9]
    scenes.add_group(obj, "pm.corner", dict.fromkeys(patch, 0.5))
bpy.ops.pointmorph.check_features()
bpy.context.scene.pointmorph.active_feature = 2
"""
    )
    found = "[feature.found for feature in bpy.context.scene.pointmorph.features]"
    kinds = ["point", "soft curve, 20 to 17", "soft region, 64 to 64"]
    assert window.ask(found) == kinds
    x, y = window.find("jump_to_feature(side='TARGET')")
    window.click((x, y + 29))  # a popover has neither call nor path
    window.screenshot("feature_menu")
    window.press("Escape", over=VIEWPORT)
    window.press_button(MORPH)
    window.wait(DONE)
    window.screenshot("features_kept")


@pytest.mark.computes
def test_progress_and_a_second_start(window):
    start_long(window)
    window.screenshot("running")
    assert not window.ask("bpy.ops.pointmorph.morph.poll()")
    reason = window.run(
        """
try:
    bpy.ops.pointmorph.morph()
except RuntimeError as error:
    answer = str(error)
"""
    )
    assert "A morph is being computed" in reason
    window.wait(f"not ({RUNNING})")
    assert window.ask("sorted(bpy.context.scene.objects.keys())") == [
        "Dune",
        "Hill",
        "Hill to Dune",
    ]


@pytest.mark.computes
def test_blender_stays_responsive(window):
    """It handles events while the library computes."""
    start_long(window)
    waits = []
    while window.ask(RUNNING):
        start = time.monotonic()
        window.ask("0")
        waits.append(time.monotonic() - start)
    # Held up, it would answer once, at the end.
    assert len(waits) > 20
    assert max(waits) < 0.5 * sum(waits)


@pytest.mark.computes
def test_escape_leaves_nothing(window):
    start_long(window)
    window.press("Escape", over=VIEWPORT)
    window.wait(f"not ({RUNNING})")
    assert window.ask("scenes.data_blocks() == before")
    assert window.ask("bpy.ops.pointmorph.morph.poll()")
    window.screenshot("stopped")
    # And the next one runs to its end.
    window.press_button(MORPH)
    window.wait(DONE)


@pytest.mark.computes
def test_undo_and_deletion_while_it_runs(window):
    start_long(window)
    # While the scene is still being read, undo would stop it: what was read is no longer true.
    window.wait("session().current.begun")
    window.press("ctrl+z", over=VIEWPORT)
    window.run("bpy.data.objects.remove(bpy.data.objects['Hill'])")
    window.wait(f"not ({RUNNING})")
    assert window.process.poll() is None
    assert window.ask(f"{RESULT} is not None")


def test_an_error_in_the_library_is_told(window):
    add_pair(window, 20)
    window.run("bpy.data.objects['Hill'].vertex_groups.clear()")
    window.run("bpy.data.objects['Dune'].vertex_groups.clear()")
    window.run("for vertex in bpy.data.objects['Hill'].data.vertices: vertex.co = 0, 0, 0")
    window.run("before = scenes.data_blocks()")
    window.press_button(MORPH)
    window.wait(f"not ({RUNNING})")
    assert window.ask("scenes.data_blocks() == before")
    window.screenshot("library_error")
    assert window.process.poll() is None


@pytest.mark.computes
def test_another_file_while_it_runs(changed_window):
    start_long(changed_window)
    changed_window.run("bpy.ops.wm.read_homefile(use_empty=True)")
    assert not changed_window.ask(RUNNING)
    assert changed_window.ask("bpy.context.workspace is not None")


@pytest.mark.computes
def test_disabling_while_it_runs(changed_window):
    start_long(changed_window)
    module = changed_window.ask("session().__package__").removesuffix(".core")
    changed_window.run(f"bpy.ops.preferences.addon_disable(module={module!r})")
    assert not changed_window.ask(RUNNING)
    changed_window.redraw()
    assert changed_window.process.poll() is None
    changed_window.run(f"bpy.ops.preferences.addon_enable(module={module!r})")
    changed_window.redraw()
    assert changed_window.ask("bpy.context.scene.pointmorph.source is not None")


@pytest.mark.computes
def test_quitting_while_it_runs(changed_window):
    start_long(changed_window)
    assert changed_window.close() == 0


# --- Clicks on the models -------------------------------------------------------------------------

NAMES = "[feature.name for feature in bpy.context.scene.pointmorph.features]"
ROWS = """{
    (obj.name, group.name): [v.index for v in obj.data.vertices for g in v.groups
                             if g.group == group.index]
    for obj in (bpy.data.objects["Hill"], bpy.data.objects["Dune"])
    for group in obj.vertex_groups
}"""


def rows_of(window):
    """By object and group, the rows that are marked; JSON knows no tuples as keys."""
    return {tuple(key): rows for key, rows in window.ask(f"[*{ROWS}.items()]")}


def add_bare_pair(window, side, faces=True):
    """Two sheets, one above the other in the view from above, without a mark."""
    window.run(PIXEL)
    window.run(
        f"""
scenes.pair({side}, {side - 3})
for name, y in (("Hill", 1.2), ("Dune", -1.2)):
    obj = bpy.data.objects[name]
    obj.vertex_groups.clear()
    obj.location.y = y
    obj.rotation_euler.z = 0.3
    if not {faces}:
        positions = [tuple(v.co) for v in obj.data.vertices]
        old, obj.data = obj.data, scenes.add_mesh("bare", positions).data
        bpy.data.objects.remove(bpy.data.objects["bare"])
        bpy.data.meshes.remove(old)
scenes.select(bpy.data.objects["Hill"])
with in_viewport(): bpy.ops.view3d.view_axis(type="TOP")
with in_viewport(): bpy.ops.view3d.view_all()
area.spaces[0].region_3d.view_distance *= 0.55
bpy.ops.ed.undo_push(message="A pair of sheets")
"""
    )
    window.open_tab()


def click_vertex(window, name, row, away=(0, 0)):
    """A click near a vertex."""
    x, y = window.ask(f"pixel({name!r}, {row})")
    window.click((x + away[0], y + away[1]))


@pytest.mark.parametrize("faces", [True, False], ids=["faces", "points"])
def test_two_clicks_make_a_feature(window, faces):
    add_bare_pair(window, 20, faces)
    window.press_button("click_features")
    window.screenshot(f"click_first_{faces}")
    click_vertex(window, "Hill", 105, away=(3, -2))
    assert rows_of(window) == {("Hill", "pm.feature 1"): [105]}
    window.screenshot(f"click_second_{faces}")
    click_vertex(window, "Dune", 88, away=(-2, 2))
    click_vertex(window, "Dune", 208)
    click_vertex(window, "Hill", 250)
    both = {
        ("Hill", "pm.feature 1"): [105],
        ("Hill", "pm.feature 2"): [250],
        ("Dune", "pm.feature 1"): [88],
        ("Dune", "pm.feature 2"): [208],
    }
    assert rows_of(window) == both
    window.screenshot(f"clicked_{faces}")

    # Undone one by one while it runs, and clicked anew.
    window.press("ctrl+z", over=VIEWPORT)
    assert ("Hill", "pm.feature 2") not in rows_of(window)
    click_vertex(window, "Hill", 251)
    assert rows_of(window)["Hill", "pm.feature 2"] == [251]

    # A vertex that is a feature already is none of another name.
    click_vertex(window, "Hill", 105)
    assert len(window.ask(NAMES)) == 2

    # After the end clicks select again, and each is undone by itself.
    window.press("Escape", over=VIEWPORT)
    assert window.ask("bpy.ops.pointmorph.click_features.poll()")
    for left in (3, 2, 1, 0):
        window.press("ctrl+z", over=VIEWPORT)
        assert sum(map(bool, rows_of(window).values())) == left
    window.press("ctrl+shift+z", over=VIEWPORT)
    assert rows_of(window) == {("Hill", "pm.feature 1"): [105]}


def test_clicks_in_four_views(window):
    """Each quarter shows the objects another way."""
    add_bare_pair(window, 20)
    window.run("with in_viewport(): bpy.ops.screen.region_quadview()")
    window.redraw()
    window.run(
        """
regions = [region for region in area.regions if region.type == "WINDOW"]
views = list(area.spaces[0].region_quadviews)
for region in regions:
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.view3d.view_all()
def pixel_in(quarter, name, row):
    obj = bpy.data.objects[name]
    place = obj.matrix_world @ obj.data.vertices[row].co
    spot = location_3d_to_region_2d(regions[quarter], views[quarter], place)
    region = regions[quarter]
    return round(region.x + spot.x), round(window.height - region.y - spot.y)
"""
    )
    window.redraw()
    window.press_button("click_features")
    for quarter, (name, row) in enumerate((("Hill", 190), ("Dune", 150), ("Hill", 229))):
        x, y = window.ask(f"pixel_in({quarter}, {name!r}, {row})")
        window.click((x, y))
    window.screenshot("quarters")
    marked = rows_of(window)
    window.press("Escape", over=VIEWPORT)
    window.run("with in_viewport(): bpy.ops.screen.region_quadview()")
    assert {key[0] for key in marked} == {"Hill", "Dune"}
    assert all(len(rows) == 1 for rows in marked.values())
