"""Parts of a morph that go later than others: live, in bakes, and without the add-on."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_group,
    add_mesh,
    add_object,
    animate,
    attribute,
    baked_frames,
    key,
    morph,
    pair,
    patch,
    pick,
    played,
    select,
    set_t,
    shown_points,
    surface_of,
)

pytestmark = pytest.mark.interface


@pytest.fixture
def shown(settings):
    """The mesh that shows the morph of two sheets, the source a bit off the origin and turned."""
    settings.show_as = "MESH"
    source, _ = pair(14, 12)
    source.location = (0.3, 0.0, 0.2)
    source.rotation_euler = (0.0, 0.4, 0.0)
    return morph()


@pytest.fixture
def choose(addon):
    def choose(obj, kind, **values):
        addon("scene.stagger").choose(obj, kind, **values)
        bpy.context.view_layer.update()

    return choose


def own_times(t, delays, overlap=0.5, falloff=1.0):
    """t of each point, as the manual says."""
    done = np.clip((t - delays * (1.0 - overlap)) / overlap, 0.0, 1.0)
    return ((1.0 - falloff) * done + falloff * (3 * done**2 - 2 * done**3))[:, None]


def world(obj):
    """Where the vertices of the source are in the world."""
    matrix = np.array(obj.matrix_world)
    return key(obj, "Basis") @ matrix[:3, :3].T + matrix[:3, 3]


def spread(values):
    return (values - values.min()) / (values.max() - values.min())


def expected(obj, delays, t, **shares):
    start, end = key(obj, "Basis"), key(obj, "Morph")
    return start + own_times(t, delays, **shares) * (end - start)


@pytest.mark.parametrize("shares", [{}, {"overlap": 0.2, "falloff": 0.0}, {"overlap": 1.0}])
def test_by_height(shown, choose, shares):
    inputs = {name.capitalize(): value for name, value in shares.items()}
    choose(shown, "Height", Direction=(0.0, 1.0, 1.0), **inputs)
    delays = spread(world(shown) @ (0.0, 1.0, 1.0))
    for t in (0.0, 0.2, 0.5, 0.9, 1.0):
        set_t(shown, t)
        np.testing.assert_allclose(
            surface_of(shown), expected(shown, delays, t, **shares), atol=2e-6
        )
    for t, name in ((0.0, "Basis"), (1.0, "Morph")):
        set_t(shown, t)
        np.testing.assert_allclose(surface_of(shown), key(shown, name), atol=1e-6)


def test_by_the_distance_to_an_object_that_can_move(shown, choose):
    empty = add_object("Wave", None)
    empty.location = (2.0, -1.0, 0.5)
    choose(shown, "Object", Object=empty, Reverse=True)
    set_t(shown, 0.4)
    for place in ((2.0, -1.0, 0.5), (-3.0, 0.0, 0.0)):
        empty.location = place
        bpy.context.view_layer.update()
        delays = 1.0 - spread(np.linalg.norm(world(shown) - place, axis=1))
        np.testing.assert_allclose(surface_of(shown), expected(shown, delays, 0.4), atol=2e-5)


def test_by_a_vertex_group(shown, choose):
    weights = np.linspace(0.0, 1.0, len(shown.data.vertices))
    add_group(shown, "late", dict(enumerate(weights.tolist())))
    choose(shown, "Vertex Group", Group="late")
    set_t(shown, 0.6)
    np.testing.assert_allclose(surface_of(shown), expected(shown, weights, 0.6), atol=1e-5)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    points = shown.pointmorph.made_from
    rows = attribute(points.data, "source_row")
    np.testing.assert_allclose(
        shown_points(points), expected(points, weights[rows], 0.6), atol=1e-5
    )


def test_by_noise(shown, choose):
    choose(shown, "Noise", Size=0.5, Overlap=0.1)
    set_t(shown, 0.5)
    here = surface_of(shown)
    start, end = key(shown, "Basis"), key(shown, "Morph")
    far = np.linalg.norm(end - start, axis=1)
    gone = np.linalg.norm(here - start, axis=1)[far > 0.1] / far[far > 0.1]
    assert (gone < 0.05).mean() > 0.1
    assert (gone > 0.95).mean() > 0.1
    choose(shown, "Noise", Seed=1)
    assert np.abs(surface_of(shown) - here).max() > 0.1


def test_points_go_as_the_mesh_does(shown, choose):
    """With their colors, radii and normals; the choices are made on the mesh."""
    points = shown.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    choose(shown, "Height", Overlap=0.3)
    set_t(shown, 0.5)
    rows = attribute(points.data, "source_row")
    delays = spread(world(shown)[:, 2])[rows]
    np.testing.assert_allclose(
        shown_points(points), expected(points, delays, 0.5, overlap=0.3), atol=5e-6
    )
    radii = [attribute(points.data, f"{side}_radius") for side in ("source", "target")]
    times = own_times(0.5, delays, overlap=0.3)[:, 0]
    np.testing.assert_allclose(
        shown_points(points, "radius"), radii[0] + times * (radii[1] - radii[0]), rtol=1e-4
    )
    normals = [attribute(points.data, f"{side}_normal") for side in ("source", "target")]
    mixed = normals[0] + times[:, None] * (normals[1] - normals[0])
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    np.testing.assert_allclose(shown_points(points, "Normal"), mixed, atol=1e-4)


def test_discs_lie_where_the_points_do(shown, choose, addon):
    points = shown.pointmorph.made_from
    bpy.ops.pointmorph.show_as(kind="POINTS")
    choose(shown, "Height", Overlap=0.3)
    set_t(shown, 0.5)
    there = shown_points(points)
    addon("data.versions").set_input(points.modifiers["Points"], "Discs", True)
    points.update_tag()
    bpy.context.view_layer.update()
    middles = surface_of(points).reshape(len(there), 6, 3).mean(axis=1)
    np.testing.assert_allclose(middles, there, atol=1e-5)


def test_materials_can_read_how_far_each_point_is(shown, choose):
    choose(shown, "Height")
    set_t(shown, 0.5)
    mesh = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    delays = spread(world(shown)[:, 2])
    np.testing.assert_allclose(attribute(mesh, "morph_delay"), delays, atol=1e-5)
    times = own_times(0.5, delays)[:, 0]
    np.testing.assert_allclose(attribute(mesh, "morph_t"), times, atol=1e-5)
    np.testing.assert_allclose(attribute(mesh, "morph_ahead"), times - 0.5, atol=1e-5)
    choose(shown, "Off")
    mesh = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert not any(a.name.startswith("morph_") for a in mesh.attributes)


@pytest.mark.makes_nodes
def test_on_a_rigid_path(shown, choose, settings, addon):
    """Each vertex is where it is on the path at its own time."""
    settings.path = "rigid"
    select(shown)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    choose(shown, "Height", Falloff=0.0)
    delays = spread(world(shown)[:, 2])
    places = addon("scene.morph_object")
    set_t(shown, 0.5)
    here = surface_of(shown)
    choose(shown, "Off")
    for row in range(0, len(here), 29):
        set_t(shown, float(own_times(0.5, delays, falloff=0.0)[row, 0]))
        np.testing.assert_allclose(here[row], surface_of(shown)[row], atol=1e-5)
    assert places.is_made(shown)


def test_a_choice_can_be_keyed(shown, choose, addon):
    choose(shown, "Height")
    path = addon("data.versions").input_path(shown.modifiers["Path"], "Overlap")
    shown.keyframe_insert(path, frame=1)
    addon("scene.stagger").choose(shown, "Height", Overlap=1.0)
    shown.keyframe_insert(path, frame=10)
    set_t(shown, 0.5)
    delays = spread(world(shown)[:, 2])
    for frame, overlap in ((1, 0.5), (10, 1.0)):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_allclose(
            surface_of(shown), expected(shown, delays, 0.5, overlap=overlap), atol=5e-6
        )


def test_a_chain_goes_through_all_its_shapes(settings, choose):
    shapes = [add_mesh(name, *patch(12, bump)) for name, bump in zip("ABC", (0, 1, 0), strict=True)]
    for obj in shapes:
        add_group(obj, "pm.peak", {78: 1.0})
    settings.show_as = "MESH"
    settings.domain = "disk"
    pick(shapes[0], shapes[2])
    settings.via.add().object = shapes[1]
    bpy.ops.pointmorph.morph_chain()
    shown = bpy.context.view_layer.objects.active
    choose(shown, "Height", Direction=(1.0, 0.0, 0.0))
    for t in (0.5, 1.2, 2.0):
        set_t(shown, t)
        times = 2.0 * own_times(t / 2.0, spread(world(shown)[:, 0]))
        first, second = np.clip(times, 0, 1), np.clip(times - 1, 0, 1)
        start, middle, end = (key(shown, name) for name in ("Basis", "B", "C"))
        there = start + first * (middle - start) + second * (end - middle)
        np.testing.assert_allclose(surface_of(shown), there, atol=1e-5)


# --- Bakes ----------------------------------------------------------------------------------------


def test_bakes_are_staggered_too(shown, choose, settings):
    choose(shown, "Height", Overlap=0.4)
    points = shown.pointmorph.made_from
    source = settings.source
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=4) == {"FINISHED"}
    assert bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=4) == {"FINISHED"}
    set_t(shown, 0.25)
    np.testing.assert_allclose(key(source, "Dune 25 %"), surface_of(shown), atol=1e-5)
    select(shown)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=5, resample=False) == {
        "FINISHED"
    }
    player = bpy.context.view_layer.objects.active
    frames = baked_frames(player)
    bpy.ops.pointmorph.show_as(kind="POINTS")
    points.hide_set(False)
    place = frames[1]["position"]
    np.testing.assert_allclose(place, shown_points(points), atol=1e-5)
    np.testing.assert_allclose(place, key(points, "Dune 25 %"), atol=1e-5)
    known = [o for o in bpy.data.objects if not o.name.startswith(".")]
    assert len(known) == 4 + 1


def test_what_is_computed_again_says_which_staggered_keys_are_old(shown, choose, settings, capfd):
    choose(shown, "Height")
    points = shown.pointmorph.made_from
    assert bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=2) == {"FINISHED"}
    for vertex in settings.target.data.vertices:
        vertex.co.z += 0.2
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    said = capfd.readouterr().out
    assert '"Dune 50 %"' in said
    assert "bake it again" in said
    assert 'The shape key "Dune" ' not in said
    np.testing.assert_allclose(key(points, "Dune"), key(points, "Morph"), atol=1e-6)


@pytest.mark.parametrize("resample", [False, True])
def test_frames_of_a_staggered_chain(settings, choose, resample):
    """Its points are where the morph object shows them; with fewer cracks if one wants that."""
    settings.path = "rigid"
    shapes = [add_mesh(name, *patch(12, bump)) for name, bump in zip("ABC", (0, 1, 0), strict=True)]
    shapes[1].data.transform(Matrix.Rotation(0.8, 4, "X"))
    for obj in shapes:
        add_group(obj, "pm.peak", {78: 1.0})
    settings.domain = "disk"
    pick(shapes[0], shapes[2])
    settings.via.add().object = shapes[1]
    bpy.ops.pointmorph.morph_chain()
    points = bpy.context.view_layer.objects.active
    choose(points, "Height", Direction=(1.0, 0.0, 0.0), Overlap=0.4)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=9, resample=resample) == {
        "FINISHED"
    }
    frames = baked_frames(bpy.context.view_layer.objects.active)
    points.hide_set(False)
    for number in (0, 3, 4, 6, 8):
        set_t(points, number / 4.0)
        count = len(points.data.vertices)
        place = frames[number]["position"][:count]
        np.testing.assert_allclose(place, shown_points(points), atol=2e-3)


# --- Without the add-on ---------------------------------------------------------------------------


def test_it_plays_without_the_add_on(shown, choose, tmp_path):
    choose(shown, "Height")
    animate(shown)
    points = shown.pointmorph.made_from
    points.hide_set(False)
    path = tmp_path / "staggered.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    found = played(path, shown.name)
    for frame in (1, 7, 13, 20):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_array_equal(found[f"{shown.name} {frame}"], surface_of(shown))
        np.testing.assert_array_equal(found[f"{points.name} {frame}"], shown_points(points))
