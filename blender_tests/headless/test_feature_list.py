"""The list of features: what it shows, adding, removing, and proposals."""

import bmesh
import bpy
import numpy as np
import pytest
from scenes import add_group, add_mesh, add_object, groups, listed, mark, pair, patch, select


def edit(*objects):
    """Enters Edit Mode with nothing selected."""
    for obj in objects:
        select(obj)
    for obj in objects:
        obj.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")


def select_vertices(obj, *vertices):
    """Selects vertices in Edit Mode, and these only."""
    mesh = bmesh.from_edit_mesh(obj.data)
    mesh.verts.ensure_lookup_table()
    for vertex in mesh.verts:
        vertex.select_set(vertex.index in vertices)
    mesh.select_flush_mode()
    bmesh.update_edit_mesh(obj.data)


# --- The list -------------------------------------------------------------------------------------


def test_the_list_follows_the_objects(settings):
    source, target = pair()
    assert listed(settings) == [("peak", True, True), ("slope", True, True)]
    mark(target, "horn", 0.7, 0.7)
    add_group(target, "Bone", {0: 1.0})
    assert listed(settings)[2:] == [("horn", False, True)]
    source.vertex_groups.remove(source.vertex_groups["pm.peak"])
    assert listed(settings)[0] == ("peak", False, True)
    target.vertex_groups["pm.slope"].name = "pm.side"
    assert sorted(listed(settings)) == [
        ("horn", False, True),
        ("peak", False, True),
        ("side", False, True),
        ("slope", True, False),
    ]
    settings.target = None
    assert listed(settings) == [("slope", True, False)]


@pytest.mark.interface
def test_new_features_move_the_others_in_memory(addon, monkeypatch, settings):
    """What was found before in a list that grows is no longer where it was: writing there crashes
    Blender sooner or later."""
    source, _target = pair()
    source.vertex_groups.clear()
    assert listed(settings) == [("peak", False, True), ("slope", False, True)]
    for number in range(100):
        source.vertex_groups.new(name=f"pm.{number}")
    mark(source, "peak", 0.0, 0.0)  # behind the new ones
    module = addon("data.feature_list")
    written, plain = [], module._set

    def watched(item, key, value):
        written.append(item.as_pointer() in {one.as_pointer() for one in settings.features})
        plain(item, key, value)

    monkeypatch.setattr(module, "_set", watched)
    assert listed(settings)[:3] == [
        ("peak", True, True),
        ("slope", False, True),
        ("0", True, False),
    ]
    assert written
    assert all(written)


def test_what_was_chosen_for_features_waits_for_their_object(settings):
    source, target = pair()
    other = add_mesh("Other", *patch(8))
    listed(settings)
    peak = settings.features["peak"]
    peak.kind, peak.hold, peak.weight, peak.use = "REGION", "SOFT", 0.25, False
    settings.source = settings.target = other
    assert listed(settings) == []
    settings.source, settings.target = source, target
    assert listed(settings) == [("peak", True, True), ("slope", True, True)]
    peak = settings.features["peak"]
    assert (peak.kind, peak.hold, peak.weight, peak.use) == ("REGION", "SOFT", 0.25, False)
    assert settings.features["slope"].kind == "AUTO"

    bpy.ops.pointmorph.remove_feature(name="peak")
    mark(source, "peak", 0, 0)
    listed(settings)
    assert settings.features["peak"].kind == "AUTO"


def test_the_list_survives_save_and_load(settings, tmp_path):
    pair()
    assert listed(settings)
    path = str(tmp_path / "features.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    loaded = bpy.context.scene.pointmorph
    assert [f.name for f in loaded.features] == ["peak", "slope"]
    assert loaded.source.name == "Hill"


def test_an_unchanged_scene_is_left_alone(settings):
    """A handler that writes each time would make Blender evaluate for ever."""
    pair()
    assert listed(settings)
    updates = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: updates.append(1))
    try:
        for _ in range(5):
            bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
    assert len(updates) <= 1


def test_renaming_in_the_list_renames_on_both(settings):
    source, target = pair()
    assert listed(settings)
    settings.features[0].name = "summit"
    for obj in (source, target):
        assert [group.name for group in obj.vertex_groups] == ["pm.summit", "pm.slope"]
    assert listed(settings) == [("summit", True, True), ("slope", True, True)]
    settings.features[0].name = "slope"  # taken
    settings.features[1].name = ""
    assert listed(settings) == [("summit", True, True), ("slope", True, True)]


# --- Adding and removing --------------------------------------------------------------------------


@pytest.fixture
def unmarked(settings):
    settings.source = add_mesh("Hill", *patch(8))
    settings.target = add_mesh("Dune", *patch(9))
    return settings.source, settings.target


def test_add_in_edit_mode(settings, unmarked):
    source, _ = unmarked
    edit(source)
    select_vertices(source, 17)
    assert bpy.ops.pointmorph.add_feature(name="nose") == {"FINISHED"}
    assert source.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert groups(source) == {"pm.nose": {17: 1.0}}
    assert listed(settings) == [("nose", True, False)]


def test_add_on_both_at_once(settings, unmarked):
    source, target = unmarked
    edit(source, target)
    select_vertices(source, 17)
    select_vertices(target, 23)
    bpy.ops.pointmorph.add_feature(name="pm.nose")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert groups(source) == {"pm.nose": {17: 1.0}}
    assert groups(target) == {"pm.nose": {23: 1.0}}
    assert listed(settings) == [("nose", True, True)]


def test_add_in_object_mode_and_move(settings, unmarked):
    source, _ = unmarked
    select(source)
    for row in (11, 12):
        for vertex in source.data.vertices:
            vertex.select = vertex.index == row
        bpy.ops.pointmorph.add_feature(name="nose")
        assert groups(source) == {"pm.nose": {row: 1.0}}
    assert settings.active_feature == 0


def test_names_are_found(settings, unmarked):
    source, target = unmarked
    edit(source)
    for row in (3, 30):
        select_vertices(source, row)
        bpy.ops.pointmorph.add_feature()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert [name for name, *_ in listed(settings)] == ["feature 1", "feature 2"]
    edit(target)
    for row in (4, 40):
        select_vertices(target, row)
        bpy.ops.pointmorph.add_feature()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert listed(settings) == [("feature 1", True, True), ("feature 2", True, True)]
    assert groups(target) == {"pm.feature 1": {4: 1.0}, "pm.feature 2": {40: 1.0}}


def test_something_must_be_selected(settings, unmarked):
    source, _ = unmarked
    edit(source)
    select_vertices(source)
    with pytest.raises(RuntimeError, match="Hill: expected selected vertices, found none"):
        bpy.ops.pointmorph.add_feature(name="nose")
    assert not source.vertex_groups


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_several_selected_vertices_are_one_feature(settings, unmarked, mode):
    source, _ = unmarked
    edit(source)
    select_vertices(source, 3, 4, 5)
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.pointmorph.add_feature(name="ridge")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert groups(source) == {"pm.ridge": {3: 1.0, 4: 1.0, 5: 1.0}}


def test_adding_needs_one_of_the_two(settings, unmarked):
    select(add_object("Bystander", None))
    with pytest.raises(RuntimeError, match="Make the source or target the active object"):
        bpy.ops.pointmorph.add_feature(name="nose")


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_remove(settings, mode):
    source, target = pair()
    add_group(source, "Bone", {0: 1.0})
    select(source)
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.pointmorph.remove_feature(name="peak")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert [group.name for group in source.vertex_groups] == ["pm.slope", "Bone"]
    assert [group.name for group in target.vertex_groups] == ["pm.slope"]
    bpy.ops.pointmorph.remove_feature()
    assert listed(settings) == []
    with pytest.raises(RuntimeError, match="There are no features yet"):
        bpy.ops.pointmorph.remove_feature()


def test_removing_what_is_not_there(settings):
    pair()
    with pytest.raises(RuntimeError, match='feature "tail": expected a marked feature'):
        bpy.ops.pointmorph.remove_feature(name="tail")


# --- Proposals ------------------------------------------------------------------------------------


def urchin(name, turn):
    """A ball with four spikes of different lengths along its axes, and their ends' vertices."""
    count = 3000
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    ball = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], 1)
    spikes = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]])
    lengths = np.array([0.9, 0.5, 0.7, 0.6])
    grown = 0.6 + np.exp((ball @ spikes.T - 1) / 0.08) @ lengths
    positions = ball * grown[:, None]
    c, s = np.cos(turn), np.sin(turn)
    obj = add_mesh(name, positions @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T)
    normals = obj.data.attributes.new("Normal", "FLOAT_VECTOR", "POINT")
    normals.data.foreach_set("vector", ball.astype(np.float32).ravel())
    return obj, np.argmax(ball @ spikes.T, axis=0)


def test_proposals_mark_tips_on_both_and_can_be_removed(addon):
    settings = bpy.context.scene.pointmorph
    (settings.source, ends), (settings.target, _) = urchin("One", 0.0), urchin("Two", 0.4)
    assert bpy.ops.pointmorph.propose_features(confidence=0.0) == {"FINISHED"}
    proposed = [f for f in listed(settings) if f[0].startswith("tip.")]
    assert len(proposed) >= 3
    assert all(on_source and on_target for _, on_source, on_target in proposed)
    assert all(0 <= feature.confidence <= 1 for feature in settings.features)
    positions = np.array([v.co for v in settings.source.data.vertices])
    for name, _, _ in proposed[:3]:
        (row,) = groups(settings.source)[f"pm.{name}"]
        assert np.linalg.norm(positions[ends] - positions[row], axis=1).min() < 0.2
    # The user's own mark is no proposal any more.
    select(settings.source)
    assert bpy.ops.pointmorph.remove_feature(name=proposed[0][0]) == {"FINISHED"}
    assert proposed[0][0] not in [name for name, _, _ in listed(settings)]


def test_proposals_below_the_wanted_confidence_arent_marked(addon, capfd):
    settings = bpy.context.scene.pointmorph
    (settings.source, _), (settings.target, _) = urchin("One", 0.0), urchin("Two", 0.4)
    assert bpy.ops.pointmorph.propose_features(confidence=1.0) == {"FINISHED"}
    assert listed(settings) == []
    assert "less likely right than 100 %" in capfd.readouterr().out


def test_that_proposals_are_no_tips_is_said(addon, capfd):
    """Smooth balls have no tips, only places between them."""
    settings = bpy.context.scene.pointmorph
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4)
    settings.source = bpy.context.object
    bpy.ops.mesh.primitive_monkey_add()
    settings.target = bpy.context.object
    assert bpy.ops.pointmorph.propose_features(confidence=0.0) == {"FINISHED"}
    assert listed(settings) == []
    said = capfd.readouterr().out
    assert "between tips: turn on Places Between" in said
    assert "less likely" not in said
    assert bpy.ops.pointmorph.propose_features(confidence=0.0, places=True) == {"FINISHED"}
    assert len(listed(settings)) > 0


def test_proposals_need_the_vertices_of_the_mesh(addon):
    """Those of modifiers that add to them are told from the mesh's own, others aren't."""
    source, target = pair()
    target.modifiers.new("More", "SUBSURF")
    assert bpy.ops.pointmorph.propose_features() == {"FINISHED"}
    reading = addon("scene.panel_request")
    shown = reading.read_request(bpy.context).target
    rows = reading.own_rows(target, shown)
    own = len(target.data.vertices)
    assert len(rows) == len(shown.positions) > 3 * own
    assert np.array_equal(rows[:own], np.arange(own))
    places = np.array([vertex.co for vertex in target.data.vertices])
    places = places + np.array(target.location) - np.array(source.location)
    assert np.linalg.norm(shown.positions[:own] - places, axis=1).max() < 0.1
    target.modifiers.new("Fewer", "DECIMATE").ratio = 0.5
    with pytest.raises(RuntimeError, match="Apply or disable the modifiers"):
        bpy.ops.pointmorph.propose_features()
