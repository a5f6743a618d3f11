"""Frames of shapes that move."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from pointmorph import sequences
from pointmorph.sequences import MovingSequence, ShapeState, frame_stores, moving_shapes
from shapes import grid

TIMES = np.linspace(0.0, 1.0, 5).tolist()
ANGLE = 0.3  # a frame


@pytest.fixture(scope="module")
def torn() -> pointmorph.Morph:
    """A sheet whose halves drift apart: new points come in between."""
    flat = grid(24, 0.0).astype(np.float32)
    apart = flat + np.where(flat[:, :1] > flat[:, 0].mean(), [[0.4, 0, 0]], 0).astype(np.float32)
    up = np.tile(np.float32([0, 0, 1]), (len(flat), 1))
    radii = np.full(len(flat), 0.04, np.float32)
    clouds = [pointmorph.Cloud(p, up, radii=radii, name=n) for p, n in ((flat, "a"), (apart, "b"))]
    rows = np.arange(len(flat))
    maps = apart, flat
    return pointmorph.restore(*clouds, np.column_stack([rows, rows]), maps, path="linear")


def turn(angle: float) -> npt.NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def states_of(
    morph: pointmorph.Morph, matrices: list[npt.NDArray[np.float64]]
) -> list[list[ShapeState]]:
    """All shapes taken through a matrix in each frame."""
    found = []
    for matrix in matrices:
        frame = []
        for cloud in (morph.source, morph.target):
            assert cloud.normals is not None
            normals = cloud.normals @ np.linalg.inv(matrix)
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            positions = (cloud.positions @ matrix.T).astype(np.float32)
            frame.append(ShapeState(positions, normals.astype(np.float32)))
        found.append(frame)
    return found


@pytest.mark.parametrize("path", ["linear", "rigid"])
@pytest.mark.parametrize("size", [1.0, 2.5])
def test_what_moves_as_a_whole_looks_as_at_rest_in_its_own_frame(
    torn: pointmorph.Morph, path: str, size: float
) -> None:
    settings = {"path": path}
    maps = torn.source_to_target, torn.target_to_source
    still = pointmorph.restore(torn.source, torn.target, torn.pairs, maps, **settings)
    matrices = [size * turn(ANGLE * k) for k in range(len(TIMES))]
    sequence = MovingSequence(still, TIMES, states_of(torn, matrices), settings)
    tolerance = 3e-6 if path == "linear" else 2e-5  # of what the solver leaves
    for k, (t, matrix) in enumerate(zip(TIMES, matrices, strict=True)):
        rest, frame = still.resampled_frame(t), sequence.frame(k)
        np.testing.assert_array_equal(frame.ids, rest.ids)
        np.testing.assert_array_equal(frame.colors, rest.colors)
        np.testing.assert_allclose(
            frame.positions, rest.positions @ matrix.T, atol=tolerance * size
        )
        turned = rest.normals @ (matrix.T / size)
        assert (np.einsum("nc,nc->n", frame.normals, turned) > np.cos(np.radians(0.2))).all()
        np.testing.assert_allclose(frame.radii, size * rest.radii, rtol=1e-4)
    assert len(sequence.frame(2).ids) > len(torn.pairs) + 20


def test_new_points_lie_in_the_stretched_surface(torn: pointmorph.Morph) -> None:
    """Stretched along one axis and sheared: the flat sheet stays flat, its points stay in it."""
    matrices = [np.array([[1, 0, 0], [0, 1 + 0.2 * k, 0], [0, 0.3 * k, 1]]) for k in range(5)]
    sequence = MovingSequence(torn, TIMES, states_of(torn, matrices), {"path": "linear"})
    for k in (1, 2, 3):
        rest, frame = torn.resampled_frame(TIMES[k]), sequence.frame(k)
        new = rest.ids >= len(torn.pairs)
        expected = rest.positions @ matrices[k].T
        spacing = 2.0 / 23
        off = np.linalg.norm(frame.positions - expected, axis=1)[new]
        assert off.max() < 0.1 * spacing
        slope = frame.positions[new][:, 2] - expected[new][:, 2]
        assert np.abs(slope).max() < 0.03 * spacing
        normal = np.linalg.inv(matrices[k]).T @ [0, 0, 1]
        cosine = frame.normals[new] @ normal / np.linalg.norm(normal)
        assert cosine.min() > np.cos(np.radians(1.0))


def test_velocities_are_the_way_to_the_next_frame(torn: pointmorph.Morph) -> None:
    matrices = [turn(0.01 * k) for k in range(len(TIMES))]
    settings = {"path": "linear"}
    sequence = MovingSequence(torn, TIMES, states_of(torn, matrices), settings, step=2)
    here, later = sequence.frame(2), sequence.frame(3)
    _, a, b = np.intersect1d(here.ids, later.ids, return_indices=True)
    assert (here.ids[a] >= len(torn.pairs)).sum() > 15
    way = (later.positions[b] - here.positions[a]) / 2
    pairs = here.ids[a] < len(torn.pairs)
    np.testing.assert_allclose(here.velocities[a][pairs], way[pairs], atol=1e-4)
    np.testing.assert_allclose(here.velocities[a][~pairs], way[~pairs], atol=0.02)


def test_frames_need_no_inverses_and_determinants_of_numpys(
    torn: pointmorph.Morph, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that are made side by side waited for each other at each small matrix."""
    matrices = [turn(ANGLE * k) for k in range(len(TIMES))]
    settings = {"path": "rigid"}
    sequence = MovingSequence(torn, TIMES, states_of(torn, matrices), settings)
    for name in ("inv", "det"):
        monkeypatch.delattr(np.linalg, name)
    assert len(sequence.frame(2).ids) > len(torn.pairs) + 20


def test_determinants_are_those_of_numpy() -> None:
    matrices = np.random.default_rng(0).normal(size=(200, 3, 3))
    cofactors = moving_shapes._cofactors(matrices)
    expected = np.linalg.det(matrices)
    found = moving_shapes._determinants(matrices, cofactors)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    inverses = cofactors.transpose(0, 2, 1) / expected[:, None, None]
    np.testing.assert_allclose(inverses @ matrices, np.tile(np.eye(3), (200, 1, 1)), atol=1e-9)


@pytest.mark.parametrize("size", [1e-90, 1e-8, 1.0, 1e8, 1e90])
def test_inverses_are_those_of_numpy(size: float) -> None:
    spread = np.random.default_rng(0).normal(size=(200, 3, 3)) * (1.0, 1.0, 1e-3)
    matrices = size * (spread.transpose(0, 2, 1) @ spread + 1e-5 * np.eye(3))
    found = moving_shapes._inverses(matrices) @ matrices
    np.testing.assert_allclose(found, np.tile(np.eye(3), (200, 1, 1)), atol=1e-8)


def test_states_must_fit(torn: pointmorph.Morph) -> None:
    states = states_of(torn, [np.eye(3)] * len(TIMES))
    states[3][1] = ShapeState(states[3][1].positions[:-1], states[3][1].normals[:-1])
    with pytest.raises(pointmorph.CloudError, match="575 in frame 7"):
        MovingSequence(torn, TIMES, states, {}, first=4)


def stop_after(count: int) -> pointmorph.Progress:
    return lambda stage, done: stage != "frames" or done < (count - 0.5) / len(TIMES)


def arrays(store: frame_stores.FrameStore) -> list[dict[str, npt.NDArray[np.generic]]]:
    return [vars(frame) for frame in store.frames()]


def test_a_store_goes_on_bit_for_bit_and_another_sequence_starts_over(
    torn: pointmorph.Morph, tmp_path: Path
) -> None:
    sequence = sequences.FrameSequence(torn, TIMES, first=3)
    whole = frame_stores.FrameStore(tmp_path / "whole", sequence)
    assert whole.fill() == len(TIMES)
    store = frame_stores.FrameStore(tmp_path / "broken", sequence)
    with pytest.raises(pointmorph.Cancelled):
        store.fill(stop_after(2))
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "broken").glob("*.npz")}
    assert 0 < len(kept) < len(TIMES)
    again = frame_stores.FrameStore(
        tmp_path / "broken", sequences.FrameSequence(torn, TIMES, first=3)
    )
    assert again.fill() == len(TIMES)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    for one, other in zip(arrays(whole), arrays(again), strict=True):
        assert one.keys() == other.keys()
        for name in one:
            np.testing.assert_array_equal(one[name], other[name])
    assert whole.counts() == [len(frame["radii"]) for frame in arrays(whole)]

    moved = states_of(torn, [turn(0.1 * k) for k in range(5)])
    for other_sequence in (
        sequences.FrameSequence(torn, TIMES, first=3, step=2),
        sequences.FrameSequence(torn, TIMES[::-1], first=3),
        sequences.FrameSequence(torn, TIMES, first=3, resample=False),
        MovingSequence(torn, TIMES, moved, {}, first=3),
        MovingSequence(torn, TIMES, moved[::-1], {}, first=3),
    ):
        frame_stores.FrameStore(tmp_path / "broken", other_sequence)
        assert not list((tmp_path / "broken").glob("*.npz"))
        again.fill()  # what was there is made anew, under the old mark
        assert len(list((tmp_path / "broken").glob("*.npz"))) == len(TIMES)


def test_a_frame_that_was_damaged_is_named(torn: pointmorph.Morph, tmp_path: Path) -> None:
    store = frame_stores.FrameStore(tmp_path / "a", sequences.FrameSequence(torn, TIMES[:2]))
    store.fill()
    path = tmp_path / "a" / "frame_0001.npz"
    whole = path.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"x" + whole[1:], whole[:-30]):
        path.write_bytes(damaged)
        with pytest.raises(pointmorph.FileError, match="frame_0001"):
            list(store.frames())
        with pytest.raises(pointmorph.FileError, match="frame_0001"):
            store.counts()


def test_a_store_removes_what_is_its_own(torn: pointmorph.Morph, tmp_path: Path) -> None:
    store = frame_stores.FrameStore(tmp_path / "a", sequences.FrameSequence(torn, TIMES[:2]))
    store.fill()
    left = tmp_path / "a" / ".frame_0001.npz.0.pointmorph-part"
    left.touch()
    os.utime(left, (0, 0))  # Windows can't tell a new one from a file that is being written
    (tmp_path / "a" / "mine.txt").touch()
    store.remove()
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["mine.txt"]
    (tmp_path / "a" / "mine.txt").unlink()
    store.remove()
    (tmp_path / "b").touch()
    with pytest.raises(pointmorph.FileError, match="a folder for frames"):
        frame_stores.FrameStore(tmp_path / "b", sequences.FrameSequence(torn, TIMES[:2]))
