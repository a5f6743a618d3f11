"""Features mirrored across the X axis of both objects; choices that go with the objects."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from scenes import add_mesh, coordinates, groups, listed, mark, members, pair, patch, row_at


def flat(name, side):
    positions, faces = patch(side)
    positions[:, 2] = 0.2 * positions[:, 0] ** 2
    return name, positions, faces


@pytest.fixture
def sheets(addon, settings):
    """Two symmetric sheets, one of them turned and moved in the world."""
    source, target = (add_mesh(*sheet) for sheet in (flat("Hill", 21), flat("Dune", 25)))
    settings.source, settings.target = source, target
    target.location, target.rotation_euler.z = (4, 1, 0), 0.7
    bpy.context.view_layer.update()
    return source, target


def put(addon, sheets, name, x, y):
    for obj in sheets:
        mark(obj, name, x, y)
    addon("data.feature_list").sync_features(bpy.context.scene)
    settings = bpy.context.scene.pointmorph
    settings.active_feature = settings.features.find(name)


def place(obj, name):
    (row,) = groups(obj)[f"pm.{name}"]
    return coordinates(obj.data.vertices)[row]


@pytest.mark.parametrize(
    ("name", "x", "both"),
    [
        ("ear.L", 0.5, ("ear.L", "ear.R")),
        ("Left paw", -0.5, ("Left paw", "Right paw")),
        ("ear", 0.5, ("ear.L", "ear.R")),
        ("ear", -0.5, ("ear.R", "ear.L")),
    ],
)
def test_a_point_is_mirrored_on_both(addon, settings, sheets, name, x, both):
    put(addon, sheets, name, x, 0.3)
    wanted = [place(obj, name) * (-1, 1, 1) for obj in sheets]
    settings.features[name].hold = "SOFT"
    assert bpy.ops.pointmorph.mirror_features() == {"FINISHED"}
    assert sorted(listed(settings)) == sorted((one, True, True) for one in both)
    for obj, mirrored in zip(sheets, wanted, strict=True):
        assert np.linalg.norm(place(obj, both[1]) - mirrored) < 0.06
    assert settings.features[both[1]].hold == "SOFT"
    # Once more, it is put where it belongs again, and is one feature still.
    settings.active_feature = settings.features.find(both[0])
    assert bpy.ops.pointmorph.mirror_features() == {"FINISHED"}
    assert len(settings.features) == 2


def test_regions_keep_their_weights(addon, settings, sheets):
    for obj in sheets:
        positions = coordinates(obj.data.vertices)
        rows = [row_at(positions, x, 0.4) for x in (0.3, 0.5, 0.7)]
        group = obj.vertex_groups.new(name="pm.cheek.L")
        for row, weight in zip(rows, (0.25, 1.0, 0.5), strict=True):
            group.add([row], weight, "REPLACE")
    addon("data.feature_list").sync_features(bpy.context.scene)
    assert bpy.ops.pointmorph.mirror_features() == {"FINISHED"}
    for obj in sheets:
        found = members(obj, obj.vertex_groups["pm.cheek.R"].index)
        assert sorted(found.values()) == [0.25, 0.5, 1.0]
        positions = coordinates(obj.data.vertices)
        assert all(positions[row][0] < -0.2 for row in found)


def test_all_but_what_lies_in_the_middle_or_is_there(addon, settings, sheets):
    for name, x in (("nose", 0.0), ("ear.L", 0.5), ("eye.L", 0.3), ("eye.R", -0.3)):
        put(addon, sheets, name, x, 0.2)
    assert bpy.ops.pointmorph.mirror_features(all_features=True) == {"FINISHED"}
    assert sorted(name for name, *_ in listed(settings)) == [
        "ear.L",
        "ear.R",
        "eye.L",
        "eye.R",
        "nose",
    ]


def test_where_there_is_no_other_side_it_says_so(addon, settings, sheets):
    put(addon, sheets, "ear", 0.9, 0.3)
    mesh = sheets[0].data
    positions = coordinates(mesh.vertices)
    positions[positions[:, 0] < 0, 0] *= 0.1
    mesh.vertices.foreach_set("co", positions.ravel())
    with pytest.raises(RuntimeError, match="isn't symmetric"):
        bpy.ops.pointmorph.mirror_features()
    assert [name for name, *_ in listed(settings)] == ["ear"]


def refusal(**options):
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.pointmorph.mirror_features(**options)
    return str(caught.value)


def test_each_refusal_has_its_own_words(addon, settings, sheets, capfd):
    put(addon, sheets, "nose", 0.0, 0.2)
    assert bpy.ops.pointmorph.mirror_features() == {"CANCELLED"}
    assert bpy.ops.pointmorph.mirror_features(all_features=True) == {"CANCELLED"}
    row = row_at(coordinates(sheets[1].data.vertices), 0.4, 0.2)
    addon("scene.feature_marks").mark(sheets[1], "nose", [row])
    assert 'one in the middle of "Hill" only' in refusal()
    assert [name for name, *_ in listed(settings)] == ["nose"]

    group = sheets[0].vertex_groups["pm.nose"]
    group.remove(list(range(len(sheets[0].data.vertices))))
    assert 'expected marked points on "Hill"' in refusal()
    said = capfd.readouterr().out
    assert 'Nothing to mirror: "nose" lies in the middle' in said
    assert "Nothing to mirror: every feature with a side in its name" in said


def test_a_mark_that_is_replaced_is_told_of(addon, settings, sheets, capfd):
    for name, x in (("ear.R", -0.2), ("ear.L", 0.5)):
        put(addon, sheets, name, x, 0.3)
    wanted = [place(obj, "ear.L") * (-1, 1, 1) for obj in sheets]
    assert bpy.ops.pointmorph.mirror_features() == {"FINISHED"}
    for obj, mirrored in zip(sheets, wanted, strict=True):
        assert np.linalg.norm(place(obj, "ear.R") - mirrored) < 0.06
    assert '"ear.R" was marked on "Hill" and "Dune" before' in capfd.readouterr().out


def test_choices_go_with_the_objects(addon, settings, sheets):
    put(addon, sheets, "ear", 0.5, 0.3)
    settings.features["ear"].kind, settings.features["ear"].weight = "REGION", 2.5
    settings.features["ear"].use = False
    sync = addon("data.feature_list").sync_features
    # In another scene, nothing is known but what the objects have.
    scene = bpy.data.scenes.new("Another")
    for obj in sheets:
        scene.collection.objects.link(obj)
    other = scene.pointmorph
    other.source, other.target = sheets
    sync(scene)
    found = other.features["ear"]
    assert (found.kind, found.hold, found.weight, found.use) == ("REGION", "AUTO", 2.5, False)

    settings.features["ear"].name = "ohr"
    assert [kept.name for kept in sheets[0].pointmorph.choices] == ["ohr"]
    assert bpy.ops.pointmorph.remove_feature(name="ohr") == {"FINISHED"}
    assert not sheets[0].pointmorph.choices
    put(addon, sheets, "ohr", 0.5, 0.3)
    assert settings.features["ohr"].kind == "AUTO"


def test_the_view_turns_to_a_feature(addon):
    class View:
        view_perspective, view_location, view_rotation = "CAMERA", None, None

    view = View()
    place, normal = Vector((1, 2, 3)), Vector((1.0, -2.0, 0.5))
    addon("operators.features").look_at(view, place, normal)
    assert view.view_perspective == "PERSP"
    assert view.view_location == place
    to_viewer = view.view_rotation @ Vector((0, 0, 1))
    assert (to_viewer - normal.normalized()).length < 1e-6
    up = view.view_rotation @ Vector((0, 1, 0))
    assert up.z > 0


def test_a_click_takes_a_vertex_of_the_face_under_it(addon, settings):
    """The nearest vertex in space may be of another sheet, right behind."""
    front = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    behind = [(0.1, 0.1, -0.01), (0.3, 0.1, -0.01), (0.2, 0.3, -0.01)]
    obj = add_mesh("Sheets", front + behind, [(0, 1, 2), (0, 2, 3), (4, 5, 6)])
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    _, row = addon("view.click_targets").nearest_on_surface(
        obj, Vector((0.2, 0.25, 5)), Vector((0, 0, -1)), depsgraph
    )
    assert row == 2


@pytest.mark.parametrize("is_perspective", [False, True])
def test_what_lies_behind_a_face_is_covered(addon, settings, is_perspective):
    front = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    behind = [(0.1, 0.1, -0.5), (3, 0.1, -0.5), (0.2, 0.3, -0.5)]
    settings.source = add_mesh("Sheets", front + behind, [(0, 1, 2), (0, 2, 3), (4, 5, 6)])
    settings.target = add_mesh("Other", [(0, 0, -9), (1, 0, -9), (0, 1, -9)], [(0, 1, 2)])
    bpy.context.view_layer.update()
    from_above = Matrix.Translation((0, 0, -5))
    view = SimpleNamespace(view_matrix=from_above, is_perspective=is_perspective)
    area = SimpleNamespace(spaces=SimpleNamespace(active=None))
    is_covered = addon("view.click_targets").is_covered
    found = [is_covered(bpy.context, area, view, Vector(place)) for place in front + behind]
    assert found == [False, False, False, False, True, False, True]


def test_suggestions_leave_marked_places_alone(addon, settings):
    computation = addon("core.computation")
    source, _ = pair()
    positions = coordinates(source.data.vertices)
    row = row_at(positions, 0.5, 0.5)
    marks = addon("core.features").Marks("vertex group", {"half": (np.array([row]), np.ones(1))})
    shape = computation.Shape("Hill", positions, None, None, None, None, marks)
    known = addon("operators.features")._MarkedPlaces(shape)
    assert known.has(row)
    assert not known.has(row_at(positions, -0.5, -0.5))
    bare = computation.Shape(
        "Hill", positions, None, None, None, None, addon("core.features").Marks("none")
    )
    assert not addon("operators.features")._MarkedPlaces(bare).has(row)
