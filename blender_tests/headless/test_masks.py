"""Vertex groups of the source that keep its shape or its place when its mesh morphs."""

import bpy
import numpy as np
import pytest
from scenes import add_group, coordinates, morph, pick

pytestmark = pytest.mark.interface


def ball(name, scale=(1, 1, 1), bump=0.0):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4)  # the same bits in every Blender
    obj = bpy.context.object
    obj.name = name
    places = coordinates(obj.data.vertices).astype(np.float64)
    places *= 1 + bump * np.sin(3 * places[:, [0]]) * np.sin(2 * places[:, [1]])
    obj.data.vertices.foreach_set("co", (places * scale).astype(np.float32).reshape(-1))
    return obj


@pytest.fixture
def balls(settings):
    """A ball with the groups Top and Bottom, and an egg with bumps."""
    settings.show_as = "MESH"
    source, target = ball("Ball"), ball("Egg", (1.0, 1.4, 0.7), bump=0.3)
    heights = coordinates(source.data.vertices)[:, 2]
    for name, rows in (("Top", heights > 0.75), ("Bottom", heights < -0.75)):
        add_group(source, name, dict.fromkeys(np.flatnonzero(rows).tolist(), 1.0))
    pick(source, target)
    return source, target


def landed(result):
    """Where the source's vertices are at the end, in the scene."""
    mesh = result.pointmorph.mesh or result
    places = coordinates(mesh.data.shape_keys.key_blocks["Morph"].data)
    return places @ np.array(mesh.matrix_world)[:3, :3].T + np.array(mesh.matrix_world)[:3, 3]


def rows_of(obj, name):
    index = obj.vertex_groups[name].index
    return [v.index for v in obj.data.vertices if any(g.group == index for g in v.groups)]


def bent(before, after):
    """How far places are from a similar copy of what they were, over their extent."""
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
    scale = (b * (a @ turn.T)).sum() / (a**2).sum()
    return np.abs(b - scale * a @ turn.T).max() / np.abs(b).max()


def test_a_rigid_part_keeps_its_shape(balls):
    source, _ = balls
    rows = rows_of(source, "Top")
    before = coordinates(source.data.vertices)[rows].astype(np.float64)
    assert bent(before, landed(morph())[rows]) > 0.05
    source.pointmorph.rigid_group = "Top"
    assert bent(before, landed(morph())[rows]) < 1e-4


def test_a_fixed_part_stays_where_it_is(balls):
    source, _ = balls
    rows = rows_of(source, "Bottom")
    before = coordinates(source.data.vertices)
    assert np.abs(landed(morph()) - before)[rows].max() > 0.05
    source.pointmorph.fixed_group = "Bottom"
    after = landed(morph())
    assert np.abs(after - before)[rows].max() < 1e-6
    others = np.setdiff1d(np.arange(len(before)), rows)
    assert np.abs(after - before)[others].max() > 0.05


def test_a_feature_comes_before_a_mask(balls):
    source, target = balls
    row = rows_of(source, "Top")[0]
    add_group(source, "pm.top", {row: 1.0})
    add_group(target, "pm.top", {0: 1.0})
    source.pointmorph.fixed_group = "pm.top"
    assert np.abs(landed(morph())[row] - coordinates(target.data.vertices)[0]).max() < 1e-6


def test_a_mask_that_is_gone_is_named(balls):
    source, _ = balls
    source.pointmorph.rigid_group = "Top"
    source.vertex_groups["Top"].name = "Crown"
    with pytest.raises(RuntimeError, match='"Top", chosen as Rigid'):
        morph()


def test_an_empty_mask_is_none(balls):
    source, _ = balls
    free = landed(morph())
    source.vertex_groups.new(name="Nothing")
    source.pointmorph.rigid_group = "Nothing"
    assert np.array_equal(landed(morph()), free)


def test_a_mask_of_the_target_does_nothing(balls):
    _, target = balls
    free = landed(morph())
    add_group(target, "Top", {0: 1.0})
    target.pointmorph.fixed_group = "Top"
    target.pointmorph.rigid_group = "gone"
    assert np.array_equal(landed(morph()), free)


def test_another_mask_makes_it_stale(balls):
    source, _ = balls
    result = morph()
    assert result.pointmorph.state == "CURRENT"
    source.pointmorph.rigid_group = "Top"
    assert 'the masks of "Ball" have changed' in result.pointmorph.stale
    bpy.ops.pointmorph.recompute()
    assert result.pointmorph.state == "CURRENT"
    source.vertex_groups["Top"].add([0], 0.5, "REPLACE")
    assert result.pointmorph.state == "STALE"


def test_the_panel_is_there_for_a_mesh(balls, addon):
    panel = addon("ui.panels").POINTMORPH_PT_masks
    assert panel.poll(bpy.context)
    bpy.context.scene.pointmorph.source = None
    assert not panel.poll(bpy.context)
