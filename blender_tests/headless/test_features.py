"""Features are vertex groups of the same name on both objects."""

import json
import sys

import bpy
import numpy as np
import pointmorph
import pytest
from scenes import (
    add_group,
    coordinates,
    error_of,
    groups,
    listed,
    mark,
    morph,
    move_vertices,
    pair,
)

# --- The vertex that a group means ----------------------------------------------------------------


def test_the_highest_weight_wins(addon):
    positions = np.arange(30, dtype=np.float32).reshape(10, 3)
    rows = np.array([2, 5, 7])
    assert addon("core.features").feature_row(positions, rows, np.float32([0.2, 0.9, 0.8])) == 5


def test_among_equals_the_nearest_to_the_weighted_centroid_wins(addon):
    positions = np.zeros((6, 3), np.float32)
    positions[:, 0] = [0, 1, 2, 3, 10, 11]
    rows = np.arange(6)
    # The centroid of all is 4.5, of those with weight 1 alone 2.
    weights = np.ones(6, np.float32)
    assert addon("core.features").feature_row(positions, rows, weights) == 3
    weights = np.float32([0, 1, 1, 1, 0, 0])
    assert addon("core.features").feature_row(positions, rows, weights) == 2
    weights = np.float32([0.25, 1, 1, 0, 0, 0])
    assert addon("core.features").feature_row(positions, rows, weights) == 1
    weights = np.float32([0, 1, 1, 0, 0, 0.25])
    assert addon("core.features").feature_row(positions, rows, weights) == 2


def test_both_objects_give_a_row(addon, settings):
    source, target = pair()
    request = addon("scene.panel_request").read_request(bpy.context)
    assert list(request.features) == ["peak", "slope"]
    for name, rows in request.features.items():
        for obj, row in zip((source, target), rows, strict=True):
            assert groups(obj)[f"pm.{name}"] == {row: 1.0}


# --- Errors ---------------------------------------------------------------------------------------


def morph_error():
    return error_of(bpy.ops.pointmorph.morph)


@pytest.mark.parametrize("side", [0, 1])
def test_a_group_on_one_object_only(settings, side):
    objects = pair()
    mark(objects[side], "horn", 0.7, 0.7)
    message = morph_error()
    for part in (f'"{objects[side].name}"', f"{objects[1 - side].name}: expected", '"pm.horn"'):
        assert part in message
    assert f'Mark "horn" on "{objects[1 - side].name}"' in message


@pytest.mark.parametrize("weights", [{}, {3: 0.0, 4: 0.0}])
def test_an_empty_group(settings, weights):
    source, target = pair()
    add_group(source, "pm.horn", weights)
    mark(target, "horn", 0.7, 0.7)
    message = morph_error()
    assert "Hill: expected a point with a weight above 0" in message
    assert 'Mark "horn" on a vertex of "Hill"' in message


def test_two_features_on_one_vertex(settings):
    source, target = pair()
    mark(source, "horn", 0.0, 0.0)  # as "peak"
    mark(target, "horn", 0.7, 0.7)
    message = morph_error()
    assert 'Hill: expected different points for the features "peak" and "horn"' in message
    assert 'Move "horn"' in message


def test_point_clouds_are_told_about_attributes(addon, settings):
    features = addon("core.features")
    marks = features.Marks("point attribute", {"tip": (np.array([], int), np.array([]))})
    shape = type("Shape", (), {"name": "Cloud", "positions": np.zeros((4, 3)), "marks": marks})
    with pytest.raises(pointmorph.FeatureError, match='in the point attribute "pm.tip"'):
        features.match(shape, shape)


# --- Points, curves and regions -------------------------------------------------------------------


def rows_of(side, x):
    """Vertices of a sheet from y = -0.5 to 0.5, joined by edges."""
    column = round((x + 1) / 2 * (side - 1))
    return [column * side + k for k in range(side // 4, side - side // 4)]


def row_of(side, x, y):
    return round((x + 1) / 2 * (side - 1)) * side + round((y + 1) / 2 * (side - 1))


def read_features():
    """The features beside those of `pair`."""
    request_features = read_all()
    return {k: f for k, f in request_features.items() if k not in ("peak", "slope")}


def read_all():
    name = next(n for n in sys.modules if n.endswith(".scene.panel_request"))
    bpy.context.view_layer.update()
    return sys.modules[name].read_request(bpy.context).features


@pytest.fixture
def sheets(settings):
    source, target = pair(24, 19)

    def group(name, source_rows, target_rows):
        for obj, rows in ((source, source_rows), (target, target_rows)):
            if not isinstance(rows, dict):
                rows = dict.fromkeys(rows, 1.0)
            add_group(obj, f"pm.{name}", rows)

    return group


def choose(settings, name, **choice):
    listed(settings)
    item = settings.features[settings.features.find(name)]
    for key, value in choice.items():
        setattr(item, key, value)


def test_one_vertex_is_a_point_and_a_path_a_curve(sheets):
    shuffled = rows_of(24, 0.5)[::-1]
    sheets("tip", [30], [40])
    sheets("ridge", shuffled, rows_of(19, 0.5))
    features = read_features()
    assert features["tip"] == (30, 40)
    ridge = features["ridge"]
    assert (ridge.kind, ridge.closed, bool(ridge.hard)) == ("curve", False, False)
    assert ridge.source == rows_of(24, 0.5)  # in order along the edges
    assert ridge.target == rows_of(19, 0.5)  # and in the same sense, as the objects lie


def test_the_heavier_end_is_the_start(sheets):
    here, there = rows_of(24, 0.5), rows_of(19, 0.5)
    sheets(
        "ridge", {row: 0.5 if row == here[0] else 1.0 for row in here},
        {row: 0.5 if row == there[-1] else 1.0 for row in there},
    )  # fmt: skip
    ridge = read_features()["ridge"]
    assert ridge.source == here[::-1]
    assert ridge.target == there


def ring(side, low, high):
    """Vertices around a square of a sheet, and their order."""
    a, b = low, high
    corners = [(a, k) for k in range(a, b)] + [(k, b) for k in range(a, b)]
    corners += [(b, k) for k in range(b, a, -1)] + [(k, a) for k in range(b, a, -1)]
    return [u * side + v for u, v in corners]


def test_a_closed_path_is_a_closed_curve(sheets):
    here, there = ring(24, 5, 18), ring(19, 4, 14)
    sheets("rim", here, there)
    rim = read_features()["rim"]
    assert rim.closed
    assert sorted(rim.source) == sorted(here)
    # What lies together belongs together: first to first, and the same way round.
    positions = [coordinates(obj.data.vertices) for obj in picked()]
    for share in (0, 0.25, 0.5, 0.75):
        a = positions[0][rim.source[round(share * len(here))]]
        b = positions[1][rim.target[round(share * len(there))]]
        assert np.linalg.norm((a - b)[:2]) < 0.25

    for obj, rows in zip(picked(), (here, there), strict=True):
        obj.vertex_groups["pm.rim"].remove([rows[7], rows[8]])
        obj.vertex_groups["pm.rim"].add([rows[7]], 0.95, "REPLACE")
        obj.vertex_groups["pm.rim"].add([rows[8]], 0.9, "REPLACE")
        others = [row for row in rows if row not in (rows[7], rows[8])]
        obj.vertex_groups["pm.rim"].add(others, 0.5, "REPLACE")
    rim = read_features()["rim"]
    assert rim.source[:2] == [here[7], here[8]]
    assert rim.target[:2] == [there[7], there[8]]


def picked():
    settings = bpy.context.scene.pointmorph
    return settings.source, settings.target


def test_other_groups_are_regions_with_their_weights(sheets):
    here = {row: 0.25 + 0.5 * (k % 2) for k, row in enumerate((30, 31, 54, 55, 56))}
    sheets("spot", here, [40, 41, 60])
    spot = read_features()["spot"]
    assert spot.kind == "region"
    assert spot.source == list(here)
    assert spot.source_weights == list(here.values())
    assert spot.target == [40, 41, 60]
    assert spot.target_weights is None


def test_a_path_and_a_patch_are_a_region(sheets):
    sheets("spot", [30, 31, 32], [40, 41, 59, 60, 61])
    assert read_features()["spot"].kind == "region"


def test_a_subdivided_target_keeps_points_and_curves(sheets):
    sheets("ridge", rows_of(24, 0.5), rows_of(19, 0.5))
    sheets("rim", ring(24, 4, 9), ring(19, 3, 7))
    sheets("spot", [300, 301, 324, 325, 326], [200, 201, 219, 220, 221])
    picked()[1].modifiers.new("Subdivision", "SUBSURF").levels = 1
    features = read_all()
    assert isinstance(features["peak"], tuple)
    ridge, rim = features["ridge"], features["rim"]
    assert (ridge.kind, ridge.closed) == ("curve", False)
    assert len(ridge.target) == 2 * len(rows_of(19, 0.5)) - 1
    assert (rim.kind, rim.closed) == ("curve", True)
    assert len(rim.target) == 2 * len(ring(19, 3, 7))
    assert features["spot"].kind == "region"


@pytest.mark.parametrize("kind", ["MIRROR", "ARRAY"])
@pytest.mark.parametrize("also_subdivided", [False, True])
@pytest.mark.parametrize("side", [0, 1])
def test_what_a_modifier_doubles_is_marked_once(sheets, kind, also_subdivided, side):
    """The own vertices count; those that it adds are there all the same."""
    sheets("ridge", rows_of(24, 0.5), rows_of(19, 0.5))
    sheets("rim", ring(24, 4, 9), ring(19, 3, 7))
    obj = picked()[side]
    own = len(obj.data.vertices)
    move_vertices(obj, (1.5, 0, 0))
    obj.modifiers.new("Twice", kind)
    if also_subdivided:
        obj.modifiers.new("Subdivision", "SUBSURF").levels = 1
    features = read_all()
    for name in ("peak", "slope"):
        row = features[name][side]
        assert row in groups(obj)[f"pm.{name}"]
    for name, closed in (("ridge", False), ("rim", True)):
        assert (features[name].kind, features[name].closed) == ("curve", closed)
        if not also_subdivided:
            assert set(features[name].rows(side)) == set(groups(obj)[f"pm.{name}"])
    shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(shown.vertices) >= 2 * own


def test_a_mirrored_target_is_morphed_as_a_whole(settings):
    _, target = pair()
    settings.domain = "auto"
    move_vertices(target, (1.5, 0, 0))
    target.modifiers.new("Twice", "MIRROR")
    obj = morph()
    ends = coordinates(obj.data.shape_keys.key_blocks["Morph"].data)
    assert ends[:, 0].min() < -2 < 2 < ends[:, 0].max()
    assert obj.pointmorph.state == "CURRENT"


def test_mirror_marks_the_other_side(sheets):
    """A feature with a side is marked on the other half by the modifier itself."""
    sheets("ear.L", [300], [200])
    source, target = picked()
    add_group(source, "pm.ear.R", {100: 1.0})
    target.vertex_groups.new(name="pm.ear.R")
    move_vertices(target, (1.5, 0, 0))
    own = len(target.data.vertices)
    target.modifiers.new("Twice", "MIRROR")
    features = read_all()
    assert features["ear.L"] == (300, 200)
    assert features["ear.R"] == (100, own + 200)


def test_a_light_vertex_is_a_soft_point(sheets):
    sheets("tip", {30: 0.3}, {40: 0.5})
    tip = read_features()["tip"]
    assert (tip.kind, tip.source, tip.target) == ("point", 30, 40)
    assert (tip.weight, bool(tip.hard)) == (pytest.approx(0.3), False)


def test_the_list_can_say_otherwise(settings, sheets):
    sheets("spot", rows_of(24, 0.5), rows_of(19, 0.5))
    choose(settings, "spot", kind="REGION", hold="EXACT")
    spot = read_features()["spot"]
    assert (spot.kind, spot.hard) == ("region", True)
    choose(settings, "spot", kind="CURVE", hold="SOFT", weight=0.2)
    spot = read_features()["spot"]
    assert (spot.kind, spot.hard, spot.weight) == ("curve", False, 0.2)
    choose(settings, "spot", kind="POINT")
    assert read_features()["spot"].source in rows_of(24, 0.5)[5:7]  # nearest to the middle
    choose(settings, "peak", hold="SOFT", weight=2.0)
    peak = read_all()["peak"]
    assert (peak.kind, peak.hard, peak.weight) == ("point", False, 2.0)


def test_without_edges_several_are_a_region_or_a_curve_by_weight(addon):
    features = addon("core.features")
    weights = {"line": (np.array([4, 2, 9]), np.float32([0.2, 0.8, 0.5]))}
    shape = type(
        "Shape",
        (),
        {
            "name": "Cloud",
            "positions": np.arange(30.0).reshape(10, 3),
            "marks": features.Marks("point attribute", weights),
        },
    )
    assert features.match(shape, shape)["line"].kind == "region"
    line = features.match(shape, shape, {"line": features.Choice(kind="CURVE")})["line"]
    assert line.source == [2, 9, 4]  # the heaviest first
    weights["line"] = (np.array([4, 2, 9]), np.float32([0.2, 0.8, 0.2]))
    with pytest.raises(pointmorph.FeatureError, match="weights that decrease along it"):
        features.match(shape, shape, {"line": features.Choice(kind="CURVE")})


@pytest.mark.parametrize(
    ("edges", "rows"),
    [
        ([(0, 1), (1, 2), (1, 3)], [0, 1, 2, 3]),  # a fork
        ([(0, 1), (2, 3)], [0, 1, 2, 3]),  # two pieces
        ([(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3)], [0, 1, 2, 3, 4, 5]),  # two rings
        ([(0, 1), (2, 3), (3, 4), (4, 2)], [0, 1, 2, 3, 4]),  # a ring and a stick
        ([(0, 1), (1, 2)], [0, 2]),
        ([], [0, 1]),
    ],
)
def test_what_is_no_path(addon, edges, rows):
    edges = np.array(edges, np.int32).reshape(-1, 2)
    assert addon("core.features").chain(np.array(rows), edges) is None


def test_a_path_that_is_merged_with_its_mirror_image_is_one(addon):
    own = np.array([0, 1, 2]), np.ones(3)
    whole = np.array([0, 1, 2, 5, 6]), np.ones(5)
    edges = np.array([(0, 1), (1, 2), (2, 5), (5, 6)])
    rows, _ = addon("core.features").meant(own, edges[:2], whole, edges)
    np.testing.assert_array_equal(rows, whole[0])


def test_paths(addon):
    chain = addon("core.features").chain
    edges = np.array([(3, 7), (7, 1), (1, 5), (5, 3), (5, 9)], np.int32)
    path = chain(np.array([1, 5, 7]), edges)
    assert (path.rows.tolist(), path.closed) == ([5, 1, 7], False)
    loop = chain(np.array([1, 3, 5, 7]), edges)
    assert (loop.rows.tolist(), loop.closed) == ([1, 5, 3, 7], True)


def test_one_here_and_several_there(sheets):
    sheets("tip", [30], [40, 41])
    message = morph_error()
    assert 'one on "Hill" and 2 on "Dune"' in message
    assert "set Kind to Point, which uses the highest weight" in message


def test_an_open_and_a_closed_curve(sheets):
    sheets("rim", ring(24, 5, 18), rows_of(19, 0.5))
    message = morph_error()
    assert 'an open one on "Dune" and a closed one on "Hill"' in message


def test_a_curve_without_order(settings, sheets):
    sheets("line", [30, 70, 110], [40, 80, 120])
    choose(settings, "line", kind="CURVE")
    assert "points of" in (message := morph_error())
    assert "Select a path of edges" in message


def test_check_says_what_each_is(settings, sheets):
    sheets("ridge", rows_of(24, 0.5), rows_of(19, 0.5))
    sheets("spot", [30, 31, 54, 55, 56], [40, 41, 59, 60, 61])
    assert bpy.ops.pointmorph.check_features() == {"FINISHED"}
    found = {item.name: item.found for item in settings.features}
    assert found == {
        "peak": "point",
        "slope": "point",
        "ridge": f"soft curve, {len(rows_of(24, 0.5))} to {len(rows_of(19, 0.5))}",
        "spot": "soft region, 5 to 5",
    }
    mark(settings.source, "horn", 0.7, 0.7)
    with pytest.raises(RuntimeError, match='Mark "horn" on "Dune"'):
        bpy.ops.pointmorph.check_features()


def test_a_morph_with_all_kinds_reports_each(settings, sheets):
    sheets("ridge", rows_of(24, 0.5), rows_of(19, 0.45))
    near = [row for row in range(24 * 24) if 0 < row % 24 < 7 and 2 < row // 24 < 9]
    there = [row for row in range(19 * 19) if 0 < row % 19 < 6 and 2 < row // 19 < 7]
    sheets("spot", near, there)
    sheets("tip", {row_of(24, 0.8, 0.8): 0.5}, {row_of(19, 0.8, 0.7): 0.5})
    obj = morph()
    report = json.loads(obj.pointmorph.report)
    kinds = {name: (kept["kind"], kept["hard"]) for name, kept in report["features"].items()}
    assert kinds == {
        "peak": ("point", True),
        "slope": ("point", True),
        "ridge": ("curve", False),
        "spot": ("region", False),
        "tip": ("point", False),
    }
    assert report["features"]["ridge"]["residual"] < 1
    assert report["features"]["spot"]["inside"] > 0.8
    assert [name for name, _ in pointmorph.feature_summary(report)] == [
        "ridge (curve)",
        "spot (region)",
        "tip (point)",
    ]
    assert settings.features[settings.features.find("spot")].found.startswith("soft region")
