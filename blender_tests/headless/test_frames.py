"""Frames in the scene and in files."""

import bpy
import numpy as np
import pytest
from pointmorph import formats
from scenes import (
    add_mesh,
    attribute,
    coordinates,
    data_blocks,
    pair,
    patch,
    row_pairs,
)


def bake(**options):
    return bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=9, **options)


@pytest.fixture
def morphed(settings):
    """Source, target and morph object, which is active."""
    source, target = pair()
    bpy.ops.pointmorph.morph()
    return source, target, bpy.context.view_layer.objects.active


@pytest.fixture
def torn(settings):
    """A sheet whose right half drifts away: frames between the ends have a crack."""
    positions, faces = patch(24, bump=0.0)
    apart = positions + np.where(positions[:, :1] > 0, [[0.6, 0, 0]], 0.0).astype(np.float32)
    settings.source = add_mesh("Whole", positions, faces)
    settings.target = add_mesh("Torn", apart)
    for number in range(0, len(positions), 40):
        for obj in (settings.source, settings.target):
            group = obj.vertex_groups.new(name=f"pm.{number}")
            group.add([number], 1.0, "REPLACE")
    bpy.ops.pointmorph.morph()
    return bpy.context.view_layer.objects.active


def shown(obj, frame):
    """Positions, radii and colours that an object shows at a frame as points."""
    bpy.context.scene.frame_set(frame)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    data = obj.evaluated_get(depsgraph).data
    assert type(data).__name__ == "PointCloud"
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
    depsgraph = bpy.context.evaluated_depsgraph_get()
    positions = shown(player, 5)[0]
    data = player.evaluated_get(depsgraph).data
    ids, velocities = attribute(data, "id"), attribute(data, "velocity")
    later = shown(player, 6)[0]
    later_ids = attribute(player.evaluated_get(depsgraph).data, "id")
    _, here, there = np.intersect1d(ids, later_ids, return_indices=True)
    assert len(here) > counts[0]
    np.testing.assert_allclose(later[there] - positions[here], velocities[here], atol=0.02)


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


def test_alembic_and_usd(torn, tmp_path):
    before = data_blocks()
    if "alembic_export" in dir(bpy.ops.wm):
        assert bake(format="ALEMBIC", directory=str(tmp_path)) == {"FINISHED"}
        file = tmp_path / "Whole_to_Torn.abc"
        assert file.stat().st_size > 9 * 12 * len(torn.data.vertices)
    else:  # as Debian builds it
        with pytest.raises(RuntimeError, match="Alembic"):
            bake(format="ALEMBIC", directory=str(tmp_path))
    if bpy.app.version < (4, 5, 0):
        with pytest.raises(RuntimeError, match="Blender 4.5"):
            bake(format="USD", directory=str(tmp_path))
    else:
        assert bake(format="USD", directory=str(tmp_path)) == {"FINISHED"}
        assert (tmp_path / "Whole_to_Torn.usdc").stat().st_size > 10000
    left = {name for name in data_blocks() ^ before if "Pointmorph" not in str(name)}
    assert not left
    assert not list(tmp_path.glob("*part*"))


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
