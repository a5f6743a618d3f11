"""Copies of sources as shown go with the last morph of them, but for those that users want."""

import bpy
import pytest
from scenes import add_mesh, mark, morph, pair, patch, select


def test_a_copy_goes_with_the_last_morph_of_it(addon, mirrored, settings):
    shown = morph()
    copy = settings.source
    name, points = copy.name, shown.pointmorph.made_from
    remove_left = addon("scene.left_copies").remove_left
    bpy.data.objects.remove(shown)
    remove_left()
    assert name in bpy.data.objects  # its points are there
    bpy.data.objects.remove(points)
    mark(copy, "peak", 1, 0)
    remove_left()
    assert name in bpy.data.objects  # who marked it wants it
    copy.vertex_groups.remove(copy.vertex_groups["pm.peak"])
    copy.hide_render = False
    remove_left()
    assert name in bpy.data.objects  # or shows it
    copy.hide_render = True
    remove_left()
    assert name not in bpy.data.objects
    assert settings.source == mirrored
    bpy.ops.pointmorph.show_shapes()
    assert not mirrored.hide_get()
    assert morph().name == "Half to Dune"


def test_points_go_with_the_mesh_that_showed_them(addon, mirrored, settings):
    left = addon("scene.left_copies")
    before = {obj.name for obj in bpy.data.objects}
    left._forget()
    left._look()
    shown = morph()  # nobody looks again before it is deleted
    delete(shown)
    assert left._look() is None
    left._stop()
    assert {obj.name for obj in bpy.data.objects} == before
    assert settings.source == mirrored
    assert morph().name == "Half to Dune"


def make_another_mesh(points):
    select(points)
    assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}


def bake(points):
    points.pointmorph.baked = '{"Half": [0.5, "linear"]}'


def key_shapes(points):
    points.data.shape_keys.keyframe_insert("eval_time", frame=1)


def key_mesh(points):
    points.data.keyframe_insert("texspace_size", frame=1)


def color(points):
    points.data.materials.append(bpy.data.materials.new("Mine"))


def keep_mesh(points):
    points.pointmorph.mesh.use_fake_user = True


def delete(obj):
    """As the viewport does: what points to it keeps it."""
    for home in obj.users_collection:
        home.objects.unlink(obj)


@pytest.mark.parametrize(
    "want",
    [
        lambda points: points.hide_set(False),
        lambda points: points.keyframe_insert("location", frame=1),
        lambda points: points.shape_key_add(name="Mine"),
        lambda points: points.modifiers.new("Mine", "SMOOTH"),
        lambda points: points.modifiers.new("Mine", "NODES"),
        make_another_mesh,
        bake,
        key_shapes,
        key_mesh,
        color,
        keep_mesh,
    ],
)
def test_points_that_somebody_wants_stay(addon, mirrored, want):
    left = addon("scene.left_copies")
    shown = morph()
    points = shown.pointmorph.made_from
    want(points)
    name = points.name
    left._forget()
    left._look()
    delete(shown)
    left._look()
    left._stop()
    assert name in bpy.data.objects
    assert points.pointmorph.source.name in bpy.data.objects


def test_points_whose_keys_were_handed_on_go(addon, mirrored):
    left = addon("scene.left_copies")
    shown = morph()
    points = shown.pointmorph.made_from
    points.data.shape_keys.animation_data.action = bpy.data.actions.new("Empty")
    name = points.name
    left._look()
    delete(shown)
    left._look()
    left._stop()
    assert name not in bpy.data.objects


def test_what_undo_brings_back_goes_again(addon, mirrored, settings):
    left = addon("scene.left_copies")
    before = {obj.name for obj in bpy.data.objects}
    delete(morph())
    left._forget()
    left._look()
    assert {obj.name for obj in bpy.data.objects} > before  # so it was in the file
    left._note_other_state()
    left._look()
    left._stop()
    assert {obj.name for obj in bpy.data.objects} == before
    assert settings.source == mirrored


def test_the_first_look_does_not_wait_for_a_change(addon):
    left = addon("scene.left_copies")
    left._stop()
    left.registration.start()
    assert bpy.app.timers.is_registered(left._look)
    left._stop()


@pytest.mark.parametrize("kind", ["MESH", "DISCS", "mesh as discs"])
def test_what_an_appended_morph_stands_for_is_hidden(addon, settings, tmp_path, kind):
    left, path = addon("scene.left_copies"), str(tmp_path / "morph.blend")
    pair()
    settings.show_as = "DISCS" if kind == "DISCS" else "MESH"
    name = morph().name
    if kind == "mesh as discs":
        assert bpy.ops.pointmorph.show_as(kind="DISCS") == {"FINISHED"}
        name = bpy.context.view_layer.objects.active.name
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    left._look()
    bpy.ops.wm.append(directory=f"{path}/Object/", filename=name)
    there = bpy.context.scene.objects
    assert {"Hill", "Dune", name} <= {obj.name for obj in there if obj.visible_get()}
    assert {obj.name for obj in there if not obj.hide_render} == {name}
    left._look()
    left._stop()
    assert {obj.name for obj in there if obj.visible_get()} == {name}
    assert not [obj.name for obj in there if obj.name.startswith(".")]
    select(bpy.data.objects[name])
    assert bpy.ops.pointmorph.show_shapes() == {"FINISHED"}
    assert not bpy.data.objects["Hill"].hide_get()


def test_undo_after_appending_shows_only_what_was_shown(addon, settings, tmp_path):
    """Blender's undo step is from before it was hidden."""
    left, path = addon("scene.left_copies"), str(tmp_path / "morph.blend")
    pair()
    settings.show_as = "MESH"
    name = morph().name
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)

    def shown():
        left._look()
        return {obj.name for obj in bpy.context.scene.objects if obj.visible_get()}

    def change(x):
        bpy.data.objects[name].location.x = x
        bpy.ops.ed.undo_push(message="Move")
        left._look()

    left._look()
    bpy.ops.ed.undo_push(message="Start")
    bpy.ops.wm.append(directory=f"{path}/Object/", filename=name)
    bpy.ops.ed.undo_push(message="Append")
    assert shown() == {name}
    change(1)
    bpy.ops.ed.undo()
    assert shown() == {name}
    bpy.ops.ed.undo()
    assert shown() == set()
    bpy.ops.ed.redo()
    assert shown() == {name}
    bpy.data.objects["Hill"].hide_set(False)  # the user's own choice
    assert shown() == {name, "Hill"}
    bpy.ops.ed.undo_push(message="Show")
    change(2)
    bpy.ops.ed.undo()
    assert shown() == {name, "Hill"}
    left._stop()


@pytest.mark.parametrize("kind", ["MESH", "DISCS"])
def test_a_duplicate_hides_nothing(addon, settings, kind):
    left = addon("scene.left_copies")
    shapes = pair()
    settings.show_as = kind
    obj = morph()
    left._look()
    for shape in shapes:
        shape.hide_set(False)  # Alt+H
        assert shape.hide_render
    duplicate = obj.copy()
    bpy.context.scene.collection.objects.link(duplicate)
    left._look()
    left._stop()
    assert all(one.visible_get() for one in (*shapes, obj, duplicate))


def test_disc_makers_stay_in_collections_that_are_overridden(addon, settings, tmp_path):
    path = str(tmp_path / "set.blend")
    pair()
    settings.show_as = "DISCS"
    group = bpy.data.collections.new("Set")
    bpy.context.scene.collection.children.link(group)
    group.objects.link(morph())
    group.objects.link(bpy.data.objects[".Pointmorph Discs"])  # as after it was appended once
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, linked):
        linked.collections = ["Set"]
    own = linked.collections[0].override_hierarchy_create(bpy.context.scene, bpy.context.view_layer)
    names = [obj.name for obj in own.objects if obj.library is None]
    assert ".Pointmorph Discs" in names
    addon("scene.disc_faces").leave_scenes()
    assert [obj.name for obj in own.objects if obj.library is None] == names


def add_key_to(copy):
    copy.shape_key_add(name="Basis")


def sculpt(copy):
    copy.data.vertices[5].co.z += 0.1


def paint(copy):
    colors = copy.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    colors.data[0].color = (1, 0, 0, 1)


def weigh(copy):
    copy.vertex_groups["bone"].add([8], 0.7, "REPLACE")


def modify(copy):
    copy.modifiers.new("Smooth", "SMOOTH")


def animate(copy):
    copy.keyframe_insert("location", frame=3)


def keep(copy):
    copy.use_fake_user = True


def point_at(copy):
    other = bpy.data.objects.new("Other", None)
    bpy.context.scene.collection.objects.link(other)
    other.constraints.new("COPY_LOCATION").target = copy


def show_in_viewport(copy):
    copy.hide_set(False)


def show_in_another_layer(copy):
    layer = bpy.context.scene.view_layers.new("Other")
    copy.hide_set(False, view_layer=layer)


WORK = (
    add_key_to,
    sculpt,
    paint,
    weigh,
    modify,
    animate,
    keep,
    point_at,
    show_in_viewport,
    show_in_another_layer,
)


@pytest.mark.parametrize("work", WORK)
def test_a_copy_that_the_user_worked_on_stays(addon, mirrored, settings, work):
    assert bpy.ops.pointmorph.use_as_shown() == {"FINISHED"}
    copy = settings.source
    copy.hide_set(True)
    copy.hide_render = True
    name = copy.name
    work(copy)
    addon("scene.left_copies").remove_left()
    assert name in bpy.data.objects


def test_the_copy_of_what_moves_goes(addon, mirrored, settings):
    mirrored.keyframe_insert("location", frame=1)
    assert bpy.ops.pointmorph.use_as_shown() == {"FINISHED"}
    copy = settings.source
    copy.hide_set(True)
    copy.hide_render = True
    name = copy.name
    addon("scene.left_copies").remove_left()
    assert name not in bpy.data.objects


def test_copies_are_looked_for_when_a_morph_is_gone(addon, mirrored, settings, monkeypatch):
    left, jobs = addon("scene.left_copies"), addon("core.background_job")
    calls = []
    monkeypatch.setattr(left, "remove_left", lambda: calls.append(1))
    shown = morph()
    other = add_mesh("Other", *patch(3))
    left._forget()
    assert left._look() is None
    bpy.data.objects.remove(other)
    assert left._look() is None
    assert not calls  # it is no morph
    bpy.data.objects.remove(shown)
    monkeypatch.setattr(jobs, "current", "a job")
    assert left._look() > 0
    monkeypatch.setattr(jobs, "current", None)
    assert not calls
    assert left._look() is None
    assert calls == [1]
    assert left._look() is None
    assert calls == [1]
    left._stop()
