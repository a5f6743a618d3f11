"""Morphs to which something is joined, from which something is separated, and library overrides of
them."""

import threading

import bpy
import numpy as np
import pytest
from scenes import add_mesh, coordinates, error_of, morph, pair, patch, recompute, select


@pytest.fixture
def shown(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    return morph()


def separate(obj):
    """What Blender makes of half the faces of an object."""
    select(obj)
    known = set(bpy.data.objects)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    halves = {vertex.index for vertex in obj.data.vertices if vertex.co.x > 0}
    for face in obj.data.polygons:
        face.select = halves.issuperset(face.vertices)
    for vertex in obj.data.vertices:
        vertex.select = vertex.index in halves
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.mesh.separate(type="SELECTED") == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    (made,) = set(bpy.data.objects) - known
    return made


@pytest.mark.parametrize("kind", ["MESH", "POINTS"])
def test_what_was_joined_makes_it_out_of_date(settings, kind, capfd):
    """Recompute says that it took it away."""
    settings.show_as = kind
    pair(14, 12)
    shown = morph()
    other = add_mesh("Hat", *patch(4))
    added, whole = len(other.data.vertices), len(shown.data.vertices)
    select(other)
    shown.select_set(True)
    bpy.context.view_layer.objects.active = shown
    assert bpy.ops.object.join() == {"FINISHED"}
    assert shown.pointmorph.state == "STALE"
    assert shown.pointmorph.stale == '"Hill to Dune" has other vertices than it was made with'
    capfd.readouterr()
    recompute(shown)
    said = f'"Hill to Dune" lost the {added} vertices that were added to it'
    assert capfd.readouterr().out.count(said) == 1
    assert shown.pointmorph.state == "CURRENT"
    assert len(shown.data.vertices) == whole


@pytest.mark.parametrize("has_keys", [False, True])
def test_a_mesh_that_points_were_joined_to_is_no_morph(settings, has_keys):
    """It was taken for one from an earlier version, which Recompute refused."""
    _, target = pair(14, 12)
    points = morph()
    other = add_mesh("Hat", *patch(4))
    if has_keys:
        other.shape_key_add(name="Basis")
    select(other)
    points.select_set(True)
    assert bpy.ops.object.join() == {"FINISHED"}
    assert "source_row" in other.data.attributes
    assert other.pointmorph.state == ""
    # The slider is still there, as a key of Blender's own.
    assert "Morph" in other.data.shape_keys.key_blocks
    select(other)
    assert "Morph first" in error_of(bpy.ops.pointmorph.recompute)
    settings.source, settings.target = other, target
    settings.show_as = "MESH"
    for feature in settings.features:
        feature.use = False
    again = morph()
    assert again.pointmorph.state == "CURRENT"
    assert len(again.data.polygons) == len(patch(4)[1])


def test_what_was_separated_stays_as_it_is(shown, capfd):
    part = separate(shown)
    assert (shown.pointmorph.state, part.pointmorph.state) == ("STALE", "STALE")
    before = coordinates(part.data.vertices)
    recompute(shown)
    assert f'"{part.name}" was left unchanged' in capfd.readouterr().out
    np.testing.assert_array_equal(coordinates(part.data.vertices), before)
    assert len(shown.data.vertices) == len(shown.pointmorph.source.data.vertices)


def test_points_that_were_separated_are_out_of_date(settings):
    pair(14, 12)
    obj = morph()
    for vertex in obj.data.vertices:
        vertex.select = vertex.co.x > 0
    select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.separate(type="SELECTED")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert obj.pointmorph.state == "STALE"
    recompute(obj)
    assert obj.pointmorph.state == "CURRENT"


@pytest.fixture
def override(shown, tmp_path):
    """The library override of a morph in another file."""
    path = str(tmp_path / "rig.blend")
    rig = bpy.data.collections.new("Rig")
    bpy.context.scene.collection.children.link(rig)
    for obj in bpy.data.objects:
        if not obj.name.startswith("."):
            rig.objects.link(obj)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, loaded):
        loaded.collections = ["Rig"]
    made = loaded.collections[0].override_hierarchy_create(
        bpy.context.scene, bpy.context.view_layer
    )
    bpy.context.view_layer.update()
    return made.objects["Hill to Dune"]


def test_an_override_knows_its_state(override, addon):
    """Blender compares overrides on other threads, where it once ended at this."""
    for _ in range(50):
        assert override.pointmorph.state == "CURRENT"
        override.location.x += 1
        override.override_library.operations_update()
    assert override.override_library is not None


def test_the_slider_of_an_override_can_be_keyed_where_its_mesh_is_one(override):
    """It was said to have a locked action."""
    select(override)
    said = error_of(bpy.ops.pointmorph.key_morph)
    assert 'The slider of "Hill to Dune" is linked from another file' in said
    override.data.override_create(remap_local_usages=True)
    assert bpy.ops.pointmorph.key_morph() == {"FINISHED"}


def test_keys_that_would_be_lost_are_not_baked_on_an_override(override):
    select(override)
    said = error_of(bpy.ops.pointmorph.bake_shape_keys, kind="PAIRS")
    assert "Hill to Dune Points: expected a morph object in this file" in said


def test_shapes_of_an_override_get_a_result_of_their_own(override):
    """The one with the linked points was to be computed again, which can't be."""
    select(override)
    assert bpy.ops.pointmorph.edit_morph() == {"FINISHED"}
    override.data.override_create(remap_local_usages=True)
    assert morph() != override


def test_state_is_no_matter_of_other_threads(shown, addon):
    found = []
    thread = threading.Thread(target=lambda: found.append(shown.pointmorph.state))
    thread.start()
    thread.join()
    assert found == [""]
    assert shown.pointmorph.state == "CURRENT"


def test_features_of_overrides_can_be_chosen(override, capfd):
    select(override)
    assert bpy.ops.pointmorph.edit_morph() == {"FINISHED"}
    settings = bpy.context.scene.pointmorph
    assert settings.source.override_library is not None
    settings.features["peak"].hold = "SOFT"
    settings.features["peak"].name = "top"
    assert "Traceback" not in "".join(capfd.readouterr())
