"""Frames of morph objects whose shapes move meanwhile."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from modeling import add_armature
from pointmorph import formats
from pointmorph.sequences import surfaces
from scenes import (
    add_mesh,
    attribute,
    baked_frames,
    mark,
    morph,
    pair,
    patch,
    row_pairs,
    select,
    shown_points,
    torn_pair,
)
from test_following import bend, in_world, morph_and_follow, swell, travel
from test_frames import bake

LAST = 9


def frame_points(player, number):
    """(N, 3): what a bake shows in the world at a frame, points in the order of their ids."""
    bpy.context.scene.frame_set(number)
    matrix = np.array(player.matrix_world)
    return shown_points(player) @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("motion", [bend, swell, travel])
@pytest.mark.parametrize("resample", [True, False])
def test_each_frame_lies_between_the_shapes_of_that_frame(settings, motion, resample):
    source, target = pair()
    for obj in (source, target):
        motion(obj)
    obj = morph_and_follow()
    obj.matrix_world = Matrix.Translation((0.4, 0, 0)) @ Matrix.Rotation(0.5, 4, "Z")
    rows = row_pairs(obj)
    bpy.context.scene.frame_set(6, subframe=0.25)
    assert bake(resample=resample) == {"FINISHED"}
    scene = bpy.context.scene
    assert (scene.frame_current, scene.frame_subframe) == (6, 0.25)
    player = bpy.context.view_layer.objects.active
    for number in (1, 4, LAST):
        scene.frame_set(number)
        t = (number - 1) / (LAST - 1)
        start, end = in_world(source)[rows[:, 0]], in_world(target)[rows[:, 1]]
        found = frame_points(player, number)
        np.testing.assert_allclose(found[: len(rows)], (1 - t) * start + t * end, atol=1e-5)
        if not resample:
            assert len(found) == len(rows)


@pytest.mark.parametrize("applied", [False, True])
def test_frames_of_a_morph_that_is_animated_say_that_they_stay(settings, capfd, applied):
    """And go along once they are its children."""
    settings.show_as = "MESH"
    pair()
    shown = morph()
    shown.scale = (2, 2, 2)
    if applied:
        assert bpy.ops.object.transform_apply() == {"FINISHED"}
    for frame, x in ((1, 0.0), (LAST, 5.0)):
        shown.location.x = x
        shown.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(1)
    capfd.readouterr()
    assert bake() == {"FINISHED"}
    frames = bpy.context.view_layer.objects.active
    said = f'"{frames.name}" stays where "{shown.name}" is in this frame'
    assert said in capfd.readouterr().out
    before = frame_points(frames, LAST)
    bpy.context.scene.frame_set(1)
    shown.hide_set(False)
    shown.select_set(True)
    bpy.context.view_layer.objects.active = shown
    assert bpy.ops.object.parent_set(type="OBJECT", keep_transform=True) == {"FINISHED"}
    np.testing.assert_allclose(frame_points(frames, LAST), before + (5, 0, 0), atol=1e-5)
    bpy.context.scene.frame_set(1)
    select(shown)
    assert bake() == {"FINISHED"}
    assert "stays where" not in capfd.readouterr().out


def test_frames_of_a_mesh_that_a_rig_moves_say_that_they_are_at_rest(settings, capfd):
    settings.show_as = "MESH"
    source, _ = pair()
    add_armature(source, (0, 0, 0))
    shown = morph()
    assert bake() == {"FINISHED"}
    assert "without the pose" not in capfd.readouterr().out
    bpy.data.objects["Rig"].pose.bones["Bone"].location = (0, 0, 0.5)
    select(shown)
    assert bake() == {"FINISHED"}
    assert f'"Hill" gives to "{shown.name}"' in capfd.readouterr().out
    bpy.ops.pointmorph.show_as(kind="POINTS")
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    assert bake() == {"FINISHED"}
    assert "without the pose" not in capfd.readouterr().out


def test_velocities_and_normals_go_along(settings):
    source, target = pair()
    for obj in (source, target):
        bend(obj, 1.5)
    obj = morph_and_follow()
    rows = row_pairs(obj)
    bake(resample=False)
    player = bpy.context.view_layer.objects.active
    frames = baked_frames(player)
    before, here, after = (frames[k]["position"] for k in (3, 4, 5))
    np.testing.assert_allclose(frames[4]["velocity"], (after - before) / 2, atol=1e-6)
    assert np.abs(after - before).max() > 0.05
    np.testing.assert_array_equal(frames[4]["id"], np.arange(len(here)))
    bpy.context.scene.frame_set(1)
    normals = np.array([v.normal for v in source.data.vertices])
    np.testing.assert_allclose(frames[0]["Normal"], normals[rows[:, 0]], atol=1e-4)
    bpy.context.scene.frame_set(LAST)
    shown = target.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    normals = np.array([v.normal for v in shown.vertices])
    np.testing.assert_allclose(frames[-1]["Normal"], normals[rows[:, 1]], atol=1e-4)


def test_new_points_keep_their_ids_and_go_along(settings):
    """A sheet that tears and travels meanwhile: the crack is closed in every frame."""
    sheets = torn_pair()
    at_rest = morph()
    bake()
    rest = baked_frames(bpy.context.view_layer.objects.active)
    for obj in sheets:
        for frame, y in ((1, 0.0), (LAST, 2.0)):
            obj.location.y = y
            obj.keyframe_insert("location", frame=frame)
        curve = obj.animation_data.action
        curves = curve.fcurves if hasattr(curve, "fcurves") else None
        if curves is None:  # Blender 5
            curves = curve.layers[0].strips[0].channelbags[0].fcurves
        for one in curves:
            for point in one.keyframe_points:
                point.interpolation = "LINEAR"
    bpy.context.scene.frame_set(1)
    select(at_rest)
    bpy.ops.pointmorph.follow()
    bake()
    moving = baked_frames(bpy.context.view_layer.objects.active)
    pairs = len(at_rest.data.vertices)
    assert len(moving[4]["id"]) > pairs + 20
    for k, (one, other) in enumerate(zip(rest, moving, strict=True)):
        np.testing.assert_array_equal(one["id"], other["id"])
        way = np.float32([0, 2.0 * k / (LAST - 1), 0])
        places = one["position"] + way
        np.testing.assert_allclose(other["position"], places, atol=2e-5)
        np.testing.assert_allclose(one["Radius"], other["Radius"], rtol=1e-4)
        speed = other["velocity"] - one["velocity"]
        np.testing.assert_allclose(speed[:, 1], 0.25, atol=1e-4)


def test_a_chain(settings):
    source, target = pair()
    settings.via.add().object = add_mesh("Fell", *patch(13))
    middle = settings.via[0].object
    for name, *place in (("peak", 0, 0), ("slope", 0.5, 0.3)):
        mark(middle, name, *place)
    for obj in (source, middle, target):
        swell(obj)
    bpy.context.scene.frame_set(1)
    bpy.ops.pointmorph.morph_chain()
    obj = bpy.context.view_layer.objects.active
    bpy.ops.pointmorph.follow()
    rows = [attribute(obj.data, f"{stage}_row") for stage in ("source", "via1", "target")]
    bake()
    player = bpy.context.view_layer.objects.active
    for number, shape, row in zip((1, 5, 9), (source, middle, target), rows, strict=True):
        bpy.context.scene.frame_set(number)
        places = in_world(shape)[row]
        np.testing.assert_allclose(
            frame_points(player, number)[: len(row)], places, atol=1e-5, err_msg=shape.name
        )


def test_points_that_come_up_on_the_way_are_refused(settings):
    source, _ = pair()
    obj = morph_and_follow()
    finer = source.modifiers.new("Build", "BUILD")
    finer.frame_start, finer.frame_duration = -9, 5
    build = source.modifiers["Build"]
    for frame, shown in ((1, False), (6, True)):
        build.show_viewport = shown
        build.keyframe_insert("show_viewport", frame=frame)
    build.use_reverse = True
    bpy.context.scene.frame_set(1)
    select(obj)
    with pytest.raises(RuntimeError, match="Hill: expected 144 points in every frame"):
        bake()
    assert bpy.context.scene.frame_current == 1


def test_files_of_points_and_faces(settings, tmp_path):
    """PLY files go on, too, and start over when a shape moves in another way."""
    source, target = pair(20, 18)
    for obj in (source, target):
        travel(obj)
    obj = morph_and_follow()
    faces = surfaces.is_available()
    options = {"format": "PLY", "directory": str(tmp_path), "faces": faces, "step": 4}
    assert bake(**options) == {"FINISHED"}
    names = sorted(path.name for path in tmp_path.glob("frame_*.ply"))
    assert names == ["frame_0001.ply", "frame_0005.ply", "frame_0009.ply"]
    places = formats.read(tmp_path / names[-1]).positions
    rows = row_pairs(obj)
    bpy.context.scene.frame_set(LAST)
    np.testing.assert_allclose(places[: len(rows)], in_world(target)[rows[:, 1]], atol=1e-5)
    if faces:
        mesh = formats.read(tmp_path / "mesh_0009.ply").positions
        # Past the border by up to 1.5 spacings on either side.
        np.testing.assert_allclose(np.ptp(mesh, axis=0), np.ptp(places, axis=0), atol=0.4)
        np.testing.assert_allclose(mesh.mean(axis=0), places.mean(axis=0), atol=0.1)
    bpy.context.scene.frame_set(1)
    times = {path: path.stat().st_mtime_ns for path in tmp_path.glob("frame_*.ply")}
    bake(**options)
    assert {path: path.stat().st_mtime_ns for path in times} == times
    target.location.z = 1.0
    target.keyframe_insert("location", frame=1)
    bake(**options)
    assert all(path.stat().st_mtime_ns != before for path, before in times.items())
