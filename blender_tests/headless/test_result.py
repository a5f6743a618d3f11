"""What a morph object survives, and how it is made again."""

import json

import bpy
import numpy as np
import pytest
from scenes import (
    add_object,
    assert_same,
    attribute,
    content,
    key,
    morph,
    move_vertices,
    pair,
    patch,
    recompute,
    row_pairs,
    select,
    shown_points,
    slider,
)

pytestmark = pytest.mark.interface


def save_and_open(tmp_path):
    path = str(tmp_path / "morph.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)


# --- Recompute in place ---------------------------------------------------------------------------


def test_recompute_keeps_name_animation_drivers_materials_and_modifiers(addon, settings):
    source, target = pair()
    obj = morph()
    obj.name, obj.data.name = "My morph", "My mesh"
    for frame, value in ((1, 0.0), (11, 1.0)):
        slider(obj).value = value
        slider(obj).keyframe_insert("value", frame=frame)
    follower = add_object("Follower", None)
    curve = follower.driver_add("location", 2)
    curve.driver.type = "AVERAGE"
    addon("data.nodes").drive(curve.driver, slider(obj))
    obj.data.materials.append(bpy.data.materials.new("Mine"))
    obj.rotation_euler.x = 0.3
    display, versions = addon("scene.points_display"), addon("data.versions")
    modifier = obj.modifiers[display.MODIFIER]
    versions.set_input(modifier, "Radius Scale", 3.0)
    later = obj.modifiers.new("Later", "SIMPLE_DEFORM")
    identity = (obj.as_pointer(), obj.data.as_pointer(), obj.data.shape_keys.as_pointer())

    positions, faces = patch(31)
    finer = bpy.data.meshes.new("Finer")
    finer.from_pydata(positions.tolist(), [], faces.tolist())
    source.data = finer
    source.vertex_groups.clear()
    target.vertex_groups.clear()
    recompute(obj)

    assert len(np.unique(row_pairs(obj)[:, 0])) == 31 * 31
    assert (obj.name, obj.data.name) == ("My morph", "My mesh")
    assert identity == (obj.as_pointer(), obj.data.as_pointer(), obj.data.shape_keys.as_pointer())
    assert [m.name for m in obj.data.materials] == ["Mine"]
    assert [m.name for m in obj.modifiers] == ["Path", display.MODIFIER, later.name]
    assert versions.input_value(modifier, "Radius Scale") == 3.0
    assert obj.rotation_euler.x == pytest.approx(0.3)
    obj.modifiers.remove(later)
    for frame, t in ((1, 0.0), (6, 0.5), (11, 1.0)):
        bpy.context.scene.frame_set(frame)
        assert follower.matrix_world.translation.z == pytest.approx(t)
        np.testing.assert_allclose(
            shown_points(obj), (1 - t) * key(obj, "Basis") + t * key(obj, "Morph"), atol=1e-5
        )


@pytest.mark.parametrize("side", [31, 15])
def test_keys_and_weights_on_the_morph_object_follow(settings, side):
    source, target = pair()
    obj = morph()
    bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=2, path="LINEAR")
    own = obj.shape_key_add(name="Own", from_mix=False)
    for point in own.data:
        point.co.x += 2
    group = obj.vertex_groups.new(name="half")
    group.add([int(v) for v in np.flatnonzero(key(obj, "Basis")[:, 0] < 0)], 0.25, "REPLACE")
    move_vertices(target, (0, 0, 0.2))
    recompute(obj)
    start, end = key(obj, "Basis"), key(obj, "Morph")
    np.testing.assert_allclose(key(obj, "Dune 50 %"), (start + end) / 2, atol=1e-6)
    np.testing.assert_array_equal(key(obj, "Dune"), end)
    np.testing.assert_allclose(key(obj, "Own"), start + (2, 0, 0), atol=1e-6)
    for vertex, place in zip(obj.data.vertices, start, strict=True):
        weights = [element.weight for element in vertex.groups if element.group == group.index]
        assert weights == ([0.25] if place[0] < 0 else [])
    # With other points there is nothing to put a user's own key on.
    mesh = bpy.data.meshes.new("Other")
    positions, faces = patch(side)
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    source.data = mesh
    for shape in (source, target):
        shape.vertex_groups.clear()
    recompute(obj)
    assert np.array_equal(key(obj, "Own"), key(obj, "Basis"))
    np.testing.assert_array_equal(key(obj, "Dune"), key(obj, "Morph"))


def test_it_goes_along_with_its_source_unless_it_was_put_elsewhere(settings):
    source, target = pair()
    obj = morph()
    for shape in (source, target):
        shape.location.x += 5
    recompute(obj)
    assert obj.location == source.location
    obj.location.y = 7
    source.location.x += 1
    recompute(obj)
    assert tuple(obj.location) == (5, 7, 0)


def test_a_morph_of_an_earlier_version(settings):
    pair()
    obj = morph()
    before = content(obj)
    obj.pointmorph.recipe = ""
    assert obj.pointmorph.state == "UNKNOWN"
    assert "earlier version" in obj.pointmorph.stale
    recompute(obj)
    assert obj.pointmorph.state == "CURRENT"
    assert_same(content(obj), before)
    obj.pointmorph.recipe = ""
    bpy.data.objects.remove(settings.target)
    with pytest.raises(RuntimeError, match="Choose two objects and morph again"):
        recompute(obj)


def test_an_error_leaves_it_as_it_was(settings):
    _, target = pair()
    obj = morph()
    before = content(obj)
    target.vertex_groups.remove(target.vertex_groups["pm.peak"])
    with pytest.raises(RuntimeError, match='Dune: expected a vertex group "pm.peak"'):
        recompute(obj)
    assert_same(content(obj), before)
    assert obj.pointmorph.state == "STALE"


def test_parts_that_were_taken_out(settings):
    pair()
    obj = morph()
    obj.data.attributes.remove(obj.data.attributes["target_radius"])
    for run in (bpy.ops.pointmorph.recompute, bpy.ops.pointmorph.follow):
        with pytest.raises(RuntimeError, match="Hill to Dune: expected the attribute target_rad"):
            run()
    slider(obj).name = "Other"
    with pytest.raises(RuntimeError, match='with its shape key "Morph", found none of that'):
        bpy.ops.pointmorph.follow()


def test_in_edit_mode(settings):
    pair()
    obj = morph()
    select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match='Switch "Hill to Dune" to Object Mode'):
        bpy.ops.pointmorph.recompute()


# --- What it survives -----------------------------------------------------------------------------


def test_save_and_load_then_recompute(settings, tmp_path):
    pair()
    settings.transfer_neighbors = 20
    obj = morph()
    before = content(obj)
    save_and_open(tmp_path)
    obj = bpy.data.objects["Hill to Dune"]
    assert obj.pointmorph.state == "CURRENT"
    move_vertices(bpy.data.objects["Dune"], (0, 0, 0.1))
    assert obj.pointmorph.state == "STALE"
    move_vertices(bpy.data.objects["Dune"], (0, 0, -0.1))
    recompute(obj)
    assert np.array_equal(content(obj)["Basis"], before["Basis"])
    assert json.loads(obj.pointmorph.report)["options"]["transfer_neighbors"] == 20


def test_rename_of_it_and_of_its_parents(settings):
    source, target = pair()
    obj = morph()
    before = content(obj)
    source.name, target.name, obj.name = "One", "Two", "Three"
    source.data.name = "Mesh of one"
    assert obj.pointmorph.state == "CURRENT"
    recompute(obj)
    assert obj.name == "Three"
    assert_same(content(obj), before)
    move_vertices(source, (0, 0, 1))
    assert obj.pointmorph.stale == '"One" was edited'


@pytest.mark.parametrize("linked", [False, True])
def test_a_duplicate(settings, linked):
    """A copy has its own points and t; a linked one (Alt+D) shares both, as Blender has it."""
    _, target = pair()
    obj = morph()
    before = content(obj)
    select(obj)
    bpy.ops.object.duplicate(linked=linked)
    copy = bpy.context.view_layer.objects.active
    assert copy != obj
    assert copy.pointmorph.state == "CURRENT"
    slider(copy).value = 1.0
    bpy.context.view_layer.update()
    assert slider(obj).value == (1.0 if linked else 0.0)
    radii = [attribute(obj.data, f"{side}_radius") for side in ("source", "target")]
    np.testing.assert_allclose(shown_points(copy, "radius"), radii[1], rtol=1e-5)
    np.testing.assert_allclose(shown_points(obj, "radius"), radii[linked], rtol=1e-5)
    move_vertices(target, (0, 0, 0.3))
    recompute(copy)
    assert copy.pointmorph.state == "CURRENT"
    assert obj.pointmorph.state == ("CURRENT" if linked else "STALE")
    if not linked:
        assert_same(content(obj), before)


def assert_kept(after, before):
    """What a morph that was computed again from its own points has as before."""
    for name in ("source_row", "target_row", "Basis", "Morph", "source_color", "target_radius"):
        assert np.array_equal(after[name], before[name]), name


def test_deletion_of_its_parents_in_the_viewport(settings):
    """They are in no scene any more, though the file keeps them as long as the morph knows them."""
    source, target = pair()
    target.location.x = 0.2
    obj = morph()
    before = content(obj)
    bpy.ops.pointmorph.show_shapes()
    bpy.ops.object.select_all(action="DESELECT")
    source.select_set(True)
    target.select_set(True)
    bpy.ops.object.delete()
    assert not {"Hill", "Dune"} & set(bpy.context.scene.objects.keys())
    slider(obj).value = 1.0
    np.testing.assert_allclose(shown_points(obj), key(obj, "Morph"), atol=1e-6)
    assert obj.pointmorph.state == "ORPHAN"
    assert '"Hill" is in no collection' in obj.pointmorph.stale
    assert '"Dune" is in no collection' in obj.pointmorph.stale
    recompute(obj)  # from what it holds
    assert_kept(content(obj), before)
    assert not {"Hill", "Dune"} & set(bpy.context.scene.objects.keys())


@pytest.mark.parametrize("which", ["source", "target", "both"])
def test_deletion_of_its_parents_from_the_file(settings, which, tmp_path):
    source, target = pair()
    obj = morph()
    before = content(obj)
    for side, shape in (("source", source), ("target", target)):
        if which in (side, "both"):
            bpy.data.objects.remove(shape)
    assert obj.pointmorph.state == "ORPHAN"
    for side, name in (("source", "Hill"), ("target", "Dune")):
        assert (f'"{name}" no longer exists' in obj.pointmorph.stale) == (which in (side, "both"))
    slider(obj).value = 0.5
    np.testing.assert_allclose(
        shown_points(obj), (before["Basis"] + before["Morph"]) / 2, atol=1e-6
    )
    save_and_open(tmp_path)
    obj = bpy.data.objects["Hill to Dune"]
    assert obj.pointmorph.state == "ORPHAN"
    recompute(obj)  # from what it holds
    assert_kept(content(obj), before)
    select(obj)
    assert bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS") == {"FINISHED"}
    if which != "target":
        with pytest.raises(RuntimeError, match="expected its source in this file, found none"):
            bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")


@pytest.mark.parametrize("as_link", [False, True])
def test_append_and_link_into_another_file(settings, tmp_path, as_link):
    pair()
    obj = morph()
    before = content(obj)
    path = str(tmp_path / "morph.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=as_link) as (_, wanted):
        wanted.objects = ["Hill to Dune"]
    obj = wanted.objects[0]
    bpy.context.scene.collection.objects.link(obj)
    assert_same(content(obj), before)
    assert obj.pointmorph.source.name == "Hill"
    assert obj.pointmorph.state == "ORPHAN"  # its objects came along, but into no collection
    assert '"Hill" is in no collection' in obj.pointmorph.stale
    if as_link:
        select(obj)
        with pytest.raises(RuntimeError, match="linked from another file: make it local"):
            bpy.ops.pointmorph.recompute()
        return
    slider(obj).value = 1.0
    np.testing.assert_allclose(shown_points(obj), before["Morph"], atol=1e-6)
    recompute(obj)
    assert_kept(content(obj), before)


def test_source_and_target_that_are_linked_from_another_file(settings, tmp_path):
    """They can be read, so all works that changes nothing on them."""
    pair()
    before = content(morph())
    path = str(tmp_path / "shapes.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Hill", "Dune"]
    for obj in wanted.objects:
        bpy.context.scene.collection.objects.link(obj)
    settings = bpy.context.scene.pointmorph
    settings.source, settings.target = wanted.objects
    settings.domain, settings.show_as, settings.path = "disk", "POINTS", "linear"
    bpy.context.view_layer.update()
    obj = morph()
    assert_same(content(obj), before)
    assert obj.pointmorph.state == "CURRENT"
    recompute(obj)
    assert_same(content(obj), before)
    assert bpy.ops.pointmorph.follow() == {"FINISHED"}
    bpy.ops.pointmorph.follow()
    assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    assert copy.library is None
    assert copy.data.library is None
    select(obj)
    with pytest.raises(RuntimeError, match="Hill: expected an editable mesh"):
        bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")


def test_undo_and_redo_of_a_recompute(settings):
    source, _ = pair()
    obj = morph()
    before = content(obj)
    move_vertices(source, (0, 0, 0.5))
    bpy.ops.ed.undo_push(message="before")
    select(obj)
    bpy.ops.pointmorph.recompute("EXEC_DEFAULT", True)
    after = content(bpy.data.objects["Hill to Dune"])
    assert not np.array_equal(after["Basis"], before["Basis"])
    bpy.ops.ed.undo()
    obj = bpy.data.objects["Hill to Dune"]
    assert_same(content(obj), before)
    assert obj.pointmorph.state == "STALE"
    bpy.ops.ed.redo()
    obj = bpy.data.objects["Hill to Dune"]
    assert_same(content(obj), after)
    assert obj.pointmorph.state == "CURRENT"


# --- t --------------------------------------------------------------------------------------------


def test_several_morphs_with_keys_and_drivers_at_every_frame(addon, settings, tmp_path):
    """Also in a file that was opened again, as a farm does it."""
    pair()
    first, second, third = (morph(new_result=True) for _ in range(3))
    for obj, values in ((first, (0, 1)), (second, (1, 0))):
        for frame, value in zip((1, 11), values, strict=True):
            slider(obj).value = value
            slider(obj).keyframe_insert("value", frame=frame)
    curve = slider(third).driver_add("value")
    curve.driver.type = "AVERAGE"
    addon("data.nodes").drive(curve.driver, slider(first))
    names = [obj.name for obj in (first, second, third)]
    save_and_open(tmp_path)
    objects = [bpy.data.objects[name] for name in names]
    for frame in (1, 4, 6, 11):
        bpy.context.scene.frame_set(frame)
        for obj in objects:
            t = slider(obj).value
            np.testing.assert_allclose(
                shown_points(obj), (1 - t) * key(obj, "Basis") + t * key(obj, "Morph"), atol=1e-5
            )
        values = [slider(obj).value for obj in objects]
        assert values[0] + values[1] == pytest.approx(1)
        assert values[2] == pytest.approx(values[0])


@pytest.mark.renders
def test_an_animation_of_several_renders(settings, output):
    """One grows, one shrinks, over frames that Blender renders by itself."""
    _, target = pair(30, 26)
    target.scale = (2, 2, 2)
    scene = bpy.context.scene
    for x, values in ((-3, (0, 1)), (3, (1, 0))):
        obj = morph(new_result=True)
        obj.location.x = x
        for frame, value in zip((1, 3), values, strict=True):
            slider(obj).value = value
            slider(obj).keyframe_insert("value", frame=frame)
    for shape in (settings.source, target):
        shape.hide_render = True
    camera = add_object("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = 12
    camera.location.z = 9
    scene.camera = camera
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y = 120, 60
    scene.frame_start, scene.frame_end = 1, 3
    scene.render.filepath = str(output / "several_")
    bpy.ops.render.render(animation=True)
    areas = []
    for frame in (1, 2, 3):
        picture = bpy.data.images.load(str(output / f"several_{frame:04d}.png"))
        alpha = np.array(picture.pixels[:]).reshape(60, 120, 4)[..., 3] > 0.5
        areas.append((alpha[:, :60].sum(), alpha[:, 60:].sum()))
    (a, b), middle, (c, d) = areas
    assert a < middle[0] < c
    assert b > middle[1] > d
    assert c > 3 * a
    assert b > 3 * d
