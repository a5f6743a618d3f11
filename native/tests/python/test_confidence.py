"""How sure a morph is of itself, point by point."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from pointmorph.storage import array_files
from shapes import grid

SIDE = 25
CORNERS = {"one": (0, 0), "other": (SIDE * SIDE - 1, SIDE * SIDE - 1)}


@pytest.fixture(scope="module")
def cut() -> pointmorph.Morph:
    """A sheet, marked at its corners, onto itself with a quarter squeezed together."""
    sheet = grid(SIDE)
    rest = sheet.copy()
    beyond = rest[:, 0] > 0.5
    rest[beyond, 0] = 0.5 + 0.02 * (rest[beyond, 0] - 0.5)
    marks = {
        **CORNERS,
        **{f"edge.{k}": (k * SIDE + SIDE - 1, k * SIDE + SIDE - 1) for k in range(3, SIDE - 1, 4)},
        **{f"seam.{k}": (k * SIDE + 18, k * SIDE + 18) for k in range(1, SIDE - 1, 4)},
    }
    clouds = pointmorph.Cloud(sheet, name="Sheet"), pointmorph.Cloud(rest, name="Rest")
    return pointmorph.morph(*clouds, marks)


def test_a_shape_onto_itself_is_sure() -> None:
    sheet = pointmorph.Cloud(grid(SIDE))
    found = pointmorph.morph(sheet, sheet, CORNERS)
    confidence = found.measure_confidence()
    assert confidence.source.min() > 0.9
    assert confidence.doubtful == ()
    assert confidence.right > 0.9
    assert confidence.warning == ""
    assert found.confidence.dtype == np.float32


def test_each_pair_has_the_lower_of_its_ends(cut: pointmorph.Morph) -> None:
    confidence = cut.measure_confidence()
    assert cut.confidence.shape == (len(cut.pairs),)
    lower = np.minimum(confidence.source[cut.pairs[:, 0]], confidence.target[cut.pairs[:, 1]])
    np.testing.assert_array_equal(cut.confidence, lower)


def test_what_was_squeezed_is_in_doubt_and_in_the_report(cut: pointmorph.Morph) -> None:
    confidence = cut.measure_confidence()
    x = cut.source.positions[:, 0]
    assert confidence.source[x > 0.7].mean() < confidence.source[x < 0.0].mean() - 0.3
    assert confidence.doubtful
    for place in confidence.doubtful:
        assert cut.source.positions[place.source, 0] > 0.2
    report = json.loads(json.dumps(cut.report))
    assert report["likely_right"] == confidence.right
    assert report["doubtful"] == [vars(place) for place in confidence.doubtful]
    assert (confidence.warning in report["warnings"]) == (confidence.right < 0.8)
    assert dict(pointmorph.quality_summary(report))["Likely right"].endswith(" %")


def test_a_saved_morph_keeps_it_and_older_files_open(cut: pointmorph.Morph, tmp_path: Path) -> None:
    cut.save(tmp_path / "cut.morph")
    again = pointmorph.open_morph(tmp_path / "cut.morph")
    assert again.has_confidence
    np.testing.assert_array_equal(again.confidence, cut.confidence)
    assert again.measure_confidence().doubtful == cut.measure_confidence().doubtful

    # As versions before it wrote them.
    file = array_files.ArrayFile(tmp_path / "cut.morph", "a morph")
    header = {key: value for key, value in file.header.items() if key != "arrays"}
    words = header.pop("confidence")
    arrays = {name: a for name, a in file.arrays.items() if not name.endswith("/confidence")}
    array_files.write(tmp_path / "older.morph", header, arrays)
    older = pointmorph.open_morph(tmp_path / "older.morph")
    assert not older.has_confidence
    np.testing.assert_array_equal(older.frame(0.3).positions, cut.frame(0.3).positions)
    with pytest.raises(pointmorph.CloudError, match="Morph again"):
        _ = older.confidence
    older.save(tmp_path / "older_again.morph")
    assert not pointmorph.open_morph(tmp_path / "older_again.morph").has_confidence

    for wrong in ({}, {**words, "doubtful": [{"row": 3}]}):
        path = tmp_path / "wrong.morph"
        array_files.write(path, {**header, "confidence": wrong}, file.arrays)
        with pytest.raises(pointmorph.FileError, match="incomplete confidence"):
            pointmorph.open_morph(path).measure_confidence()


def test_a_morph_from_its_pairs_has_none(cut: pointmorph.Morph) -> None:
    up = np.tile([0.0, 0, 1], (SIDE * SIDE, 1))
    sheet = pointmorph.Cloud(grid(SIDE), up, radii=np.full(SIDE * SIDE, 0.05))
    rows = np.arange(SIDE * SIDE)
    restored = pointmorph.restore(sheet, sheet, np.column_stack([rows, rows]))
    assert not restored.has_confidence
    with pytest.raises(pointmorph.CloudError, match="Morph again"):
        restored.measure_confidence()
    assert "likely_right" not in restored.report


def test_it_can_be_stopped_and_asked_for_again() -> None:
    sheet = pointmorph.Cloud(grid(15))
    found = pointmorph.morph(sheet, sheet, {"one": (0, 0), "other": (224, 224)})
    with pytest.raises(pointmorph.Cancelled):
        found.measure_confidence(lambda stage, fraction: stage != "confidence")
    assert found.confidence.size == len(found.pairs)
