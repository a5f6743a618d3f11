"""Sequences of frames, and frames as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pointmorph
import pytest
from plyfile import PlyData
from pointmorph import sequences
from shapes import grid

TIMES = [0.0, 0.1, 0.4, 0.7, 1.0]


@pytest.fixture(scope="module")
def morph() -> pointmorph.Morph:
    return pointmorph.morph(pointmorph.Cloud(grid(13)), pointmorph.Cloud(grid(13, 0.8)))


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("frame_*"))


def test_numbers_and_velocities(morph: pointmorph.Morph, tmp_path: Path) -> None:
    counts = sequences.write_frames(morph, tmp_path, TIMES, first=10, step=2)
    assert names(tmp_path) == [f"frame_{number:04d}.ply" for number in range(10, 20, 2)]
    assert counts == [len(morph.resampled_frame(t).ids) for t in TIMES]
    rows = PlyData.read(str(tmp_path / "frame_0012.ply"))["vertex"].data
    # around t = 0.1 t grows by 0.4 in 4 frames
    expected = morph.resampled_frame(0.1).velocities * np.gradient(TIMES)[1] / 2
    np.testing.assert_allclose(rows["vz"], expected[:, 2], atol=1e-7)


def test_nothing_is_prepared_for_no_frames(tmp_path: Path) -> None:
    plane = grid(13)
    result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(0.8 * plane), path="rigid")
    stages: set[str] = set()

    def note(stage: str, _done: float) -> bool:
        stages.add(stage)
        return True

    assert sequences.write_frames(result, tmp_path, [], progress=note) == []
    assert not stages & {"motion", "resampling"}
    sequences.write_frames(result, tmp_path, [0.5], progress=note)
    assert {"motion", "resampling"} <= stages


def test_an_interrupted_run_goes_on_and_another_morph_starts_over(
    morph: pointmorph.Morph, tmp_path: Path
) -> None:
    def stop(stage: str, done: float) -> bool:
        return stage != "frames" or done < 0.1

    with pytest.raises(pointmorph.Cancelled):
        sequences.write_frames(morph, tmp_path, TIMES, resume=True, progress=stop)
    kept = names(tmp_path)
    assert 0 < len(kept) < len(TIMES)
    before = {name: (tmp_path / name).stat().st_mtime_ns for name in kept}
    counts = sequences.write_frames(morph, tmp_path, TIMES, resume=True)
    every = names(tmp_path)
    assert len(every) == len(TIMES)
    assert {name: (tmp_path / name).stat().st_mtime_ns for name in kept} == before
    assert counts == [len(morph.resampled_frame(t).ids) for t in TIMES]

    sequences.write_frames(morph, tmp_path, TIMES[:2], resume=True)
    assert names(tmp_path) == every[:2]
    assert (tmp_path / kept[0]).stat().st_mtime_ns != before[kept[0]]


def test_a_place_that_cannot_be_written(morph: pointmorph.Morph, tmp_path: Path) -> None:
    (tmp_path / "frame_0001.ply").mkdir()
    (tmp_path / "frame_0001.ply" / "full").touch()
    with pytest.raises(pointmorph.FileError, match="frame_0001"):
        sequences.write_frames(morph, tmp_path, TIMES)
