"""What the library is given of an object."""

import bpy
import numpy as np
import pointmorph
import pytest
from mathutils import Matrix
from scenes import (
    add_attribute,
    add_group,
    add_mesh,
    add_object,
    add_point_cloud,
    coordinates,
    mark,
    pair,
    patch,
    select,
)

pytestmark = pytest.mark.interface

MATRICES = {
    "moved": Matrix.Translation((3, -2, 5)),
    "rotated": Matrix.Rotation(0.8, 4, (1, 2, 3)) @ Matrix.Translation((1, 1, 1)),
    "stretched": Matrix.Diagonal((2, 0.5, 3, 1)),
    "mirrored": Matrix.Rotation(2.0, 4, "Z") @ Matrix.Diagonal((-1.5, 1, 1, 1)),
    "turned inside out": Matrix.Diagonal((-1, -1, -2, 1)),
    "sheared": Matrix(((1, 0.4, 0, 1), (0, 1, 0.2, 0), (0, 0, 1.5, -4), (0, 0, 0, 1))),
}


@pytest.fixture
def read(addon, settings):
    """Reads an object in the world's frame."""

    def read_shape(obj, as_shown=False, origin=(0.0, 0.0, 0.0)):
        reading = addon("scene.shape_reader")
        reading.update(bpy.context, obj)
        steps = reading.read_shape_steps(bpy.context, obj, np.array(origin), as_shown)
        return addon("core.stepping").finish(steps)

    return read_shape


def place(obj, matrix):
    """Gives an object any world matrix; a shear needs a parent."""
    obj.parent = add_object("parent", None)
    obj.matrix_parent_inverse = matrix
    bpy.context.view_layer.update()


# --- Positions and normals ------------------------------------------------------------------------


def test_an_object_at_rest_keeps_its_bits(read):
    positions, faces = patch(10)
    assert np.array_equal(read(add_mesh("Sheet", positions, faces)).positions, positions)


@pytest.mark.parametrize("name", MATRICES)
def test_transforms(read, name):
    obj = add_mesh("Sheet", *patch(40))
    place(obj, MATRICES[name])
    shape = read(obj)
    expected = np.array([obj.matrix_world @ v.co for v in obj.data.vertices])
    np.testing.assert_allclose(shape.positions, expected, rtol=1e-6, atol=1e-6)

    # Normals of the same surface with the transform applied to its vertices. A mirror turns faces
    # over; what was outside stays outside.
    applied = obj.data.copy()
    applied.transform(obj.matrix_world)
    if obj.matrix_world.determinant() < 0:
        applied.flip_normals()
    applied.update()
    normals = np.array([v.normal for v in applied.vertices])
    # Vertex normals are means of face normals, which a stretch weights differently.
    assert np.einsum("ij,ij->i", shape.normals, normals).min() > 0.97
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1, rtol=1e-5)


def test_normals_of_a_plane_are_exact_through_any_transform(read):
    matrix = MATRICES["sheared"] @ MATRICES["mirrored"]
    obj = add_mesh("Plane", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
    place(obj, matrix)
    x, y = np.array(matrix.col[0][:3]), np.array(matrix.col[1][:3])
    outward = -np.cross(x, y)  # the mirror
    expected = outward / np.linalg.norm(outward)
    np.testing.assert_allclose(read(obj).normals, np.tile(expected, (4, 1)), atol=1e-6)


def test_frames_have_their_origin_where_it_is_asked_for(read):
    positions, faces = patch(10)
    obj = add_mesh("Sheet", positions, faces)
    obj.location = (1000, 2000, -3000)
    assert np.array_equal(read(obj, origin=(1000, 2000, -3000)).positions, positions)


def test_a_transform_set_a_moment_ago_counts(read):
    obj = add_mesh("Sheet", *patch(6))
    obj.location.x = 7
    assert read(obj).positions[:, 0].min() == pytest.approx(6)


def test_vertices_without_faces_have_no_normals(read):
    positions, faces = patch(6)
    assert read(add_mesh("Points", positions)).normals is None
    loose = np.vstack([positions, [[5, 5, 5]]])
    assert read(add_mesh("Sheet and a point", loose, faces)).normals is None


def test_vertices_without_faces_may_bring_normals(read):
    positions, _ = patch(6)
    obj = add_mesh("Points", positions)
    add_attribute(obj.data, "Normal", "FLOAT_VECTOR", np.tile([0, 0, 1], (36, 1)))
    assert np.array_equal(read(obj).normals, np.tile(np.float32([0, 0, 1]), (36, 1)))


def test_the_boundary_is_the_longest_open_loop(read):
    positions, faces = patch(10)
    hole = 4 * 9 + 4  # the quad in the middle
    shape = read(add_mesh("Sheet", positions, np.delete(faces, hole, axis=0)))
    on_edge = np.abs(positions[:, :2]).max(axis=1) == 1
    assert sorted(shape.cloud().boundary) == np.flatnonzero(on_edge).tolist()


# --- Colours and radii ----------------------------------------------------------------------------


def test_no_colors(read):
    assert read(add_mesh("Sheet", *patch(6))).colors is None


@pytest.mark.parametrize("kind", ["FLOAT_COLOR", "BYTE_COLOR"])
@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_colors(read, kind, domain):
    positions, faces = patch(6)
    obj = add_mesh("Sheet", positions, faces)
    colors = np.random.default_rng(1).uniform(0, 1, (36, 4)).astype(np.float32)
    given = colors if domain == "POINT" else colors[faces.reshape(-1)]
    attribute = add_attribute(obj.data, "Col", kind, given, domain)
    obj.data.color_attributes.active_color = attribute
    # A byte of sRGB is as much as .0086 in linear light.
    tolerance = 0 if kind == "FLOAT_COLOR" else 0.005
    np.testing.assert_allclose(read(obj).colors, colors, rtol=0, atol=tolerance)


def test_corners_of_a_vertex_are_averaged_and_loose_vertices_are_white(read):
    positions = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (9, 9, 9)]
    obj = add_mesh("Two triangles", positions, [(0, 1, 2), (0, 2, 3)])
    corners = [[1, 0, 0, 1]] * 3 + [[0, 0, 1, 0.5]] * 3
    attribute = add_attribute(obj.data, "Col", "FLOAT_COLOR", corners, "CORNER")
    obj.data.color_attributes.active_color = attribute
    mean = [0.5, 0, 0.5, 0.75]
    expected = [mean, [1, 0, 0, 1], mean, [0, 0, 1, 0.5], [1, 1, 1, 1]]
    np.testing.assert_array_equal(read(obj).colors, expected)


def test_the_active_color_attribute_is_taken(read):
    obj = add_mesh("Sheet", *patch(6))
    first = add_attribute(obj.data, "First", "FLOAT_COLOR", np.zeros((36, 4)))
    add_attribute(obj.data, "Second", "FLOAT_COLOR", np.ones((36, 4)))
    obj.data.color_attributes.active_color = obj.data.attributes["Second"]
    assert (read(obj).colors == 1).all()
    obj.data.color_attributes.active_color = obj.data.attributes["First"]
    assert first.name == "First"
    assert (read(obj).colors == 0).all()


def test_radii_grow_with_the_object(read):
    obj = add_mesh("Sheet", *patch(6))
    assert read(obj).radii is None
    add_attribute(obj.data, "radius", "FLOAT", np.linspace(0, 1, 36))
    assert np.array_equal(read(obj).radii, np.linspace(0, 1, 36, dtype=np.float32))
    obj.scale = (2, -4, 1)
    np.testing.assert_allclose(read(obj).radii, np.linspace(0, 2, 36), rtol=1e-6)


# --- States of an object --------------------------------------------------------------------------


def test_the_target_is_what_is_shown_and_the_source_is_not(read):
    obj = add_mesh("Sheet", *patch(6))
    obj.modifiers.new("Finer", "SUBSURF").levels = 1
    mark(obj, "corner", 1, 1)
    assert len(read(obj).positions) == 36
    shown = read(obj, as_shown=True)
    assert len(shown.positions) == 11 * 11
    rows, weights = shown.marks.weights["corner"]
    best = rows[np.argmax(weights)]
    assert np.abs(shown.positions[best, :2]).min() > 0.9


def test_shape_keys_of_the_target_count_and_of_the_source_do_not(read):
    positions, faces = patch(6)
    obj = add_mesh("Sheet", positions, faces)
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="Up")
    for point in key.data:
        point.co.z += 3
    key.value = 1
    assert np.array_equal(read(obj).positions, positions)
    np.testing.assert_allclose(read(obj, True).positions, positions + [0, 0, 3], rtol=1e-6)


@pytest.mark.parametrize("as_shown", [False, True])
def test_edits_count_at_once(read, as_shown):
    import bmesh

    obj = add_mesh("Sheet", *patch(6))
    select(obj)
    bpy.ops.object.mode_set(mode="EDIT")
    edited = bmesh.from_edit_mesh(obj.data)
    edited.verts.ensure_lookup_table()
    edited.verts[3].co = (9, 8, 7)
    bmesh.update_edit_mesh(obj.data)
    assert read(obj, as_shown).positions[3].tolist() == [9, 8, 7]
    assert obj.mode == "EDIT"


def test_reading_leaves_nothing_behind(read):
    from scenes import data_blocks

    obj = add_mesh("Sheet", *patch(6))
    before = data_blocks()
    read(obj, as_shown=True)
    assert data_blocks() == before


def test_a_point_cloud(read):
    positions, _ = patch(8)
    radii = np.linspace(0.1, 0.2, 64, dtype=np.float32)
    colors = np.random.default_rng(2).uniform(0, 1, (64, 4)).astype(np.float32)
    weights = np.zeros(64)
    weights[5] = 1
    attributes = {
        "radius": ("FLOAT", radii),
        "Color": ("FLOAT_COLOR", colors),
        "pm.tip": ("FLOAT", weights),
        "other": ("FLOAT", weights),
    }
    obj = add_point_cloud("Cloud", positions, attributes)
    obj.location = (1, 2, 3)
    assert obj.type == "POINTCLOUD"
    shape = read(obj)
    np.testing.assert_allclose(shape.positions, positions + [1, 2, 3], rtol=1e-6)
    assert np.array_equal(shape.radii, radii)
    assert np.array_equal(shape.colors, colors)
    assert list(shape.marks.weights) == ["tip"]
    assert shape.marks.weights["tip"][0].tolist() == [5]


def test_groups_without_the_prefix_are_no_features(read):
    obj = add_mesh("Sheet", *patch(6))
    add_group(obj, "Bone.L", {0: 1.0})
    add_group(obj, "pm.tip", {7: 0.5, 8: 0.25})
    weights = read(obj).marks.weights
    assert list(weights) == ["tip"]
    assert weights["tip"][0].tolist() == [7, 8]
    assert weights["tip"][1].tolist() == [0.5, 0.25]


# --- Errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("data", ["curves", "lattices", "cameras", "metaballs"])
def test_other_types_are_refused(read, data):
    arguments = ("CURVE",) if data == "curves" else ()
    obj = add_object("Thing", getattr(bpy.data, data).new("Thing", *arguments))
    with pytest.raises(
        pointmorph.CloudError, match=r"Thing: expected a mesh or a point cloud"
    ) as e:
        read(obj)
    assert "Convert" in str(e.value)


@pytest.mark.parametrize("scale", [(0, 1, 1), (1, 1, 1e-9), (0, 0, 0), (1, float("nan"), 1)])
def test_flat_transforms_are_refused(read, scale):
    obj = add_mesh("Sheet", *patch(6))
    obj.scale = scale
    with pytest.raises(pointmorph.CloudError, match="Sheet: expected a scale other than 0"):
        read(obj)


def test_disabled_objects_are_refused_and_hidden_ones_are_not(read):
    obj = add_mesh("Sheet", *patch(6))
    obj.hide_set(True)
    obj.location.x = 5
    assert read(obj).positions[:, 0].min() == pytest.approx(4)
    obj.hide_set(False)
    obj.hide_viewport = True
    with pytest.raises(pointmorph.CloudError, match="Sheet: .* enabled .* Outliner"):
        read(obj)


def test_both_are_read_in_the_frame_of_the_source(addon, settings):
    source, target = pair()
    source.location = (100, 0, 0)
    target.location = (100, 5, 0)
    request = addon("scene.panel_request").read_request(bpy.context)
    assert np.array_equal(request.source.positions, coordinates(source.data.vertices))
    np.testing.assert_allclose(
        request.target.positions, coordinates(target.data.vertices) + [0, 5, 0], atol=1e-6
    )


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_arrays_are_what_blender_says_one_by_one(addon, mode):
    """Whether Blender keeps an attribute for them, as it does for slots only where one isn't 0."""
    arrays = addon("data.arrays")
    obj = add_mesh("Sheet", *patch(5))
    mesh = obj.data
    layer = mesh.uv_layers.new(name="Layout")
    for number, loop in enumerate(mesh.loops):
        layer.data[number].uv = (0.1 * loop.vertex_index, 0.5)
    assert not arrays.material_indices(mesh).any()
    mesh.polygons[3].material_index = 2
    select(obj)
    bpy.ops.object.mode_set(mode=mode)
    for found, said in (
        (arrays.mesh_corners(mesh), [loop.vertex_index for loop in mesh.loops]),
        (arrays.mesh_edges(mesh), [edge.vertices[:] for edge in mesh.edges]),
        (arrays.vertex_positions(mesh), [vertex.co[:] for vertex in mesh.vertices]),
        (arrays.material_indices(mesh), [face.material_index for face in mesh.polygons]),
        (arrays.corner_uvs(mesh.uv_layers[0]), [item.uv[:] for item in mesh.uv_layers[0].data]),
    ):
        said = np.array(said)
        assert found.dtype == (np.int32 if said.dtype.kind == "i" else np.float32)
        assert np.array_equal(found.reshape(said.shape), said)
    assert arrays.material_indices(mesh).tolist() == [0, 0, 0, 2, *12 * [0]]
    bpy.ops.object.mode_set(mode="OBJECT")
