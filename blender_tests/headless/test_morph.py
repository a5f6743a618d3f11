"""The morph object."""

import json

import bpy
import numpy as np
import pointmorph
import pointmorph.meshes
import pytest
from mathutils import Matrix
from scenes import (
    add_attribute,
    add_mesh,
    add_object,
    add_point_cloud,
    attribute,
    coordinates,
    data_blocks,
    error_of,
    key,
    morph,
    pair,
    patch,
    read,
    row_at,
    row_pairs,
    select,
    triangles,
)

pytestmark = pytest.mark.interface


def evaluated_points(obj):
    """What the morph object shows: positions, attributes, names of materials, world matrix."""
    found = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "POINTCLOUD":
            assert instance.parent.original == obj
            cloud = instance.object.data
            names = ("Color", "Normal", "radius")
            attributes = {name: attribute(cloud, name) for name in names}
            materials = [material.name for material in cloud.materials]
            positions = read(cloud.points, "co", 3)
            found.append((positions, attributes, materials, instance.matrix_world.copy()))
    [points] = found
    return points


# --- What is made ---------------------------------------------------------------------------------


def test_the_object(settings):
    source, target = pair()
    obj = morph()
    assert obj.name == "Hill to Dune"
    assert obj.select_get()
    assert not source.select_get()
    assert [k.name for k in obj.data.shape_keys.key_blocks] == ["Basis", "Morph"]
    morph_key = obj.data.shape_keys.key_blocks["Morph"]
    assert (morph_key.value, morph_key.slider_min, morph_key.slider_max) == (0, 0, 1)
    assert json.loads(obj.pointmorph.report)["pairs"] == len(obj.data.vertices)
    assert obj.pointmorph.source == source
    assert obj.pointmorph.target == target
    assert len(obj.data.edges) == len(obj.data.polygons) == 0


def test_ends_are_the_inputs_bit_for_bit_and_every_vertex_is_there(settings):
    source, target = pair(domain="auto")
    obj = morph()
    rows = row_pairs(obj)
    for side, name, shape in ((0, "Basis", source), (1, "Morph", target)):
        positions = coordinates(shape.data.vertices)
        assert np.array_equal(key(obj, name), positions[rows[:, side]])
        assert np.array_equal(np.unique(rows[:, side]), np.arange(len(positions)))
    assert np.array_equal(coordinates(obj.data.vertices), key(obj, "Basis"))


def test_features_meet(settings):
    source, target = pair(domain="auto")
    rows = {tuple(row) for row in row_pairs(morph())}
    for place in ((0, 0), (0.5, 0.3)):
        ends = tuple(row_at(coordinates(o.data.vertices), *place) for o in (source, target))
        assert ends in rows


def test_the_library_gives_the_same_pairs(settings):
    """Called directly, with the same arrays made independently of the add-on."""
    objects = pair(domain="auto")
    obj = morph()
    clouds = []
    for shape in objects:
        mesh = shape.data
        faces = triangles(mesh)
        clouds.append(
            pointmorph.Cloud(
                coordinates(mesh.vertices),
                np.array([v.normal for v in mesh.vertices], np.float32),
                faces=faces,
                name=shape.name,
                boundary=pointmorph.meshes.boundary_loops(faces, len(mesh.vertices))[0],
            )
        )
    features = {
        name: tuple(row_at(cloud.positions, *place) for cloud in clouds)
        for name, place in (("peak", (0, 0)), ("slope", (0.5, 0.3)))
    }
    expected = pointmorph.morph(*clouds, features)
    assert np.array_equal(row_pairs(obj), expected.pairs)
    for name, side, expected_ends in (
        ("landing", 0, expected.wrapped()),
        ("source_onward", 0, expected.source_to_target),
        ("target_landing", 1, expected.target_to_source),
    ):
        by_pair = expected_ends[expected.pairs[:, side]]
        np.testing.assert_allclose(attribute(obj.data, name), by_pair, atol=1e-6)
    for t, side in ((0, "source"), (1, "target")):
        frame = expected.frame(t)
        assert np.array_equal(attribute(obj.data, f"{side}_radius"), frame.radii)
        assert np.array_equal(attribute(obj.data, f"{side}_color"), frame.colors)


def test_attributes_of_both_ends(settings):
    source, target = pair()
    rng = np.random.default_rng(3)
    given = {}
    for obj in (source, target):
        count = len(obj.data.vertices)
        given[obj] = (
            rng.uniform(0, 1, (count, 4)).astype(np.float32),
            rng.uniform(0.01, 0.02, count).astype(np.float32),
        )
        colors = add_attribute(obj.data, "Col", "FLOAT_COLOR", given[obj][0])
        obj.data.color_attributes.active_color = colors
        add_attribute(obj.data, "radius", "FLOAT", given[obj][1])
    obj = morph()
    rows = row_pairs(obj)
    for side, shape in enumerate((source, target)):
        name = ("source", "target")[side]
        colors, radii = given[shape]
        assert np.array_equal(attribute(obj.data, f"{name}_color"), colors[rows[:, side]])
        assert np.array_equal(attribute(obj.data, f"{name}_radius"), radii[rows[:, side]])
        normals = np.array([v.normal for v in shape.data.vertices])
        np.testing.assert_allclose(
            attribute(obj.data, f"{name}_normal"), normals[rows[:, side]], atol=1e-6
        )


@pytest.mark.parametrize("t", [0.0, 0.25, 1.0])
def test_it_shows_points_with_colors_and_radii_at_the_key(settings, t):
    source, target = pair()
    for obj, color, radius in ((source, (1, 0, 0, 1), 0.01), (target, (0, 0, 1, 0.5), 0.03)):
        count = len(obj.data.vertices)
        colors = add_attribute(obj.data, "Col", "FLOAT_COLOR", np.tile(color, (count, 1)))
        obj.data.color_attributes.active_color = colors
        add_attribute(obj.data, "radius", "FLOAT", np.full(count, radius))
    obj = morph()
    obj.data.shape_keys.key_blocks["Morph"].value = t
    positions, attributes, materials, matrix = evaluated_points(obj)
    ends = key(obj, "Basis"), key(obj, "Morph")
    assert matrix == obj.matrix_world
    np.testing.assert_allclose(positions, (1 - t) * ends[0] + t * ends[1], atol=1e-6)
    expected = np.array([1 - t, 0, t, 1 - t / 2])
    np.testing.assert_allclose(attributes["Color"], np.tile(expected, (len(positions), 1)))
    np.testing.assert_allclose(attributes["radius"], 0.01 + 0.02 * t, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(attributes["Normal"], axis=1), 1, rtol=1e-5)
    assert materials == ["Pointmorph Points"]


@pytest.mark.makes_nodes
def test_discs_instead_of_points(addon, settings):
    pair()
    obj = morph()
    display, versions = addon("scene.points_display"), addon("data.versions")
    modifier = obj.modifiers[display.MODIFIER]
    versions.set_input(modifier, "Discs", True)
    obj.update_tag()
    shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    assert len(shown.polygons) == len(obj.data.vertices)
    normals = read(shown.polygons, "normal", 3)
    expected = attribute(obj.data, "source_normal")
    assert np.einsum("ij,ij->i", normals, expected).min() > 0.999


def test_t_is_animatable(settings):
    pair()
    obj = morph()
    morph_key = obj.data.shape_keys.key_blocks["Morph"]
    for frame, value in ((1, 0.0), (11, 1.0)):
        morph_key.value = value
        morph_key.keyframe_insert("value", frame=frame)
    bpy.context.scene.frame_set(6)
    positions, attributes, *_ = evaluated_points(obj)
    ends = key(obj, "Basis"), key(obj, "Morph")
    np.testing.assert_allclose(positions, (ends[0] + ends[1]) / 2, atol=1e-5)
    radii = [attribute(obj.data, f"{side}_radius") for side in ("source", "target")]
    np.testing.assert_allclose(attributes["radius"], (radii[0] + radii[1]) / 2, rtol=1e-4)


def test_nodes_and_material_are_shared(settings):
    pair()
    assert morph().name == "Hill to Dune"
    known = len(bpy.data.node_groups)
    assert morph(new_result=True).name == "Hill to Dune.001"
    assert len(bpy.data.node_groups) == known
    assert len(bpy.data.materials) == 1


# --- Transforms -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "matrix",
    [
        Matrix.Translation((50, 60, 70)),
        Matrix.LocRotScale((1, 2, 3), Matrix.Rotation(1, 3, "X").to_quaternion(), (2, -1, 0.5)),
    ],
)
def test_the_morph_lies_where_the_objects_are(settings, matrix):
    source, target = pair()
    source.matrix_world = matrix
    target.matrix_world = Matrix.Translation((53, 60, 70)) @ Matrix.Rotation(0.5, 4, "Z")
    obj = morph()
    bpy.context.view_layer.update()
    assert obj.location == source.location
    assert obj.matrix_world.to_3x3() == Matrix.Identity(3)
    rows = row_pairs(obj)
    for side, name, shape in ((0, "Basis", source), (1, "Morph", target)):
        here = np.array(
            [obj.matrix_world @ Matrix.Translation(p).translation for p in key(obj, name)]
        )
        there = np.array([shape.matrix_world @ v.co for v in shape.data.vertices])
        np.testing.assert_allclose(here, there[rows[:, side]], atol=1e-5)


def test_far_from_the_origin_nothing_is_lost(settings):
    source, target = pair()
    near = morph()
    for obj in (source, target):
        obj.location = (1e5, -2e5, 3e5)
    far = morph(new_result=True)
    assert np.array_equal(key(near, "Basis"), key(far, "Basis"))
    assert np.array_equal(key(near, "Morph"), key(far, "Morph"))


# --- Other inputs ---------------------------------------------------------------------------------


def test_vertices_without_faces(settings):
    for side, name, turn in (("source", "Hill", 0), ("target", "Dune", 1)):
        positions, _ = patch(30, turn=turn)
        setattr(settings, side, add_mesh(name, positions))
    obj = morph()
    assert np.array_equal(
        key(obj, "Basis"), coordinates(settings.source.data.vertices)[row_pairs(obj)[:, 0]]
    )


def test_point_clouds(settings):
    ends = {}
    for side, name, size in (("source", "Hill", 26), ("target", "Dune", 30)):
        positions, _ = patch(size)
        radii = np.full(len(positions), 0.05, np.float32)
        ends[side] = positions
        setattr(settings, side, add_point_cloud(name, positions, {"radius": ("FLOAT", radii)}))
    obj = morph()
    rows = row_pairs(obj)
    assert np.array_equal(key(obj, "Basis"), ends["source"][rows[:, 0]])
    assert np.array_equal(key(obj, "Morph"), ends["target"][rows[:, 1]])
    with pytest.raises(RuntimeError, match="Hill: expected a mesh, to hold shape keys"):
        bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")


@pytest.mark.parametrize("side", [0, 1])
def test_edit_mode_is_left_and_the_edits_count(settings, capfd, side):
    settings.show_as = "MESH"
    edited = pair()[side]
    select(edited)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0, 0, 2))
    bpy.ops.pointmorph.morph()
    shown = bpy.data.objects["Hill to Dune"]
    assert edited.mode == "OBJECT"
    assert edited.hide_get()
    assert bpy.context.view_layer.objects.active == shown
    assert len(shown.data.polygons)
    assert key(shown, ("Basis", "Morph")[side])[:, 2].min() > 1
    assert "without its faces" not in capfd.readouterr().out


def test_a_target_with_modifiers_is_taken_as_shown(settings):
    _, target = pair()
    target.modifiers.new("Finer", "SUBSURF").levels = 1
    obj = morph()
    assert row_pairs(obj)[:, 1].max() + 1 > len(target.data.vertices)


# --- Save, load, undo -----------------------------------------------------------------------------


def test_save_and_load(settings, tmp_path):
    pair()
    obj = morph()
    obj.data.shape_keys.key_blocks["Morph"].value = 0.5
    kept = {name: key(obj, name) for name in ("Basis", "Morph")}
    rows = row_pairs(obj)
    shown = evaluated_points(obj)[0]
    path = str(tmp_path / "morph.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.data.objects["Hill to Dune"]
    for name, positions in kept.items():
        assert np.array_equal(key(obj, name), positions)
    assert np.array_equal(row_pairs(obj), rows)
    assert np.array_equal(evaluated_points(obj)[0], shown)
    assert obj.pointmorph.source == bpy.data.objects["Hill"]


def test_undo_is_one_step(settings):
    pair()
    bpy.ops.ed.undo_push(message="before")
    before = data_blocks()
    bpy.ops.pointmorph.morph("EXEC_DEFAULT", True)
    after = data_blocks()
    assert "objects: Hill to Dune" in after
    bpy.ops.ed.undo()
    assert data_blocks() == before
    bpy.ops.ed.redo()
    assert data_blocks() == after


@pytest.mark.parametrize("last", ["Hill", "Dune"])
def test_selected_objects_are_morphed_where_none_are_chosen(settings, last):
    """Unless one of both is: who chose it means it."""
    shapes = pair()
    settings.source = settings.target = None
    select(bpy.data.objects[last])
    assert "Select two or more" in refused()
    for obj in shapes:
        obj.select_set(True)
    first = next(obj.name for obj in shapes if obj.name != last)
    settings.source = shapes[0]
    assert "Choose a target first" in refused()
    settings.source = None
    assert morph().name == f"{first} to {last}"
    assert (settings.source.name, settings.target.name) == (first, last)


# --- Errors ---------------------------------------------------------------------------------------


def refused():
    return error_of(bpy.ops.pointmorph.morph)


def test_nothing_picked(settings):
    assert "Select two or more objects, the target last" in refused()
    settings.source = add_mesh("Hill", *patch(8))
    assert "Choose a target first" in refused()


def test_source_and_target_the_same(settings):
    settings.source = settings.target = add_mesh("Hill", *patch(8))
    assert 'Source and target are both "Hill"' in refused()


def test_an_object_that_was_removed(settings):
    _, target = pair()
    bpy.context.scene.collection.objects.unlink(target)
    assert '"Dune" is no longer in the scene' in refused()
    bpy.data.objects.remove(target)
    assert "Choose a target first" in refused()


def test_another_type(settings):
    pair()
    settings.target = add_object("Rope", None)
    assert "Rope: expected a mesh or a point cloud, found an object of type Empty" in refused()


def test_a_flat_scale(settings):
    pair()
    settings.target.scale.z = 0
    assert "Dune: expected a scale other than 0" in refused()


@pytest.mark.parametrize(
    "positions",
    [
        np.empty((0, 3)),
        np.zeros((1, 3)),
        np.zeros((50, 3)),
        np.linspace(0, 1, 50)[:, None] * [[1, 2, 3]],
        np.full((50, 3), np.nan),
        np.full((50, 3), np.inf),
    ],
    ids=["empty", "one point", "coincident", "collinear", "NaN", "infinite"],
)
@pytest.mark.parametrize("side", ["source", "target"])
def test_bad_points(settings, positions, side):
    pair()
    setattr(settings, side, add_mesh("Bad", positions))
    for obj in (settings.source, settings.target):
        obj.vertex_groups.clear()
    assert "Bad: expected" in refused()


def test_a_loop_on_an_open_patch(settings):
    pair()
    for name in ("peak", "slope", "foot"):
        settings.loop.add().name = name
    assert "loop" in refused().lower()


@pytest.mark.makes_nodes
def test_an_error_while_the_object_is_made_leaves_nothing(addon, settings, monkeypatch):
    pair()
    bpy.context.view_layer.update()
    before = data_blocks()
    for name in ("fill_mesh", "write_attribute", "write_key"):
        with monkeypatch.context() as patched:

            def fail(*arguments):
                raise MemoryError("no memory left")

            patched.setattr(addon("data.arrays"), name, fail)
            with pytest.raises(RuntimeError, match="no memory left"):
                bpy.ops.pointmorph.morph()
        assert data_blocks() == before, name
    with monkeypatch.context() as patched:
        patched.setattr(addon("data.versions"), "input_path", fail)
        with pytest.raises(RuntimeError, match="no memory left"):
            bpy.ops.pointmorph.morph()
    assert data_blocks() == before
    assert morph().name == "Hill to Dune"


@pytest.mark.computes
def test_ctrl_c_stops_a_script(settings, monkeypatch):
    pair()
    before = data_blocks()

    def interrupted(*arguments, progress, **keywords):
        progress("pairing", 0.5)
        raise KeyboardInterrupt

    monkeypatch.setattr(pointmorph, "morph", interrupted)
    with pytest.raises((KeyboardInterrupt, RuntimeError)):
        bpy.ops.pointmorph.morph()
    assert data_blocks() == before


# --- The picture ----------------------------------------------------------------------------------


@pytest.mark.renders
def test_a_render_shows_a_solid_colored_surface(settings, output):
    source, target = pair(60, 50)
    for obj, color in ((source, (0.9, 0.1, 0.05, 1)), (target, (0.05, 0.1, 0.9, 1))):
        colors = np.tile(color, (len(obj.data.vertices), 1))
        item = add_attribute(obj.data, "Col", "FLOAT_COLOR", colors)
        obj.data.color_attributes.active_color = item
        obj.hide_render = True
    obj = morph()
    scene = bpy.context.scene
    camera = add_object("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = 1.6  # within the sheet
    camera.location.z = 5
    scene.camera = camera
    sun = add_object("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy = 3
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 96
    scene.view_settings.view_transform = "Standard"
    for t in (0, 1):
        obj.data.shape_keys.key_blocks["Morph"].value = t
        path = output / f"points_{t}.png"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(str(path))
        pixels = np.array(picture.pixels[:]).reshape(96, 96, 4)
        strong, weak = pixels[..., 2 * t], pixels[..., 2 - 2 * t]
        assert (strong > 2 * weak).mean() > 0.999, t
        assert strong.mean() > 0.3
