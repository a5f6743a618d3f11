"""Points that go later than others, and the path that is taken when nobody says."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from command_runs import run, xyz
from pointmorph import formats, sequences
from pointmorph.sequences import Chain, moving_shapes
from shapes import grid, grid_faces
from test_morphing import features

SIDE = 21
TURN = np.array([[1.0, 0, 0], [0, np.cos(2), np.sin(2)], [0, -np.sin(2), np.cos(2)]])


def marks(side: int) -> dict[str, tuple[int, int]]:
    """So many on grids with SIDE and `side` points a side that the pose needn't be searched for,
    which takes longer than all the rest."""
    corners = [
        ((SIDE * SIDE - SIDE) * x + (SIDE - 1) * y, (side * side - side) * x + (side - 1) * y)
        for x in (0, 1)
        for y in (0, 1)
    ]
    return features(SIDE, side) | {f"corner {k}": rows for k, rows in enumerate(corners)}


def morph(delay: npt.ArrayLike | None = None, **settings: object) -> pointmorph.Morph:
    """A bump turned by two radians, with the source's faces."""
    source = pointmorph.Cloud(grid(SIDE, 0.8), faces=grid_faces(SIDE), delay=delay)
    target = pointmorph.Cloud(grid(SIDE, 0.8) @ TURN)
    return pointmorph.morph(source, target, marks(SIDE), **settings)  # type: ignore[arg-type]


def times(t: float, delays: npt.NDArray[np.floating], overlap: float, falloff: float):
    done = np.clip((t - delays * (1 - overlap)) / overlap, 0, 1)
    return (1 - falloff) * done + falloff * (3 * done**2 - 2 * done**3)


@pytest.mark.parametrize(("method", "path"), [("auto", "rigid"), ("paper", "linear")])
def test_the_path_that_is_taken_when_nobody_says(method: str, path: str) -> None:
    default, asked = (morph(method=method, **more) for more in ({}, {"path": path}))
    assert default.report["options"]["path"] == "auto"
    np.testing.assert_array_equal(default.frame(0.4).positions, asked.frame(0.4).positions)
    # By the two radians of TURN, or 114.6°, as far as the map tells.
    warned = any(re.search("rotated 11[3-6]°", line) for line in default.report["warnings"])
    assert warned == (path == "linear")


def test_a_chain_of_nothing_is_refused() -> None:
    with pytest.raises(pointmorph.CloudError, match="at least one morph"):
        Chain([], {})


def test_the_last_go_when_the_first_are_there() -> None:
    delays = np.linspace(0, 1, SIDE * SIDE)
    given = morph(delays, stagger="delay", stagger_overlap=0.2, path="linear")
    rows = given.pairs[:, 0]
    ends = given.frame(0).positions, given.frame(1).positions
    np.testing.assert_array_equal(ends[0], given.source.positions[rows])
    for t in (0.1, 0.5, 0.83):
        share = times(t, delays[rows], 0.2, 1.0)[:, None]
        expected = (1 - share) * ends[0] + share * ends[1]
        np.testing.assert_allclose(given.frame(t).positions, expected, atol=1e-9)


@pytest.mark.parametrize("path", ["linear", "rigid"])
def test_the_mesh_goes_as_the_pairs_do(path: str) -> None:
    plain = morph(path=path)
    late = morph(path=path, stagger="x", stagger_overlap=0.3, stagger_falloff=0)
    x = np.asarray(plain.source.positions)[:, 0]
    delays = (x - x.min()) / np.ptp(x)
    here = late.wrapped(0.6)
    for row in range(0, len(x), 37):
        there = plain.wrapped(float(times(0.6, delays, 0.3, 0)[row]))[row]
        np.testing.assert_allclose(here[row], there, atol=1e-4)
    for t in (0.0, 1.0):
        np.testing.assert_array_equal(late.wrapped(t), plain.wrapped(t))
    back = morph(path=path, stagger="x", stagger_order="reverse", stagger_overlap=0.01)
    moved = np.linalg.norm(back.wrapped(0.5) - plain.wrapped(0.0), axis=1)
    assert moved[delays < 0.45].max() == 0
    np.testing.assert_array_equal(back.wrapped(0.5)[delays > 0.55], plain.wrapped(1)[delays > 0.55])


def test_restored_morphs_and_sequences_know_the_delays() -> None:
    delays = np.linspace(0, 1, SIDE * SIDE)
    settings = {"stagger": "delay", "path": "linear"}
    first = morph(delays, **settings)
    clouds = []
    for side, cloud in enumerate((first.source, first.target)):
        frame, rows = first.frame(side), first.pairs[:, side]
        normals, radii = np.empty((len(cloud), 3)), np.empty(len(cloud))
        normals[rows], radii[rows] = frame.normals, frame.radii
        clouds.append(
            pointmorph.Cloud(cloud.positions, normals, radii=radii, delay=None if side else delays)
        )
    maps = first.source_to_target, first.target_to_source
    again = pointmorph.restore(*clouds, first.pairs, maps, **settings)
    np.testing.assert_allclose(again.frame(0.4).positions, first.frame(0.4).positions, atol=1e-12)
    source = pointmorph.Cloud(
        clouds[0].positions, clouds[0].normals, radii=clouds[0].radii, delay=delays[::-1]
    )
    other = pointmorph.restore(source, clouds[1], first.pairs, maps, **settings)
    prints = {sequences.FrameSequence(m, [0.0, 1.0]).fingerprint for m in (again, other)}
    assert len(prints) == 2


FLAT, HIGH, LOW = (0.0, np.eye(3)), (0.8, TURN), (0.3, np.eye(3))


def restored(ends, delay: npt.ArrayLike | None, **settings: object):
    """Between two sheets, row by row: the height of a bump and a turn of each."""
    clouds = []
    for bump, turn in ends:
        places = grid(SIDE, bump) @ turn
        normals = np.tile(turn[2], (SIDE * SIDE, 1))
        radii = np.full(SIDE * SIDE, 0.1 + bump)
        clouds.append(pointmorph.Cloud(places, normals, radii=radii, delay=delay))
    rows = np.arange(SIDE * SIDE)
    maps = clouds[1].positions, clouds[0].positions
    return pointmorph.restore(*clouds, np.column_stack([rows, rows]), maps, **settings)


def test_each_point_of_a_chain_goes_through_all_of_it_in_its_own_time() -> None:
    delays = np.linspace(0, 1, SIDE * SIDE)
    parts = [
        restored((FLAT, HIGH), delays, path="rigid"),
        restored((HIGH, LOW), None, path="rigid"),
    ]
    settings = {"path": "rigid", "stagger": "delay", "stagger_overlap": 0.4}
    chain = Chain(parts, settings)
    for t in (0.4, 0.5, 0.6):
        own = 2.0 * times(t, delays, 0.4, 1.0)
        assert own.min() < 0.9 < 1.1 < own.max()
        here, fuller = chain.frame(t), chain.resampled_frame(t)
        for row in range(0, len(delays), 23):
            number, along = sequences.part_at(own[row] / 2.0, 2)
            there = parts[number].frame(along)
            np.testing.assert_allclose(here.positions[row], there.positions[row], atol=1e-4)
            np.testing.assert_allclose(here.radii[row], there.radii[row], atol=1e-9)
        np.testing.assert_array_equal(fuller.positions[: len(delays)], here.positions)
    for t, part in ((0, parts[0]), (1, parts[1])):
        np.testing.assert_array_equal(chain.frame(t).positions, part.frame(t).positions)
    # The same of shapes that could move, and don't.
    shapes = parts[0].source, parts[0].target, parts[1].target
    still = [moving_shapes.ShapeState(shape.positions, shape.normals) for shape in shapes]
    moving = moving_shapes.MovingSequence(chain, [0.0, 0.4, 1.0], [still] * 3, settings)
    np.testing.assert_allclose(
        moving.frame(1).positions, chain.resampled_frame(0.4).positions, atol=1e-6
    )


def test_a_chain_that_is_not_staggered_shows_one_morph_after_the_other() -> None:
    """Halves of a sheet drift apart and come back, with new points on both ways."""
    flat = grid(24, 0.0)
    apart = flat + np.where(flat[:, :1] > flat[:, 0].mean(), [[0.4, 0, 0]], 0)
    up, rows = np.tile([0.0, 0, 1], (len(flat), 1)), np.arange(len(flat))
    clouds = [
        pointmorph.Cloud(places, up, radii=np.full(len(flat), 0.04))
        for places in (flat, apart, flat)
    ]
    parts = [
        pointmorph.restore(
            *ends, np.column_stack([rows, rows]), (ends[1].positions, ends[0].positions),
            path="linear",
        )
        for ends in pairwise(clouds)
    ]  # fmt: skip
    chain = Chain(parts, {"path": "linear"})
    assert chain.inserted() == sum(part.inserted() for part in parts)
    seen = []
    for t, part, along in ((0.25, parts[0], 0.5), (0.75, parts[1], 0.5)):
        np.testing.assert_array_equal(chain.frame(t).positions, part.frame(along).positions)
        fuller, own = chain.resampled_frame(t), part.resampled_frame(along)
        np.testing.assert_array_equal(fuller.positions, own.positions)
        np.testing.assert_array_equal(fuller.velocities, 2 * own.velocities)
        seen.append(set(fuller.ids[fuller.ids >= len(chain.pairs)]))
        assert 0 < max(seen[-1]) < len(chain.pairs) + chain.inserted()
    assert seen[0].isdisjoint(seen[1])


def test_a_chain_of_other_points_is_refused() -> None:
    parts = [restored((FLAT, HIGH), None), restored((HIGH, LOW), None)]
    rows = np.arange(SIDE * SIDE)[::-1]
    other = pointmorph.restore(
        parts[1].source, parts[1].target, np.column_stack([rows, rows]), stagger="none"
    )
    with pytest.raises(pointmorph.CloudError, match="continue those of the previous"):
        Chain([parts[0], other], {})


@pytest.mark.parametrize("path", ["linear", "rigid"])
def test_with_an_overlap_of_one_all_go_together(path: str) -> None:
    delays = np.linspace(0, 1, SIDE * SIDE)
    together = morph(delays, path=path, stagger="delay", stagger_overlap=1.0, stagger_falloff=0.0)
    plain = morph(delays, path=path)
    for t in (0.2, 0.5, 0.9):
        np.testing.assert_allclose(together.frame(t).positions, plain.frame(t).positions, atol=1e-4)
        np.testing.assert_allclose(together.wrapped(t), plain.wrapped(t), atol=1e-4)


@pytest.mark.parametrize("delay", [None, [0.5, 0.5], np.full(SIDE * SIDE, 1.5)])
def test_delays_that_do_not_fit_are_refused(delay: npt.ArrayLike | None) -> None:
    with pytest.raises(pointmorph.CloudError, match="delay"):
        morph(delay, stagger="delay")


def test_the_command_line_takes_delays_from_files(tmp_path: Path) -> None:
    positions = grid(SIDE, 0.8)
    finer = 2 * SIDE - 1
    for name, side, turn in (("a", SIDE, np.eye(3)), ("b", finer, TURN)):
        lines = "".join(f"v {x} {y} {z}\n" for x, y, z in grid(side, 0.8) @ turn)
        lines += "".join(f"f {i + 1} {j + 1} {k + 1}\n" for i, j, k in grid_faces(side))
        (tmp_path / f"{name}.obj").write_text(lines)
    last = list(range(SIDE))
    content = {"features": marks(finer), "delay": {"source": last}}
    (tmp_path / "marks.json").write_text(json.dumps(content))
    call = [
        "morph", tmp_path / "a.obj", tmp_path / "b.obj", "--features", tmp_path / "marks.json",
        "--frames", 3, "--out", tmp_path / "out",
    ]  # fmt: skip
    mesh_too = ("--mesh", "source", "--denser", 0.0005)
    done = run(*call, *mesh_too, "--stagger", "delay", "--stagger-overlap", 0.4)
    assert done.returncode == 0, done.stderr
    pairs = np.load(tmp_path / "out" / "pairs.npy")
    half = xyz(tmp_path / "out" / "frame_0001.ply")
    starts, ends = (xyz(tmp_path / "out" / f"frame_000{n}.ply") for n in (0, 2))
    late = np.isin(pairs[:, 0], last)
    # At ½ the first have gone for longer than they take; the last haven't begun (0.6).
    np.testing.assert_array_equal(half[late], starts[late])
    np.testing.assert_array_equal(half[~late], ends[~late])
    first, mesh, end = (formats.read(tmp_path / "out" / f"mesh_000{n}.obj") for n in range(3))
    np.testing.assert_allclose(mesh.positions[:SIDE], positions[:SIDE], atol=1e-6)
    # A vertex between one that waits and one that has gone is on its way.
    assert len(mesh.positions) > SIDE * SIDE
    there = np.isclose(mesh.positions, end.positions, atol=1e-6).all(axis=1)
    waits = np.isclose(mesh.positions, first.positions, atol=1e-6).all(axis=1)
    assert there[SIDE : SIDE * SIDE].all()
    between = ~(there | waits)
    assert between.any()
    assert not between[: SIDE * SIDE].any()

    # Where all overlap, all are halfway in the middle.
    done = run(*call, "--stagger", "delay", "--stagger-overlap", 1)
    assert done.returncode == 0, done.stderr
    together = xyz(tmp_path / "out" / "frame_0001.ply")
    assert run(*call).returncode == 0
    plain = xyz(tmp_path / "out" / "frame_0001.ply")
    np.testing.assert_allclose(together, plain, atol=1e-4)
    moves = np.linalg.norm(ends - starts, axis=1) > 0.1
    assert (np.linalg.norm(together - starts, axis=1) > 0.01)[moves].all()
