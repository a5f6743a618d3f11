"""Points that go later than others, and the path that is taken when nobody says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from pointmorph import formats, sequences
from shapes import grid, grid_faces
from test_cli import run, xyz
from test_morphing import features

SIDE = 21
TURN = np.array([[1.0, 0, 0], [0, np.cos(2), np.sin(2)], [0, -np.sin(2), np.cos(2)]])


def morph(delay: npt.ArrayLike | None = None, **settings: object) -> pointmorph.Morph:
    """A bump turned by two radians, with the source's faces."""
    source = pointmorph.Cloud(grid(SIDE, 0.8), faces=grid_faces(SIDE), delay=delay)
    target = pointmorph.Cloud(grid(SIDE, 0.8) @ TURN)
    marks = {name: (a, a) for name, (a, _) in features(SIDE, SIDE).items()} | {"corner": (0, 0)}
    return pointmorph.morph(source, target, marks, **settings)  # type: ignore[arg-type]


def times(t: float, delays: npt.NDArray[np.floating], overlap: float, falloff: float):
    done = np.clip((t - delays * (1 - overlap)) / overlap, 0, 1)
    return (1 - falloff) * done + falloff * (3 * done**2 - 2 * done**3)


@pytest.mark.parametrize(("method", "path"), [("auto", "rigid"), ("paper", "linear")])
def test_the_path_that_is_taken_when_nobody_says(method: str, path: str) -> None:
    default, asked = (morph(method=method, **more) for more in ({}, {"path": path}))
    assert default.report["options"]["path"] == "auto"
    np.testing.assert_array_equal(default.frame(0.4).positions, asked.frame(0.4).positions)
    warned = any("115°" in warning for warning in default.report["warnings"])
    assert warned == (path == "linear")


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


@pytest.mark.parametrize("delay", [None, [0.5, 0.5], np.full(SIDE * SIDE, 1.5)])
def test_delays_that_do_not_fit_are_refused(delay: npt.ArrayLike | None) -> None:
    with pytest.raises(pointmorph.CloudError, match="delay"):
        morph(delay, stagger="delay")


def test_the_command_line_takes_delays_from_files(tmp_path: Path) -> None:
    positions = grid(SIDE, 0.8)
    for name, turn in (("a", np.eye(3)), ("b", TURN)):
        lines = "".join(f"v {x} {y} {z}\n" for x, y, z in positions @ turn)
        lines += "".join(f"f {i + 1} {j + 1} {k + 1}\n" for i, j, k in grid_faces(SIDE))
        (tmp_path / f"{name}.obj").write_text(lines)
    last = list(range(SIDE))
    marks = {name: [a, a] for name, (a, _) in features(SIDE, SIDE).items()}
    content = {"features": {**marks, "corner": [0, 0]}, "delay": {"source": last}}
    (tmp_path / "marks.json").write_text(json.dumps(content))
    call = [
        "morph", tmp_path / "a.obj", tmp_path / "b.obj", "--features", tmp_path / "marks.json",
        "--frames", 3, "--out", tmp_path / "out", "--mesh", "source",
    ]  # fmt: skip
    done = run(*call, "--stagger", "delay", "--stagger-overlap", 0.4)
    assert done.returncode == 0, done.stderr
    pairs = np.load(tmp_path / "out" / "pairs.npy")
    half = xyz(tmp_path / "out" / "frame_0001.ply")
    starts, ends = (xyz(tmp_path / "out" / f"frame_000{n}.ply") for n in (0, 2))
    late = np.isin(pairs[:, 0], last)
    # At ½ the first have gone for longer than they take; the last haven't begun (0.6).
    np.testing.assert_array_equal(half[late], starts[late])
    np.testing.assert_array_equal(half[~late], ends[~late])
    mesh = formats.read(tmp_path / "out" / "mesh_0001.obj").positions
    np.testing.assert_allclose(mesh[:SIDE], positions[:SIDE], atol=1e-6)
    wrong = run(*call, "--stagger", "delay", "--denser")
    assert wrong.returncode == 2
    assert "no --stagger" in wrong.stderr
