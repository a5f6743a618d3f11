"""The target's UV maps and weights on the morph, and the source's weights on the target."""

import bpy
import numpy as np
import pytest
from scenes import add_group, coordinates, read
from transferring_scenes import exactly_there, transfer, unwrap, words

pytestmark = pytest.mark.interface


def test_uvs_keep_their_seams(turned):
    """Two islands, far apart: the same map has the same UVs at all corners."""
    _, target, copy = turned
    corners = np.array([loop.vertex_index for loop in target.data.loops])
    uvs = coordinates(target.data.vertices)[corners][:, :2] * 0.2 + 0.25
    middle = read(target.data.polygons, "center", 3)[:, 0]
    uvs[np.repeat(middle > 0.1, 4)] += 0.5
    layer = target.data.uv_layers.new(name="Skin")
    layer.data.foreach_set("uv", uvs.astype(np.float32).reshape(-1))
    transfer(copy, uvs=True)
    found = read(copy.data.uv_layers["target.Skin"].data, "uv", 2)
    np.testing.assert_allclose(found, uvs, atol=1e-5)
    assert "squeezed" not in words(copy)
    # Elsewhere, a face goes with one side.
    exactly_there(copy, target, shift=[0.07, 0, 0])
    transfer(copy, uvs=True)
    found = read(copy.data.uv_layers["target.Skin"].data, "uv", 2).reshape(-1, 4, 2)
    assert np.ptp(found, axis=1).max() < 0.06
    assert 'faces lie across a seam of the UV map "Skin"' in words(copy)


@pytest.mark.parametrize("by_pairs", [False, True])
def test_uv_maps_come_only_where_they_are_wanted(turned, by_pairs):
    _, target, copy = turned
    unwrap(target, "Skin")
    add_group(target, "bone", {0: 1.0})
    obj = copy.pointmorph.made_from if by_pairs else copy
    obj.hide_set(False)
    transfer(obj)
    assert "target.bone" in obj.vertex_groups
    assert "target.Skin" not in obj.data.attributes
    transfer(obj, uvs=True)
    assert obj.data.attributes["target.Skin"].domain == ("POINT" if by_pairs else "CORNER")


def test_no_room_for_another_uv_map(turned):
    _, target, copy = turned
    for number in range(8):
        copy.data.uv_layers.new(name=f"Own {number}")
    target.data.uv_layers.new(name="Skin")
    add_group(target, "bone", {0: 1.0})
    transfer(copy, uvs=True)
    assert 'has no room for the UV map "target.Skin"' in words(copy)
    assert "target.bone" in copy.vertex_groups


@pytest.mark.parametrize("by_pairs", [False, True])
def test_weights_of_the_source_on_the_target(turned, by_pairs):
    source, target, copy = turned
    ramp = np.clip(0.5 + 0.4 * coordinates(source.data.vertices)[:, 0], 0, 1)
    add_group(source, "bone", dict(enumerate(ramp.tolist())))
    obj = copy
    if by_pairs:
        obj = copy.pointmorph.made_from
        obj.hide_set(False)
    transfer(obj, back=True)
    assert [group.name for group in target.vertex_groups][5:] == ["source.bone"]
    index = target.vertex_groups["source.bone"].index
    found = np.array([next((e.weight for e in v.groups if e.group == index), 0.0)
                      for v in target.data.vertices])  # fmt: skip
    np.testing.assert_allclose(found, ramp, atol=0.1 if by_pairs else 1e-5)
    assert 'To "Dune": the vertex group "source.bone"' in words(obj)
    # Once more, it's neither carried to and fro nor in its own way.
    transfer(obj, back=True)
    assert len(target.vertex_groups) == 6
    assert not [g.name for g in obj.vertex_groups if "source.bone" in g.name]


@pytest.mark.parametrize("prefix", ["", "target.", "x."])
def test_weights_to_and_fro_twice(turned, prefix):
    source, target, copy = turned
    add_group(source, "leg", {0: 1.0})
    add_group(target, "arm", {0: 1.0})
    copy.vertex_groups.clear()
    for _ in range(2):
        assert transfer(copy, back=True, prefix=prefix) == {"FINISHED"}
        back = prefix.replace("target", "source") + "leg"
        assert [group.name for group in target.vertex_groups][5:] == ["arm", back]
        assert [group.name for group in copy.vertex_groups] == [f"{prefix}arm"]
    # Only who asks for it changes the target.
    target.vertex_groups.remove(target.vertex_groups[back])
    bpy.ops.pointmorph.recompute()
    assert back not in target.vertex_groups
    assert f"{prefix}arm" in copy.vertex_groups


def test_values_by_place_on_the_source(turned):
    source, target, copy = turned
    place = coordinates(target.data.vertices)
    ramp = np.clip(0.5 + 0.4 * place[:, 1], 0, 1)
    add_group(target, "bone", dict(enumerate(ramp.tolist())))
    transfer(copy, onto="SOURCE", prefix="")
    index = source.vertex_groups["bone"].index
    found = np.array([next((e.weight for e in v.groups if e.group == index), 0.0)
                      for v in source.data.vertices])  # fmt: skip
    assert np.abs(found - ramp).max() < 0.1
    assert "bone" not in copy.vertex_groups
