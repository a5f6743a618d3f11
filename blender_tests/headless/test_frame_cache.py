"""Frames in the scene are a file on disk that Blender reads frame by frame, without the add-on."""

import json
import os
import subprocess
import sys
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
    select,
    shown_cloud,
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
    return Path(bpy.path.abspath(player.modifiers["Mesh Cache"].filepath))


def shown(player, frame, subframe=0.0):
    """What is shown at a frame: positions, and attributes by name."""
    bpy.context.scene.frame_set(frame, subframe=subframe)
    cloud = shown_cloud(player)
    return {"position": coordinates(cloud.points), **{n: attribute(cloud, n) for n in NAMES}}


def assert_same(found, wanted):
    for name, values in found.items():
        known = wanted["Radius" if name == "radius" else name]
        np.testing.assert_array_equal(values, known, err_msg=name)


def test_what_is_shown_has_the_bits_of_the_file(torn):
    player = bake(torn)
    frames = baked_frames(player)
    assert len({len(frame["id"]) for frame in frames}) > 3
    for number in (9, 1, 5, 6):
        assert_same(shown(player, number), frames[number - 1])
    assert_same(shown(player, 5, 0.75), frames[4])
    assert_same(shown(player, -20), frames[0])
    assert_same(shown(player, 99), frames[8])


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
    assert [path.name for path in (tmp_path / "blendcache_shot").iterdir()] == [
        "Whole_to_Torn_Frames.pc2"
    ]


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


PLAY = """
import json, os, sys
import bpy, numpy as np
assert not hasattr(bpy.types.Scene, "pointmorph")
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
found = []
for number in (1, 5, 9):
    bpy.context.scene.frame_set(number)
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "POINTCLOUD":
            points = instance.object.data.points
            places = np.empty(3 * len(points), np.float32)
            points.foreach_get("co", places)
            found.append((len(points), float(places.astype(float).sum())))
print("FOUND", json.dumps(found))
sys.stdout.flush()
os._exit(0)  # Blender as a Python module doesn't always survive its own end
"""


@pytest.mark.skipif(bool(bpy.app.binary_path), reason="about Blender as a Python module")
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
    environment = {**os.environ, "PYTHONPATH": str(Path(bpy.__file__).parents[5])}
    said = subprocess.run(
        [sys.executable, "-c", PLAY, str(folder / "shot.blend")],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert "FOUND" in said.stdout, said.stderr
    line = next(line for line in said.stdout.splitlines() if line.startswith("FOUND"))
    found = json.loads(line.removeprefix("FOUND "))
    for (count, total), number in zip(found, (1, 5, 9), strict=True):
        assert count == len(frames[number - 1]["id"])
        assert total == pytest.approx(float(frames[number - 1]["position"].astype(float).sum()))


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
    surfaces = addon("operators.bakes").pointmorph.surfaces
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
    # Baked as points again, it shows points.
    assert bake(bpy.data.objects["Hill to Dune"]) == player
    assert len(shown_cloud(player).points)


def test_faces_by_nodes_go_to_no_file(addon, torn, tmp_path, monkeypatch):
    surfaces = addon("operators.bakes").pointmorph.surfaces
    monkeypatch.setattr(surfaces, "is_available", lambda: False)
    select(torn)
    with pytest.raises(RuntimeError, match="packages pymeshlab and scipy"):
        bpy.ops.pointmorph.bake_frames(faces=True, format="PLY", directory=str(tmp_path))
