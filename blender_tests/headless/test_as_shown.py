"""What modifiers make of a source: said to be left out, or taken as shown."""

import bpy
import numpy as np
import pytest
from modeling import add_armature
from panel_drawing import Layout, drawing_context
from scenes import (
    add_mesh,
    coordinates,
    data_blocks,
    error_of,
    key,
    mark,
    morph,
    pair,
    patch,
    pick,
    select,
    set_t,
)


def test_what_is_left_out_is_said(addon, mirrored):
    known = addon("scene.as_shown")
    assert known.left_out(mirrored) == ["Twice"]
    assert known.vertices_shown(bpy.context.view_layer, mirrored) == 128
    mirrored.modifiers[0].show_viewport = False
    assert known.left_out(mirrored) == []
    mirrored.shape_key_add(name="Basis")
    key = mirrored.shape_key_add(name="Up")
    key.value = 0.0
    assert known.left_out(mirrored) == []
    key.value = 0.5
    assert known.left_out(mirrored) == ["shape keys"]
    assert known.left_out(None) == []


def test_the_source_as_shown_is_morphed(mirrored, settings):
    assert bpy.ops.pointmorph.use_as_shown() == {"FINISHED"}
    copy = settings.source
    assert copy.name == "Half as Shown"
    assert len(copy.data.vertices) == 128
    assert not copy.modifiers
    assert copy.material_slots[0].material.name == "Skin"
    assert copy.data.uv_layers[0].name == "Layout"
    assert [group.name for group in copy.vertex_groups] == ["bone"]
    assert [v.index for v in copy.data.vertices if v.groups] == [3, 67]
    assert tuple(copy.location) == (1, 2, 3)
    assert mirrored.hide_get()
    assert len(mirrored.modifiers) == 1
    assert len(mirrored.data.vertices) == 64
    assert "has no modifiers" in error_of(bpy.ops.pointmorph.use_as_shown)


def test_marks_come_along(mirrored, settings):
    mark(mirrored, "peak", 1, 0)
    mark(settings.target, "peak", 0, 0)
    mirrored.modifiers.clear()
    mirrored.modifiers.new("Bend", "CAST").factor = 0.3
    bpy.context.view_layer.update()
    bpy.ops.pointmorph.use_as_shown()
    assert [f.name for f in settings.features if f.on_source and f.on_target] == ["peak"]
    shown = morph()
    evaluated = mirrored.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    np.testing.assert_allclose(
        coordinates(shown.data.vertices), coordinates(evaluated.vertices), atol=1e-6
    )


def add_key(obj, value, offset):
    """A shape key that moves all of a mesh."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="Up")
    positions = coordinates(key.data) + np.asarray(offset, np.float32)
    key.data.foreach_set("co", positions.reshape(-1))
    key.value = value


def put_on(obj, what):
    """Something that makes an object look different from its own mesh, or could."""
    if what == "mirror":
        obj.modifiers.new("Twice", "MIRROR").use_axis = (False, False, True)
        obj.modifiers.new("Round", "SUBSURF")
    elif what == "rough":
        obj.modifiers.new("Round", "SUBSURF")
        obj.modifiers["Round"].levels = 2
    elif what in ("pose", "rest"):
        add_armature(obj, (0, 0, 0.5 * (what == "pose")))
    elif what in ("key", "quiet key"):
        add_key(obj, 0.5 * (what == "key"), (0, 0, 1))
    elif what in ("pin", "pinned basis"):
        add_key(obj, 0.0, (0, 0, 1))
        obj.active_shape_key_index = int(what == "pin")
        obj.show_only_shape_key = True
    elif what == "round":
        obj.modifiers.new("Round", "SUBSURF")
    elif what == "triangles":
        obj.modifiers.new("Triangles", "TRIANGULATE")
    bpy.context.view_layer.update()


def shown_surface(obj):
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return coordinates(evaluated.vertices)


CHANGED = ("mirror", "rough", "pose", "key", "pin")


@pytest.mark.parametrize("what", [*CHANGED, "rest", "quiet key", "pinned basis", "triangles"])
def test_a_source_is_morphed_as_it_looks(settings, capfd, what):
    """At 0 the morph is what the viewport showed, at 1 it lies on the target."""
    settings.show_as = "MESH"
    source, target = pair(3 if what == "rough" else 14, 12)
    if what == "rough":
        source.vertex_groups.clear()
        target.vertex_groups.clear()
    put_on(source, what)
    before = shown_surface(source)
    shown = morph()
    assert shown.name == "Hill to Dune"
    np.testing.assert_allclose(shown_surface(shown), before, atol=1e-5)
    set_t(shown, 1)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(shown_surface(shown), key(shown, "Morph"), atol=1e-5)
    said = capfd.readouterr().out
    assert ("The source was morphed as shown" in said) == (what in CHANGED)
    assert (settings.source != source) == (what in CHANGED)
    assert source.hide_get()
    bpy.ops.pointmorph.show_shapes()
    assert not source.hide_get()
    assert settings.source.hide_get() == (what in CHANGED)
    bpy.ops.pointmorph.morph()
    assert len(bpy.context.scene.objects) == 4 + (what in CHANGED) + (what in ("pose", "rest"))


@pytest.mark.parametrize("what", [*CHANGED, "rest", "quiet key", "pinned basis", "round"])
def test_the_panel_counts_the_vertices_that_are_morphed(addon, settings, what):
    settings.show_as = "POINTS"
    source, target = pair(3 if what == "rough" else 14, 12)
    for obj in (source, target):
        obj.vertex_groups.clear()
    put_on(source, what)
    known, view_layer = addon("scene.as_shown"), bpy.context.view_layer
    as_shown = known.is_taken_as_shown(view_layer, source)
    assert as_shown == (what in CHANGED)
    told = known.vertices_shown(view_layer, source) if as_shown else len(source.data.vertices)
    morph()
    assert len(settings.source.data.vertices) == told


def test_suggestions_are_for_the_source_as_it_is_morphed(addon, settings):
    """A ball that a shape key stretches to a bar with a tip, and the bar itself."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4)
    source = bpy.context.object
    places = coordinates(source.data.vertices)
    bar = places * (0.5, 0.5, 1) * (1 + 1.5 * np.maximum(places[:, 2:], 0) ** 8)
    bar = bar * (1.0, 1.0, 2.0)
    source.shape_key_add(name="Basis")
    key = source.shape_key_add(name="Bar")
    key.data.foreach_set("co", bar.astype(np.float32).reshape(-1))
    key.value = 1.0
    target = add_mesh("Bar", bar, [f.vertices[:] for f in source.data.polygons])
    pick(source, target)
    before = data_blocks()
    request = addon("scene.panel_request").read_request(bpy.context)
    assert data_blocks() == before
    assert settings.source == source
    assert not source.hide_get()
    assert request.source.name == source.name
    np.testing.assert_allclose(request.source.positions, bar, atol=1e-5)
    settings.source.pointmorph.keep_modifiers = True
    request = addon("scene.panel_request").read_request(bpy.context)
    np.testing.assert_allclose(request.source.positions, places, atol=1e-5)
    settings.source.pointmorph.keep_modifiers = False
    assert bpy.ops.pointmorph.propose_features() == {"FINISHED"}
    assert len(settings.features) > 0
    for item in settings.features:
        rows = [
            [v.index for v in obj.data.vertices if any(g.group == group.index for g in v.groups)]
            for obj in (source, target)
            for group in [obj.vertex_groups[f"pm.{item.name}"]]
        ]
        assert [len(found) for found in rows] == [1, 1]
        apart = bar[rows[0][0]] - bar[rows[1][0]]
        assert np.linalg.norm(apart) < 0.5, item.name


def test_suggestions_on_a_mirrored_source_are_marked_on_its_own_half(addon, mirrored):
    request = addon("scene.panel_request").read_request(bpy.context)
    assert len(request.source.positions) == 128
    rows = addon("scene.panel_request").own_rows(mirrored, request.source)
    assert np.array_equal(rows[:64], np.arange(64))
    assert (rows[64:] == -1).sum() > 50
    mirrored.modifiers.new("Fewer", "DECIMATE").ratio = 0.5
    bpy.context.view_layer.update()
    request = addon("scene.panel_request").read_request(bpy.context)
    with pytest.raises(Exception, match="Apply or disable the modifiers that add or remove"):
        addon("scene.panel_request").own_rows(mirrored, request.source)


def test_reading_leaves_the_source_selected(addon, mirrored):
    select(mirrored)
    addon("scene.panel_request").read_request(bpy.context)
    assert mirrored.select_get()
    assert bpy.context.view_layer.objects.active == mirrored
    assert (mirrored.hide_get(), mirrored.hide_render) == (False, False)


@pytest.mark.parametrize("kind", ["ARMATURE", "LATTICE"])
def test_a_parent_that_bends_counts_as_a_modifier(addon, settings, kind):
    source, _ = pair(14, 12)
    if kind == "ARMATURE":
        add_armature(source, (0, 0, 0.5))
        parent = source.modifiers[0].object
        source.modifiers.clear()
    else:
        lattice = bpy.data.lattices.new("Cage")
        parent = bpy.data.objects.new("Cage", lattice)
        bpy.context.scene.collection.objects.link(parent)
        for point in lattice.points:
            point.co_deform.z += 0.5
    source.parent, source.parent_type = parent, kind
    bpy.context.view_layer.update()
    known = addon("scene.as_shown")
    assert known.left_out(source) == known.changed_by(bpy.context, source) == [parent.name]
    assert known.is_taken_as_shown(bpy.context.view_layer, source)


def test_the_panel_says_nothing_of_vertices_that_are_not_known(addon, settings, monkeypatch):
    panels, said = addon("ui.panels"), []
    source, _ = pair(14, 12)
    put_on(source, "rest")
    layout = Layout()
    layout.label = lambda text="", **_: said.append(text)
    panels._draw_left_out(layout, drawing_context(), source)
    assert said[-1] == "Without modifiers: 196 vertices"
    monkeypatch.setattr(addon("scene.as_shown"), "_evaluated_in", lambda *_: None)
    said.clear()
    panels._draw_left_out(layout, drawing_context(), source)
    assert said == [""]


@pytest.mark.parametrize("what", ["plain", "mirror"])
@pytest.mark.parametrize("how", ["linked", "overridden"])
def test_what_is_linked_is_morphed_as_objects_of_this_file(settings, tmp_path, how, what):
    settings.show_as = "MESH"
    path = str(tmp_path / "library.blend")
    shapes = pair()
    put_on(shapes[0], what)
    bpy.data.libraries.write(path, set(shapes))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, loaded):
        loaded.objects = ["Hill", "Dune"]
    objects = list(loaded.objects)
    for obj in objects:
        bpy.context.scene.collection.objects.link(obj)
    if how == "overridden":
        objects = [obj.override_create(remap_local_usages=True) for obj in objects]
    bpy.context.view_layer.update()
    pick(*objects)
    bpy.context.scene.pointmorph.show_as = "MESH"
    shown = morph()
    source = bpy.context.scene.pointmorph.source
    made = {shown, shown.pointmorph.made_from, *({source} if what == "mirror" else ())}
    for obj in made:
        assert obj.library is obj.override_library is obj.data.library is None
    assert (source == objects[0]) == (what == "plain")
    if what == "plain":
        with pytest.raises(RuntimeError, match="an editable mesh.*linked from another file"):
            bpy.ops.pointmorph.subdivide_source()


def test_modifiers_are_kept_on_request(mirrored, settings, capfd):
    mirrored.pointmorph.keep_modifiers = True
    shown = morph()
    assert settings.source == mirrored
    assert [modifier.name for modifier in shown.modifiers] == ["Path", "Twice"]
    assert "keeps Twice of the source: they change the target" in capfd.readouterr().out


@pytest.mark.parametrize("what", ["pose", "key"])
def test_how_to_keep_what_was_applied_is_said(settings, capfd, what):
    """With Keep Modifiers, a pose would be there twice."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    put_on(source, what)
    morph()
    advice = ("turn on Keep Modifiers", "set its armature to Rest Position")[what == "pose"]
    said = capfd.readouterr().out.replace('choose "Hill" as the source, ', "")
    assert f"To keep what was applied, {advice}" in said
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")
    said = capfd.readouterr().out.replace("choose it as the source, ", "")
    assert f'For keys on "Hill" itself, {advice}' in said


def test_a_cache_that_would_undo_the_morph_is_not_kept(settings, capfd, tmp_path):
    """A mesh of an Alembic file has its vertices from there, whatever moves them before. With Keep
    Modifiers, which was advised, the slider did nothing."""
    settings.show_as = "MESH"
    source, target = pair(14, 12)
    target.vertex_groups.clear()
    path = str(tmp_path / "moving.abc")
    for frame, z in ((1, 0.0), (3, 2.0)):
        source.location.z = z
        source.keyframe_insert("location", frame=frame)
    source.modifiers.new("Rough", "DISPLACE").strength = 0.01
    select(source)
    bpy.ops.wm.alembic_export(filepath=path, selected=True, start=1, end=3, flatten=True)
    bpy.data.objects.remove(source)
    bpy.ops.wm.alembic_import(filepath=path, always_add_cache_reader=True)
    cached = next(o for o in bpy.context.scene.objects if o not in (target,))
    assert [m.type for m in cached.modifiers] == ["MESH_SEQUENCE_CACHE"]
    pick(cached, target)
    morph()
    assert "show the morph as points or discs and turn on Follow" in capfd.readouterr().out
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")
    assert "For keys on" not in capfd.readouterr().out
    pick(cached, target)
    cached.pointmorph.keep_modifiers = True
    shown = morph()
    assert f"has no {cached.modifiers[0].name}" in capfd.readouterr().out
    places = shown_surface(shown)
    set_t(shown, 1)
    bpy.context.view_layer.update()
    assert np.abs(shown_surface(shown) - places).max() > 0.1


def test_a_morph_at_its_end_is_a_source(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    first = morph()
    set_t(first, 1)
    bpy.context.view_layer.update()
    end = shown_surface(first)
    last = add_mesh("Field", *patch(11, bump=0.1))
    mark(last, "peak", 0, 0)
    mark(last, "slope", 0.5, 0.3)
    pick(first, last)
    shown = morph()
    np.testing.assert_allclose(shown_surface(shown), end, atol=1e-5)
    assert not settings.source.pointmorph.keeps_faces
    assert settings.source.pointmorph.made_from is None


def test_after_an_error_the_source_is_itself(addon, mirrored, settings, monkeypatch):
    addon("scene.points_display").remove_unused()  # those of other tests

    def fail(*_):
        raise RuntimeError("of Blender's")

    monkeypatch.setattr(addon("scene.slider_keys"), "follow", fail)
    before = data_blocks()
    assert "of Blender's" in error_of(bpy.ops.pointmorph.morph)
    assert settings.source == mirrored
    assert not mirrored.hide_get()
    assert not mirrored.hide_render
    assert data_blocks() - before == set()


def test_a_source_picked_again_renews_its_copy(mirrored, settings):
    target = settings.target
    shown = morph()
    copy = settings.source
    assert copy.pointmorph.shown_from == mirrored
    assert shown.pointmorph.shown_from is None
    mirrored.modifiers.new("Round", "SUBSURF")
    pick(mirrored, target)
    bpy.context.view_layer.update()
    before, meshes = shown_surface(mirrored), len(bpy.data.meshes)
    name, keyed = shown.name, shown.data.shape_keys.key_blocks["Morph"]
    keyed.value = 0.0
    bpy.ops.pointmorph.morph()
    assert settings.source == copy
    assert len(bpy.context.scene.objects) == 5
    assert shown.name == name
    np.testing.assert_allclose(shown_surface(shown), before, atol=1e-5)
    assert len(bpy.data.meshes) == meshes
    assert copy.data.name == "Half as Shown"


def test_after_an_error_a_renewed_copy_is_as_before(addon, mirrored, settings, monkeypatch):
    target = settings.target
    morph()
    copy, mesh = settings.source, settings.source.data
    mirrored.modifiers.new("Round", "SUBSURF")
    pick(mirrored, target)

    def fail(*_):
        raise RuntimeError("of Blender's")

    monkeypatch.setattr(addon("scene.morphing_mesh"), "remake", fail)
    before = data_blocks()
    assert "of Blender's" in error_of(bpy.ops.pointmorph.morph)
    assert settings.source == mirrored
    assert copy.data == mesh
    assert data_blocks() == before


def test_a_source_that_gets_a_modifier_gets_another_morph(settings):
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    first = morph()
    put_on(source, "mirror")
    before = shown_surface(source)
    bpy.ops.pointmorph.morph()
    second = bpy.context.view_layer.objects.active
    assert second != first
    np.testing.assert_allclose(shown_surface(second), before, atol=1e-5)


def test_keep_modifiers_makes_another_morph(mirrored, settings):
    target = settings.target
    first = morph()
    pick(mirrored, target)
    mirrored.pointmorph.keep_modifiers = True
    second = morph()
    assert second != first
    assert settings.source == mirrored
    mirrored.pointmorph.keep_modifiers = False
    bpy.ops.pointmorph.morph()
    assert settings.source == first.pointmorph.source
    assert len(bpy.context.scene.objects) == 7


def test_points_keep_no_modifiers(mirrored, settings, capfd):
    settings.show_as = "POINTS"
    mirrored.pointmorph.keep_modifiers = True
    morph()
    assert "of the source: they change the target" not in capfd.readouterr().out


def test_what_a_copy_goes_without_is_named(mirrored, capfd):
    mirrored.modifiers.new("Fur", "PARTICLE_SYSTEM")
    bpy.context.view_layer.update()
    morph()
    assert "goes without Fur of the source" in capfd.readouterr().out


def test_a_copy_that_undo_took_away_is_said_to_be_gone(addon, mirrored, settings, monkeypatch):
    chains = addon("data.chains")
    compute = chains.compute_all

    def undo(*arguments):
        bpy.data.objects.remove(bpy.data.objects["Half as Shown"])
        return compute(*arguments)

    monkeypatch.setattr(chains, "compute_all", undo)
    with pytest.raises(RuntimeError, match="gone after undo. Press Morph again."):
        bpy.ops.pointmorph.morph()


def test_after_an_interruption_the_source_is_itself(addon, mirrored, settings, monkeypatch):
    class Interruption(BaseException):
        """As Ctrl-C, which pytest would take for its own."""

    def interrupt(*_):
        raise Interruption

    monkeypatch.setattr(addon("data.chains"), "compute_all", interrupt)
    before = data_blocks()
    assert "Interruption" in error_of(bpy.ops.pointmorph.morph)
    assert settings.source == mirrored
    assert not mirrored.hide_get()
    assert data_blocks() - before == set()


def test_what_does_nothing_is_not_called_as_shown(addon):
    known = addon("scene.as_shown")
    source, _ = pair(14, 12)
    put_on(source, "triangles")
    assert known.left_out(source) == ["Triangles"]
    assert not known.may_change(source)
    put_on(source, "mirror")
    assert known.may_change(source)


def test_advice_is_not_to_do_what_is_done(addon):
    """At rest, what is applied is something else than the pose."""
    as_shown = addon("scene.as_shown")
    obj = add_mesh("Hill", *patch(7))
    add_armature(obj, (0, 0, 0.5))
    obj.modifiers.new("Mirror", "MIRROR")
    for position, words in (("POSE", "Rest Position"), ("REST", "Keep Modifiers")):
        bpy.data.objects["Rig"].data.pose_position = position
        bpy.context.view_layer.update()
        assert words in as_shown.how_to_keep(obj, "it")
        posed = as_shown.posed_twice(bpy.context, obj, obj)
        assert (posed is None) == (position == "REST")
