"""Frames in the scene are a file on disk that Blender reads frame by frame, without the add-on."""

import os
from pathlib import Path

import bpy
import numpy as np
import pytest
from scenes import (
    attribute,
    baked_frames,
    coordinates,
    data_blocks,
    morph,
    pair,
    played,
    select,
    shown_cloud,
    surface_of,
    torn_pair,
)

pytestmark = pytest.mark.interface

NAMES = ("Color", "Normal", "velocity", "radius", "id")


@pytest.fixture
def torn(settings):
    torn_pair()
    return morph()


def bake(obj, **options):
    select(obj)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=9, **options) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def cache_of(player):
    return Path(os.path.normpath(bpy.path.abspath(player.modifiers["Mesh Cache"].filepath)))


def shown(player, frame, subframe=0.0):
    """What is shown at a frame: positions, and attributes by name."""
    bpy.context.scene.frame_set(frame, subframe=subframe)
    cloud = shown_cloud(player)
    return {"position": coordinates(cloud.points), **{n: attribute(cloud, n) for n in NAMES}}


def assert_same(found, wanted):
    for name, values in found.items():
        known = wanted["Radius" if name == "radius" else name]
        np.testing.assert_array_equal(values, known, err_msg=name)


@pytest.mark.makes_nodes
def test_what_is_shown_has_the_bits_of_the_file(torn):
    player = bake(torn)
    frames = baked_frames(player)
    assert len({len(frame["id"]) for frame in frames}) > 3
    for number in (9, 1, 5, 6):
        assert_same(shown(player, number), frames[number - 1])
    assert_same(shown(player, 5, 0.75), frames[4])
    assert_same(shown(player, -20), frames[0])
    assert_same(shown(player, 99), frames[8])


@pytest.mark.makes_nodes
def test_nothing_of_the_frames_is_in_the_blend_file(torn, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    torn = bpy.data.objects["Whole to Torn"]
    blocks = data_blocks()
    player = bake(torn)
    assert cache_of(player) == tmp_path / "blendcache_shot" / "Whole_to_Torn_Frames.pc2"
    assert player.modifiers["Mesh Cache"].filepath.startswith("//")
    kinds = {name.split(":")[0] for name in data_blocks() - blocks}
    assert kinds - {"all_ids"} == {"meshes", "node_groups", "objects"}
    assert len(player.data.vertices) == 1
    bpy.ops.wm.save_mainfile()
    size = os.path.getsize(tmp_path / "shot.blend")
    bake(torn, step=4)
    bpy.ops.wm.save_mainfile()
    assert abs(os.path.getsize(tmp_path / "shot.blend") - size) < 4_000
    bake(torn)
    most = max(len(frame["id"]) for frame in baked_frames(player))
    assert cache_of(player).stat().st_size == 32 + 9 * 12 * (1 + 5 * most)


def test_a_second_bake_replaces_the_first(addon, torn, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    torn = bpy.data.objects["Whole to Torn"]
    player = bake(torn)
    player.name = "Mine"
    addon("data.versions").set_input(player.modifiers["Points"], "Radius Scale", 2.0)
    player.modifiers.new("Own", "NODES")
    before = baked_frames(player)
    blocks = data_blocks()
    assert bake(torn, resample=False, step=2) == player
    assert data_blocks() == blocks
    assert [m.name for m in player.modifiers] == ["Cache Rows", "Mesh Cache", "Points", "Own"]
    assert addon("data.versions").input_value(player.modifiers["Points"], "Radius Scale") == 2.0
    player.modifiers.remove(player.modifiers["Own"])
    after = baked_frames(player)
    assert (len(before), len(after)) == (9, 5)
    addon("data.versions").set_input(player.modifiers["Points"], "Radius Scale", 1.0)
    assert_same(shown(player, 4), after[1])
    assert_same(shown(player, 5), after[2])
    assert files_in(tmp_path / "blendcache_shot") == [
        "Whole_to_Torn_Frames.pc2",
        "Whole_to_Torn_Frames_1.pc2",
    ]
    bpy.ops.wm.save_mainfile()
    assert files_in(tmp_path / "blendcache_shot") == ["Whole_to_Torn_Frames_1.pc2"]


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())


def saved(path):
    """Saves the file there. Returns the morph object."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return bpy.data.objects["Whole to Torn"]


def opened(path):
    """Opens a file. Returns what shows its frames."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects["Whole to Torn Frames"]


def test_undo_of_a_second_bake_shows_the_first(torn, tmp_path):
    wanted = baked_frames(bake(saved(tmp_path / "shot.blend")))
    bpy.ops.ed.undo_push(message="first")
    bake(bpy.data.objects["Whole to Torn"], resample=False, step=4)
    bpy.ops.ed.undo_push(message="second")
    bpy.ops.ed.undo()
    player = bpy.data.objects["Whole to Torn Frames"]
    assert_same(shown(player, 5), wanted[4])
    assert_same(shown(player, 9), wanted[8])


def test_a_file_closed_without_saving_shows_what_it_did(torn, tmp_path):
    path = tmp_path / "shot.blend"
    wanted = baked_frames(bake(saved(path)))
    bpy.ops.wm.save_mainfile()
    bake(bpy.data.objects["Whole to Torn"], resample=False, step=4)
    assert_same(shown(opened(path), 5), wanted[4])
    bpy.ops.wm.save_mainfile()
    assert files_in(tmp_path / "blendcache_shot") == ["Whole_to_Torn_Frames.pc2"]


@pytest.mark.parametrize("linked", [True, False])
def test_versions_of_a_file_have_frames_of_their_own(addon, torn, tmp_path, monkeypatch, linked):
    if not linked:  # as on a disk that has no second names
        monkeypatch.setattr(addon("scene.cache_files").os, "link", refused)
    first, second = tmp_path / "shot_001.blend", tmp_path / "other" / "shot_002.blend"
    second.parent.mkdir()
    wanted = baked_frames(bake(saved(first)))
    bpy.ops.wm.save_mainfile()
    torn = saved(second)
    bake(torn, resample=False, step=4)
    bpy.ops.wm.save_mainfile()
    assert files_in(second.parent / "blendcache_shot_002") == ["Whole_to_Torn_Frames_1.pc2"]
    assert_same(shown(opened(first), 5), wanted[4])
    bpy.ops.wm.save_as_mainfile(filepath=str(second), copy=True)
    assert cache_of(bpy.data.objects["Whole to Torn Frames"]).parent.name == "blendcache_shot_001"
    bake(bpy.data.objects["Whole to Torn"], resample=False, step=4)
    bpy.ops.wm.save_mainfile()
    assert files_in(tmp_path / "blendcache_shot_001") == ["Whole_to_Torn_Frames_1.pc2"]
    player = opened(second)
    assert cache_of(player).parent == second.parent / "blendcache_shot_002"
    assert player.modifiers["Mesh Cache"].filepath.startswith("//blendcache")
    assert_same(shown(player, 5), wanted[4])


def refused(*_):
    raise OSError("no room")


def test_duplicates_go_along_with_the_first_save(torn, tmp_path):
    player = bake(torn)
    wanted = baked_frames(player)
    select(player)
    bpy.ops.object.duplicate()
    twin = bpy.context.view_layer.objects.active.name
    bpy.data.objects.remove(torn)  # frames outlive the morph
    old = cache_of(player)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert not old.exists()
    for name in ("Whole to Torn Frames", twin):
        assert_same(shown(bpy.data.objects[name], 5), wanted[4])
    assert files_in(tmp_path / "blendcache_shot") == ["Whole_to_Torn_Frames.pc2"]


def test_undo_after_the_first_save_shows_the_frames(torn, tmp_path):
    wanted = baked_frames(bake(torn))
    bpy.ops.ed.undo_push(message="before")
    bpy.data.objects["Whole"].location.x += 1
    bpy.ops.ed.undo_push(message="moved")
    saved(tmp_path / "shot.blend")
    bpy.ops.ed.undo()
    assert_same(shown(bpy.data.objects["Whole to Torn Frames"], 5), wanted[4])


def test_frames_that_cannot_move_stay(addon, torn, tmp_path, monkeypatch):
    player = bake(torn)
    wanted = baked_frames(player)
    old = cache_of(player)
    files = addon("scene.cache_files")
    for module, name in ((files.os, "link"), (files.shutil, "copyfile")):
        monkeypatch.setattr(module, name, refused)
    saved(tmp_path / "shot.blend")
    player = bpy.data.objects["Whole to Torn Frames"]
    assert "can't store them: no room" in addon("core.background_job").problem[1]
    assert cache_of(player) == old
    assert_same(shown(player, 5), wanted[4])
    assert not (tmp_path / "blendcache_shot").exists()
    monkeypatch.undo()
    bpy.ops.wm.save_mainfile()
    assert cache_of(player).parent == tmp_path / "blendcache_shot"
    assert_same(shown(player, 5), wanted[4])


def test_a_save_that_fails_leaves_frames_where_they_are(torn, tmp_path):
    player = bake(torn)
    before = player.modifiers["Mesh Cache"].filepath
    (tmp_path / "shot.blend@").mkdir()  # where Blender writes to at first
    with pytest.raises(RuntimeError):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert player.modifiers["Mesh Cache"].filepath == before
    assert cache_of(player).is_file()


def test_a_bake_that_fails_leaves_no_file(addon, torn, tmp_path, monkeypatch):
    saved(tmp_path / "shot.blend")
    monkeypatch.setattr(addon("scene.cached_frames").frame_players, "belongs", refused)
    select(bpy.data.objects["Whole to Torn"])
    with pytest.raises(RuntimeError, match="no room"):
        bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3)
    assert [n for n in files_in(tmp_path / "blendcache_shot") if n.endswith(".pc2")] == []
    assert "Whole to Torn Frames" not in bpy.data.objects


def test_a_second_bake_keeps_what_the_user_did(addon, torn):
    """It goes to the object of the first one, also beside duplicates that sort before."""
    player = bake(torn)
    player.name = "Zebra"
    select(player)
    bpy.ops.object.duplicate()
    bpy.context.view_layer.objects.active.name = "Ape"
    player.location.x += 2
    bpy.context.view_layer.update()
    inputs = addon("data.versions")
    inputs.set_input(player.modifiers["Points"], "Surface", True)
    where = player.matrix_world.copy()
    assert bake(torn) == player
    assert player.matrix_world == where
    assert inputs.input_value(player.modifiers["Points"], "Surface")


def test_frames_follow_a_morph_that_was_moved(torn):
    player = bake(torn)
    bpy.context.view_layer.update()
    torn.location.x += 2
    bpy.context.view_layer.update()
    assert bake(torn) == player
    bpy.context.view_layer.update()
    np.testing.assert_allclose(player.location, torn.location)


def test_each_scene_has_frames_of_its_own(torn):
    player = bake(torn)
    bpy.context.scene.collection.objects.unlink(player)
    bpy.data.scenes.new("Other").collection.objects.link(player)
    assert bake(torn) != player


def test_one_kind_of_frames_is_shown_at_a_time(addon, torn, monkeypatch):
    """Those with faces in files of Blender, or those of points."""
    surfaces = addon("operators.bakes").pointmorph.sequences.surfaces
    if not surfaces.is_available():
        pytest.skip("without packages that make faces")
    points = bake(torn, step=8)
    faces = bake(torn, step=8, faces=True)
    assert faces != points
    assert (points.hide_get(), points.hide_render) == (True, True)
    assert bake(torn, step=8) == points
    assert (points.hide_get(), faces.hide_get(), faces.hide_render) == (False, True, True)


def test_nodes_of_an_earlier_version_are_replaced(torn):
    player = bake(torn)
    wanted = baked_frames(player)
    modifiers = [player.modifiers[name] for name in ("Cache Rows", "Points")]
    for modifier in modifiers:
        modifier.node_group = modifier.node_group.copy()
        modifier.node_group["pointmorph_version"] = "an earlier one"
    bake(torn)
    for modifier in modifiers:
        assert modifier.node_group["pointmorph_version"] != "an earlier one"
    assert_same(shown(player, 5), wanted[4])


def test_too_many_points_are_refused_before_the_work(addon, torn, monkeypatch):
    cache = addon("core.frame_cache")
    monkeypatch.setattr(cache, "MOST", 10)
    monkeypatch.setattr(addon("operators.bakes").pointmorph.sequences, "FrameStore", None)
    select(torn)
    with pytest.raises(RuntimeError, match="Whole to Torn: expected at most 10 points"):
        bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3)


def test_ids_that_floats_do_not_hold_are_refused(addon, torn, monkeypatch):
    monkeypatch.setattr(addon("core.frame_cache"), "_LAST_ID", 5)
    select(torn)
    with pytest.raises(RuntimeError, match="Whole to Torn: expected IDs of points up to 5"):
        bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3)


def test_a_duplicate_keeps_the_frames_that_it_has(torn, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    torn = bpy.data.objects["Whole to Torn"]
    player = bake(torn)
    select(player)
    bpy.ops.object.duplicate()
    twin = bpy.context.view_layer.objects.active
    before = baked_frames(twin)
    bake(torn, resample=False, step=4)
    counts = sorted(len(baked_frames(one)) for one in (player, twin))
    assert counts == [3, 9]
    kept = next(one for one in (player, twin) if len(baked_frames(one)) == 9)
    np.testing.assert_array_equal(baked_frames(kept)[4]["position"], before[4]["position"])
    assert len(list((tmp_path / "blendcache_shot").iterdir())) == 2


def test_a_file_that_is_saved_later_takes_its_frames_along(torn, tmp_path, capfd):
    player = bake(torn)
    assert "Save the file" in capfd.readouterr().out
    assert cache_of(player).is_relative_to(bpy.app.tempdir)
    wanted = baked_frames(player)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copy.blend"), copy=True)
    assert_same(shown(player, 5), wanted[4])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert_same(shown(bpy.data.objects["Whole to Torn Frames"], 5), wanted[4])
    for name in ("shot.blend", "copy.blend"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / name))
        assert_same(shown(bpy.data.objects["Whole to Torn Frames"], 5), wanted[4])


def test_discs_are_made_ahead_for_all_frames(addon, torn, capfd):
    """While they are shown; those that a frame doesn't need have no extent."""
    player = bake(torn)
    frames = baked_frames(player)
    versions, modifier = addon("data.versions"), player.modifiers["Points"]
    faces = versions.input_value(modifier, "Faces of Discs")

    def seen(obj):
        return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data

    def discs_at(number):
        bpy.context.scene.frame_set(number)
        mesh = seen(player)
        places = coordinates(mesh.vertices).reshape(-1, 6, 3)
        return places, attribute(mesh, "Color").reshape(-1, 6, 4), attribute(mesh, "velocity")

    assert len(seen(faces).polygons) <= 1
    versions.set_input(modifier, "Discs", True)
    player.update_tag()
    bpy.context.view_layer.update()
    most = max(len(frame["id"]) for frame in frames)
    assert len(seen(faces).polygons) == most
    for number in (9, 1, 5, 6):
        ahead = discs_at(number)
        count = len(frames[number - 1]["id"])
        assert len(ahead[0]) == most
        place = frames[number - 1]["position"]
        np.testing.assert_allclose(ahead[0][:count].mean(axis=1), place, atol=1e-6)
        assert np.abs(ahead[0][count:] - place[-1]).max(initial=0.0) == 0.0
        versions.set_input(modifier, "Faces of Discs", None)
        player.update_tag()
        for values, known in zip(discs_at(number), ahead, strict=True):
            np.testing.assert_array_equal(values, known[: len(values)])
        versions.set_input(modifier, "Faces of Discs", faces)
        player.update_tag()
    again = bake(torn)
    assert again == player
    assert versions.input_value(modifier, "Faces of Discs") == faces
    versions.set_input(modifier, "Discs", False)
    player.update_tag()
    bpy.context.view_layer.update()
    assert len(seen(faces).polygons) <= 1
    # Some versions print it, others log it.
    assert "Dependency cycle" not in "".join(capfd.readouterr())


def test_discs_of_a_copy_are_its_own(addon, torn):
    """They can be on while those of the first one are off, and are made ahead all the same."""
    player = bake(torn)
    select(player)
    bpy.ops.object.duplicate()
    twin = bpy.context.view_layer.objects.active
    versions = addon("data.versions")
    faces = [
        versions.input_value(one.modifiers["Points"], "Faces of Discs") for one in (player, twin)
    ]
    assert faces[0] != faces[1]
    versions.set_input(twin.modifiers["Points"], "Discs", True)
    twin.update_tag()
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    made = [len(one.evaluated_get(depsgraph).data.polygons) for one in faces]
    assert made == [1, max(len(frame["id"]) for frame in baked_frames(player))]
    # Another bake is of one of them, and leaves the other its own.
    bake(torn, resample=False)
    after = [
        versions.input_value(one.modifiers["Points"], "Faces of Discs") for one in (player, twin)
    ]
    assert after == faces


def test_discs_are_turned_on_without_the_add_on(addon, torn, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    player = bake(bpy.data.objects["Whole to Torn"])
    path = tmp_path / "off.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    addon("data.versions").set_input(player.modifiers["Points"], "Discs", True)
    player.update_tag()
    found = played(path, player.name, turned_on="Discs")
    for frame in (1, 7):
        bpy.context.scene.frame_set(frame)
        expected = surface_of(player)
        assert len(expected) > 100
        np.testing.assert_array_equal(found[f"{player.name} {frame}"], expected)


def test_a_file_that_is_gone_shows_nothing(torn):
    player = bake(torn)
    cache_of(player).unlink()
    bpy.context.scene.frame_set(3)
    count = sum(
        len(instance.object.data.points)
        for instance in bpy.context.evaluated_depsgraph_get().object_instances
        if instance.object.type == "POINTCLOUD"
    )
    assert count == 0


def test_a_blender_without_the_add_on_plays_it(torn, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    player = bake(bpy.data.objects["Whole to Torn"])
    bpy.ops.wm.save_mainfile()
    frames = baked_frames(player)
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    for path in list(tmp_path.iterdir()):
        if path != folder:
            path.rename(folder / path.name)
    numbers = (1, 5, 9)
    found = played(folder / "shot.blend", player.name, frames=numbers)
    for number in numbers:
        places = found[f"{player.name} {number}"].astype(float)
        assert len(places) == len(frames[number - 1]["id"])
        expected = frames[number - 1]["position"].astype(float)
        assert places.sum() == pytest.approx(float(expected.sum()))


def test_another_morph_has_frames_of_its_own(torn):
    first = bake(torn)
    pair()
    second = bake(morph())
    assert first != second
    assert cache_of(first) != cache_of(second)
    assert len(baked_frames(first)) == len(baked_frames(second)) == 9


def test_faces_by_nodes(addon, settings, monkeypatch):
    """Where Blender's Python has no packages for it, its own nodes put faces through the points."""
    if not bpy.app.build_options.openvdb:
        pytest.skip("this Blender was built without volumes")
    surfaces = addon("operators.bakes").pointmorph.sequences.surfaces
    monkeypatch.setattr(surfaces, "is_available", lambda: False)
    source, _ = pair(24, 20)
    player = bake(morph(), faces=True)
    for frame in (1, 5):
        bpy.context.scene.frame_set(frame)
        evaluated = player.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = evaluated.data
        assert len(mesh.polygons) > 500
        assert mesh.color_attributes.active_color.name == "Color"
        assert mesh.materials[mesh.polygons[0].material_index].name == "Pointmorph Points"
        names = {item.name for item in mesh.attributes}
        assert "velocity" in names
        assert not [name for name in names if name.startswith("pointmorph")]
    bpy.context.scene.frame_set(1)
    mesh = player.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    places = coordinates(mesh.vertices) + np.array(player.location)
    inside = np.abs(places[:, :2]).max(axis=1) < 0.9
    apart = [
        np.linalg.norm(np.array(source.closest_point_on_mesh(p)[1]) - p)
        for p in places[inside].tolist()
    ]
    assert max(apart) < 0.3 * 2 / 23  # of the spacing
    normals = np.array([polygon.normal[2] for polygon in mesh.polygons])
    assert (normals > 0).mean() > 0.97  # as the sheet's: one side only
    # Baked as points again, it shows points: it was the bake that had turned faces on.
    assert bake(bpy.data.objects["Hill to Dune"]) == player
    assert len(shown_cloud(player).points)


def test_faces_by_nodes_go_to_no_file(addon, torn, tmp_path, monkeypatch):
    surfaces = addon("operators.bakes").pointmorph.sequences.surfaces
    monkeypatch.setattr(surfaces, "is_available", lambda: False)
    select(torn)
    with pytest.raises(RuntimeError, match="packages pymeshlab and scipy"):
        bpy.ops.pointmorph.bake_frames(faces=True, format="PLY", directory=str(tmp_path))
