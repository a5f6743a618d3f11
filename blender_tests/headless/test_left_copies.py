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
    # As the viewport does: the points keep a pointer to it.
    for home in shown.users_collection:
        home.objects.unlink(shown)
    assert left._look() is None
    left._stop()
    assert {obj.name for obj in bpy.data.objects} == before
    assert settings.source == mirrored
    assert morph().name == "Half to Dune"


@pytest.mark.parametrize("how", ["shown", "mesh", "baked", "keyed"])
def test_points_that_somebody_wants_stay(addon, mirrored, how):
    left = addon("scene.left_copies")
    shown = morph()
    points = shown.pointmorph.made_from
    if how == "shown":
        points.hide_set(False)
    elif how == "mesh":
        select(points)
        assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}
    elif how == "baked":
        points.pointmorph.baked = '{"Half": [0.5, "linear"]}'
    else:
        points.keyframe_insert("location", frame=1)
    name = points.name
    left._forget()
    left._look()
    bpy.data.objects.remove(shown)
    left._look()
    left._stop()
    assert name in bpy.data.objects
    assert points.pointmorph.source.name in bpy.data.objects


@pytest.mark.parametrize("kind", ["MESH", "DISCS"])
def test_what_an_appended_morph_stands_for_is_hidden(addon, settings, tmp_path, kind):
    left, path = addon("scene.left_copies"), str(tmp_path / "morph.blend")
    pair()
    settings.show_as = kind
    name = morph().name
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
