"""What models carry: a mesh of the source that morphs, and what comes over from the target."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scenes import (
    add_attribute,
    add_mesh,
    attribute,
    coordinates,
    data_blocks,
    key,
    morph,
    pair,
    patch,
    read,
    row_pairs,
    select,
)

pytestmark = pytest.mark.interface


def dress(obj, seed):
    """Two materials in two slots, one of them the object's own; colours by corner and by point,
    two UV maps, weights, an attribute. Returns nothing: a test reads it where it is."""
    rng = np.random.default_rng(seed)
    mesh = obj.data
    for name in ("Stone", "Moss"):
        mesh.materials.append(bpy.data.materials.new(f"{obj.name} {name}"))
    obj.material_slots[1].link = "OBJECT"
    obj.material_slots[1].material = bpy.data.materials.new(f"{obj.name} own")
    mesh.polygons.foreach_set("material_index", rng.integers(0, 2, len(mesh.polygons)))
    corners, points = len(mesh.loops), len(mesh.vertices)
    for name, domain, count in (("Paint", "CORNER", corners), ("Tint", "POINT", points)):
        add_attribute(mesh, name, "FLOAT_COLOR", rng.uniform(0, 1, (count, 4)), domain)
    mesh.color_attributes.active_color = mesh.color_attributes["Tint"]
    for name in ("UVMap", "Light"):
        layer = mesh.uv_layers.new(name=name)
        layer.data.foreach_set("uv", rng.uniform(0, 1, 2 * corners).astype(np.float32))
    for name in ("bone.L", "bone.R"):
        group = obj.vertex_groups.new(name=name)
        for row in rng.choice(points, points // 2, replace=False).tolist():
            group.add([row], float(rng.uniform(0.1, 1)), "REPLACE")
    add_attribute(mesh, "mass", "FLOAT", rng.uniform(0, 1, points))


def belongings(obj):
    """All of that, to compare."""
    mesh = obj.data
    groups = {group.index: group.name for group in obj.vertex_groups}
    return {
        "faces": [tuple(p.vertices) for p in mesh.polygons],
        "materials": [slot.material.name for slot in obj.material_slots],
        "slots": [slot.link for slot in obj.material_slots],
        "indices": [p.material_index for p in mesh.polygons],
        "colors": {
            item.name: (item.domain, attribute(mesh, item.name).tolist())
            for item in mesh.color_attributes
        },
        "active": mesh.color_attributes.active_color.name,
        "uvs": {layer.name: read(layer.data, "uv", 2).tolist() for layer in mesh.uv_layers},
        "groups": [group.name for group in obj.vertex_groups],
        "weights": [
            sorted((groups[e.group], e.weight) for e in vertex.groups) for vertex in mesh.vertices
        ],
        "mass": attribute(mesh, "mass").tolist(),
        "modifiers": [(m.name, m.type) for m in obj.modifiers],
        "matrix": [list(row) for row in obj.matrix_world],
    }


@pytest.fixture
def dressed(settings):
    source, target = pair()
    dress(source, 1)
    dress(target, 2)
    source.modifiers.new("Finer", "SUBSURF")
    source.matrix_world = Matrix.LocRotScale((5, 6, 7), None, (2, -1, 0.5))
    target.location = (5, 6, 7.5)
    return source, target, morph()


def make_mesh(obj):
    select(obj)
    assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}
    bpy.context.view_layer.update()
    return bpy.context.view_layer.objects.active


def test_a_mesh_of_the_source_has_all_that_the_source_has(dressed):
    source, _, obj = dressed
    before = belongings(source)
    copy = make_mesh(obj)
    assert copy.name == "Hill to Dune Mesh"
    own = belongings(copy)
    assert own["modifiers"].pop(0) == ("Path", "NODES")
    assert own == before
    assert belongings(source) == before
    assert source.data.shape_keys is None
    assert copy.data != source.data
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE")
    assert np.array_equal(key(copy, "Basis"), coordinates(source.data.vertices))
    assert np.array_equal(key(copy, "Morph"), key(source, "Dune"))
    assert (copy.pointmorph.state, copy.pointmorph.made_from) == ("CURRENT", obj)


def test_it_morphs_by_its_own_t(dressed):
    _, _, obj = dressed
    copy = make_mesh(obj)
    copy.modifiers.clear()
    t = copy.data.shape_keys.key_blocks["Morph"]
    assert (t.value, t.slider_min, t.slider_max) == (0, 0, 1)
    for frame, value in ((1, 0.0), (11, 1.0)):
        t.value = value
        t.keyframe_insert("value", frame=frame)
    bpy.context.scene.frame_set(6)
    shown = copy.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    middle = (key(copy, "Basis") + key(copy, "Morph")) / 2
    np.testing.assert_allclose(coordinates(shown.vertices), middle, atol=1e-6)
    assert obj.data.shape_keys.key_blocks["Morph"].value == 0


def test_existing_keys_of_the_source_stay(settings):
    source, _ = pair()
    source.shape_key_add(name="Basis")
    for name in ("Smile", "Morph"):
        added = source.shape_key_add(name=name)
        added.value = 0.0  # Blender 5 begins with 1
        for point in added.data:
            point.co.z += 1
    kept = {name: key(source, name) for name in ("Smile", "Morph")}
    copy = make_mesh(morph())
    for name, positions in kept.items():
        assert np.array_equal(key(copy, name), positions)
    assert [k.name for k in copy.data.shape_keys.key_blocks][-1] == "Morph.001"
    assert copy.pointmorph.state == "CURRENT"


@pytest.mark.parametrize("other_faces", [False, True])
@pytest.mark.parametrize("without_pairs", [False, True])
def test_recompute_keeps_name_animation_and_materials(dressed, other_faces, without_pairs):
    source, target, obj = dressed
    copy = make_mesh(obj)
    copy.name = "Mine"
    t = copy.data.shape_keys.key_blocks["Morph"]
    for frame, value in ((1, 0.0), (11, 1.0)):
        t.value = value
        t.keyframe_insert("value", frame=frame)
    copy.data.materials[0] = bpy.data.materials.new("Gold")
    own = copy.shape_key_add(name="Own", from_mix=False)
    own.value = 0.0
    for point in own.data:
        point.co.z += 3
    identity = (copy.as_pointer(), copy.data.as_pointer(), copy.data.shape_keys.as_pointer())
    if other_faces:
        positions, faces = patch(17)
        mesh = bpy.data.meshes.new("Finer")
        mesh.from_pydata(positions.tolist(), [], faces.tolist())
        for material in source.data.materials:
            mesh.materials.append(material)
        source.data = mesh
        source.vertex_groups.clear()
        target.vertex_groups.clear()
        dress(source, 5)
        for _ in range(2):
            source.data.materials.pop()
    else:
        for vertex in source.data.vertices:
            vertex.co.z += 0.25
    source.data.update()
    assert copy.pointmorph.state == "STALE"
    if without_pairs:
        bpy.data.objects.remove(obj)
        obj = None
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.shape_keys)
    count = [len(kind) for kind in kinds]
    select(copy)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    # Points that are gone are made again.
    assert [len(kind) - without_pairs for kind in kinds] == count
    assert identity == (
        copy.as_pointer(),
        copy.data.as_pointer(),
        copy.data.shape_keys.as_pointer(),
    )
    assert copy.name == "Mine"
    assert copy.pointmorph.state == "CURRENT"
    now, wanted = belongings(copy), belongings(source)
    for name in ("faces", "indices", "colors", "uvs", "weights", "groups", "mass", "active"):
        assert now[name] == wanted[name], name
    assert copy.data.materials[0].name == "Gold"
    start = coordinates(source.data.vertices)
    assert np.array_equal(key(copy, "Basis"), start)
    offset = 0 if other_faces else 3
    np.testing.assert_allclose(key(copy, "Own"), start + (0, 0, offset), atol=1e-6)
    fresh = make_mesh(morph(new_result=True))
    assert np.array_equal(key(copy, "Morph"), key(fresh, "Morph"))
    copy.modifiers.clear()
    bpy.context.scene.frame_set(11)
    shown = copy.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    np.testing.assert_allclose(coordinates(shown.vertices), key(copy, "Morph"), atol=1e-6)


def test_a_linked_duplicate_shares_what_is_made_again(dressed):
    _, target, obj = dressed
    copy = make_mesh(obj)
    bpy.ops.object.duplicate(linked=True)
    twin = bpy.context.view_layer.objects.active
    assert twin.data == copy.data
    for vertex in target.data.vertices:
        vertex.co.z += 1
    for made in (None, obj):
        if made is not None:
            bpy.data.objects.remove(made)
            target.data.vertices[0].co.z += 0.1
        select(twin)
        bpy.ops.pointmorph.recompute()
        assert twin.pointmorph.state == copy.pointmorph.state == "CURRENT"
        assert twin.data == copy.data


def test_a_recompute_of_the_morph_takes_its_meshes_along(dressed):
    _, target, obj = dressed
    copy = make_mesh(obj)
    before = key(copy, "Morph")
    for vertex in target.data.vertices:
        vertex.co.z += 1
    select(obj)
    bpy.ops.pointmorph.recompute()
    assert copy.pointmorph.state == "CURRENT"
    assert not np.array_equal(key(copy, "Morph"), before)


def test_what_cannot_follow_a_recompute_is_named(dressed, capfd):
    source, _, obj = dressed
    copy = make_mesh(obj)
    before = key(copy, "Morph")
    select(obj)
    bpy.ops.pointmorph.transfer_attributes()
    bpy.data.objects.remove(source)
    bpy.ops.pointmorph.recompute()
    said = capfd.readouterr().out
    assert '"Hill" no longer exists' in said
    assert '"Hill to Dune Mesh" was left unchanged' in said
    assert np.array_equal(key(copy, "Morph"), before)


def test_refusals(settings):
    pair()
    obj = morph()
    copy = make_mesh(obj)
    with pytest.raises(RuntimeError, match="Make the morph object the active object"):
        bpy.ops.pointmorph.make_mesh()
    select(obj)
    before = data_blocks()
    with pytest.raises(RuntimeError, match="Dune: expected any of the chosen attributes"):
        bpy.ops.pointmorph.transfer_attributes()
    settings.source.data.vertices[0].co.z += 1
    with pytest.raises(RuntimeError, match="Hill: expected the vertices .* edited"):
        bpy.ops.pointmorph.make_mesh()
    assert data_blocks() == before
    bpy.data.objects.remove(settings.target)
    with pytest.raises(RuntimeError, match="expected its target in this file"):
        bpy.ops.pointmorph.transfer_attributes()
    bpy.data.objects.remove(obj)
    select(copy)
    with pytest.raises(RuntimeError, match='found no "Dune"'):
        bpy.ops.pointmorph.recompute()


# --- From the target ------------------------------------------------------------------------------


def weights_of(obj, name):
    index = obj.vertex_groups[name].index
    return np.array(
        [
            next((e.weight for e in vertex.groups if e.group == index), 0.0)
            for vertex in obj.data.vertices
        ]
    )


def test_onto_the_pairs_value_by_value(dressed):
    _, target, obj = dressed
    assert bpy.ops.pointmorph.transfer_attributes(uvs=True) == {"FINISHED"}
    rows = row_pairs(obj)[:, 1]
    assert np.array_equal(attribute(obj.data, "target.Tint"), attribute(target.data, "Tint")[rows])
    corners = np.array([loop.vertex_index for loop in target.data.loops])
    paint = attribute(target.data, "Paint")
    mean = np.stack([np.bincount(corners, c) for c in paint.T], axis=1)
    mean /= np.bincount(corners)[:, None]
    np.testing.assert_allclose(attribute(obj.data, "target.Paint"), mean[rows], atol=1e-6)
    for name in ("bone.L", "bone.R"):
        np.testing.assert_allclose(
            weights_of(obj, f"target.{name}"), weights_of(target, name)[rows], atol=1e-6
        )
    uv = read(target.data.uv_layers["Light"].data, "uv", 2)
    found = read(obj.data.attributes["target.Light"].data, "vector", 2)
    for row, value in zip(rows, found, strict=True):
        assert (np.abs(uv[corners == row] - value).max(axis=1) < 1e-6).any()
    assert "pm.peak" not in [g.name.removeprefix("target.") for g in obj.vertex_groups]


def by_place(target, function):
    """Writes colours, a weight and UVs that are linear over the sheet, so that what must come over
    is known everywhere. Returns the expected values at world places."""
    places = coordinates(target.data.vertices)
    values = function(places)
    add_attribute(
        target.data, "Ramp", "FLOAT_COLOR", np.column_stack([values, np.ones(len(values))])
    )
    target.data.color_attributes.active_color = target.data.color_attributes["Ramp"]
    group = target.vertex_groups.new(name="ramp")
    for row, value in enumerate(values[:, 0]):
        group.add([row], float(value), "REPLACE")
    layer = target.data.uv_layers.new(name="Ramp UV")
    corners = [loop.vertex_index for loop in target.data.loops]
    layer.data.foreach_set("uv", values[corners, :2].astype(np.float32).reshape(-1))


def ramp(places):
    return np.clip(0.5 + 0.25 * places + [[0, 0.1, 0]], 0, 1)


@pytest.mark.parametrize("pairs_gone", [False, True])
def test_onto_a_mesh_of_the_source_along_the_map(settings, pairs_gone):
    """A linear function of the place is the same at the place where a vertex lands."""
    source, target = pair()
    by_place(target, ramp)
    source.matrix_world = Matrix.LocRotScale((1, 0, 0), None, (2, 1, 0.5))
    target.matrix_world = Matrix.LocRotScale(
        (1.5, 0, 0), Matrix.Rotation(1, 3, "Z").to_quaternion(), None
    )
    obj = morph()
    copy = make_mesh(obj)
    if pairs_gone:
        bpy.data.objects.remove(obj)
    select(copy)
    bpy.ops.pointmorph.transfer_attributes(uvs=True)
    landing = key(copy, "Morph")
    world = landing @ np.array(copy.matrix_world.to_3x3()).T + np.array(copy.location)
    back = np.array(target.matrix_world.inverted())
    own = world @ back[:3, :3].T + back[:3, 3]
    # The landing lies a little off the facets; the nearest place on them counts.
    own = np.array([target.closest_point_on_mesh(place)[1] for place in own.tolist()])
    expected = ramp(own)
    np.testing.assert_allclose(attribute(copy.data, "target.Ramp")[:, :3], expected, atol=2e-5)
    np.testing.assert_allclose(weights_of(copy, "target.ramp"), expected[:, 0], atol=2e-5)
    found = read(copy.data.uv_layers["target.Ramp UV"].data, "uv", 2)
    corners = [loop.vertex_index for loop in copy.data.loops]
    np.testing.assert_allclose(found, expected[corners, :2], atol=2e-5)


@pytest.mark.parametrize("domain", ["POINT", "CORNER", None])
def test_colors_go_over_with_t(settings, domain):
    source, target = pair()
    by_place(target, ramp)
    if domain is not None:
        count = len(source.data.vertices if domain == "POINT" else source.data.loops)
        values = np.random.default_rng(4).uniform(0, 1, (count, 4))
        add_attribute(source.data, "Skin", "FLOAT_COLOR", values, domain)
        source.data.color_attributes.active_color = source.data.color_attributes["Skin"]
    copy = make_mesh(morph())
    bpy.ops.pointmorph.transfer_attributes(weights=False)
    name = "Skin" if domain else "Color"
    start = attribute(copy.data, name)
    end = attribute(copy.data, "target.Ramp")
    corners = np.array([loop.vertex_index for loop in copy.data.loops])
    start = start if domain == "CORNER" else start[corners]
    for t in (0.0, 0.3, 1.0):
        copy.data.shape_keys.key_blocks["Morph"].value = t
        bpy.context.view_layer.update()
        shown = copy.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        np.testing.assert_allclose(
            attribute(shown, name), (1 - t) * start + t * end[corners], atol=1e-6
        )
    # Once more is no error, and a recompute brings over what is there then.
    bpy.ops.pointmorph.transfer_attributes(weights=False)
    assert [m.name for m in copy.modifiers] == ["Path", "Colors"]
    for item in target.data.color_attributes["Ramp"].data:
        item.color = (0, 1, 0, 1)
    bpy.ops.pointmorph.recompute()
    assert np.array_equal(np.unique(attribute(copy.data, "target.Ramp"), axis=0), [(0, 1, 0, 1)])


def test_names_that_are_taken_are_refused(dressed):
    _, _, obj = dressed
    copy = make_mesh(obj)
    before = belongings(copy)
    with pytest.raises(RuntimeError, match='no other color attribute named "Tint"'):
        bpy.ops.pointmorph.transfer_attributes(prefix="")
    assert belongings(copy) == before


def test_a_target_with_other_points_by_now(dressed):
    _, target, _ = dressed
    mesh = add_mesh("Other", *patch(9)).data
    target.data = mesh
    add_attribute(mesh, "Col", "FLOAT_COLOR", np.ones((81, 4)))
    with pytest.raises(RuntimeError, match="Dune: expected the 100 points .* found 81"):
        bpy.ops.pointmorph.transfer_attributes()
