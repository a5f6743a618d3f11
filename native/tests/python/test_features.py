"""Features of every kind: as objects, as JSON, through samples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
import pytest
from pointmorph import Feature
from pointmorph.commands.cli import read_features
from pointmorph.meshes import Shape, sampling
from pointmorph.shapes.features import feature_from_json
from shapes import grid, grid_faces


def row(side: int, x: float, y: float) -> int:
    def cell(c: float) -> int:
        return round((c + 1) / 2 * (side - 1))

    return cell(x) * side + cell(y)


def line(side: int, x: float) -> list[int]:
    """Rows of a grid from y = -0.6 to 0.6."""
    return [row(side, x, y) for y in np.arange(-0.6, 0.61, 2 / (side - 1))]


def disk(side: int, x: float, radius: float) -> list[int]:
    positions = grid(side)
    inside = np.hypot(positions[:, 0] - x, positions[:, 1]) < radius
    return np.flatnonzero(inside).tolist()


def corners(a: int, b: int) -> dict[str, Any]:
    return {
        f"corner {k}": (row(a, x, y), row(b, x, y))
        for k, (x, y) in enumerate([(-1, -1), (1, -1), (1, 1), (-1, 1), (1, 0)])
    }


def morph(features: dict[str, Any], **settings: Any) -> pointmorph.Morph:
    clouds = (pointmorph.Cloud(grid(31), name="here"), pointmorph.Cloud(grid(25), name="there"))
    return pointmorph.morph(*clouds, features, **settings)


# --- Morphs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("hard", [False, True])
def test_a_curve_goes_onto_a_curve(hard: bool) -> None:
    feature = Feature(line(31, 0.0), line(25, 0.25), "curve", hard=hard)
    result = morph({**corners(31, 25), "seam": feature})
    images = result.source_to_target[line(31, 0.0)]
    spacing = 2 / 24
    assert np.abs(images[:, 0] - 0.25).max() < (0.1 if hard else 0.5) * spacing
    (kept,) = (kept for kept in result.quality.features if kept.name == "seam")
    assert (kept.kind, kept.hard, kept.weight) == ("curve", hard, 1.0)
    assert kept.residual < 0.5
    assert result.report["features"]["seam"]["residual"] == kept.residual
    assert result.report["feature_residual"] == 0


def test_a_region_goes_into_a_region_and_weights_onto_weights() -> None:
    here, there = disk(31, -0.3, 0.4), disk(25, 0.1, 0.4)
    feature = Feature(np.array(here), np.array(there), "region")
    result = morph({**corners(31, 25), "spot": feature})
    middle = result.source_to_target[row(31, -0.3, 0)]
    assert np.hypot(middle[0] - 0.1, middle[1]) < 0.15
    assert result.report["features"]["spot"]["inside"] > 0.9
    without = morph(corners(31, 25)).source_to_target[row(31, -0.3, 0)]
    assert np.hypot(without[0] - 0.1, without[1]) > 0.3

    fading = [
        1 - np.hypot(grid(side)[rows, 0] - x, grid(side)[rows, 1]) / 0.4
        for side, rows, x in ((31, here, -0.3), (25, there, 0.1))
    ]
    result = morph({**corners(31, 25), "spot": Feature(here, there, "region", *fading)})
    weight_there = np.zeros(625)
    weight_there[there] = fading[1]
    images = result.source_to_target[here]
    nearest = [int(np.argmin(np.linalg.norm(grid(25) - image, axis=1))) for image in images]
    assert np.corrcoef(fading[0], weight_there[nearest])[0, 1] > 0.9


def test_a_soft_point_gives_way_by_its_weight() -> None:
    offsets = []
    for weight in (0.03, 1.0, 30.0):
        pulled = Feature(row(31, 0, 0), row(25, 0.25, 0), weight=weight, hard=False)
        image = morph({**corners(31, 25), "pulled": pulled}).source_to_target[row(31, 0, 0)]
        offsets.append(float(np.linalg.norm(image - grid(25)[row(25, 0.25, 0)])))
    assert offsets[0] > 2 * offsets[1] > 4 * offsets[2] > 0


def test_the_summary_lists_what_may_be_off() -> None:
    spot = Feature(disk(31, 0, 0.3), disk(25, 0, 0.3), "region")
    seam = Feature(line(31, 0.5), line(25, 0.5), "curve")
    summary = pointmorph.feature_summary(
        morph({**corners(31, 25), "spot": spot, "seam": seam}).report
    )
    assert [name for name, _ in summary] == ["spot (region)", "seam (curve)"]
    assert "% inside" in summary[0][1]
    assert summary[1][1].endswith("spacings off")


def test_method_paper_knows_curves_and_refuses_regions() -> None:
    marks = {"middle": (row(31, 0, -0.9), row(25, 0, -0.9))}
    seam = Feature(line(31, 0.0), line(25, 0.25), "curve", hard=True)
    images = morph({**marks, "seam": seam}, method="paper").source_to_target[line(31, 0.0)]
    assert np.abs(images[:, 0] - 0.25).mean() < 0.1
    spot = Feature(disk(31, 0, 0.3), disk(25, 0, 0.3), "region")
    with pytest.raises(pointmorph.FeatureError, match="Use method auto, which supports regions"):
        morph({"spot": spot}, method="paper")


# --- What is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("feature", "words"),
    [
        (Feature(1, 2, "line"), "'line'"),
        (Feature([1], 2), r"a row of the source, found \[1\]"),
        (Feature(1, True), "a row of the target, found True"),
        (Feature(1, 2, "curve"), "rows of the source, found 1"),
        (Feature([1, 2.5], [3, 4], "curve"), "rows of the source"),
        (Feature([1], [3, 4], "curve"), "2 or more points along the curve on here, found 1"),
        (Feature([1, 2], [3, 4], "curve", closed=True), "3 or more"),
        (Feature([1, 2, 1], [3, 4], "curve"), "point 1 twice"),
        (Feature([1, 2], [3, 4], "curve", [1, 1]), "weights of points in a region"),
        (Feature([], [3], "region"), "one or more points of here"),
        (Feature([1], [9999], "region"), "point 9999"),
        (Feature([1], [3], "region", [1, 1]), "a weight for each of 1 points, found 2"),
        (Feature([1], [3], "region", [2]), "from 0 to 1, found 2"),
        (Feature([1], [3], "region", ["x"]), "weights of the source"),
        (Feature([1], [3], "region", closed=True), "a curve, to be closed"),
        (Feature(1, 2, weight=0), "a weight above 0"),
        (Feature(1, 2, weight=float("nan")), "a weight above 0"),
        (Feature(1, 2, weight="1"), "a number as weight"),  # type: ignore[arg-type]
        (Feature(1, 2, hard="no"), "hard to be true or false"),  # type: ignore[arg-type]
    ],
)
def test_features_that_make_no_sense_are_refused(feature: Feature, words: str) -> None:
    with pytest.raises(pointmorph.FeatureError, match=words) as error:
        morph({"nose": feature})
    assert error.value.subject == 'feature "nose"'


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([1], "a list of 1"),
        ("nose", "'nose'"),
        ([1, 2.5], "a row of the target, found 2.5"),
        ([True, 2], "a row of the source, found True"),
        ({}, 'a "source", found none'),
        ({"source": 1}, 'a "target", found none'),
        ({"source": [1, 2], "target": [3]}, "a row of the source"),
        ({"kind": "path", "source": 1, "target": 2}, "'path'"),
        ({"source": 1, "target": 2, "closed": True}, "keys of a point: .*found 'closed'"),
        ({"source": 1, "target": 2, "wieght": 2}, "found 'wieght'"),
        ({"source": 1, "target": 2, "weight": True}, "a number as weight"),
        ({"source": 1, "target": 2, "weight": -1}, "a weight above 0"),
        ({"source": 1, "target": 2, "hard": 1}, "hard to be true or false"),
        ({"source": 1, "target": 2, "hard": None}, "hard to be true or false"),
        ({"kind": "curve", "source": 1, "target": [2, 3]}, "a list of rows of the source"),
        (
            {"kind": "curve", "source": [1, 4], "target": [2, 3], "closed": 1},
            "closed to be true or",
        ),
        ({"kind": "curve", "source": {"rows": [1]}, "target": [2]}, "a list of rows"),
        ({"kind": "region", "source": {"rows": [1], "weight": [1]}, "target": [2]}, "'weight'"),
        ({"kind": "region", "source": {"weights": [1]}, "target": [2]}, "no rows"),
        ({"kind": "region", "source": {"rows": [1], "weights": 1}, "target": [2]}, "a list of"),
        ({"kind": "region", "source": {"rows": [1], "weights": ["a"]}, "target": [2]}, "Pass num"),
    ],
)
def test_json_that_makes_no_sense_is_refused(value: Any, words: str) -> None:
    with pytest.raises(pointmorph.FeatureError, match=words) as error:
        feature_from_json("nose", value)
    assert error.value.subject == 'feature "nose"'


def test_json_is_read(tmp_path: Path) -> None:
    (tmp_path / "marks.json").write_text(
        json.dumps(
            {
                "features": {
                    "nose": [1, 2],
                    "ear": {"source": 3, "target": 4, "weight": 2, "hard": False},
                    "belt": {
                        "kind": "curve",
                        "source": [1, 2, 3],
                        "target": [4, 5, 6],
                        "closed": True,
                    },
                    "snout": {
                        "kind": "region",
                        "source": {"rows": [7, 8], "weights": [0.5, 1]},
                        "target": [9],
                    },
                }
            }
        )
    )
    features, loop = read_features(tmp_path / "marks.json")
    assert loop == []
    assert features == {
        "nose": Feature(1, 2),
        "ear": Feature(3, 4, weight=2, hard=False),
        "belt": Feature([1, 2, 3], [4, 5, 6], "curve", closed=True),
        "snout": Feature([7, 8], [9], "region", [0.5, 1]),
    }


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ({"feature": {"nose": [1, 2]}}, 'expected "features", found "feature"'),
        ({"features": {}, "Loops": ["nose"]}, 'expected "loop", found "Loops"'),
        ({"nose": [1, 2]}, 'found no "features"'),
    ],
)
def test_a_file_whose_marks_would_not_be_seen_is_refused(
    tmp_path: Path, content: dict[str, Any], found: str
) -> None:
    (tmp_path / "marks.json").write_text(json.dumps(content))
    with pytest.raises(pointmorph.FileError, match=found):
        read_features(tmp_path / "marks.json")


def test_a_features_file_may_have_notes(tmp_path: Path) -> None:
    content = {"features": {"nose": [1, 2]}, "confidence": {"nose": 0.5}, "notes": "by hand"}
    (tmp_path / "marks.json").write_text(json.dumps(content))
    assert read_features(tmp_path / "marks.json")[0] == {"nose": Feature(1, 2)}


# --- Samples --------------------------------------------------------------------------------------


def sheets() -> list[Shape]:
    return [
        Shape(name, grid(side), None, None, None, grid_faces(side))
        for name, side in (("here", 31), ("there", 25))
    ]


def test_all_kinds_go_through_sampling() -> None:
    positions = [grid(31), grid(25)]
    spots = [disk(31, 0, 0.4), disk(25, 0.2, 0.4)]
    given = {
        "nose": Feature(row(31, 0.5, 0.5), row(25, 0.5, 0.5), weight=2, hard=False),
        "seam": Feature(line(31, 0.0), line(25, 0.25), "curve"),
        "spot": Feature(*spots, "region", *(np.full(len(rows), 0.5) for rows in spots)),
        "speck": Feature([row(31, 0.8, -0.8)], [row(25, 0.8, -0.8)], "region"),
    }
    count = 400  # coarser than the vertices
    clouds, features = sampling.sample_pair(sheets(), given, count)
    assert [len(cloud) for cloud in clouds] == [count, count]
    assert list(features) == list(given)
    nose = features["nose"]
    assert (nose.kind, nose.weight, nose.hard) == ("point", 2, False)
    for side, cloud in enumerate(clouds):
        nose_row = given["nose"].rows(side)[0]
        np.testing.assert_array_equal(
            cloud.positions[nose.rows(side)[0]], positions[side][nose_row]
        )
        seam = cloud.positions[features["seam"].rows(side)]
        ends = positions[side][np.array(given["seam"].rows(side))[[0, -1]]]
        np.testing.assert_array_equal(seam[[0, -1]], ends)
        steps = np.diff(seam[:, 1])
        assert (steps[:-1] > 0.99 * 2 / np.sqrt(count)).all()
        np.testing.assert_array_equal(seam[:, 0], ends[0, 0])
        # A sample is in the spot where its triangle is, by the mean of its corners' weights.
        inside = features["spot"].rows(side)
        away = np.hypot(cloud.positions[:, 0] - 0.2 * side, cloud.positions[:, 1])
        cell = 2 * np.sqrt(2) / (30, 24)[side]
        assert set(np.flatnonzero(away < 0.4 - cell)) <= set(inside)
        assert (away[inside] < 0.4 + cell).all()
        assert max(features["spot"].weights(side)) == pytest.approx(0.5)
        assert features["speck"].weights(side)[0] == 1
    assert morph_of(clouds, features).report["features"]["spot"]["inside"] > 0.8


def morph_of(clouds: list[pointmorph.Cloud], features: dict[str, Feature]) -> pointmorph.Morph:
    return pointmorph.morph(clouds[0], clouds[1], features)


def test_bare_clouds_keep_the_weights_of_the_points_that_stay() -> None:
    shapes = [Shape(s.name, s.positions, None, None, None, None) for s in sheets()]
    weights = np.linspace(0.1, 1, len(disk(31, 0, 0.4)))
    spot = Feature(disk(31, 0, 0.4), disk(25, 0, 0.4), "region", weights)
    clouds, features = sampling.sample_pair(shapes, {"spot": spot}, 300)
    assert len(clouds[0]) == 300
    for at, weight in zip(features["spot"].rows(0), features["spot"].weights(0), strict=True):
        (vertex,) = np.flatnonzero((grid(31) == clouds[0].positions[at]).all(axis=1))
        assert weight == pytest.approx(weights[disk(31, 0, 0.4).index(int(vertex))])
