"""Morphs whose shape keys somebody has removed or renamed."""

import bpy
import numpy as np
import pytest
from scenes import (
    add_mesh,
    coordinates,
    error_of,
    key,
    mark,
    morph,
    pair,
    patch,
    recompute,
    select,
    set_t,
    shown_points,
    slider,
    surface_of,
)


@pytest.fixture(params=["MESH", "POINTS"])
def shown(request, settings):
    settings.show_as = request.param
    pair(14, 12)
    return morph()


def seen(obj):
    """(3, N, 3): what is seen at the start, in the middle and at the end."""
    found = []
    for t in (0.0, 0.5, 1.0):
        set_t(obj, t)
        found.append(surface_of(obj) if obj.pointmorph.keeps_faces else shown_points(obj))
    return np.array(found)


def lose(obj, what):
    """As the buttons of the shape keys do: Blender may end where a script removes driven ones."""
    keys = obj.data.shape_keys.key_blocks
    if what == "renamed":
        keys["Morph"].name = "Mine"
        return
    select(obj)
    obj.active_shape_key_index = max(keys.find(what), 0)
    assert bpy.ops.object.shape_key_remove(all=what == "all") == {"FINISHED"}
    bpy.context.view_layer.update()


@pytest.mark.parametrize("what", ["all", "Morph", "Basis", "renamed"])
def test_recompute_brings_them_back(shown, what):
    before = seen(shown)
    lose(shown, what)
    assert shown.pointmorph.state == "STALE"
    assert shown.pointmorph.stale.startswith('the shape key "Morph" of "Hill to Dune" was removed')
    assert "Recompute it" in error_of(bpy.ops.pointmorph.key_morph)
    recompute(shown)
    assert (shown.pointmorph.state, shown.pointmorph.stale) == ("CURRENT", "")
    assert [k.name for k in shown.data.shape_keys.key_blocks] == ["Basis", "Morph"]
    np.testing.assert_allclose(seen(shown), before, atol=1e-6)


def test_points_follow_the_slider_of_the_mesh_again(settings):
    settings.show_as = "MESH"
    pair(14, 12)
    mesh = morph()
    points = mesh.pointmorph.made_from
    lose(mesh, "all")
    recompute(mesh)
    set_t(mesh, 0.25)
    assert slider(points).value == pytest.approx(0.25)
    points.shape_key_clear()
    recompute(mesh)
    set_t(mesh, 0.75)
    assert slider(points).value == pytest.approx(0.75)
    lose(mesh, "all")
    points.shape_key_clear()
    recompute(mesh)
    set_t(mesh, 0.5)
    assert slider(points).value == pytest.approx(0.5)


@pytest.mark.parametrize("applied", [False, True])
def test_without_the_source_as_well(shown, applied):
    """What the mesh holds is enough, unless its vertices are on the way."""
    before = seen(shown)
    bpy.data.objects.remove(bpy.data.objects["Hill"])
    if applied:
        set_t(shown, 0.5)
        bpy.ops.object.shape_key_remove(all=True, apply_mix=True)
    else:
        lose(shown, "all")
    bpy.context.view_layer.update()
    assert shown.pointmorph.state == "ORPHAN"
    assert 'the shape key "Morph" of "Hill to Dune" was removed' in shown.pointmorph.stale
    if not applied:
        recompute(shown)
        assert shown.pointmorph.stale == '"Hill" no longer exists'
        np.testing.assert_allclose(seen(shown), before, atol=1e-6)
    elif not shown.pointmorph.keeps_faces:
        select(shown)
        assert 'with its shape key "Morph"' in error_of(bpy.ops.pointmorph.recompute)


@pytest.mark.parametrize("animated", [False, True])
def test_what_was_applied_meanwhile_stays(settings, animated):
    """It jumped."""
    settings.show_as = "MESH"
    pair(14, 12)
    mesh = morph()
    mesh.rotation_euler = 0.3, 0.2, 0.7
    mesh.location = 1, 2, 3
    assert bpy.ops.object.transform_apply() == {"FINISHED"}
    if animated:
        mesh.keyframe_insert("location", frame=1)
    before = seen(mesh)
    lose(mesh, "all")
    recompute(mesh)
    bpy.context.view_layer.update()
    matrix = np.array(mesh.matrix_world)
    assert np.allclose(matrix, np.eye(4)) == animated
    found = seen(mesh) @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(found, before, atol=1e-5)


def test_what_cannot_come_back_names_other_ways(settings):
    """Recompute said to recompute."""
    pair(14, 12)
    points = morph()
    points.data.attributes.remove(points.data.attributes["path0_0"])  # as in an earlier version
    lose(points, "all")
    select(points)
    assert "Alt-click Morph for a new result" in error_of(bpy.ops.pointmorph.recompute)


def test_keys_of_a_renamed_slider_stay(shown):
    slider(shown).keyframe_insert("value", frame=3)
    lose(shown, "renamed")
    recompute(shown)
    (path,) = {
        curve.data_path
        for layer in _channels(shown.data.shape_keys.animation_data.action)
        for curve in layer
    }
    assert path == 'key_blocks["Morph"].value'


def _channels(action):
    if hasattr(action, "fcurves"):
        return [action.fcurves]
    return [bag.fcurves for layer in action.layers for s in layer.strips for bag in s.channelbags]


@pytest.mark.parametrize("gone", ["all", "Morph", "Dune", "Basis"])
def test_a_chain_gets_them_back(settings, gone):
    settings.show_as = "MESH"
    pair(14, 12)
    between = add_mesh("Middle", *patch(11, bump=0.2))
    mark(between, "peak", 0, 0)
    mark(between, "slope", 0.5, 0.3)
    settings.via.add().object = between
    chain = morph()
    before = [key(chain, name) for name in ("Basis", "Morph", "Middle", "Dune")]
    lose(chain, gone)
    assert chain.pointmorph.state == "STALE"
    recompute(chain)
    assert chain.pointmorph.state == "CURRENT"
    for name, places in zip(("Basis", "Morph", "Middle", "Dune"), before, strict=True):
        np.testing.assert_allclose(key(chain, name), places, atol=1e-6)
    assert slider(chain).slider_max == 2.0
    set_t(chain, 1.25)
    values = {k.name: k.value for k in chain.data.shape_keys.key_blocks}
    assert (values["Middle"], values["Dune"]) == pytest.approx((0.75, 0.25))


def test_what_was_baked_stays(shown):
    shown.shape_key_add(name="Mine").data[0].co.z += 1
    moved = coordinates(shown.data.shape_keys.key_blocks["Mine"].data) - key(shown, "Basis")
    lose(shown, "Basis")
    recompute(shown)
    now = key(shown, "Mine") - key(shown, "Basis")
    np.testing.assert_allclose(now, moved, atol=1e-5)
