"""Frames in the scene and in files."""

import sys

import bpy
import numpy as np
import pytest
from pointmorph import formats
from pointmorph.sequences import surfaces
from scenes import (
    attribute,
    baked_frames,
    coordinates,
    data_blocks,
    morph,
    row_pairs,
    shown_cloud,
    torn_pair,
)

pytestmark = pytest.mark.interface


def bake(**options):
    return bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=9, **options)


@pytest.fixture
def torn(settings):
    """The morph object of a sheet whose right half drifts away."""
    torn_pair()
    return morph()


def shown(obj, frame):
    """Positions, radii and colours that an object shows at a frame as points."""
    bpy.context.scene.frame_set(frame)
    data = shown_cloud(obj)
    return coordinates(data.points), attribute(data, "radius"), attribute(data, "Color")


def test_the_scene_shows_the_frames(morphed):
    _, _, obj = morphed
    rows = row_pairs(obj)
    assert bake(resample=False) == {"FINISHED"}
    player = bpy.context.view_layer.objects.active
    assert player.name == "Hill to Dune Frames"
    assert obj.hide_render
    start = coordinates(obj.data.shape_keys.reference_key.data)
    end = coordinates(obj.data.shape_keys.key_blocks["Morph"].data)
    for frame in (9, 1, 4):  # in any order
        positions, radii, colors = shown(player, frame)
        t = (frame - 1) / 8
        assert positions.shape == (len(rows), 3)
        np.testing.assert_allclose(positions, (1 - t) * start + t * end, atol=1e-6)
        ends = [attribute(obj.data, f"{side}_radius") for side in ("source", "target")]
        np.testing.assert_allclose(radii, (1 - t) * ends[0] + t * ends[1], rtol=1e-5)
        assert colors.shape == (len(rows), 4)
    for outside, inside in ((-5, 1), (40, 9)):
        np.testing.assert_array_equal(shown(player, outside)[0], shown(player, inside)[0])


def test_cracks_are_closed_and_velocities_are_by_frame(torn):
    assert bake() == {"FINISHED"}
    player = bpy.context.view_layer.objects.active
    counts = [len(shown(player, frame)[0]) for frame in (1, 5, 9)]
    assert counts[0] == counts[2] == len(torn.data.vertices)
    assert counts[1] > counts[0] + 20
    positions = shown(player, 5)[0]
    data = shown_cloud(player)
    ids, velocities = attribute(data, "id"), attribute(data, "velocity")
    later = shown(player, 6)[0]
    later_ids = attribute(shown_cloud(player), "id")
    _, here, there = np.intersect1d(ids, later_ids, return_indices=True)
    assert len(here) > counts[0]
    np.testing.assert_allclose(later[there] - positions[here], velocities[here], atol=0.02)


SIDE = 80  # pixels
WIDTH = 1.5  # of what the camera sees, in units of space


def rendered(scene, path):
    """How far points cover each pixel of the present frame, by Cycles."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(-1, 4)[:, 3]


@pytest.mark.renders
@pytest.mark.parametrize("discs", [False, True])
def test_cycles_blurs_by_the_velocity(addon, torn, tmp_path, discs):
    bake()
    player = bpy.context.view_layer.objects.active
    addon("data.versions").set_input(player.modifiers["Points"], "Discs", discs)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", WIDTH
    camera.location = (1.05, 0.0, 5.0)  # above the edge that moves
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.film_transparent = True
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 256, False
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.frame_set(5)
    still = rendered(scene, tmp_path / "still.png")
    # For four frames: two before this one, two after.
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 4.0
    blurred = rendered(scene, tmp_path / "blurred.png")
    way = 2.0 * baked_frames(player)[4]["velocity"][:, 0].max()
    assert way > 0.14
    assert rightmost(blurred) - rightmost(still) == pytest.approx(way, abs=0.03)


def rightmost(coverage):
    """The last column that is covered a little, in units of space."""
    return WIDTH / SIDE * np.flatnonzero(coverage.reshape(SIDE, SIDE).max(axis=0) > 0.02).max()


def test_easing_and_step(morphed):
    _, _, obj = morphed
    start = coordinates(obj.data.shape_keys.reference_key.data)
    end = coordinates(obj.data.shape_keys.key_blocks["Morph"].data)
    bake(easing="SMOOTH", step=4, resample=False)
    player = bpy.context.view_layer.objects.active
    t = 0.5  # the middle stays
    np.testing.assert_allclose(shown(player, 5)[0], (1 - t) * start + t * end, atol=1e-6)
    np.testing.assert_array_equal(shown(player, 7)[0], shown(player, 5)[0])
    assert not np.array_equal(shown(player, 9)[0], shown(player, 5)[0])


def test_ply_files_go_on_where_they_were_stopped(torn, tmp_path):
    assert bake(format="PLY", directory=str(tmp_path)) == {"FINISHED"}
    files = sorted(tmp_path.glob("*.ply"))
    assert [file.name for file in files] == [f"frame_{number:04d}.ply" for number in range(1, 10)]
    shape = formats.read(files[4])
    assert len(shape.positions) > len(torn.data.vertices)
    assert shape.radii is not None
    times = {file: file.stat().st_mtime_ns for file in files}
    files[3].unlink()
    bake(format="PLY", directory=str(tmp_path))
    again = {file: file.stat().st_mtime_ns for file in files}
    assert [file for file in files if again[file] != times[file]] == [files[3]]


def read_back(kind, file):
    """The object with the geometry of a file that was baked."""
    before = set(bpy.data.objects)
    reader = bpy.ops.wm.usd_import if kind == "USD" else bpy.ops.wm.alembic_import
    assert reader(filepath=str(file)) == {"FINISHED"}
    (read,) = [o for o in set(bpy.data.objects) - before if o.type in {"MESH", "POINTCLOUD"}]
    return read


def geometry(obj, frame):
    """What an object shows at a frame: its data, evaluated; valid until the frame changes."""
    bpy.context.scene.frame_set(frame)
    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def can_write(kind, faces):
    """Whether this Blender can; when it can't, a bake must have said so."""
    if kind == "ALEMBIC":
        return "alembic_export" in dir(bpy.ops.wm)  # some builds are without
    return bpy.app.version >= ((4, 2, 0) if faces else (4, 5, 0))


RATE = 24.0  # frames a second; files keep velocities by second
FILES = {"USD": "Whole_to_Torn.usdc", "ALEMBIC": "Whole_to_Torn.abc"}


@pytest.mark.parametrize("kind", FILES)
def test_points_come_back_from_files(torn, tmp_path, kind):
    before = data_blocks()
    if not can_write(kind, faces=False):
        with pytest.raises(RuntimeError, match="Blender"):
            bake(format=kind, directory=str(tmp_path))
        return
    assert bake(format=kind, directory=str(tmp_path)) == {"FINISHED"}
    assert [file.name for file in tmp_path.iterdir()] == [FILES[kind]]
    assert not {name for name in data_blocks() ^ before if "Pointmorph" not in str(name)}

    bake()
    player = bpy.context.view_layer.objects.active
    read = read_back(kind, tmp_path / FILES[kind])
    for frame in (1, 5, 6, 9):
        positions, radii, colors = shown(player, frame)
        expected = shown_cloud(player)
        velocities, ids = attribute(expected, "velocity"), attribute(expected, "id")
        normals = attribute(expected, "Normal")
        data = geometry(read, frame)
        points = data.points if kind == "USD" else data.vertices
        np.testing.assert_allclose(coordinates(points), positions, atol=1e-6)
        np.testing.assert_allclose(attribute(data, "velocity"), RATE * velocities, atol=1e-4)
        if kind == "USD":
            np.testing.assert_allclose(attribute(data, "radius"), radii, rtol=1e-6)
            np.testing.assert_allclose(attribute(data, "Color"), colors, atol=1e-6)
            np.testing.assert_allclose(attribute(data, "Normal"), normals, atol=1e-6)
            np.testing.assert_array_equal(attribute(data, "point_id"), ids)


def is_closed_but_for_the_border(data):
    """Whether every edge has one or two faces, and few have one."""
    loops = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("edge_index", loops)
    counts = np.bincount(loops, minlength=len(data.edges))
    return counts.min() >= 1 and counts.max() == 2 and (counts == 1).mean() < 0.15


@pytest.mark.logic
def test_faces_on_request(torn, tmp_path):
    if not surfaces.is_available():
        pytest.skip("this Python has no pymeshlab and scipy that fit its numpy")
    before = data_blocks()
    bake(step=4, faces=True)
    player = bpy.context.view_layer.objects.active
    assert player.type == "MESH"
    expected = {}
    for frame in (1, 5, 9):
        data = geometry(player, frame)
        assert is_closed_but_for_the_border(data)
        used = data.materials[data.polygons[0].material_index]
        assert used.name == "Pointmorph Points"
        assert all(polygon.use_smooth for polygon in data.polygons)
        kept = attribute(data, "Color"), attribute(data, "velocity")
        expected[frame] = (coordinates(data.vertices), len(data.polygons), *kept)
    bpy.context.view_layer.objects.active = torn
    baked = data_blocks()
    bake(step=4, faces=True, resample=False)  # in place of the first
    assert bpy.context.view_layer.objects.active == player
    assert len(data_blocks()) == len(baked)
    assert is_closed_but_for_the_border(geometry(player, 5))
    bpy.context.view_layer.objects.active = torn
    bake(step=4, faces=True)
    assert len({len(positions) for positions, *_ in expected.values()}) == 3
    written = [kind for kind in FILES if can_write(kind, faces=True)]
    assert written
    for kind in written:
        folder = tmp_path / kind
        bpy.context.view_layer.objects.active = torn
        bake(step=4, faces=True, format=kind, directory=str(folder))
        assert [file.name for file in folder.iterdir()] == [FILES[kind]]
        check_faces(kind, read_back(kind, folder / FILES[kind]), expected)
    assert len(data_blocks()) > len(before)


def check_faces(kind, read, expected):
    """Whether a file has the positions, faces, colors and velocities of every frame."""
    for frame, (positions, faces, colors, velocities) in expected.items():
        data = geometry(read, frame)
        np.testing.assert_allclose(coordinates(data.vertices), positions, atol=1e-6)
        assert len(data.polygons) == faces
        np.testing.assert_allclose(attribute(data, "velocity"), RATE * velocities, atol=1e-4)
        back = attribute(data, "Color")
        if kind == "ALEMBIC":
            corners = np.empty(len(data.loops), np.int32)
            data.loops.foreach_get("vertex_index", corners)
            colors = colors[corners]
        np.testing.assert_allclose(back, colors, atol=0.01 if kind == "ALEMBIC" else 1e-6)


def test_errors_begin_with_the_names_of_the_panel(morphed):
    with pytest.raises(RuntimeError, match="Error: Last: expected a frame after the first, 5"):
        bpy.ops.pointmorph.bake_frames(frame_start=5, frame_end=5)
    with pytest.raises(RuntimeError, match="Error: Folder: expected a folder beside"):
        bpy.ops.pointmorph.bake_frames(format="PLY", directory="//", frame_end=3)


@pytest.mark.makes_faces
def test_faces_beside_ply_points_and_without_the_library(torn, tmp_path, monkeypatch):
    if surfaces.is_available():
        bake(step=8, faces=True, format="PLY", directory=str(tmp_path))
        mesh = formats.read(tmp_path / "mesh_0001.ply")
        assert mesh.faces is not None
        assert (tmp_path / "frame_0009.ply").exists()
        monkeypatch.setitem(sys.modules, "pymeshlab", None)
    before = data_blocks()
    for kind in ("ALEMBIC", "PLY"):
        with pytest.raises(RuntimeError, match="packages pymeshlab and scipy"):
            bake(faces=True, format=kind, directory=str(tmp_path))
    assert data_blocks() == before


def test_a_folder_beside_a_file_that_was_never_saved_is_refused(torn):
    assert not bpy.data.filepath
    with pytest.raises(RuntimeError, match="Save the file, or choose another folder"):
        bake(step=8, format="PLY", directory="//frames")


def test_a_file_that_cannot_be_written_leaves_the_frames_for_another_try(torn, tmp_path):
    kind = next((kind for kind in FILES if can_write(kind, faces=False)), None)
    if kind is None:
        pytest.skip("this Blender writes neither")
    (tmp_path / FILES[kind]).mkdir()
    (tmp_path / FILES[kind] / "full").touch()
    before = data_blocks()
    with pytest.raises(RuntimeError, match="can be written"):
        bake(format=kind, directory=str(tmp_path))
    store = tmp_path / f"{FILES[kind]}.frames"
    assert {file.name for file in tmp_path.iterdir()} == {FILES[kind], store.name}
    assert len(list(store.glob("*.npz"))) == 9
    assert not {name for name in data_blocks() ^ before if "Pointmorph" not in str(name)}
    (tmp_path / FILES[kind] / "full").unlink()
    (tmp_path / FILES[kind]).rmdir()
    bake(format=kind, directory=str(tmp_path))
    assert [file.name for file in tmp_path.iterdir()] == [FILES[kind]]


def test_what_cannot_be_baked_says_so(morphed, tmp_path):
    _, _, obj = morphed
    before = data_blocks()
    with pytest.raises(RuntimeError, match="after the first"):
        bpy.ops.pointmorph.bake_frames(frame_start=5, frame_end=5)
    (tmp_path / "file").touch()
    with pytest.raises(RuntimeError, match="folder"):
        bake(format="PLY", directory=str(tmp_path / "file" / "frames"))
    obj.data.attributes.remove(obj.data.attributes["target_radius"])
    with pytest.raises(RuntimeError, match="target_radius"):
        bake()
    assert data_blocks() == before


def test_a_folder_may_be_beside_the_file():
    """Blender 5 warns of a path that begins with // where a property doesn't say so."""
    operator = bpy.ops.pointmorph.bake_frames.get_rna_type()
    for owner, name in (
        (operator, "directory"),
        (bpy.context.scene.pointmorph.bl_rna, "frames_directory"),
    ):
        assert getattr(owner.properties[name], "is_path_supports_blend_relative", True)
