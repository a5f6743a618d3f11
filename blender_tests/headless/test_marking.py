"""Marks: clicked, found again, paired, jumped to, proposed; and what the loop's list does."""

import itertools

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Matrix, Vector

pytestmark = pytest.mark.interface


@pytest.fixture
def pair():
    return scenes.pair(24, 19)


def marked(obj, name):
    return list(scenes.groups(obj)[f"pm.{name}"])


def bare(obj):
    obj.vertex_groups.clear()
    scenes.mark(obj, "only", 0.9, 0.9)
    obj.vertex_groups.clear()


# --- What lies under the mouse --------------------------------------------------------------------


def place(obj, row):
    return obj.matrix_world @ obj.data.vertices[row].co


@pytest.mark.parametrize("row", [0, 100, 315, 575])
def test_a_ray_takes_the_nearest_vertex(addon, pair, row):
    """Whatever the object's transform; shear and mirror included."""
    targets = addon("view.click_targets")
    obj = pair[0]
    obj.matrix_world = Matrix(((2, 0.5, 0, 4), (0, -0.3, 0.1, -2), (0.2, 0, 1.5, 1), (0, 0, 0, 1)))
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    normal = obj.matrix_world.to_3x3().inverted().transposed() @ obj.data.vertices[row].normal
    target = place(obj, row) + 1e-3 * (place(obj, 300) - place(obj, row))
    along = -normal.normalized()
    found = targets.nearest_on_surface(obj, target - 5 * along, along, depsgraph)
    assert found is not None
    places = np.array([place(obj, k) for k in range(len(obj.data.vertices))])
    met = np.array(target - 5 * along + found[0] * along)
    assert found[1] == np.argmin(np.linalg.norm(places - met, axis=1)) == row
    beside = target + Vector((500, 0, 0))
    assert targets.nearest_on_surface(obj, beside, along, depsgraph) is None


def test_a_ray_takes_what_the_viewport_shows(addon, pair):
    """A modifier that moves vertices moves what can be clicked; subdivisions add no rows."""
    targets = addon("view.click_targets")
    obj = pair[0]
    lift = obj.modifiers.new("Lift", "DISPLACE")
    lift.direction, lift.strength, lift.mid_level = "Z", 3.0, 0.0
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    down = Vector((0, 0, -1))
    above = place(obj, 200) + Vector((0, 0, 10))
    distance, row = targets.nearest_on_surface(obj, above, down, depsgraph)
    assert row == 200
    assert distance == pytest.approx(7, abs=1e-4)
    obj.modifiers.clear()
    obj.modifiers.new("Finer", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    _, row = targets.nearest_on_surface(obj, above, down, depsgraph)
    assert row == 200


def looking_down(size, perspective):
    """(4, 4) from the world to the cube of a camera at z = 10 that looks down."""
    near, far, wide = 1.0, 100.0, 0.5
    if perspective:
        project = np.diag([1 / wide, 1 / wide, -(far + near) / (far - near), 0.0])
        project[2, 3], project[3, 2] = -2 * far * near / (far - near), -1.0
    else:
        project = np.diag([0.2, 0.2, -2 / (far - near), 1.0])
        project[2, 3] = -(far + near) / (far - near)
    view = np.eye(4)
    view[2, 3] = -10.0
    return project @ view


@pytest.mark.parametrize("perspective", [True, False])
def test_a_point_without_faces_is_taken_from_the_front(addon, perspective):
    nearest = addon("view.click_targets").nearest_projected
    rng = np.random.default_rng(4)
    front = np.column_stack([rng.uniform(-1, 1, (400, 2)), np.zeros(400)])
    places = np.concatenate([front + (0, 0, -2), front])  # the same behind
    matrix, size = looking_down(600, perspective), (600, 600)
    flat = places @ matrix[:3, :3].T + matrix[:3, 3]
    depth = places @ matrix[3, :3] + matrix[3, 3]
    pixels = (flat[:, :2] / depth[:, None] + 1) / 2 * 600
    for row in (400, 512, 799):
        assert nearest(places, matrix, size, pixels[row]) == row
    assert nearest(places, matrix, size, (-200, -200)) is None
    assert nearest(places[:0], matrix, size, (300, 300)) is None
    behind = np.array([[0.0, 0.0, 20.0]])  # of the viewer, where perspective mirrors
    if perspective:
        assert nearest(behind, matrix, size, (300, 300)) is None


def test_what_is_asked_for_next(addon, pair, settings):
    asked_for = addon("operators.clicks").asked_for
    source, target = pair
    assert asked_for(settings) == ("feature 1", [source, target])
    scenes.mark(target, "ear", 0.7, 0.7)
    addon("data.feature_list").sync_features(bpy.context.scene)
    assert asked_for(settings) == ("ear", [source])
    assert asked_for(settings, "peak") == ("peak", [])


def test_clicks_need_a_window(pair):
    with pytest.raises(RuntimeError, match="window"):
        bpy.ops.pointmorph.click_features()


# --- Marks and where they are ---------------------------------------------------------------------


def test_marks_are_found_and_found_again(addon, pair):
    markers = addon("scene.marked_points")
    source = pair[0]
    markers.forget()
    first = markers.marks_of(source, wait=True)
    assert {name: mark.row for name, mark in first.items()} == {
        name: marked(source, name)[0] for name in ("peak", "slope")
    }
    source.vertex_groups.remove(source.vertex_groups["pm.peak"])
    scenes.add_group(source, "pm.peak", {3: 1.0})
    scenes.add_group(source, "pm.patch", dict.fromkeys(range(40, 52), 0.5))
    scenes.add_group(source, "pm.nothing", {})
    again = markers.marks_of(source, wait=True)
    assert again["peak"].rows == (3,)
    assert again["patch"].count == 12
    assert 40 <= again["patch"].row < 52
    assert again["nothing"] is None
    assert markers.count_of(source, "nothing") == 0
    assert markers.count_of(source, "patch") == 12


def test_marks_are_found_between_redraws(addon, pair, monkeypatch):
    """In slices: what is not known yet is no mark, and comes later."""
    markers = addon("scene.marked_points")
    markers.forget()
    monkeypatch.setattr(markers, "_SLICE", 100)
    monkeypatch.setattr(addon("data.areas"), "redraw_viewports", lambda: None)
    source = pair[0]
    assert set(markers.marks_of(source).values()) == {None}
    turns = 0
    while markers._look() is not None:
        turns += 1
    assert turns >= len(source.data.vertices) // 100 - 1
    assert markers.marks_of(source)["peak"].rows == tuple(marked(source, "peak"))
    bpy.app.timers.unregister(markers._look)


def test_marks_lie_where_the_viewport_shows_them(addon, pair):
    markers = addon("scene.marked_points")
    source = pair[0]
    source.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(1, 4, "X")
    lift = source.modifiers.new("Lift", "DISPLACE")
    lift.direction, lift.strength, lift.mid_level = "Z", 2.0, 0.0
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    wanted = source.matrix_world @ (source.data.vertices[7].co + Vector((0, 0, 2)))
    assert (markers.place_of(source, 7, depsgraph) - wanted).length < 1e-5


def test_neighbouring_colors_differ(addon):
    colors = [addon("data.feature_list").color_of(k) for k in range(9)]
    for a, b in itertools.pairwise(colors):
        assert np.linalg.norm(np.subtract(a, b)) > 0.4


# --- Operators ------------------------------------------------------------------------------------


def test_swap_and_take_selected(pair, settings):
    source, target = pair
    bpy.ops.pointmorph.swap_objects()
    assert (settings.source, settings.target) == (target, source)
    scenes.select(source)
    with pytest.raises(RuntimeError, match="Select two"):
        bpy.ops.pointmorph.pick_selected()
    target.select_set(True)
    bpy.ops.pointmorph.pick_selected()
    assert (settings.source, settings.target) == (target, source)
    bpy.context.view_layer.objects.active = target
    bpy.ops.pointmorph.pick_selected()
    assert (settings.source, settings.target) == (source, target)


def test_pairs_by_name(pair, settings):
    source, target = pair
    scenes.mark(source, "Left Ear", 0.7, 0.7)
    scenes.mark(target, "left_ear", 0.7, 0.7)
    scenes.mark(target, "tail", -0.7, 0.7)
    scenes.add_group(source, "hand", {1: 1.0})
    scenes.add_group(target, "hand", {2: 1.0})
    scenes.add_group(source, "none", {})
    scenes.add_group(target, "none", {5: 1.0})
    bpy.ops.pointmorph.pair_features()
    assert "Left Ear" in settings.features
    assert settings.features["Left Ear"].on_target
    assert not settings.features["tail"].on_source
    assert "hand" not in settings.features
    bpy.ops.pointmorph.pair_features(groups=True)
    assert marked(target, "hand") == [2]
    assert "none" not in settings.features
    assert "hand" in source.vertex_groups  # the rig's own stays


def test_jump_puts_the_cursor_there(pair, settings):
    bpy.context.view_layer.update()
    settings.active_feature = settings.features.find("slope")
    pair[1].location.x = 5
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.jump_to_feature(side="TARGET")
    wanted = place(pair[1], marked(pair[1], "slope")[0])
    assert (bpy.context.scene.cursor.location - wanted).length < 1e-6
    pair[1].vertex_groups.remove(pair[1].vertex_groups["pm.slope"])
    with pytest.raises(RuntimeError, match="Mark it there first"):
        bpy.ops.pointmorph.jump_to_feature(side="TARGET")


def test_a_feature_that_is_off_is_none(addon, pair, settings):
    scenes.mark(pair[0], "half", 0.2, 0.9)
    addon("data.feature_list").sync_features(bpy.context.scene)
    with pytest.raises(RuntimeError, match="half"):
        bpy.ops.pointmorph.morph()
    assert addon("core.background_job").problem[0] == "FEATURES"
    addon("data.feature_list").sync_features(bpy.context.scene)
    assert addon("core.background_job").problem is not None  # nothing has changed
    settings.features["half"].use = False
    settings.features["slope"].use = False
    assert set(addon("scene.panel_request").read_request(bpy.context).features) == {"peak"}
    assert bpy.ops.pointmorph.morph() == {"FINISHED"}
    assert addon("core.background_job").problem is None


def test_a_problem_is_forgotten_once_something_else_is_marked_or_picked(addon, pair, settings):
    session, sync = addon("core.background_job"), addon("data.feature_list").sync_features
    for change in (
        lambda: scenes.mark(pair[1], "half", 0.2, 0.9),
        lambda: setattr(settings, "target", None),
    ):
        scenes.mark(pair[0], "half", 0.2, 0.9)
        sync(bpy.context.scene)
        session.problem = "FEATURES", "half isn't marked on the target"
        change()
        sync(bpy.context.scene)
        assert session.problem is None


def test_points_of_a_cloud_can_be_marked(addon, settings):
    positions, _ = scenes.patch(12)
    cloud = scenes.add_point_cloud("Cloud", positions, {})
    if not len(cloud.data.points):
        pytest.skip("this Blender makes no point cloud with points of its own")
    marking = addon("scene.feature_marks")
    marking.mark(cloud, "nose", [17])
    assert addon("scene.marked_points").marks_of(cloud, wait=True)["nose"].rows == (17,)
    marking.mark(cloud, "nose", [18])
    assert addon("scene.marked_points").marks_of(cloud, wait=True)["nose"].rows == (18,)
    marking.unmark(cloud, "nose")
    assert addon("data.feature_list").feature_names(cloud) == []


# --- The loop -------------------------------------------------------------------------------------


def loop_names(settings):
    return [feature.name for feature in settings.loop]


def balls(settings):
    """Two spheres with four marks around each."""
    objects = []
    for name, radius in (("Ball", 1.0), ("Globe", 1.5)):
        i = np.arange(1500)
        z, a = 1 - (2 * i + 1) / 1500, i * np.pi * (3 - 5**0.5)
        ring = np.sqrt(1 - z * z)
        positions = np.stack([ring * np.cos(a), ring * np.sin(a), z], axis=1)
        obj = scenes.add_mesh(name, radius * positions)
        places = {"front": (1, 0, 0), "left": (0, 1, 0), "back": (-1, 0, 0), "right": (0, -1, 0)}
        for mark, where in places.items():
            scenes.add_group(obj, f"pm.{mark}", {int(np.argmax(positions @ where)): 1.0})
        objects.append(obj)
    settings.source, settings.target = objects
    return objects


def test_the_loop_is_edited(addon, pair, settings):
    scenes.mark(pair[0], "ear", 0.7, 0.7)
    scenes.mark(pair[1], "ear", 0.7, 0.7)
    addon("data.feature_list").sync_features(bpy.context.scene)
    for name in ("peak", "slope", "ear"):
        bpy.ops.pointmorph.add_loop_feature(name=name)
    assert loop_names(settings) == ["peak", "slope", "ear"]
    with pytest.raises(RuntimeError, match="once"):
        bpy.ops.pointmorph.add_loop_feature(name="ear")
    with pytest.raises(RuntimeError, match="none of that name"):
        bpy.ops.pointmorph.add_loop_feature(name="tail")
    bpy.ops.pointmorph.move_loop_feature(direction="UP")
    assert loop_names(settings) == ["peak", "ear", "slope"]
    settings.active_loop = 0
    bpy.ops.pointmorph.move_loop_feature(direction="UP")  # a loop has no first
    assert settings.active_loop == 2
    bpy.ops.pointmorph.remove_loop_feature()
    with pytest.raises(RuntimeError, match="at least three"):
        bpy.ops.pointmorph.show_cut()
    bpy.ops.pointmorph.clear_loop()
    assert loop_names(settings) == []
    with pytest.raises(RuntimeError, match="Select a feature"):
        bpy.ops.pointmorph.clear_loop()


def test_a_loop_is_proposed_and_its_cut_shown(addon, settings):
    source, _ = balls(settings)
    source.location = (3, 0, 1)
    source.scale = (2, 2, 2)
    bpy.ops.pointmorph.propose_loop()
    assert sorted(loop_names(settings)) == ["back", "front", "left", "right"]
    shown = addon("view.cut_curves").shown
    assert set(shown) == {"Ball", "Globe"}
    for name, radius in (("Ball", 1.0), ("Globe", 1.5)):
        curve = shown[name]
        assert np.allclose(np.linalg.norm(curve, axis=1), radius, rtol=0.03)
        assert np.abs(curve[:, 2]).max() < 0.2 * radius
    shown.clear()
    bpy.ops.pointmorph.show_cut()
    assert set(shown) == {"Ball", "Globe"}


def test_a_loop_through_what_is_not_marked_is_refused(addon, settings):
    balls(settings)
    bpy.ops.pointmorph.propose_loop()
    settings.target.vertex_groups.remove(settings.target.vertex_groups["pm.left"])
    addon("data.feature_list").sync_features(bpy.context.scene)
    with pytest.raises(RuntimeError, match="left"):
        bpy.ops.pointmorph.show_cut()
