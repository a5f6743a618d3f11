"""Morph objects that follow sources and targets which move."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_object,
    add_point_cloud,
    coordinates,
    data_blocks,
    key,
    morph,
    pair,
    patch,
    recompute,
    row_pairs,
    select,
    shown_points,
)

pytestmark = pytest.mark.interface


def bend(obj, angle=1.0):
    """An armature of two bones with weights, which bends the object from frame 1 to frame 11."""
    armature = bpy.data.armatures.new("Rig")
    rig = add_object("Rig", armature)
    select(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    for number, x in enumerate((-1.0, 0.0)):
        bone = armature.edit_bones.new(f"bone{number}")
        bone.head, bone.tail = (x, 0, 0), (x + 1, 0, 0)
        if number:
            bone.parent = armature.edit_bones["bone0"]
    bpy.ops.object.mode_set(mode="OBJECT")
    x = coordinates(obj.data.vertices)[:, 0]
    for name, weights in (("bone0", 0.5 - x / 2), ("bone1", 0.5 + x / 2)):
        group = obj.vertex_groups.new(name=name)
        for row, weight in enumerate(weights):
            group.add([row], float(np.clip(weight, 0, 1)), "REPLACE")
    obj.modifiers.new("Rig", "ARMATURE").object = rig
    bone = rig.pose.bones["bone1"]
    bone.rotation_mode = "XYZ"
    for frame, value in ((1, 0.0), (11, angle)):
        bone.rotation_euler.z = value
        bone.keyframe_insert("rotation_euler", frame=frame)


def swell(obj):
    """A shape key that grows from frame 1 to frame 11."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    fat = obj.shape_key_add(name="Fat", from_mix=False)
    for point in fat.data:
        point.co *= 1.7
    for frame, value in ((1, 0.0), (11, 1.0)):
        fat.value = value
        fat.keyframe_insert("value", frame=frame)


def travel(obj):
    for frame, x in ((1, 0.0), (11, 3.0)):
        obj.location.x = x
        obj.rotation_euler.z = x / 3
        obj.keyframe_insert("location", frame=frame)
        obj.keyframe_insert("rotation_euler", frame=frame)


def in_world(obj):
    """(N, 3): the vertices or points of an object as they are shown."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = evaluated.data
    places = coordinates(data.points if hasattr(data, "points") else data.vertices)
    matrix = np.array(evaluated.matrix_world)
    return places @ matrix[:3, :3].T + matrix[:3, 3]


def shown_in_world(obj):
    matrix = np.array(obj.matrix_world)
    return shown_points(obj) @ matrix[:3, :3].T + matrix[:3, 3]


def morph_and_follow():
    bpy.context.scene.frame_set(1)
    obj = morph()
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    assert obj.pointmorph.follows
    return obj


def assert_it_follows(obj, source, target):
    rows = row_pairs(obj)
    t = obj.data.shape_keys.key_blocks["Morph"]
    for frame in (1, 4, 11, 20):
        bpy.context.scene.frame_set(frame)
        for value in (0.0, 1.0, 0.25):
            t.value = value
            bpy.context.view_layer.update()
            start, end = in_world(source)[rows[:, 0]], in_world(target)[rows[:, 1]]
            np.testing.assert_allclose(
                shown_in_world(obj), (1 - value) * start + value * end, atol=2e-6
            )


@pytest.mark.parametrize("motion", [bend, swell, travel])
def test_it_is_the_source_at_0_and_the_target_at_1_in_every_frame(settings, motion):
    source, target = pair()
    for obj in (source, target):
        motion(obj)
    target.matrix_world = Matrix.Translation((0.3, 0.2, 0)) @ target.matrix_world
    obj = morph_and_follow()
    assert_it_follows(obj, source, target)
    assert obj.pointmorph.state == "CURRENT"


def test_a_mesh_says_how_it_follows(settings):
    settings.show_as = "MESH"
    pair()
    morph()
    with pytest.raises(RuntimeError, match="as points or discs first.*Keep Modifiers"):
        bpy.ops.pointmorph.follow()


@pytest.mark.parametrize("motion", [bend, swell])
def test_a_source_that_was_posed_is_followed_itself(settings, motion):
    """A copy of it as shown is morphed, which stands still."""
    source, target = pair()
    motion(source)
    source.modifiers.new("Twice", "MIRROR").use_axis = (False, False, True)
    bpy.context.scene.frame_set(7)
    obj = morph()
    copy = settings.source
    assert copy.pointmorph.shown_from == source
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    assert_it_follows(obj, source, target)
    bpy.context.scene.frame_set(7)
    np.testing.assert_allclose(in_world(source), in_world(copy), atol=1e-5)
    # A copy that was edited is another shape, also where it has as many vertices.
    bpy.ops.pointmorph.follow()
    copy.data.vertices[0].co.z += 0.5
    copy.data.update()
    recompute(obj)
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    assert_it_follows(obj, copy, target)
    bpy.ops.pointmorph.follow()
    copy.data.vertices.add(1)
    copy.data.update()
    recompute(obj)
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    assert_it_follows(obj, copy, target)


def test_after_save_load_and_duplicate(settings, tmp_path):
    source, target = pair()
    swell(source)
    bend(target)
    obj = morph_and_follow()
    select(obj)
    bpy.ops.object.duplicate()
    path = str(tmp_path / "follow.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    source, target, *objects = (
        bpy.data.objects[name] for name in ("Hill", "Dune", "Hill to Dune", "Hill to Dune.001")
    )
    for obj in objects:
        assert_it_follows(obj, source, target)


def test_after_a_recompute_with_other_points(settings):
    source, target = pair()
    swell(target)
    obj = morph_and_follow()
    positions, faces = patch(17)
    mesh = bpy.data.meshes.new("Finer")
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    source.data = mesh
    for shape in (source, target):
        shape.vertex_groups.clear()
    # Until then, what was morphed is shown: nothing collapses.
    bpy.context.scene.frame_set(11)
    np.testing.assert_allclose(shown_points(obj), key(obj, "Basis"), atol=1e-6)
    bpy.context.scene.frame_set(1)
    select(obj)
    bpy.ops.pointmorph.recompute()
    assert_it_follows(obj, source, target)


def test_normals_turn_along(settings):
    source, _ = pair()
    bend(source, 1.5)
    obj = morph_and_follow()
    bpy.context.scene.frame_set(11)
    evaluated = source.evaluated_get(bpy.context.evaluated_depsgraph_get())
    normals = np.array([v.normal for v in evaluated.data.vertices])
    np.testing.assert_allclose(
        shown_points(obj, "Normal"), normals[row_pairs(obj)[:, 0]], atol=1e-4
    )


def test_point_clouds(settings):
    for side, name, size in (("source", "Hill", 16), ("target", "Dune", 15)):
        positions, _ = patch(size)
        setattr(settings, side, add_point_cloud(name, positions, {}))
        travel(getattr(settings, side))
    obj = morph_and_follow()
    assert_it_follows(obj, settings.source, settings.target)


def test_off_again(settings):
    source, _ = pair()
    swell(source)
    obj = morph_and_follow()
    modifiers = [m.name for m in obj.modifiers]
    assert modifiers[:2] == ["Path", "Follow"]
    bpy.ops.pointmorph.follow()
    assert not obj.pointmorph.follows
    assert [m.name for m in obj.modifiers] == ["Path", *modifiers[2:]]
    assert len(obj.animation_data.drivers) == 2
    bpy.context.scene.frame_set(11)
    np.testing.assert_allclose(shown_points(obj), key(obj, "Basis"), atol=1e-6)


@pytest.mark.parametrize("gone", ["source", "target"])
def test_without_a_parent_it_shows_what_was_morphed(settings, gone):
    source, target = pair()
    travel(source)
    obj = morph_and_follow()
    bpy.data.objects.remove(source if gone == "source" else target)
    bpy.context.scene.frame_set(11)
    np.testing.assert_allclose(shown_points(obj), key(obj, "Basis"), atol=1e-6)
    bpy.ops.pointmorph.follow()
    with pytest.raises(RuntimeError, match="to follow them, found one that no longer exists"):
        bpy.ops.pointmorph.follow()


def test_modifiers_that_add_vertices_are_refused(settings):
    source, _ = pair()
    source.modifiers.new("Finer", "SUBSURF")
    bpy.ops.pointmorph.morph()
    before = data_blocks()
    with pytest.raises(RuntimeError, match="Hill: expected the 144 points .* Disable the modif"):
        bpy.ops.pointmorph.follow()
    assert data_blocks() == before


def test_shape_keys_say_that_they_cannot_follow(settings):
    pair()
    morph_and_follow()
    for kind in ("SOURCE", "PAIRS"):
        with pytest.raises(RuntimeError, match="can't follow moving shapes"):
            bpy.ops.pointmorph.bake_shape_keys(kind=kind)


@pytest.mark.renders
def test_it_renders_in_motion(settings, output):
    """Without any handler: what a farm renders is what the viewport shows."""
    source, target = pair(40, 36)
    for shape in (source, target):
        travel(shape)
        shape.hide_render = True
    morph_and_follow()
    scene = bpy.context.scene
    camera = add_object("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = 8
    camera.location.z = 5
    scene.camera = camera
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = 64
    centers = []
    for frame in (1, 11):
        scene.frame_set(frame)
        scene.render.filepath = str(output / f"follow_{frame}.png")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath)
        alpha = np.array(picture.pixels[:]).reshape(64, 64, 4)[..., 3]
        centers.append(np.average(np.arange(64), weights=alpha.sum(axis=0)))
    assert centers[1] - centers[0] == pytest.approx(3 / 8 * 64, abs=2)
