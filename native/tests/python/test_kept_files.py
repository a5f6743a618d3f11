"""Files that earlier versions have written, kept as they are: this version opens them.

`native/tests/kept/make_kept.py` makes them; blender_tests opens the .blend files.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from pointmorph.commands.cli import main
from shapes import grid

KEPT = Path(__file__).resolve().parents[1] / "kept"
VERSIONS = sorted(path.name for path in KEPT.iterdir() if (path / "sheets.morph").exists())
LOW, HIGH = grid(5, 0.1), grid(6, 0.6)


def test_there_are_kept_files_of_this_version_or_an_earlier_one() -> None:
    assert VERSIONS


@pytest.mark.parametrize("version", VERSIONS)
def test_a_kept_morph_has_its_frames(version: str) -> None:
    morph = pointmorph.open_morph(KEPT / version / "sheets.morph")
    morph.check()
    pairs = morph.pairs
    assert set(pairs[:, 0]) == set(range(25))
    assert set(pairs[:, 1]) == set(range(36))
    assert {(12, 14), (0, 0)} <= set(map(tuple, pairs.tolist()))
    np.testing.assert_array_equal(morph.frame(0.0).positions, LOW[pairs[:, 0]])
    np.testing.assert_array_equal(morph.frame(1.0).positions, HIGH[pairs[:, 1]])
    then = np.load(KEPT / version / "frame.npy")
    np.testing.assert_allclose(morph.frame(0.4).positions, then, atol=1e-6)
    assert np.abs(then - LOW[pairs[:, 0]]).max() > 0.1
    wrapped = np.load(KEPT / version / "wrapped.npy")
    # How faces turn on the way may become better; where they come from and go to may not change.
    np.testing.assert_allclose(morph.wrapped(0.4), wrapped, atol=1e-3)
    assert len(morph.resampled_frame(0.4).positions) >= len(pairs)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_kept_batch_is_done_and_reported(version: str, tmp_path: Path) -> None:
    folder = tmp_path / "batch"
    shutil.copytree(KEPT / version / "batch", folder)
    before = json.loads((folder / "made" / "batch.json").read_text())["pairs"]
    assert main(["batch", str(folder / "jobs.json"), "--report"]) == 0
    [row] = json.loads((folder / "made" / "batch.json").read_text())["pairs"]
    assert row["pair"] == "low_to_high"
    assert row["state"] in ("done", "kept")
    assert row["pairs"] == before[0]["pairs"] >= 36
    morph = pointmorph.open_morph(folder / "made" / "low_to_high" / "pair.morph")
    np.testing.assert_allclose(morph.frame(1.0).positions, HIGH[morph.pairs[:, 1]], atol=1e-5)
