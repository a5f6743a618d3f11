"""Meshes as surfaces: any two morph, the source's faces become the target, and where they are too
large for it, that is said and mended."""

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pointmorph
import pytest
from mathutils.bvhtree import BVHTree
from modeling import creature, primitive
from scenes import (
    add_group,
    add_mesh,
    add_point_cloud,
    attribute,
    baked_frames,
    centers,
    coordinates,
    key,
    mark,
    morph,
    pair,
    patch,
    pick,
    row_pairs,
    select,
    triangles,
)

TOO_FEW = "has too few vertices for"


PAIRS = {
    "cube to icosphere": lambda: (primitive("cube"), primitive("ico_sphere")),
    "cylinder to sphere": lambda: (primitive("cylinder"), primitive("uv_sphere")),
    "cone to Suzanne": lambda: (primitive("cone"), primitive("monkey")),
    "500 faces to 50,000": lambda: (
        creature("Fox", 0.9, 0.6, 0.3, 0.06, 500),
        creature("Hare", 1.2, 0.8, 0.5, 0.02),
    ),
}


def tree_of(positions, faces):
    return BVHTree.FromPolygons(positions.tolist(), faces.tolist(), all_triangles=True)


def farthest(places, positions, faces):
    """The 99th percentile of the distances of places from faces, in √area of those: of every
    k-th of them, ten thousand at most."""
    places = places[:: 1 + len(places) // 10_000]
    corners = positions[faces].astype(float)
    sides = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2
    tree = tree_of(positions, faces)
    far = [tree.find_nearest(place)[3] for place in places.tolist()]
    return np.quantile(far, 0.99) / np.sqrt(area)


def warnings_of(obj):
    return " ".join(json.loads(obj.pointmorph.report)["warnings"])


@pytest.mark.parametrize("name", PAIRS)
def test_any_two_meshes_in_two_clicks(name):
    source, target = PAIRS[name]()
    pick(source, target)
    goal, goal_faces = coordinates(target.data.vertices), triangles(target.data)
    start, form = coordinates(source.data.vertices), triangles(source.data)
    obj = morph()
    assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}
    wrapped = key(bpy.context.view_layer.objects.active, "Morph")
    assert farthest(wrapped, goal, goal_faces) < 1e-3
    # Few vertices can't show the target. It is said, and what mends it:
    assert f'"{source.name}" {TOO_FEW}' in warnings_of(obj)
    assert "Subdivide Source" in warnings_of(obj)
    assert obj.pointmorph.too_fine == target.name
    missed = farthest(centers(goal, goal_faces), wrapped, triangles(source.data))

    select(obj)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert obj.pointmorph.state == "CURRENT"  # it has computed the morph again, too
    assert {len(face.vertices) for face in source.data.polygons} <= {3, 4}
    # The source looks the same: old vertices first, new ones on its faces; only where they help.
    finer = coordinates(source.data.vertices)
    assert len(start) < len(finer) < 1.5 * len(start) + 10 * max(len(goal), 100)
    assert np.array_equal(finer[: len(start)], start)
    assert farthest(finer, start, form) < 1e-5
    mesh = next(item for item in bpy.data.objects if item.pointmorph.made_from == obj)
    wrapped = key(mesh, "Morph")
    assert len(wrapped) == len(finer)
    # Suzanne's eyes are parts of their own: a cone spans their sockets, which are holes, with one
    # vertex of a hundred.
    assert farthest(wrapped, goal, goal_faces) < (5e-2 if "Suzanne" in name else 2e-3)
    assert farthest(centers(goal, goal_faces), wrapped, triangles(mesh.data)) < max(
        0.25 * missed, 0.008
    )


def test_fine_meshes_need_hardly_more(settings):
    source, _ = pair(24, 24, domain="auto")
    obj = morph()
    assert TOO_FEW not in warnings_of(obj)
    assert obj.pointmorph.too_fine == ""
    assert bpy.ops.pointmorph.subdivide_source() == {"CANCELLED"}
    assert len(source.data.vertices) == 24**2


@pytest.mark.parametrize(("off", "missed"), [(0.0065, 0.0), (0.0075, 1.0)])
def test_what_can_not_be_seen_is_not_missed(addon, off, missed):
    """As the verdict says "good" up to 0.7 % of the size."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    target = SimpleNamespace(positions=square, triangles=faces)
    above = square + np.array([0, 0, off], np.float32)
    assert addon("data.coverage").missed_share(above, faces, target) == pytest.approx(missed)


def test_faces_are_kept_for_when_the_objects_are_gone(addon, settings, tmp_path):
    source, target = pair(8, 30, domain="auto")
    faces = [triangles(shape.data) for shape in (source, target)]
    obj = morph()
    before = {name: attribute(obj.data, name) for name in ("landing", "source_onward")}
    bpy.data.objects.remove(source)
    bpy.data.objects.remove(target)
    path = str(tmp_path / "orphan.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.data.objects["Hill to Dune"]
    for kept, was in zip(addon("scene.recipes").faces_of(obj), faces, strict=True):
        assert np.array_equal(kept, was)
    assert len(obj.pointmorph.faces) < 2 * sum(map(len, faces)) + 500  # of 12 bytes a face
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    for name, was in before.items():
        np.testing.assert_allclose(attribute(obj.data, name), was, atol=1e-6)


def test_a_result_of_an_earlier_version(settings):
    """It kept no faces, and no map beside the landing."""
    source, target = pair(14, 12)
    obj = morph()
    recipe = json.loads(obj.pointmorph.recipe)
    rim = pointmorph.meshes.boundary_loops(triangles(source.data), 14**2)[0].tolist()
    obj.pointmorph.recipe = json.dumps({**recipe, "boundaries": [rim, None]})
    obj.pointmorph.faces = ""
    obj.data.attributes.remove(obj.data.attributes["source_onward"])
    settings.path = "rigid"
    select(obj)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3) == {"FINISHED"}
    bpy.data.objects.remove(source)
    bpy.data.objects.remove(target)
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert np.isfinite(attribute(obj.data, "landing")).all()


@pytest.mark.parametrize("numbers", [[], [5], [0, 2**31 - 1, -(2**31), 7], range(1000)])
def test_packed_numbers_come_back(addon, numbers):
    packing = addon("core.packing")
    packed = packing.pack(np.array(numbers, np.int32))
    assert np.array_equal(packing.unpack(packed, len(numbers)), np.array(numbers, np.int32))
    if len(numbers) > 0:
        with pytest.raises(ValueError, match="more than"):
            packing.unpack(packed, len(numbers) - 1)


def test_the_map_starts_anew_where_faces_differ(addon, settings):
    computation = addon("core.computation")
    request = addon("scene.panel_request").read_request
    pair(12, 10, domain="auto")
    settings.method = "auto"
    first = request(bpy.context)
    earlier = computation.Earlier(first, ("there", "back"))
    mark(settings.source, "more", -0.5, 0.5)
    mark(settings.target, "more", -0.5, 0.5)
    addon("data.feature_list").sync_features(bpy.context.scene)
    assert earlier.start_for(request(bpy.context)) == ("there", "back")
    bpy.context.view_layer.objects.active = settings.source
    settings.source.data.polygons[0].flip()
    assert earlier.start_for(request(bpy.context)) is None


def test_the_paper_takes_points_alone(settings):
    pair(16, 14)
    settings.method = "paper"
    obj = morph()
    assert np.array_equal(attribute(obj.data, "landing"), attribute(obj.data, "source_onward"))


def test_a_chain_through_a_cube_ends_on_the_last_shape(settings):
    shapes = [primitive("ico_sphere", subdivisions=3), primitive("cube"), primitive("uv_sphere")]
    settings.source, settings.target = shapes[0], shapes[-1]
    settings.via.add().object = shapes[1]
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    obj = bpy.context.view_layer.objects.active
    for name, shape in (("landing1", shapes[1]), ("landing", shapes[2])):
        places = attribute(obj.data, name)
        assert farthest(places, coordinates(shape.data.vertices), triangles(shape.data)) < 2e-3
    # Not through the sphere, as its corners alone would have it.
    assert np.linalg.norm(attribute(obj.data, "landing"), axis=1).min() > 0.97


def test_a_mesh_and_a_cloud(settings):
    source = primitive("ico_sphere", subdivisions=3)
    points = coordinates(primitive("ico_sphere", subdivisions=4).data.vertices) * (2, 1, 1)
    target = add_point_cloud("Points", points, {})
    bpy.context.view_layer.update()
    for shapes in ((source, target), (target, source)):
        pick(*shapes)
        obj = morph()
        assert np.isfinite(attribute(obj.data, "landing")).all()
        assert obj.pointmorph.too_fine == ""
    select(obj)
    with pytest.raises(RuntimeError, match="expected a mesh"):
        bpy.ops.pointmorph.subdivide_source()


@pytest.mark.parametrize("path", ["linear", "rigid"])
def test_bakes_of_eight_vertices(settings, path):
    pick(primitive("cube"), primitive("ico_sphere", subdivisions=3, location=(1, 2, 3)))
    settings.path = path
    obj = morph()
    source = settings.source
    for kind, changed in (("PAIRS", obj), ("SOURCE", source)):
        select(obj)
        assert bpy.ops.pointmorph.bake_shape_keys(kind=kind, steps=2) == {"FINISHED"}
        assert np.isfinite(key(changed, "Icosphere 50 %")).all()
    select(obj)
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3) == {"FINISHED"}
    for frame in baked_frames(bpy.data.objects["Cube to Icosphere Frames"]):
        assert len(frame["position"]) >= len(obj.data.vertices)
        assert np.isfinite(frame["position"]).all()


def test_loose_vertices_and_polygons(settings):
    """A ball with an unused vertex, and faces of eight corners."""
    ball = primitive("ico_sphere", subdivisions=3).data
    positions = np.vstack([coordinates(ball.vertices), [[0.0, 0.0, 3.0]]])
    source = add_mesh("Loose", positions, triangles(ball))
    target = primitive("cylinder", vertices=8)
    pick(source, target)
    obj = morph()
    assert np.isfinite(attribute(obj.data, "landing")).all()
    assert set(row_pairs(obj)[:, 0]) == set(range(len(positions)))


# --- How good it looks ----------------------------------------------------------------------------


def test_what_is_wrong_with_the_mesh_is_said_and_shown(settings):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4)
    settings.target = bpy.context.object
    bpy.ops.mesh.primitive_cube_add()
    settings.source = bpy.context.object
    obj = morph()
    obj.location.x += 2.0
    bpy.context.view_layer.update()
    mesh = json.loads(obj.pointmorph.report)["mesh"]
    assert mesh["grade"] in mesh["verdict"].lower()
    assert {"folded", "creased", "uncovered", "off"} <= set(mesh)
    assert mesh["grade"] == "poor"
    assert bpy.ops.pointmorph.go_to_place(kind="MESH") == {"FINISHED"}
    place = np.array(mesh["worst"][0]["position"]) + (2, 0, 0)
    np.testing.assert_allclose(bpy.context.scene.cursor.location, place, atol=1e-5)


def test_a_chain_tells_of_the_mesh_on_its_first_way(settings):
    shapes = [
        add_mesh(name, *patch(12, bump)) for name, bump in zip("ABC", (0, 0.5, 1), strict=True)
    ]
    for shape in shapes:
        mark(shape, "peak", 0, 0)
        mark(shape, "slope", 0.5, 0.3)
    settings.source, settings.target = shapes[0], shapes[-1]
    settings.via.add().object = shapes[1]
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    report = json.loads(bpy.context.view_layer.objects.active.pointmorph.report)
    assert report["mesh"]["verdict"].startswith("A to B: ")


def test_the_mesh_that_is_shown_gets_more_vertices(settings):
    settings.show_as = "MESH"
    source, target = primitive("cube"), primitive("ico_sphere", subdivisions=3)
    pick(source, target)
    shown = morph()
    assert (shown.name, len(shown.data.vertices)) == ("Cube to Icosphere", 8)
    assert shown.pointmorph.made_from.pointmorph.too_fine == "Icosphere"
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert shown.pointmorph.state == "CURRENT"
    assert shown.pointmorph.made_from.pointmorph.too_fine == ""
    assert len(shown.data.vertices) == len(source.data.vertices) > 90
    assert np.abs(np.linalg.norm(key(shown, "Morph"), axis=1) - 1.0).max() < 0.03


def test_no_face_turns_over_on_a_rigid_path(settings):
    """A tube that is bent to a half circle, more than straight ways can do."""
    u, v = np.meshgrid(np.arange(41) / 40, np.arange(16) / 16 * 2 * np.pi, indexing="ij")
    rows = np.arange(41 * 16).reshape(41, 16)
    ring = np.roll(rows, -1, axis=1)
    faces = np.stack([rows[:-1], ring[:-1], ring[1:], rows[1:]], axis=-1).reshape(-1, 4)
    y, z = 0.2 * np.cos(v), 0.2 * np.sin(v)
    tube = np.stack([4 * u, y, z], axis=-1).reshape(-1, 3)
    angle, radius = 3.0 * u, 4 / 3.0 + y
    bent = np.stack([radius * np.sin(angle), radius * np.cos(angle), z], axis=-1).reshape(-1, 3)
    source, target = add_mesh("Tube", tube, faces), add_mesh("Bow", bent, faces)
    for obj in (source, target):
        for number, row in enumerate((0, 8, 320, 328, 640, 648)):
            add_group(obj, f"pm.{number}", {row: 1.0})
    pick(source, target)
    morph()
    assert bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=4, path="RIGID") == {"FINISHED"}
    form = triangles(source.data)

    def areas(name):
        corners = key(source, name)[form].astype(float)
        return np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )

    for name in ("Bow 25 %", "Bow 50 %", "Bow 75 %"):
        assert areas(name).sum() == pytest.approx(areas("Basis").sum(), rel=0.1)
        assert (areas(name) > 0.3 * np.minimum(areas("Basis"), areas("Bow"))).all()
