"""Shape keys on the source mesh and on the pairs."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_mesh,
    add_object,
    attribute,
    baked_frames,
    coordinates,
    data_blocks,
    error_of,
    key,
    mark,
    morph,
    pair,
    patch,
    row_pairs,
    select,
)

pytestmark = pytest.mark.interface


def names(obj):
    return [k.name for k in obj.data.shape_keys.key_blocks]


def bake(**options):
    return bpy.ops.pointmorph.bake_shape_keys(**options)


def landing_by_row(obj, count):
    result = np.full((count, 3), np.nan, np.float32)
    result[row_pairs(obj)[:, 0]] = attribute(obj.data, "landing")
    assert np.isfinite(result).all()
    return result


def test_one_key_on_the_source(settings):
    source, target = pair(24, 19, "auto")
    obj = morph()
    before = coordinates(source.data.vertices)
    faces = [tuple(p.vertices) for p in source.data.polygons]
    assert bake(kind="SOURCE", steps=1) == {"FINISHED"}
    assert names(source) == ["Basis", "Dune"]
    assert np.array_equal(key(source, "Basis"), before)
    assert np.array_equal(key(source, "Dune"), landing_by_row(obj, len(before)))
    assert [tuple(p.vertices) for p in source.data.polygons] == faces
    assert source.active_shape_key.name == "Dune"

    # It looks like the target: every vertex lies on its surface.
    source.data.shape_keys.key_blocks["Dune"].value = 1
    shown = source.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    distances = [(v.co - target.closest_point_on_mesh(v.co)[1]).length for v in shown.vertices]
    spacing = 2 / 18
    assert np.mean(distances) < 0.05 * spacing
    assert max(distances) < 0.5 * spacing


def test_source_is_the_default(morphed):
    source, *_ = morphed
    bake()
    assert names(source) == ["Basis", "Dune"]


@pytest.mark.parametrize("kind", ["SOURCE", "PAIRS"])
def test_steps(morphed, kind):
    source, _, obj = morphed
    changed = source if kind == "SOURCE" else obj
    bake(kind=kind, steps=4)
    first = [] if kind == "SOURCE" else ["Morph"]
    assert names(changed) == ["Basis", *first, "Dune 25 %", "Dune 50 %", "Dune 75 %", "Dune"]
    start, end = key(changed, "Basis"), key(changed, "Dune")
    for percent in (25, 50, 75):
        t = percent / 100
        np.testing.assert_allclose(
            key(changed, f"Dune {percent} %"), (1 - t) * start + t * end, atol=1e-6
        )


@pytest.mark.parametrize("kind", ["SOURCE", "PAIRS"])
def test_a_turned_target_does_not_shrink_on_the_way(settings, kind):
    for name, turn in (("Hill", 0.0), ("Dune", 2.0)):
        obj = add_mesh(name, *patch(20))
        obj.matrix_world = Matrix.Rotation(turn, 4, "X")
        for number, (x, y) in enumerate([(0, 0), (0.8, 0.7), (-0.9, 0.4), (-0.6, -0.8), (0.7, -1)]):
            mark(obj, str(number), x, y)
    settings.source, settings.target = bpy.data.objects["Hill"], bpy.data.objects["Dune"]
    bpy.ops.pointmorph.morph()
    changed = settings.source if kind == "SOURCE" else bpy.context.view_layer.objects.active

    def size(step):
        rows = key(changed, step)
        return np.linalg.norm(rows - rows.mean(axis=0))

    bake(kind=kind, steps=2, path="LINEAR")
    assert size("Dune 50 %") < 0.9 * size("Basis")
    settings.path = "rigid"
    bake(kind=kind, steps=2)
    assert size("Dune 50 %.001") == pytest.approx(size("Basis"), rel=0.02)
    np.testing.assert_array_equal(key(changed, "Dune.001"), key(changed, "Dune"))


def test_the_published_method_goes_straight_in_bakes_too(settings):
    source, target = pair()
    target.rotation_euler = (2.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    settings.method, settings.path = "paper", "auto"
    obj = morph()
    settings.method = "auto"  # for the next morph
    bake(kind="SOURCE", steps=2)
    bake(kind="PAIRS", steps=2)

    def check(changed):
        middle = (key(changed, "Basis") + key(changed, "Dune")) / 2
        np.testing.assert_allclose(key(changed, "Dune 50 %"), middle, atol=1e-6)

    check(source)
    check(obj)
    settings.method = "paper"
    source.data.shape_keys.reference_key.data[0].co.z += 0.1
    source.data.vertices[0].co.z += 0.1
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    check(obj)
    settings.method = "auto"
    assert bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3, resample=False) == {
        "FINISHED"
    }
    frames = baked_frames(bpy.context.view_layer.objects.active)
    middle = (key(obj, "Basis") + key(obj, "Dune")) / 2
    np.testing.assert_allclose(frames[1]["position"], middle, atol=1e-5)


def test_pairs_end_at_the_target(morphed):
    _, target, obj = morphed
    bake(kind="PAIRS")
    assert names(obj) == ["Basis", "Morph", "Dune"]
    ends = coordinates(target.data.vertices)[row_pairs(obj)[:, 1]]
    assert np.array_equal(key(obj, "Dune"), ends)


def test_existing_keys_are_kept(settings):
    source, _ = pair()
    source.shape_key_add(name="Rest")
    smile = source.shape_key_add(name="Smile")
    smile.value = 0.5
    for point in smile.data:
        point.co.z += 1
    kept = {name: key(source, name) for name in ("Rest", "Smile")}
    source.pointmorph.keep_modifiers = True
    bpy.ops.pointmorph.morph()
    bake(kind="SOURCE", steps=2)
    assert names(source) == ["Rest", "Smile", "Dune 50 %", "Dune"]
    for name, positions in kept.items():
        assert np.array_equal(key(source, name), positions)
    assert source.data.shape_keys.key_blocks["Smile"].value == 0.5
    assert source.data.shape_keys.key_blocks["Dune"].value == 0


def test_a_second_bake_adds_to_the_first(morphed):
    source, *_ = morphed
    bake()
    bake()
    assert names(source) == ["Basis", "Dune", "Dune.001"]


def test_keys_that_have_its_name_already_stay_as_they_are(settings, capfd):
    """Those that are baked get a number, and the user is told their names."""
    source, _ = pair()
    source.shape_key_add(name="Basis")
    own = source.shape_key_add(name="Dune")
    own.value = 0.0
    own.data[0].co.z += 1
    before = key(source, "Dune")
    select(morph())
    bake(steps=4)
    expected = ["Dune 25 %", "Dune 50 %", "Dune 75 %", "Dune.001"]
    assert names(source) == ["Basis", "Dune", *expected]
    np.testing.assert_array_equal(key(source, "Dune"), before)
    said = 'Shape keys added to "Hill": "Dune 25 %" to "Dune.001", 4 in all'
    assert said in capfd.readouterr().out
    bake(steps=1)
    assert 'Shape keys added to "Hill": "Dune.002"' in capfd.readouterr().out
    np.testing.assert_array_equal(key(source, "Dune"), before)


def test_groups_materials_and_modifiers_stay(settings):
    source, _ = pair()
    source.data.materials.append(bpy.data.materials.new("Stone"))
    source.modifiers.new("Finer", "SUBSURF")
    bpy.ops.pointmorph.morph()
    bake()
    assert [m.name for m in source.data.materials] == ["Stone"]
    assert [m.name for m in source.modifiers] == ["Finer"]
    assert [g.name for g in source.vertex_groups] == ["pm.peak", "pm.slope"]


@pytest.mark.parametrize("moved_after", [False, True])
def test_transforms(settings, moved_after):
    """The key is in the source's own space, and stays right when the source moves on."""
    source, target = pair()
    rotation = Matrix.Rotation(1, 3, (1, 2, 0)).to_quaternion()
    source.matrix_world = Matrix.LocRotScale((5, 6, 7), rotation, (2, -1, 0.5))
    target.location = (4, 6, 8)
    obj = morph()
    bpy.context.view_layer.update()
    matrix = source.matrix_world.copy()
    if moved_after:
        source.matrix_world = Matrix.Translation((9, 9, 9))
    bake()
    here = np.array([matrix @ v.co for v in source.data.shape_keys.key_blocks["Dune"].data])
    there = landing_by_row(obj, len(here)) + np.array(obj.location)
    np.testing.assert_allclose(here, there, atol=1e-5)


def test_after_save_and_load(morphed, tmp_path):
    source, _, obj = morphed
    landing = landing_by_row(obj, len(source.data.vertices))
    path = str(tmp_path / "morph.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    bake(kind="SOURCE")
    bake(kind="PAIRS", steps=2)
    assert np.array_equal(key(bpy.data.objects["Hill"], "Dune"), landing)
    assert names(bpy.data.objects["Hill to Dune"])[2:] == ["Dune 50 %", "Dune"]


def test_the_morph_object_is_found_when_something_else_is_active(morphed):
    source, *_ = morphed
    select(source)
    bake()
    assert names(source) == ["Basis", "Dune"]


def test_keys_of_other_vertices_than_the_mesh_has_are_said(settings):
    source, _ = pair()
    source.shape_key_add(name="Basis")
    source.data.clear_geometry()  # a script that leaves the keys behind
    positions, faces = patch(13)
    source.data.from_pydata(positions.tolist(), [], faces.tolist())
    source.vertex_groups.clear()
    mark(source, "peak", 0, 0)
    mark(source, "slope", 0.5, 0.3)
    assert "shape keys for its 169 vertices" in error_of(bpy.ops.pointmorph.morph)
    source.shape_key_clear()
    select(morph())
    source.shape_key_add(name="Basis")
    source.data.clear_geometry()
    source.data.from_pydata(patch(12)[0].tolist(), [], [])
    error_of(bpy.ops.pointmorph.bake_shape_keys)


def test_keys_can_be_undone(morphed):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.pointmorph.bake_shape_keys("EXEC_DEFAULT", True, kind="SOURCE", steps=3)
    assert len(names(bpy.data.objects["Hill"])) == 4
    bpy.ops.ed.undo()
    assert bpy.data.objects["Hill"].data.shape_keys is None


# --- Errors ---------------------------------------------------------------------------------------


def refused(kind="SOURCE"):
    return error_of(bake, kind=kind)


def test_before_a_morph(settings):
    pair()
    assert "Morph first" in refused()


def test_the_source_changed(morphed):
    source, *_ = morphed
    source.data.vertices[7].co.z += 0.1
    assert 'Hill: expected the vertices that "Hill to Dune" was made from' in refused()
    assert "Recompute the morph" in refused()


def test_the_source_has_more_vertices(morphed):
    source, *_ = morphed
    source.data.vertices.add(1)
    assert 'Hill: expected the vertices that "Hill to Dune" was made from' in refused()


def test_the_source_is_gone(morphed):
    source, *_ = morphed
    bpy.data.objects.remove(source)
    assert "Hill to Dune: expected its source in this file" in refused()
    bake(kind="PAIRS")


def test_the_source_is_in_no_collection(morphed):
    """As after a deletion in the viewport, or when it only came along with an appended morph."""
    source, *_ = morphed
    bpy.context.scene.collection.objects.unlink(source)
    said = refused()
    assert 'Hill to Dune: expected its source in this file, found "Hill" in no collection' in said
    assert "drag it into a collection" in said


def test_the_source_is_edited(morphed):
    source, *_ = morphed
    select(source)
    bpy.ops.object.mode_set(mode="EDIT")
    assert "Hill: expected an object in Object Mode" in refused()


def test_the_morph_key_is_gone(morphed):
    _, _, obj = morphed
    obj.shape_key_clear()
    for kind in ("SOURCE", "PAIRS"):
        assert 'expected a morph object with its shape key "Morph"' in refused(kind)


def test_keys_of_a_copy_are_told_of(settings, capfd):
    source, _ = pair()
    source.modifiers.new("Bend", "CAST").factor = 0.5
    morph()
    bake(kind="SOURCE", steps=1)
    copy = bpy.data.objects["Hill as Shown"]
    assert names(copy) == ["Basis", "Dune"]
    assert not copy.hide_get()
    assert source.hide_get()
    assert source.data.shape_keys is None
    assert 'For keys on "Hill" itself, choose it' in capfd.readouterr().out


def test_keys_on_hidden_points_are_told_of(settings, capfd):
    settings.show_as = "MESH"
    pair()
    shown = morph()
    bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=2)
    said = capfd.readouterr().out
    added = 'Shape keys added to "Hill to Dune Points": "Dune 50 %", "Dune"'
    assert f"{added}. It is hidden while the mesh" in said
    assert "press Points in the Result panel" in said
    bpy.ops.pointmorph.show_as(kind="POINTS")
    bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=1)
    assert "hidden" not in capfd.readouterr().out
    assert len(shown.data.shape_keys.key_blocks) == 2


@pytest.mark.parametrize("with_keys", [False, True])
def test_an_error_in_the_middle_leaves_nothing(addon, morphed, monkeypatch, with_keys):
    source, *_ = morphed
    if with_keys:
        source.shape_key_add(name="Basis")
        source.shape_key_add(name="Smile")
    before = data_blocks()
    write_key = addon("data.arrays").write_key
    calls = []

    def fail_at_the_third(*arguments):
        calls.append(1)
        if len(calls) == 3:
            raise MemoryError("no memory left")
        write_key(*arguments)

    monkeypatch.setattr(addon("data.arrays"), "write_key", fail_at_the_third)
    with pytest.raises(RuntimeError, match="no memory left"):
        bake(steps=5)
    assert data_blocks() == before
    if with_keys:
        assert names(source) == ["Basis", "Smile"]
    else:
        assert source.data.shape_keys is None


def test_another_active_object_is_no_morph_object(morphed, settings):
    settings.source = None
    select(add_object("Bystander", None))
    assert "make a morph object the active object" in refused()
