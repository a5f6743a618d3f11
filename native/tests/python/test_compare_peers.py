"""The comparison with peers: its measures on maps that are known, and the command."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shapes import grid, grid_faces

pytest.importorskip("scipy", reason="the comparison's measures need scipy")
pytest.importorskip("tabulate", reason="the comparison's table needs tabulate")

import compare_measures as measures
import compare_methods as methods
import compare_peers

SCRIPT = Path(compare_peers.__file__)
COUNT = 6000
MARK_STEP = COUNT // 20
SPHERE_AREA = 4 * np.pi


def sphere(count: int = COUNT) -> measures.Floats:
    """Points of the unit sphere along Fibonacci's spiral: about as even as points get."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=-1)


def surface(points: measures.Floats, normals: measures.Floats, area: float) -> measures.Surface:
    none = np.empty((0, 3))
    return measures.Surface(points, normals, area, none, none)


def around_z(points: measures.Floats, degrees: float) -> measures.Floats:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


@functools.cache
def yardstick() -> measures.Yardstick:
    """Between the sphere and itself, with every place its own counterpart."""
    ball = surface(sphere(), sphere(), SPHERE_AREA)
    same = np.repeat(np.arange(0, COUNT, MARK_STEP)[:, None], 2, axis=1)
    return measures.Yardstick(ball, ball, np.empty((0, 2), np.int64), same)


def measured(images: measures.Floats) -> dict[str, float | None]:
    """Measures of the map of the sphere onto itself that sends its points to `images`."""
    return yardstick().measure(methods.two_way(images, sphere()))


def test_the_identity_is_perfect() -> None:
    row = measured(sphere())
    for name, value in (
        ("landmarks", 0), ("landmarks_max", 0), ("tears", 0), ("flips", 0), ("covered", 1),
        ("dirichlet", 1), ("dirichlet_back", 1), ("stretch_p99", 1),
    ):  # fmt: skip
        assert row[name] == pytest.approx(value, abs=1e-9), name
    assert row["features_max"] is None


def test_a_rotation_misses_landmarks_by_its_arc_and_distorts_nothing() -> None:
    images = around_z(sphere(), 40)
    row = measured(images)
    cosines = (images * sphere()).sum(axis=1)[::MARK_STEP]
    arcs = np.arccos(np.clip(cosines, -1, 1)) / np.sqrt(SPHERE_AREA)
    assert row["landmarks"] == pytest.approx(arcs.mean(), rel=0.06)  # graphs are 3 % too long
    assert row["dirichlet"] == pytest.approx(1, abs=0.15)  # snapping to samples
    assert row["tears"] == pytest.approx(0, abs=0.002)
    assert row["flips"] == pytest.approx(0, abs=0.01)


def test_a_mirror_image_is_turned_over_everywhere() -> None:
    row = measured(sphere() * [1, 1, -1])
    assert row["flips"] == pytest.approx(1, abs=0.005)
    assert row["dirichlet"] == pytest.approx(1, abs=0.15)


def test_stretch_to_an_ellipsoid_is_that_of_the_triangles() -> None:
    scale = np.array([2.0, 1.0, 0.7])
    points, images = sphere(), sphere() * scale
    normals = points / scale
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # The area of the image: the determinant of the linear map times |A^-T n|, averaged.
    area = SPHERE_AREA * np.prod(scale) * np.linalg.norm(points / scale, axis=1).mean()
    ball, egg = surface(points, points, SPHERE_AREA), surface(images, normals, area)
    rows = np.arange(COUNT)
    got = measures.smoothness(ball, egg, np.stack([rows, rows], axis=-1), np.random.default_rng(0))
    # The mean of |A t|² over unit tangents t at n is (|A|² - |A n|²) / 2.
    squares = ((scale**2).sum() - ((points * scale) ** 2).sum(axis=1)) / 2
    expected = squares.mean() * SPHERE_AREA / area
    assert got.dirichlet == pytest.approx(expected, rel=0.03)
    assert got.flips == 0


def test_a_half_that_is_turned_outside_in_is_torn_off_and_flipped() -> None:
    points = sphere()
    upper = points[:, 2] > 0
    polar, around = np.arccos(points[:, 2]), np.arctan2(points[:, 1], points[:, 0])
    polar = np.where(upper, np.pi / 2 - polar, polar)  # pole to equator, equator to pole
    flat = np.sin(polar)
    row = measured(np.stack([flat * np.cos(around), flat * np.sin(around), np.cos(polar)], axis=-1))
    _, near = measures.neighbors(points, measures.TEAR_NEIGHBORS)
    crossing = (upper[:, None] != upper[near]).mean()
    assert 0.7 * crossing < row["tears"] < 2 * crossing
    assert 0.4 < row["flips"] < 0.52
    assert row["stretch_p99"] > 3


def test_features_count_apart_and_their_pose_is_taken_away() -> None:
    points = sphere()
    turned = 3 * around_z(points, 70) + [5.0, -2.0, 1.0]
    ball = surface(points, points, SPHERE_AREA)
    moved = surface(turned, around_z(points, 70), 9 * SPHERE_AREA)
    rows = np.arange(COUNT)
    features = np.stack([rows[::1500], rows[::1500]], axis=-1)
    landmarks = np.stack([rows[100::1500], rows[200::1500]], axis=-1)
    row = measures.Yardstick(ball, moved, features, landmarks).measure(
        np.stack([rows, rows], axis=-1)
    )
    assert row["features_max"] == 0
    assert row["landmarks"] > 0.05
    assert row["tears"] == 0  # straight in-betweens of shapes that lie alike


def test_points_that_are_in_no_pair_are_noticed() -> None:
    rows = np.flatnonzero(sphere()[:, 2] < 0)
    ball = surface(sphere(), sphere(), SPHERE_AREA)
    yardstick = measures.Yardstick(ball, ball, np.empty((0, 2), int), np.empty((0, 2), int))
    row = yardstick.measure(np.stack([rows, rows], axis=-1))
    assert row["covered"] == pytest.approx(0.5, abs=0.01)
    assert row["landmarks"] is None


def test_bare_clouds_get_an_area_and_normals() -> None:
    points = sphere()
    assert measures.cloud_area(points) == pytest.approx(SPHERE_AREA, rel=0.1)
    assert ((measures.estimated_normals(points) * points).sum(axis=1) > 0.95).all()


# --- The command ----------------------------------------------------------------------------------


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """Two bumps over the same square, with and without faces, six features and two landmarks."""
    corners = [(0, 0), (0, 32), (32, 0), (32, 32), (16, 16), (16, 24), (8, 16), (24, 8)]
    for name, side, height in (("low", 33, 0.3), ("high", 17, 0.6)):
        points, faces = grid(side, height), grid_faces(side)
        (tmp_path / f"{name}.off").write_text(
            f"OFF\n{len(points)} {len(faces)} 0\n"
            + "".join(f"{x} {y} {z}\n" for x, y, z in points)
            + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
        )
        np.savetxt(tmp_path / f"{name}.xyz", points)
    rows = [[i * 33 + j, i // 2 * 17 + j // 2] for i, j in corners]
    marks = {
        "features": {f"f{k}": row for k, row in enumerate(rows[:6])},
        "landmarks": {f"l{k}": row for k, row in enumerate(rows[6:])},
    }
    (tmp_path / "marks.json").write_text(json.dumps(marks))
    return tmp_path


def arguments(pair: Path, suffix: str, options: tuple[object, ...]) -> list[str]:
    files = [pair / f"{name}.{suffix}" for name in ("low", "high")]
    return [str(word) for word in (*files, "--features", pair / "marks.json", *options)]


def run(pair: Path, suffix: str, *options: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments(pair, suffix, options)]
    return subprocess.run(command, capture_output=True, text=True)


Call = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def call(pair: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """The same as `run` but without a new interpreter, and with fewer points to measure along and
    to draw with: most of the script's time goes there."""
    monkeypatch.setattr(measures, "DENSE", 3000)

    def called(suffix: str, *options: object) -> subprocess.CompletedProcess[str]:
        words = [str(SCRIPT), *arguments(pair, suffix, options)]
        monkeypatch.setattr(sys, "argv", words)
        try:
            status = compare_peers.main()
        except SystemExit as stop:
            status = stop.code
        return subprocess.CompletedProcess(words, status, *capsys.readouterr())

    return called


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Methods run in this process, where that they have their own isn't what is tested."""
    monkeypatch.setattr(
        compare_peers, "run", lambda name, pair, _: compare_peers._measured(name, pair)
    )


def test_the_table_has_a_row_for_each_method(pair: Path, call: Call) -> None:
    names = ["auto", "procrustes", "thin-plate"]
    done = call("off", "--methods", ",".join(names), "--points", 400, "--json", pair / "out.json")
    assert done.returncode == 0, done.stderr
    assert "6 features, 2 landmarks held out" in done.stdout
    rows = {row["method"]: row for row in json.loads((pair / "out.json").read_text())}
    assert list(rows) == names
    for name in names:
        assert methods.METHODS[name].title in done.stdout
        assert rows[name]["landmarks"] < 0.1
        assert rows[name]["covered"] == 1
        assert rows[name]["units"] > 0
    assert rows["auto"]["features_max"] == 0


@pytest.mark.parametrize(
    "name", [name for name, method in methods.METHODS.items() if method.modules]
)
def test_an_installed_peer_finds_its_way_over_a_bump(pair: Path, name: str) -> None:
    for module in methods.METHODS[name].modules:
        pytest.importorskip(module, reason=f"the peer {name} isn't installed")
    files = pair / "low.off", pair / "high.off"
    given = compare_peers.read(files, pair / "marks.json", 500, [])
    # In this process: a table would call an error of a peer a reason to skip it.
    pairs = methods.METHODS[name].run(given.pair)
    clouds = given.pair.source, given.pair.target
    sides = [
        measures.Surface.of(cloud, shape) for cloud, shape in zip(clouds, given.shapes, strict=True)
    ]
    landmarks = np.array(list(given.landmarks.values()))
    row = measures.Yardstick(*sides, given.pair.marks, landmarks).measure(pairs)
    assert row["landmarks"] < 0.15
    assert row["covered"] > 0.99


@pytest.mark.usefixtures("one_process")
def test_files_vertices_and_features_that_are_held_out(call: Call) -> None:
    done = call("off", "--methods", "procrustes", "--points", 0, "--hold-out", "f4,f5")
    assert done.returncode == 0, done.stderr
    assert "low (1,089 points) to high (289), 4 features, 4 landmarks held out" in done.stdout


def test_what_cannot_run_is_named_with_the_reason(
    pair: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = run(pair, "xyz", "--methods", "procrustes,nricp", "--points", 250)
    assert done.returncode == 0, done.stderr
    assert "trimesh's non-rigid ICP: needs faces, and these models have none" in done.stdout

    absent = methods.Method("absent", methods.procrustes, ("no_such_package",))
    files = pair / "low.off", pair / "high.off"
    given = compare_peers.read(files, pair / "marks.json", 250, [])
    monkeypatch.setitem(methods.METHODS, "procrustes", absent)
    assert "not installed" in compare_peers._measured("procrustes", given.pair).skipped

    few = compare_peers.read(files, pair / "marks.json", 250, ["f0", "f1", "f2", "f3"]).pair
    with pytest.raises(methods.NotApplicableError, match="three features or more, found 2"):
        methods.procrustes(few)
    flat = compare_peers.read(files, pair / "marks.json", 250, ["f4", "f5"]).pair
    with pytest.raises(methods.NotApplicableError, match="four features or more"):
        methods.thin_plate(flat)


def test_a_method_that_takes_too_long_is_stopped(call: Call) -> None:
    done = call("off", "--methods", "auto", "--points", 400, "--timeout", 0)
    assert done.returncode == 0, done.stderr
    assert "Pointmorph: stopped after 0 s" in done.stdout


def test_wrong_calls_say_what_is_wrong(pair: Path, call: Call) -> None:
    done = call("off", "--methods", "magic")
    assert done.returncode == 2
    assert "no such method: magic" in done.stderr
    done = run(pair, "off", "--hold-out", "tail")
    assert done.returncode == 1
    assert 'feature "tail": expected one of' in done.stderr


def test_what_is_drawn_where_the_cloud_has_a_point_goes_where_that_goes() -> None:
    pytest.importorskip("PIL", reason="the comparison's pictures need pillow")
    import compare_pictures

    points = grid(9, dtype=np.float64)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    drawn = compare_pictures.Drawn(points[5:], normals[5:])
    partners = points[::-1].copy()
    images = compare_pictures.carried(drawn, points, normals, partners)
    np.testing.assert_allclose(images, partners[5:], atol=1e-6)


@pytest.mark.usefixtures("one_process")
def test_pictures_of_meshes_and_bare_clouds(
    pair: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("PIL", reason="the comparison's pictures need pillow")
    import compare_pictures

    monkeypatch.setattr(compare_pictures, "SPLATS", 10_000)
    for suffix in ("off", "xyz"):
        folder = pair / suffix
        done = call(
            suffix, "--methods", "procrustes", "--points", 250, "--pictures", folder,
            "--up", "z", "--view", "1,1,0.5",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert (folder / "low_to_high.png").read_bytes().startswith(b"\x89PNG")
