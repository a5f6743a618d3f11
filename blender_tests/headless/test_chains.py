"""One object that goes from shape to shape."""

import json
from itertools import pairwise

import bpy
import numpy as np
import pytest
from mathutils import Vector
from pointmorph.sequences import surfaces
from scenes import (
    add_attribute,
    add_mesh,
    attribute,
    baked_frames,
    coordinates,
    error_of,
    key,
    mark,
    morph,
    patch,
    row_at,
    select,
    set_t,
    shown_points,
)

NAMES = ("Hill", "Dune", "Fell", "Rock")
SIDES = (14, 12, 17, 13)


def shapes(count=3, marked=True):
    """Sheets that differ in size and form, picked as a chain."""
    found = []
    for number, (name, side) in enumerate(zip(NAMES[:count], SIDES, strict=False)):
        obj = add_mesh(name, *patch(side, bump=0.3 + 0.3 * number, turn=number))
        obj.location = (0, 0, 0.5 * number)
        if marked:
            mark(obj, "peak", 0, 0)
            mark(obj, "slope", 0.5, 0.3)
        radii = np.full(side * side, 0.01 * (number + 1))
        add_attribute(obj.data, "radius", "FLOAT", radii)
        color = np.zeros((side * side, 4))
        color[:, number % 3] = color[:, 3] = 1
        obj.data.color_attributes.active_color = add_attribute(
            obj.data, "Col", "FLOAT_COLOR", color
        )
        found.append(obj)
    settings = bpy.context.scene.pointmorph
    settings.source, settings.target = found[0], found[-1]
    settings.domain = "disk"  # as in scenes.pair
    for obj in found[1:-1]:
        settings.via.add().object = obj
    return found


def chain():
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def columns(obj, count=3):
    """(M, n): rows of all shapes."""
    stages = ["source", *(f"via{k}" for k in range(1, count - 1)), "target"]
    return np.stack([attribute(obj.data, f"{stage}_row") for stage in stages], axis=1)


def world(obj):
    return coordinates(obj.data.vertices) + np.array(obj.location, np.float32)


# --- The object -----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [3, 4])
def test_whole_numbers_of_t_are_the_shapes(settings, count):
    found = shapes(count)
    obj = chain()
    assert obj.name == " to ".join(NAMES[:count])
    t = obj.data.shape_keys.key_blocks["Morph"]
    assert (t.value, t.slider_min, t.slider_max) == (0, 0, count - 1)
    rows = columns(obj, count)
    for number, shape in enumerate(found):
        # Every vertex of every shape is there, and all points lie on vertices.
        assert np.array_equal(np.unique(rows[:, number]), np.arange(len(shape.data.vertices)))
        set_t(obj, number)
        np.testing.assert_allclose(
            shown_points(obj) + np.array(obj.location), world(shape)[rows[:, number]], atol=1e-6
        )
        np.testing.assert_allclose(shown_points(obj, "radius"), 0.01 * (number + 1), rtol=1e-5)
        color = np.zeros(4)
        color[number % 3] = color[3] = 1
        np.testing.assert_allclose(
            shown_points(obj, "Color"), np.tile(color, (len(rows), 1)), atol=1e-6
        )


def test_between_shapes_it_is_their_mix_and_joints_are_continuous(settings):
    found = shapes(3)
    obj = chain()
    rows = columns(obj)
    places = [world(s)[r] - np.array(obj.location) for s, r in zip(found, rows.T, strict=True)]
    for t in (0.25, 0.999, 1.001, 1.5):
        number = int(t)
        share = t - number
        set_t(obj, t)
        mixed = (1 - share) * places[number] + share * places[number + 1]
        np.testing.assert_allclose(shown_points(obj), mixed, atol=2e-6)
        radius = 0.01 * (1 + t)
        np.testing.assert_allclose(shown_points(obj, "radius"), radius, rtol=1e-4)
    set_t(obj, 1.0)
    joint = shown_points(obj)
    step = max(np.abs(b - a).max() for a, b in pairwise(places))
    for t in (0.999, 1.001):
        set_t(obj, t)
        assert np.abs(shown_points(obj) - joint).max() <= 0.001 * step + 2e-6


def test_every_pair_of_every_way_is_in_it(settings):
    """Each way alone, computed by Morph, has the same pairs."""
    found = shapes(3)
    for shape in found:
        shape.location = (0, 0, 0)  # the same frame for each of them
    rows = columns(chain())
    settings.via.clear()
    for number in (0, 1):
        settings.source, settings.target = found[number : number + 2]
        alone = morph()
        pairs = {
            tuple(row)
            for row in np.stack(
                [attribute(alone.data, f"{side}_row") for side in ("source", "target")], axis=1
            )
        }
        assert {tuple(row) for row in rows[:, number : number + 2]} == pairs


def test_marks_meet_along_the_whole_chain(settings):
    found = shapes(3)
    rows = {tuple(row) for row in columns(chain())}
    for place in ((0, 0), (0.5, 0.3)):
        assert tuple(row_at(coordinates(s.data.vertices), *place) for s in found) in rows


def test_join_pairs(addon):
    """Every pair of both tables, no row more than that takes, and the same each time."""
    rng = np.random.default_rng(7)
    join = addon("data.chains").join_pairs
    for _ in range(20):
        tables = []
        for a, b in ((5, 7), (7, 4), (4, 9)):
            extra = np.stack([rng.integers(0, a, 6), rng.integers(0, b, 6)], axis=1)
            total = [(k % a, k % b) for k in range(max(a, b))]
            tables.append(np.unique(np.concatenate([total, extra]), axis=0))
        joined = join(tables)
        for number, table in enumerate(tables):
            found = {tuple(row) for row in joined[:, number : number + 2]}
            assert found == {tuple(row) for row in table}
        two = join(tables[:2])
        counts = [np.bincount(side, minlength=7) for side in (tables[0][:, 1], tables[1][:, 0])]
        assert len(two) == np.maximum(*counts).sum()


def test_report_and_quality(settings):
    settings.method = "paper"
    for obj, x in zip(shapes(3), (-0.6, 0.6, -0.6), strict=True):
        mark(obj, "wrong", x, -0.7)  # on the wrong side of the one between
        mark(obj, "too", -x, 0.7)
    obj = chain()
    report = json.loads(obj.pointmorph.report)
    assert set(report["ways"]) == {"Hill to Dune", "Dune to Fell"}
    assert report["pairs"] == len(obj.data.vertices)
    assert bpy.ops.pointmorph.show_distortion() == {"FINISHED"}
    assert report["worst"]
    assert bpy.ops.pointmorph.go_to_place() == {"FINISHED"}
    assert bpy.context.scene.cursor.location.length > 0


# --- What it survives -----------------------------------------------------------------------------


def test_save_load_duplicate_and_frames(settings, tmp_path):
    shapes(3)
    obj = chain()
    t = obj.data.shape_keys.key_blocks["Morph"]
    for frame, value in ((1, 0.0), (21, 2.0)):
        t.value = value
        t.keyframe_insert("value", frame=frame)
        for curve in t.id_data.animation_data.drivers:
            assert curve.driver.is_valid
    path = str(tmp_path / "chain.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.data.objects["Hill to Dune to Fell"]
    select(obj)
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    copy.data.shape_keys.animation_data.action = None
    set_t(copy, 2.0)
    for frame, name in ((1, "Basis"), (11, "Dune"), (21, "Fell")):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_allclose(shown_points(obj), key(obj, name), atol=2e-6)
        np.testing.assert_allclose(shown_points(copy), key(copy, "Fell"), atol=2e-6)
    assert obj.pointmorph.state == copy.pointmorph.state == "CURRENT"


def test_recompute_in_place(settings):
    found = shapes(3)
    obj = chain()
    identity = obj.as_pointer(), obj.data.as_pointer(), obj.data.shape_keys.as_pointer()
    positions, faces = patch(16, bump=0.9)
    mesh = bpy.data.meshes.new("Finer")
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    found[1].data = mesh
    for shape in found:
        shape.vertex_groups.clear()
    assert '"Dune" has 256 points instead of 144' in obj.pointmorph.stale
    select(obj)
    bpy.ops.pointmorph.recompute()
    assert obj.pointmorph.state == "CURRENT"
    assert identity == (obj.as_pointer(), obj.data.as_pointer(), obj.data.shape_keys.as_pointer())
    rows = columns(obj)
    for number, shape in enumerate(found):
        set_t(obj, number)
        np.testing.assert_allclose(
            shown_points(obj) + np.array(obj.location), world(shape)[rows[:, number]], atol=2e-6
        )
    # Without one of its shapes it's made from what it holds.
    before = key(obj, "Fell")
    bpy.data.objects.remove(found[1])
    assert (obj.pointmorph.state, obj.pointmorph.stale) == ("ORPHAN", '"Dune" no longer exists')
    bpy.ops.pointmorph.recompute()
    assert np.array_equal(np.unique(key(obj, "Fell"), axis=0), np.unique(before, axis=0))


def test_in_a_window_ways_start_from_their_maps(addon, settings, monkeypatch, starts):
    """Also those whose marks are the same."""
    found = shapes(3)
    settings.domain = "auto"
    jobs = addon("core.background_job")
    recomputing = addon("operators.modal_operator").Computing
    monkeypatch.setattr(recomputing, "_in_window", True)
    obj = chain()
    assert [way.request.target.name for way in jobs.earlier_ways] == ["Dune", "Fell"]
    found[-1].vertex_groups.remove(found[-1].vertex_groups["pm.slope"])
    mark(found[-1], "slope", 0.6, 0.2)
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert starts == [None, None, [196, 144], [144, 289]]
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert starts[4:] == [None, None]  # nothing has changed
    monkeypatch.setattr(recomputing, "_in_window", False)
    for shape in found:
        mark(shape, "less", 0.5, -0.4)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert starts[6:] == [None, None]  # a script gets the same whatever was done before
    jobs.forget()


def test_edit_this_morph_picks_the_chain(settings):
    found = shapes(4)
    obj = chain()
    settings.via.clear()
    settings.source = found[2]
    select(obj)
    bpy.ops.pointmorph.edit_morph()
    assert [settings.source, *(v.object for v in settings.via), settings.target] == found


# --- Bakes, frames, following, mesh ---------------------------------------------------------------


def test_shape_keys_on_the_pairs(settings):
    shapes(3)
    obj = chain()
    bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=2, path="LINEAR")
    names = [k.name for k in obj.data.shape_keys.key_blocks]
    assert names == [
        *("Basis", "Morph", "Dune", "Fell"),
        *("Dune 50 %", "Dune.001", "Fell 50 %", "Fell.001"),
    ]
    for name, wanted in (("Dune.001", key(obj, "Dune")), ("Fell.001", key(obj, "Fell"))):
        assert np.array_equal(key(obj, name), wanted)
    np.testing.assert_allclose(
        key(obj, "Fell 50 %"), (key(obj, "Dune") + key(obj, "Fell")) / 2, atol=1e-6
    )


def test_shape_keys_on_the_source_look_like_each_shape(settings):
    found = shapes(3)
    chain()
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")
    assert [k.name for k in found[0].data.shape_keys.key_blocks] == ["Basis", "Dune", "Fell"]
    bpy.context.view_layer.update()
    for shape, side in zip(found[1:], SIDES[1:3], strict=True):
        offset = np.array(found[0].location) - np.array(shape.location)
        places = key(found[0], shape.name) + offset
        apart = [
            np.linalg.norm(np.array(shape.closest_point_on_mesh(place)[1]) - place)
            for place in places.tolist()
        ]
        spacing = 2 / (side - 1)
        assert np.mean(apart) < 0.1 * spacing
        assert max(apart) < spacing


def test_a_mesh_of_the_source(settings):
    found = shapes(3)
    obj = chain()
    bpy.ops.pointmorph.make_mesh()
    copy = bpy.context.view_layer.objects.active
    bpy.ops.pointmorph.transfer_attributes()
    for t, name in ((0, "Basis"), (1, "Dune"), (2, "Fell")):
        set_t(copy, t)
        shown = copy.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        np.testing.assert_allclose(coordinates(shown.vertices), key(copy, name), atol=2e-6)
        expected = np.array([1 - t / 2, 0, t / 2, 1])
        np.testing.assert_allclose(
            attribute(shown, "Col"), np.tile(expected, (len(shown.loops), 1)), atol=1e-5
        )
    found[1].data.vertices[0].co.z += 0.1
    assert copy.pointmorph.state == "STALE"
    bpy.ops.pointmorph.recompute()
    assert copy.pointmorph.state == obj.pointmorph.state == "CURRENT"


def test_frames_in_the_scene(settings):
    found = shapes(3)
    obj = chain()
    rows = columns(obj)
    place = np.array(obj.location)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=5, resample=False) == {
        "FINISHED"
    }
    player = bpy.context.view_layer.objects.active
    for frame, number in ((1, 0), (3, 1), (5, 2)):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_allclose(
            shown_points(player) + place, world(found[number])[rows[:, number]], atol=2e-6
        )
    bpy.context.scene.frame_set(2)
    middle = shown_points(player)
    ends = [world(s)[r] - place for s, r in zip(found, rows.T, strict=True)]
    np.testing.assert_allclose(middle, (ends[0] + ends[1]) / 2, atol=2e-6)


def test_frames_with_new_points_and_other_paths(settings, tmp_path):
    """New points of one way are never taken for those of another."""
    shapes(3)
    obj = chain()
    pairs = len(obj.data.vertices)
    bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=9, path="RIGID")
    seen = []
    for frame in baked_frames(bpy.data.objects[f"{obj.name} Frames"]):
        ids = frame["id"]
        assert len(np.unique(ids)) == len(ids)
        seen.append(set(ids[ids >= pairs].tolist()))
        assert np.isfinite(frame["position"]).all()
    assert len(seen) == 9
    assert not set.union(*seen[:4]) & set.union(*seen[5:])
    select(obj)
    bpy.ops.pointmorph.bake_frames(
        format="PLY", frame_start=1, frame_end=3, directory=str(tmp_path)
    )
    assert len(list(tmp_path.glob("*.ply"))) == 3


def test_frames_with_faces(settings):
    if not surfaces.is_available():
        pytest.skip("this Python has no pymeshlab and scipy that fit its numpy")
    found = shapes(3)
    obj = chain()
    bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3, faces=True)
    frames = sorted(bpy.data.collections[f"{obj.name} Frames"].objects.keys())
    assert len(frames) == 3
    for name, shape, side in zip(frames, found, SIDES[:3], strict=True):
        mesh = bpy.data.objects[name].data
        assert len(mesh.polygons)
        offset = np.array(obj.location) - np.array(shape.location)
        places = (coordinates(mesh.vertices) + offset).tolist()
        apart = [(shape.closest_point_on_mesh(p)[1] - Vector(p)).length for p in places]
        assert np.median(apart) < 0.25 * 2 / (side - 1)


def test_it_follows_moving_shapes(settings):
    found = shapes(3)
    for number, shape in enumerate(found):
        for frame, y in ((1, 0.0), (11, 1.0 + number)):
            shape.location.y = y
            shape.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(1)
    obj = chain()
    bpy.ops.pointmorph.follow()
    rows = columns(obj)
    for frame in (1, 7, 11):
        bpy.context.scene.frame_set(frame)
        for number, shape in enumerate(found):
            set_t(obj, number)
            matrix = np.array(shape.matrix_world)
            there = coordinates(shape.data.vertices) + matrix[:3, 3]
            np.testing.assert_allclose(
                shown_points(obj) + np.array(obj.location), there[rows[:, number]], atol=2e-6
            )


# --- Picking --------------------------------------------------------------------------------------


def test_picking_a_chain_from_the_selection(settings):
    for name in ("c", "a", "d", "b"):
        add_mesh(name, *patch(8)).select_set(True)
    bpy.ops.pointmorph.add_to_chain()
    assert settings.source.name == "a"
    assert [item.object.name for item in settings.via] == ["b", "c"]
    assert settings.target.name == "d"
    settings.active_via = 0
    bpy.ops.pointmorph.change_chain(change="DOWN")
    assert [item.object.name for item in settings.via] == ["c", "b"]
    assert settings.active_via == 1
    bpy.ops.pointmorph.change_chain(change="UP")
    assert [item.object.name for item in settings.via] == ["b", "c"]
    bpy.ops.pointmorph.change_chain(change="REMOVE")
    assert [item.object.name for item in settings.via] == ["c"]


def refused():
    return error_of(bpy.ops.pointmorph.morph_chain)


def test_chains_that_cannot_be_made(settings):
    assert "Add shapes between the source and target first" in refused()
    found = shapes(3)
    settings.via.add()
    assert "every shape in between" in refused()
    settings.via[1].object = found[2]
    assert '"Fell" comes twice in a row' in refused()
    settings.via[1].object = found[0]
    for _ in range(9):
        settings.via.add().object = found[(len(settings.via) + 1) % 2]
    assert "11 shapes at most, but there are 13" in refused()
    settings.via.clear()
    settings.via.add().object = found[1]
    bpy.context.scene.collection.objects.unlink(found[1])
    assert '"Dune" is no longer in the scene' in refused()
    bpy.context.scene.collection.objects.link(found[1])
    found[1].vertex_groups.remove(found[1].vertex_groups["pm.peak"])
    assert 'Dune: expected a vertex group "pm.peak"' in refused()


def test_there_and_back_again(settings):
    """A shape may come twice."""
    found = shapes(3)
    settings.target = found[0]
    settings.via.remove(0)
    settings.via.add().object = found[1]
    obj = chain()
    rows = columns(obj)
    set_t(obj, 2.0)
    np.testing.assert_allclose(
        shown_points(obj), coordinates(found[0].data.vertices)[rows[:, 2]], atol=2e-6
    )
    assert obj.pointmorph.state == "CURRENT"
