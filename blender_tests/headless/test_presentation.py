"""What is seen after a morph: the source's faces, or points, and not what they stand for."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from panel_drawing import Layout, drawing_context
from scenes import (
    add_mesh,
    attribute,
    coordinates,
    data_blocks,
    error_of,
    key,
    mark,
    morph,
    pair,
    patch,
    pick,
    recompute,
    select,
    set_t,
    shown_points,
    surface_of,
)

pytestmark = pytest.mark.interface


@pytest.fixture
def painted(settings):
    """Source, target and what shows their morph; the source has a material and a UV map."""
    settings.show_as = "MESH"
    source, target = pair(14, 12)
    source.data.materials.append(bpy.data.materials.new("Skin"))
    source.data.uv_layers.new(name="Layout")
    return source, target, morph()


def test_the_source_s_faces_show_the_morph(painted):
    source, target, shown = painted
    assert shown.name == "Hill to Dune"
    assert len(shown.data.polygons) == len(source.data.polygons)
    assert shown.material_slots[0].material.name == "Skin"
    assert shown.data.uv_layers[0].name == "Layout"
    points = shown.pointmorph.made_from
    assert points.name == "Hill to Dune Points"
    assert points.hide_get()
    assert points.hide_render
    assert not shown.hide_get()
    for obj in (source, target):
        assert obj.hide_get()
        assert obj.hide_render
    np.testing.assert_array_equal(surface_of(shown), coordinates(source.data.vertices))
    shown.data.shape_keys.key_blocks["Morph"].value = 1.0
    np.testing.assert_allclose(surface_of(shown), key(shown, "Morph"), atol=1e-6)
    corners = coordinates(target.data.vertices)
    for corner in (0, 11, 132, 143):
        assert np.linalg.norm(surface_of(shown) - corners[corner], axis=1).min() < 0.05


@pytest.mark.parametrize("modifier", [False, True])
def test_a_source_that_is_disabled_in_viewports_or_locked_is_shown_as_a_morph(settings, modifier):
    """Its copy was as invisible."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.hide_select = True
    if modifier:
        source.modifiers.new("Twice", "ARRAY")
    else:
        source.hide_viewport = True
    shown = morph()
    assert shown.visible_get()
    assert (shown.hide_viewport, shown.hide_select) == (False, False)
    recompute(shown)
    assert shown.visible_get()


def test_keys_of_the_slider_are_none_of_the_source(addon, settings):
    """A source whose shape keys go along got them into its own action."""
    curves_of = addon("data.versions").curves_of
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.pointmorph.keep_modifiers = True
    source.shape_key_add(name="Basis")
    smile = source.shape_key_add(name="Smile")
    for frame, value in ((1, 0.0), (20, 1.0)):
        smile.value = value
        smile.keyframe_insert("value", frame=frame)
    bpy.context.scene.frame_set(1)
    shown = morph()
    assert bpy.ops.pointmorph.key_morph(start=1, end=20) == {"FINISHED"}
    paths = [f'key_blocks["{name}"].value' for name in ("Smile", "Morph")]
    assert [c.data_path for c in curves_of(shown.data.shape_keys)] == paths
    assert [c.data_path for c in curves_of(source.data.shape_keys)] == paths[:1]
    bpy.context.scene.frame_set(20)
    assert shown.data.shape_keys.key_blocks["Smile"].value == 1.0


def test_a_source_whose_strip_is_tweaked(settings):
    """Its action can't be changed meanwhile: Morph failed."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.pointmorph.keep_modifiers = True
    source.shape_key_add(name="Basis")
    source.shape_key_add(name="Smile").keyframe_insert("value", frame=1)
    data = source.data.shape_keys.animation_data
    action, data.action = data.action, None
    track = data.nla_tracks.new()
    track.strips.new("Smiles", 1, action).select = True
    data.nla_tracks.active = track
    data.use_tweak_mode = True
    shown = morph()
    assert data.use_tweak_mode
    assert bpy.ops.pointmorph.key_morph(start=1, end=20) == {"FINISHED"}
    own = shown.data.shape_keys.animation_data
    assert own.action not in (None, action)
    assert own.nla_tracks[0].strips[0].action == action


def test_points_have_the_same_slider(painted):
    _, _, shown = painted
    points = shown.pointmorph.made_from
    slider = shown.data.shape_keys.key_blocks["Morph"]
    slider.value = 0.25
    assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    assert (points.hide_get(), shown.hide_get()) == (False, True)
    assert bpy.context.view_layer.objects.active == points
    ends = key(points, "Basis"), key(points, "Morph")
    np.testing.assert_allclose(shown_points(points), 0.75 * ends[0] + 0.25 * ends[1], atol=1e-6)
    slider.value = 0.5
    np.testing.assert_allclose(shown_points(points), (ends[0] + ends[1]) / 2, atol=1e-6)
    assert bpy.ops.pointmorph.show_as(kind="MESH") == {"FINISHED"}
    assert (points.hide_get(), shown.hide_get()) == (True, False)
    assert bpy.context.view_layer.objects.active == shown


def test_one_button_brings_the_originals_back(painted):
    source, target, _ = painted
    for visible in (True, False):
        assert bpy.ops.pointmorph.show_shapes() == {"FINISHED"}
        for obj in (source, target):
            assert obj.hide_get() != visible
            assert obj.hide_render != visible


@pytest.mark.parametrize("by_user", [False, True])
def test_the_originals_come_back_when_the_morph_is_deleted(painted, addon, by_user):
    source, target, shown = painted
    points = shown.pointmorph.made_from
    points.hide_set(False)
    if by_user:
        select(shown)
        points.select_set(True)
        bpy.ops.object.delete()
    else:
        bpy.data.batch_remove([shown, points])
    layout = Layout()
    panel = addon("ui.panels").POINTMORPH_PT_morph
    drawing = SimpleNamespace(layout=layout, _draw_between=panel._draw_between)
    panel._draw_shapes(drawing, layout, drawing_context())
    assert "show_shapes" in layout.drawn
    assert bpy.ops.pointmorph.show_shapes() == {"FINISHED"}
    for obj in (source, target):
        assert obj.visible_get()
        assert not obj.hide_render
    assert not bpy.ops.pointmorph.show_shapes.poll()


@pytest.mark.parametrize("by_user", [False, True])
@pytest.mark.parametrize("operator", ["recompute", "morph"])
def test_points_that_were_deleted_are_made_again(painted, by_user, operator):
    _, _, shown = painted
    points = shown.pointmorph.made_from
    points.hide_set(False)
    if by_user:
        select(points)
        bpy.ops.object.delete()
    else:
        bpy.data.objects.remove(points)
    shown.data.shape_keys.key_blocks["Morph"].value = 0.25
    select(shown)
    assert getattr(bpy.ops.pointmorph, operator)() == {"FINISHED"}
    points = shown.pointmorph.made_from
    assert points.name == "Hill to Dune Points"
    assert points in list(bpy.context.scene.objects)
    assert (points.hide_get(), shown.hide_get()) == (True, False)
    assert points.pointmorph.mesh == shown
    assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    ends = key(points, "Basis"), key(points, "Morph")
    np.testing.assert_allclose(shown_points(points), 0.75 * ends[0] + 0.25 * ends[1], atol=1e-6)


def test_recompute_and_bakes_work_from_the_mesh(painted):
    source, _, shown = painted
    points = shown.pointmorph.made_from
    slider = shown.data.shape_keys.key_blocks["Morph"]
    slider.value = 1.0
    slider.keyframe_insert("value", frame=10)
    for vertex in source.data.vertices:
        vertex.co.z += 0.2
    assert shown.pointmorph.state == points.pointmorph.state == "STALE"
    select(shown)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert shown.pointmorph.state == points.pointmorph.state == "CURRENT"
    np.testing.assert_allclose(
        coordinates(shown.data.shape_keys.key_blocks[0].data),
        coordinates(source.data.vertices),
        atol=1e-6,
    )
    assert shown.data.shape_keys.animation_data.action is not None
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=2) == {"FINISHED"}
    assert len(source.data.shape_keys.key_blocks) == 3
    assert not source.hide_get()
    select(shown)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=5, step=2) == {"FINISHED"}
    assert shown.hide_get()
    assert points.hide_get()


@pytest.mark.parametrize("kind", ["MESH", "DISCS"])
def test_what_is_shown_is_named(settings, capfd, kind):
    """Not its points, or its mesh, which are hidden."""
    pair()
    settings.show_as = "MESH"
    morph()
    assert bpy.ops.pointmorph.show_as(kind=kind) == {"FINISHED"}
    shown = bpy.context.view_layer.objects.active
    capfd.readouterr()
    recompute(shown)
    assert f'"{shown.name}": 144 pairs' in capfd.readouterr().out
    assert shown.name == "Hill to Dune" + (" Points" if kind == "DISCS" else "")
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=2) == {"FINISHED"}
    said = capfd.readouterr().out
    assert 'Baked 2 frames to "Hill to Dune Frames"' in said


def test_vertex_groups_that_go_with_the_vertices_are_named(painted, capfd):
    source, _, shown = painted
    shown.vertex_groups.new(name="Wave").add([3], 1.0, "REPLACE")
    positions, faces = patch(12)
    source.data.clear_geometry()
    source.data.from_pydata(positions.tolist(), [], faces.tolist())
    mark(source, "peak", 0, 0)  # its groups are gone, too
    mark(source, "slope", 0.5, 0.3)
    select(shown)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    said = capfd.readouterr().out
    assert 'The vertex group "Wave" of "Hill to Dune" was removed' in said
    assert said.count("was removed") == 1


def cloud(settings):
    """What shows the morph of a source without faces."""
    settings.show_as = "MESH"
    source = add_mesh("Cloud", patch(14)[0])
    target = add_mesh("Dune", *patch(12, bump=0.8))
    for obj in (source, target):
        mark(obj, "peak", 0, 0)
    pick(source, target)
    settings.domain = "disk"
    return morph()


def test_a_source_without_faces_is_shown_as_discs(settings):
    shown = cloud(settings)
    assert shown.name == "Cloud to Dune"
    assert "source_row" in shown.data.attributes
    assert not shown.hide_get()
    assert settings.source.hide_get()
    evaluated = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(evaluated.polygons) == len(shown.data.vertices)
    assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    assert len(shown_points(shown)) == len(shown.data.vertices)


def test_of_many_points_without_faces_points_are_shown(addon, settings, monkeypatch):
    monkeypatch.setattr(addon("scene.presentation"), "_MANY", 100)
    shown = cloud(settings)
    assert len(shown_points(shown)) == len(shown.data.vertices) > 100


def test_solid_shading_shows_the_colors_of_discs(addon, settings):
    shading = SimpleNamespace(color_type="MATERIAL")
    space = SimpleNamespace(type="VIEW_3D", shading=shading)
    show_colors = addon("operators.shading").show_colors
    shown = cloud(settings)
    for kind, color_type in (("DISCS", "VERTEX"), ("POINTS", "MATERIAL"), ("DISCS", "VERTEX")):
        bpy.ops.pointmorph.show_as(kind=kind)
        show_colors(SimpleNamespace(space_data=space), shown)
        assert shading.color_type == color_type
    shading.color_type = "OBJECT"  # a choice of the user's
    for kind in ("POINTS", "DISCS"):
        bpy.ops.pointmorph.show_as(kind=kind)
        show_colors(SimpleNamespace(space_data=space), shown)
        assert shading.color_type == "OBJECT"


def test_distortion_is_shown_on_points(painted):
    _, _, shown = painted
    points = shown.pointmorph.made_from
    assert bpy.ops.pointmorph.show_distortion() == {"FINISHED"}
    assert not points.hide_get()
    assert shown.hide_get()
    assert attribute(points.data, "distortion").min() >= 0


@pytest.mark.parametrize("kind", ["MESH", "POINTS", "DISCS"])
def test_what_was_shown_comes_back_after_the_colors(painted, kind):
    points = painted[2].pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind=kind)

    def seen():
        return [(obj.name, obj.hide_get(), obj.hide_render) for obj in bpy.context.scene.objects]

    before = seen()
    bpy.ops.pointmorph.show_distortion()
    bpy.ops.pointmorph.show_confidence()
    assert not points.hide_get()
    bpy.ops.pointmorph.show_confidence()
    assert seen() == before


def test_it_survives_saving_and_its_mesh_being_deleted(painted, tmp_path):
    path = str(tmp_path / "morph.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    shown = bpy.data.objects["Hill to Dune"]
    points = shown.pointmorph.made_from
    assert points.pointmorph.mesh == shown
    shown.data.shape_keys.key_blocks["Morph"].value = 1.0
    select(points)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    np.testing.assert_allclose(shown_points(points), key(points, "Morph"), atol=1e-6)
    bpy.data.objects.remove(shown)
    assert bpy.ops.pointmorph.show_as(kind="MESH") == {"FINISHED"}
    again = points.pointmorph.mesh
    assert again is not None
    assert len(again.data.polygons) == 13 * 13


def test_a_chain_is_shown_by_the_source_s_faces(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    between = add_mesh("Mound", *patch(13, bump=0.2))
    mark(between, "peak", 0, 0)
    mark(between, "slope", 0.5, 0.3)
    settings.via.add().object = between
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    shown = bpy.context.view_layer.objects.active
    assert len(shown.data.polygons) == 13 * 13
    points = shown.pointmorph.made_from
    shown.data.shape_keys.key_blocks["Morph"].value = 2.0
    bpy.ops.pointmorph.show_as(kind="POINTS")
    last = points.data.shape_keys.key_blocks[-1]
    np.testing.assert_allclose(shown_points(points), coordinates(last.data), atol=1e-6)
    assert between.hide_get()


@pytest.mark.parametrize("kind", ["MESH", "POINTS", "DISCS"])
def test_the_morph_has_dimensions(settings, kind):
    """Those of what it shows: Blender frames it by them, and its panel Item says them."""
    source, target = pair(14, 12)
    target.scale = (2, 3, 1)
    settings.show_as = kind
    obj = morph()
    for t, shape in ((0.0, source), (1.0, target)):
        set_t(obj, t)
        bpy.context.view_layer.update()
        extent, least = np.array(obj.dimensions), np.array(shape.dimensions)
        assert (extent > 0.9 * least).all(), (t, extent, least)
        assert (extent < least + 1.0).all(), (t, extent, least)  # balls stick out


@pytest.mark.parametrize("kind", ["MESH", "POINTS", "DISCS"])
def test_the_box_of_the_result_has_its_rows(painted, addon, kind):
    _, _, shown = painted
    points = shown.pointmorph.made_from
    points.pointmorph.too_fine = "Dune"
    bpy.ops.pointmorph.show_as(kind=kind)
    layout = Layout()
    context = drawing_context()
    panel = addon("ui.result_panel").POINTMORPH_PT_result
    panel.draw(SimpleNamespace(layout=layout), context)
    expected = ["key_morph", *3 * ["show_as"], "show_shapes", "recompute", "explain"]
    places = ["go_to_place"] if "go_to_place" in layout.drawn else []
    assert layout.drawn == [*expected, *places, "subdivide_source"]
    bpy.data.objects.remove(points)
    select(shown)
    layout.drawn.clear()
    panel.draw(SimpleNamespace(layout=layout), context)
    assert layout.drawn[:3] == ["key_morph", "show_shapes", "recompute"]


@pytest.mark.parametrize("kind", ["MULTIRES", "SOFT_BODY", "MESH_CACHE", "MESH_SEQUENCE_CACHE"])
def test_a_modifier_that_must_be_first_is_left_off(settings, capfd, kind):
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.pointmorph.keep_modifiers = True
    source.modifiers.new("Finer", kind)
    source.modifiers.new("Smooth", "SMOOTH").factor = 0.0
    shown = morph()
    assert [modifier.name for modifier in shown.modifiers] == ["Path", "Smooth"]
    assert len(source.modifiers) == 2
    assert '"Hill to Dune" has no Finer' in capfd.readouterr().out
    shown.data.shape_keys.key_blocks["Morph"].value = 1.0
    np.testing.assert_allclose(surface_of(shown), key(shown, "Morph"), atol=1e-6)


@pytest.mark.parametrize("late", [False, True])
def test_an_error_nobody_thought_of_leaves_the_scene_as_it_was(addon, settings, monkeypatch, late):
    addon("scene.points_display").remove_unused()  # those of other tests
    settings.show_as = "MESH"
    source, target = pair(14, 12)
    source.hide_render = True
    select(source)
    before = data_blocks()

    def fail(*_):
        raise RuntimeError("of Blender's")

    parts = ("scene.slider_keys", "follow"), ("operators.shading", "show_colors")
    module, name = parts[late]
    monkeypatch.setattr(addon(module), name, fail)
    said = error_of(bpy.ops.pointmorph.morph)
    assert "Morph failed. RuntimeError: of Blender's" in said
    assert data_blocks() - before == set()
    assert [obj.hide_get() for obj in (source, target)] == [False, False]
    assert [obj.hide_render for obj in (source, target)] == [True, False]
    assert bpy.context.view_layer.objects.active == source
    monkeypatch.undo()
    assert morph().name == "Hill to Dune"


def test_colors_are_taken_off_without_the_mesh_that_was_deleted(painted):
    points = painted[2].pointmorph.made_from
    bpy.ops.pointmorph.show_distortion()
    bpy.data.objects.remove(painted[2])
    select(points)
    bpy.ops.pointmorph.show_distortion()
    assert points.pointmorph.mesh is None
    assert not points.hide_get()


def test_points_deleted_before_a_failed_recomputation_stay_so(painted, addon, monkeypatch):
    points = painted[2].pointmorph.made_from
    points.hide_set(False)
    select(points)
    bpy.ops.object.delete()
    select(painted[2])

    def fail(*_):
        raise RuntimeError("of Blender's")

    monkeypatch.setattr(addon("scene.morphing_mesh"), "remake", fail)
    assert "of Blender's" in error_of(bpy.ops.pointmorph.recompute)
    assert not points.users_collection


@pytest.mark.parametrize("excluded", [False, True])
def test_points_are_made_again_in_an_excluded_collection(painted, excluded):
    shown = painted[2]
    bpy.data.objects.remove(shown.pointmorph.made_from)
    if excluded:
        away = bpy.data.collections.new("Away")
        bpy.context.scene.collection.children.link(away)
        layer = bpy.context.view_layer.layer_collection.children["Away"]
        bpy.context.view_layer.active_layer_collection = layer
        layer.exclude = True
    select(shown)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert shown.pointmorph.made_from.pointmorph.mesh == shown
