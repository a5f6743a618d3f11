"""More faces for the source, where it has too few to become the target."""

import json
from types import SimpleNamespace

import bmesh
import bpy
import numpy as np
import pointmorph
import pytest
from mathutils import Matrix
from modeling import primitive
from scenes import (
    add_group,
    add_mesh,
    add_point_cloud,
    centers,
    coordinates,
    groups,
    key,
    morph,
    pair,
    patch,
    pick,
    read,
    recompute,
    row_pairs,
    select,
    triangles,
)


def test_subdividing_carries_all_that_the_source_has(settings):
    source = primitive("cube")
    target = primitive("ico_sphere", subdivisions=4)
    positions = coordinates(source.data.vertices)
    for obj in (source, target):
        corner = int(np.argmax(coordinates(obj.data.vertices) @ (1, 1, 1)))
        add_group(obj, "pm.corner", {corner: 1.0})
    edge = source.data.edges[0].vertices[:]
    add_group(source, "bone", {edge[0]: 1.0, edge[1]: 0.0})
    source.shape_key_add(name="Basis")
    wide = source.shape_key_add(name="Wide", from_mix=False)
    wide.value = 0.0  # Blender 5 begins with 1
    wide.data.foreach_set("co", (positions * (2, 1, 1)).astype(np.float32).reshape(-1))
    uvs = read(source.data.uv_layers.active.data, "uv", 2)
    pick(source, target)
    obj = morph()
    select(obj)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}

    count = len(source.data.vertices)
    assert count > 90
    weights = groups(source)
    assert len(weights["pm.corner"]) == 1  # still a point
    assert sorted(set(np.round(list(weights["bone"].values()), 3)))[-2] < 1.0
    assert len(weights["bone"]) > 2
    np.testing.assert_allclose(
        key(source, "Wide"), coordinates(source.data.vertices) * (2, 1, 1), atol=1e-6
    )
    finer = read(source.data.uv_layers.active.data, "uv", 2)
    assert len(finer) > len(uvs)
    assert np.ptp(finer, axis=0) == pytest.approx(np.ptp(uvs, axis=0), abs=1e-6)
    assert not [a.name for a in source.data.attributes if a.name.startswith(".") and "pl" in a.name]
    # It stays a point, which is met.
    rows = [next(iter(groups(shape)["pm.corner"])) for shape in (source, target)]
    assert tuple(rows) in {tuple(pair) for pair in row_pairs(obj).tolist()}


def test_subdividing_says_what_it_needs(settings):
    source, _ = pair(6, 24, domain="auto")
    obj = morph()
    source.data.vertices[0].co.z += 1.0
    select(obj)
    with pytest.raises(RuntimeError, match="others: the mesh was edited"):
        bpy.ops.pointmorph.subdivide_source()
    source.data.vertices[0].co.z -= 1.0
    assert len(source.data.vertices) == 36
    # An earlier version left no faces, and no map back.
    obj.pointmorph.faces = ""
    obj.data.attributes.remove(obj.data.attributes["target_landing"])
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert len(source.data.vertices) > 36


def test_subdividing_finds_a_target_anew_that_was_moved(settings):
    source, target = primitive("cube"), primitive("ico_sphere", subdivisions=3)
    pick(source, target)
    obj = morph()
    target.location = (5, 0, 0)
    assert bpy.ops.pointmorph.subdivide_source(recompute=False) == {"FINISHED"}
    moved = len(source.data.vertices)
    assert moved > 90
    target.data.transform(Matrix.Scale(3.0, 4, (1, 0, 0)))
    select(obj)
    recompute(obj)
    assert obj.pointmorph.state == "CURRENT"


def test_a_chain_of_shapes_that_were_moved_is_recomputed_first(settings):
    shapes = [primitive("cube"), primitive("ico_sphere", subdivisions=2), primitive("uv_sphere")]
    settings.source, settings.target = shapes[0], shapes[-1]
    settings.via.add().object = shapes[1]
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    shapes[1].location = (5, 0, 0)
    with pytest.raises(RuntimeError, match="others that have changed. Recompute first"):
        bpy.ops.pointmorph.subdivide_source()


def test_subdividing_goes_past_the_clouds_of_a_chain(settings):
    source, target = primitive("cube"), primitive("ico_sphere", subdivisions=3)
    points = coordinates(target.data.vertices) * (1.5, 1, 1)
    cloud = add_point_cloud("Points", points, {})
    settings.source, settings.target = source, target
    settings.via.add().object = cloud
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    obj = bpy.context.view_layer.objects.active
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert len(source.data.vertices) > 90
    assert obj.pointmorph.state == "CURRENT"


def test_subdividing_leaves_edges_alone_that_are_no_faces(settings):
    """Wires along the diagonals of all faces, some of which are those of its triangles."""
    source, target = primitive("cube"), primitive("ico_sphere", subdivisions=3)
    edited = bmesh.new()
    edited.from_mesh(source.data)
    for face in list(edited.faces):
        for a, b in ((0, 2), (1, 3)):
            edited.edges.new((face.verts[a], face.verts[b]))
    edited.to_mesh(source.data)
    edited.free()
    pick(source, target)
    morph()
    assert bpy.ops.pointmorph.subdivide_source(recompute=False) == {"FINISHED"}
    mesh = source.data
    assert len(mesh.vertices) > 90
    assert {row for face in mesh.polygons for row in face.vertices} == set(
        range(len(mesh.vertices))
    )
    assert {len(face.vertices) for face in mesh.polygons} <= {3, 4}


def test_faces_that_can_not_be_cut_are_named(addon, settings):
    source = primitive("cube")
    edited = bmesh.new()
    edited.from_mesh(source.data)
    finer = SimpleNamespace(ends=np.array([[0, 7]]), triangles=np.array([[0, 7, 8]]))
    with pytest.raises(pointmorph.CloudError, match="Cube: expected faces that can be cut"):
        addon("scene.source_subdivision")._cut(edited, "Cube", finer, np.array([0]))
    edited.free()


def test_a_start_is_for_one_morph_and_its_shapes(addon):
    denser = addon("data.denser_source")
    places, targets = np.eye(3, dtype=np.float32), np.eye(3, dtype=np.float32) * 2
    start = denser.Start(places, targets, ("there", "back"))

    def found(source, target, **settings):
        shapes = (SimpleNamespace(positions=one) for one in (source, target))
        return start.start_for(
            SimpleNamespace(source=next(shapes), target=next(shapes), settings=settings)
        )

    assert found(places, targets) == ("there", "back")
    assert found(places, targets + 0.1) is None
    assert found(places + 0.1, targets) is None
    assert found(places, targets, method="paper") is None
    with denser.starting(7, start):
        assert denser.start_of(7) is start
        assert denser.start_of(8) is None
    assert denser.start_of(7) is None


def test_subdividing_looks_at_every_shape_of_a_chain(settings, starts):
    shapes = [
        primitive("cube"),
        primitive("ico_sphere", subdivisions=2),
        primitive("cylinder", vertices=64),
    ]
    settings.source, settings.target = shapes[0], shapes[-1]
    settings.via.add().object = shapes[1]
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    obj = bpy.context.view_layer.objects.active
    before = json.loads(obj.pointmorph.report)["too_fine"]
    assert min(before["Icosphere"], before["Cylinder"]) > 0.9
    starts.clear()
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    # From the map that the vertices were added for; the other way has the same shapes as before.
    assert starts == [[len(shape.data.vertices) for shape in shapes[:2]], None]
    after = json.loads(obj.pointmorph.report)["too_fine"]
    assert "Icosphere" not in after
    # It may be found turned about its axis, and its rim where the source has fewer vertices.
    assert after.get("Cylinder", 0.0) < 0.4


def test_subdividing_keeps_what_faces_and_their_corners_have(settings):
    """A sheet of two materials and colors whose seam is where they meet."""
    positions, faces = patch(5, bump=0.0)
    source = add_mesh("Flag", positions, faces)
    mesh = source.data
    for name in ("Left", "Right"):
        mesh.materials.append(bpy.data.materials.new(name))
    middle = centers(positions, faces)[:, 0]
    mesh.polygons.foreach_set("material_index", (middle > 0).astype(np.int32))
    mesh.uv_layers.new(name="UV")
    mesh.color_attributes.new(name="Paint", type="FLOAT_COLOR", domain="CORNER")
    uvs, colors = mesh.uv_layers["UV"], mesh.color_attributes["Paint"]
    for face in mesh.polygons:
        for loop in face.loop_indices:
            x, y, _ = positions[mesh.loops[loop].vertex_index]
            right = face.material_index
            uvs.data[loop].uv = (x + 10 * right, y)
            colors.data[loop].color = (right, 0.5 * x + 0.5, 0, 1)
    for edge in mesh.edges:
        edge.use_seam = bool(np.abs(positions[list(edge.vertices), 0]).max() < 1e-6)
    target = add_mesh("Dunes", *patch(30, bump=1.5, turn=1.0))
    pick(source, target)
    obj = morph()
    select(obj)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert len(mesh.vertices) > 60
    uvs, colors = mesh.uv_layers["UV"], mesh.color_attributes["Paint"]
    places = coordinates(mesh.vertices)
    for face in mesh.polygons:
        right = int(places[list(face.vertices), 0].mean() > 0)
        assert face.material_index == right
        for loop in face.loop_indices:
            x, y, _ = places[mesh.loops[loop].vertex_index]
            np.testing.assert_allclose(uvs.data[loop].uv, (x + 10 * right, y), atol=1e-4)
            np.testing.assert_allclose(
                colors.data[loop].color, (right, 0.5 * x + 0.5, 0, 1), atol=1e-4
            )
        assert face.normal.z > 0.9
    seam = [edge for edge in mesh.edges if edge.use_seam]
    assert sum(np.linalg.norm(np.diff(places[list(e.vertices)], axis=0)) for e in seam) == (
        pytest.approx(2.0, abs=1e-5)
    )
    assert all(np.abs(places[list(edge.vertices), 0]).max() < 1e-6 for edge in seam)


@pytest.mark.parametrize("has_keys", [False, True])
def test_subdividing_leaves_no_cracks_along_seams(settings, has_keys):
    """Imported models have vertices of their own on each side of a seam. New ones between them were
    an odd bit apart, so that the surface opened, and tore in the morph."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2)
    ball = bpy.context.object
    positions, faces = 1.3 * coordinates(ball.data.vertices), triangles(ball.data)
    bpy.data.objects.remove(ball)
    rows = np.arange(faces.size).reshape(-1, 3)
    source = add_mesh("Ball", (positions[faces] + 0.1).reshape(-1, 3), rows)
    for name in ("Basis", "Up") if has_keys else ():
        source.shape_key_add(name=name).value = 0.0
    bpy.ops.mesh.primitive_monkey_add()
    pick(source, bpy.context.object)
    obj = morph()
    select(obj)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    found = [coordinates(source.data.vertices)]
    found += [key(source, name) for name in ("Basis", "Up") if has_keys]
    for places in found:
        assert len(places) > 2 * faces.size
        near = np.unique(np.round(places / 1e-5), axis=0)
        assert len(np.unique(places, axis=0)) == len(near)


def test_subdividing_keeps_the_shading_of_normals_that_somebody_gave(settings):
    """As those of imported models: Blender keeps them beside what the faces have, which is other
    where these are cut. They came out as dents."""
    source = add_mesh("Sheet", *patch(5, bump=0.5))
    source.data.shade_smooth()
    hill = add_mesh("Dunes", *patch(30, bump=1.5, turn=1.0))

    def wanted(mesh):
        corners = read(mesh.loops, "vertex_index", 1, np.int32).reshape(-1)
        bent = coordinates(mesh.vertices)[corners] * (0.4, 0.3, 0.0) + (0, 0, 1)
        return bent / np.linalg.norm(bent, axis=1, keepdims=True)

    source.data.normals_split_custom_set(wanted(source.data).tolist())
    pick(source, hill)
    obj = morph()
    select(obj)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    mesh = source.data
    assert len(mesh.vertices) > 60
    assert mesh.has_custom_normals
    assert [a.name for a in mesh.attributes if "pointmorph" in a.name] == []
    found = read(mesh.corner_normals, "vector", 3)
    np.testing.assert_allclose(found, wanted(mesh), atol=0.03)


def test_subdividing_alone_leaves_the_morph_to_be_recomputed(settings):
    pick(primitive("cube"), primitive("ico_sphere", subdivisions=3))
    obj = morph()
    assert bpy.ops.pointmorph.subdivide_source(recompute=False) == {"FINISHED"}
    assert len(settings.source.data.vertices) > 90
    assert (obj.pointmorph.state, obj.pointmorph.too_fine) == ("STALE", "Icosphere")
    recompute(obj)
    assert (obj.pointmorph.state, obj.pointmorph.too_fine) == ("CURRENT", "")
    # Enough of them: nothing is computed again.
    before = obj.pointmorph.report
    assert bpy.ops.pointmorph.subdivide_source() == {"CANCELLED"}
    assert obj.pointmorph.report == before


def test_what_can_not_be_recomputed_is_subdivided_alone(settings):
    source, target = primitive("cube"), primitive("ico_sphere", subdivisions=3)
    pick(source, target)
    obj = morph()
    bpy.data.objects.remove(target)
    before = obj.pointmorph.report
    select(obj)
    assert bpy.ops.pointmorph.subdivide_source() == {"FINISHED"}
    assert len(source.data.vertices) > 90
    assert (obj.pointmorph.state, obj.pointmorph.report) == ("ORPHAN", before)


def test_what_can_not_be_computed_leaves_the_source_alone(settings):
    source, target = primitive("cube"), primitive("ico_sphere", subdivisions=3)
    pick(source, target)
    obj = morph()
    add_group(source, "pm.corner", {0: 1.0})
    with pytest.raises(RuntimeError, match='^Error: Icosphere: expected a vertex group "pm.corn'):
        bpy.ops.pointmorph.subdivide_source()
    assert len(source.data.vertices) == 8
    assert obj.pointmorph.too_fine == "Icosphere"
