"""The command line as a user or a script meets it."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command_runs import COMMAND, PAIR, A, B, run, run_apart, write_off, write_pair, xyz
from plyfile import PlyData
from pointmorph import formats
from pointmorph.commands import terminal
from pointmorph.formats import ply
from shapes import around, ball, grid


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    return write_pair(tmp_path)


def test_a_whole_morph_and_back_from_its_files(pair: Path) -> None:
    out = pair / "out"
    done = run_apart(
        "morph", pair / "plane.off", pair / "bump.off", "--out", out,
        "--features", pair / "features.json", "--frames", 3,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # no bars in a pipe
    assert sorted(os.listdir(out)) == [
        "frame_0000.ply", "frame_0001.ply", "frame_0002.ply",
        "pairs.npy", "report.json", "source.ply", "target.ply",
    ]  # fmt: skip
    pairs = np.load(out / "pairs.npy")
    assert pairs.dtype == np.int64
    source, target = xyz(out / "source.ply"), xyz(out / "target.ply")
    assert len(source) == A * A
    assert len(target) == B * B
    for name in ("source", "target"):
        sure = ply.read(out / f"{name}.ply")["vertex"].columns["confidence"]
        assert sure.dtype == np.float32
        assert (sure > 0.5).all()  # a bump that both corners and the middle hold
        assert (sure <= 1).all()
    assert set(pairs[:, 0]) == set(range(len(source)))
    assert set(pairs[:, 1]) == set(range(len(target)))
    np.testing.assert_array_equal(xyz(out / "frame_0000.ply"), source[pairs[:, 0]])
    np.testing.assert_array_equal(xyz(out / "frame_0002.ply"), target[pairs[:, 1]])
    report = json.loads((out / "report.json").read_text())
    for key in (
        "stages", "seconds", "peak_memory_bytes", "pairs", "feature_residual", "cracks",
        "warnings", "options", "quality", "worst", "margin", "confidence", "rivals", "proposals",
        "starts", "likely_right", "doubtful",
    ):  # fmt: skip
        assert key in report
    for name in ("Covered", "Stretch", "Faces folded", "Round-trip error"):
        assert f"\n  {name}" in done.stdout
    assert any(f"\n{grade}: " in done.stdout for grade in ("Good", "Fair", "Poor"))

    again = run(
        "morph", out / "source.ply", out / "target.ply", "--out", pair / "again",
        "--features", pair / "features.json", "--threads", 1,
    )  # fmt: skip
    assert again.returncode == 0, again.stderr


def test_vertices_are_morphed_as_they_are_in_the_file(pair: Path) -> None:
    run("morph", pair / "plane.off", pair / "bump.off", "--out", pair / "out")
    shape = formats.read(pair / "plane.off")
    np.testing.assert_array_equal(xyz(pair / "out" / "source.ply"), shape.positions)


def test_closed_models_are_cut_along_the_loop(tmp_path: Path) -> None:
    clouds = {"source": ball(400), "target": 2.0 * ball(300)}
    for name, points in clouds.items():
        np.savetxt(tmp_path / f"{name}.xyz", points)
    rows = [around(points) for points in clouds.values()]
    marks = {
        "features": {name: [rows[0][name], rows[1][name]] for name in rows[0]},
        "loop": list(rows[0]),
    }
    (tmp_path / "features.json").write_text(json.dumps(marks))
    done = run(
        "morph", tmp_path / "source.xyz", tmp_path / "target.xyz", "--out", tmp_path / "out",
        "--features", tmp_path / "features.json", "--method", "paper",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "report.json").read_text())["domain"] == "cut"
    i, j = np.load(tmp_path / "out" / "pairs.npy").T
    assert len(np.unique(i)) == 400
    assert len(np.unique(j)) == 300
    assert np.linalg.norm(2.0 * clouds["source"][i] - clouds["target"][j], axis=1).mean() < 0.3


def test_closed_models_meet_on_the_sphere(tmp_path: Path) -> None:
    clouds = {"source": ball(400), "target": 2.0 * ball(300)}
    for name, points in clouds.items():
        np.savetxt(tmp_path / f"{name}.xyz", points)
    rows = [around(points) for points in clouds.values()]
    marks = {"features": {name: [rows[0][name], rows[1][name]] for name in rows[0]}}
    (tmp_path / "features.json").write_text(json.dumps(marks))
    done = run(
        "morph", tmp_path / "source.xyz", tmp_path / "target.xyz", "--out", tmp_path / "out",
        "--features", tmp_path / "features.json", "--method", "paper", "--domain", "sphere",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "report.json").read_text())["domain"] == "sphere"
    i, j = np.load(tmp_path / "out" / "pairs.npy").T
    assert len(np.unique(i)) == 400
    assert len(np.unique(j)) == 300
    assert np.linalg.norm(2.0 * clouds["source"][i] - clouds["target"][j], axis=1).mean() < 0.4


def test_a_shorter_second_run_leaves_no_old_frames(pair: Path) -> None:
    for frames in (4, 2):
        done = run(
            "morph",
            pair / "plane.off",
            pair / "bump.off",
            "--out",
            pair / "o",
            "--frames",
            frames,
            "--features",
            pair / "features.json",
        )
        assert done.returncode == 0
    assert sorted(p.name for p in (pair / "o").glob("frame_*")) == [
        "frame_0000.ply",
        "frame_0001.ply",
    ]


def test_samples_and_settings(pair: Path) -> None:
    done = run(
        "morph", pair / "plane.off", pair / "bump.off", "--out", pair / "o", "--samples", 700,
        "--features", pair / "features.json", "--pairing-cluster-size", 6, "--lod_cluster_size", 8,
        "--influence-radius", "0.4", "--method", "paper", "--domain", "disk",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(xyz(pair / "o" / "source.ply")) == len(xyz(pair / "o" / "target.ply")) == 700
    options = json.loads((pair / "o" / "report.json").read_text())["options"]
    assert options["pairing_cluster_size"] == 6
    assert options["lod_cluster_size"] == 8
    assert options["influence_radius"] == 0.4
    first = xyz(pair / "o" / "source.ply")[0]  # kept features come first
    places = [0, 0, 0], [0.5, 0, 0], [0, -0.5, 0], [-1, -1, 0]
    assert any(np.isclose(first, place).all() for place in places)


def test_features_of_every_kind(pair: Path) -> None:
    def rows(side: int, x: float) -> list[int]:
        column = round((x + 1) / 2 * (side - 1))
        return [column * side + k for k in range(side // 4, side - side // 4)]

    def near(side: int, x: float) -> list[int]:
        positions = grid(side)
        return np.flatnonzero(np.hypot(positions[:, 0] - x, positions[:, 1]) < 0.3).tolist()

    marks = {
        "middle": [8 * A + 8, 6 * B + 6],
        "tip": {"source": A * 12 + 8, "target": B * 10 + 6, "weight": 0.5, "hard": False},
        "seam": {"kind": "curve", "source": rows(A, -0.5), "target": rows(B, -0.4)},
        "spot": {"kind": "region", "source": {"rows": near(A, 0.5)}, "target": near(B, 0.6)},
    }
    (pair / "kinds.json").write_text(json.dumps({"features": marks}))
    for extra in ([], ["--samples", 500]):
        done = run(
            "morph", pair / "plane.off", pair / "bump.off", "--out", pair / "o",
            "--features", pair / "kinds.json", *extra,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        kept = json.loads((pair / "o" / "report.json").read_text())["features"]
        assert [(name, k["kind"], k["hard"]) for name, k in kept.items()] == [
            ("middle", "point", True), ("tip", "point", False),
            ("seam", "curve", False), ("spot", "region", False),
        ]  # fmt: skip
        assert kept["middle"]["residual"] == 0
        assert kept["tip"]["weight"] == 0.5
        assert kept["seam"]["residual"] < 0.5
        assert kept["spot"]["inside"] > 0.9
        for name in ("tip (point)", "seam (curve)", "spot (region)"):
            assert f"\n  {name}: " in done.stdout

    (pair / "worse.json").write_text('{"features": {"spot": {"kind": "region", "sorce": []}}}')
    done = run(
        "morph", pair / "plane.off", pair / "bump.off", "--out", pair / "p",
        "--features", pair / "worse.json",
    )  # fmt: skip
    assert done.returncode == 1
    assert 'feature "spot"' in done.stderr
    assert "'sorce'" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "status", "word"),
    [
        ([], 2, "usage"),
        (["morph"], 2, "required"),
        (["morph", "plane.off", "bump.off"], 2, "--out"),
        ([*PAIR, "--out", "o", "--colour", "1"], 2, "--colour"),
        ([*PAIR, "--out", "o", "--pth", "linear"], 2, "unknown option --pth. Did you mean --path?"),
        (["mroph", "plane.off", "bump.off"], 2, "Did you mean morph?"),
        ([*PAIR, "more.off", "--out", "o"], 2, "too many arguments: more.off"),
        ([*PAIR, "--out", "o", "--frames", "x"], 2, "--frames: expected a whole number, found 'x'"),
        ([*PAIR, "--out", "o", "--omega", "x"], 2, "--omega: expected a number, found 'x'"),
        ([*PAIR, "--save", "o", "--frames", "2"], 2, "--out DIR"),
        ([*PAIR, "--out", "o", "--mesh", "source"], 2, "--frames N"),
        ([*PAIR, "--out", "o", "--frames", "1"], 2, "at least 2"),
        ([*PAIR, "--out", "o", "--samples", "0"], 2, "at least 1"),
        ([*PAIR, "--out", "o", "--influence", "0"], 2, "0.51 to 1000"),
        ([*PAIR, "--out", "o", "--method", "x"], 2, "paper"),
        ([*PAIR, "--out", "o", "--method", "pap"], 2, "paper"),
        (["morph", "none.off", "bump.off", "--out", "o"], 1, "no such file"),
        ([*PAIR, "--out", "o", "--features", "none.json"], 1, "none.json"),
        (["morph", "plane.off", "bump.off", "--out", "plane.off"], 1, "plane.off"),
        ([*PAIR, "--out", "o", "--features", "bad.json"], 1, "JSON"),
        ([*PAIR, "--out", "o", "--features", "odd.json"], 1, "nose"),
        ([*PAIR, "--out", "o", "--features", "twice.json"], 1, "'nose' twice in one object"),
        ([*PAIR, "--out", "o", "--stagger-overlap", "0.3"], 2, "--stagger KIND"),
        (
            [*PAIR, "--out", "o", "--features", "odd.json", "--samples", "999"],
            1,
            "nose",
        ),
    ],
)  # fmt: skip
def test_wrong_calls_say_what_to_do(
    pair: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], status: int, word: str
) -> None:
    monkeypatch.chdir(pair)
    (pair / "twice.json").write_text('{"features": {"nose": [5, 7], "nose": [8, 9]}}')
    (pair / "bad.json").write_text("{")
    (pair / "odd.json").write_text('{"features": {"nose": [99999, 0]}}')
    done = run(*arguments)
    assert done.returncode == status, done.stderr
    assert word in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    if arguments:
        assert done.stderr.startswith("pointmorph: ")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "options", "word"),
    [
        ("source.off", ["--save", "source.off"], "save"),
        ("target.ply", ["--out", "."], "target.ply"),
        ("mesh_0000.ply", ["--out", ".", "--frames", "2"], "mesh_0000.ply"),
        ("frame_0007.ply", ["--out", ".", "--save", "a.morph"], "frame_0007.ply"),
    ],
)
def test_models_are_not_written_over(
    pair: Path, monkeypatch: pytest.MonkeyPatch, name: str, options: list[str], word: str
) -> None:
    monkeypatch.chdir(pair)
    if name.endswith(".off"):
        (pair / "plane.off").rename(name)
    else:
        shape = formats.read("plane.off")
        assert shape.faces is not None
        colors = np.ones((len(shape.positions), 4))
        formats.write_mesh(name, shape.positions, shape.positions, colors, shape.faces)
    before = (pair / name).read_bytes()
    done = run("morph", name, "bump.off", *options)
    assert done.returncode == 2
    assert word in done.stderr
    assert (pair / name).read_bytes() == before
    assert run("propose", name, "bump.off", "--out", name).returncode == 2
    assert (pair / name).read_bytes() == before


def test_help_lists_what_counts_once_with_its_range() -> None:
    morph, propose = (run(command, "--help").stdout for command in ("morph", "propose"))
    assert "--wrap-conform VALUE" in morph
    assert "wrap_conform" not in morph
    assert "8 to 64 points" in " ".join(morph.split())
    assert "--stagger-overlap" in morph
    assert "--stagger-overlap" not in propose
    assert "usage: pointmorph morph SOURCE TARGET --out DIR [--OPTION VALUE ...]\n" in morph


def test_lines_fit_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("COLUMNS", "69")
    text, piped = Terminal(), io.StringIO()
    lines = [
        f"  - {'word ' * 30}end",
        "  Cracks                    17 %  of the points drift apart on the way",
    ]
    for line in lines:
        terminal.say(line, text)
        terminal.say(line, piped)
    assert piped.getvalue() == "".join(f"{line}\n" for line in lines)
    shown = text.getvalue().splitlines()
    assert max(map(len, shown)) <= 69
    assert shown[1].startswith("    word")
    assert shown[-1] == " " * 34 + "way"


def test_a_reader_that_stops_ends_no_run(pair: Path) -> None:
    words = [sys.executable, "-m", "pointmorph", "morph", *PAIR[1:], "--out", "piped"]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=pair
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert "Traceback" not in process.stderr.read().decode()
    assert process.returncode == 0
    assert (pair / "piped" / "report.json").is_file()


@pytest.mark.skipif(sys.platform == "win32", reason="folders are locked in other ways there")
@pytest.mark.parametrize("threads", [1, 2])
def test_clouds_in_ply_files_are_read_and_written_side_by_side(
    tmp_path: Path, threads: int
) -> None:
    heads = {
        "text": "ply\nformat ascii 1.0\nelement vertex {}\n",
        "blocks": "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
    }
    numbers = "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    shapes = {"text": grid(A, 0.0), "blocks": grid(B, 0.8)}
    for name, positions in shapes.items():
        rows = positions.astype("<f4")
        content = (
            "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
            if name == "text"
            else rows.tobytes()
        )
        head = heads[name].format(len(rows)) + numbers
        (tmp_path / f"{name}.ply").write_bytes(head.encode() + content)
    files = [tmp_path / f"{name}.ply" for name in shapes]
    done = run("morph", *files, "--out", tmp_path / "out", "--threads", threads)
    assert done.returncode == 0, done.stderr
    for side, positions in zip(("source", "target"), shapes.values(), strict=True):
        written = xyz(tmp_path / "out" / f"{side}.ply")
        np.testing.assert_array_equal(written, positions.astype("<f4"))

    # The first file is the one that is said, and words among numbers are noticed on any thread.
    files[1].write_bytes(files[1].read_bytes()[:-1])
    done = run("morph", *files, "--out", tmp_path / "out", "--threads", threads)
    assert done.returncode == terminal.FAILED
    assert "blocks.ply" in done.stderr
    files[0].write_text(files[0].read_text() + " nonsense")
    done = run("morph", *files, "--out", tmp_path / "out", "--threads", threads)
    assert done.returncode == terminal.FAILED
    assert "text.ply" in done.stderr
    assert "blocks.ply" not in done.stderr


def test_an_unwritable_folder_is_said(pair: Path) -> None:
    if os.geteuid() == 0:
        out = Path("/proc/pointmorph")
    else:
        (pair / "locked").mkdir(mode=0o500)
        out = pair / "locked" / "o"
    done = run("morph", pair / "plane.off", pair / "bump.off", "--out", out)
    assert done.returncode == 1
    assert str(out) in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C can't be sent to one process there")
def test_control_c_ends_at_once_and_leaves_no_half_file(tmp_path: Path) -> None:
    write_off(tmp_path / "plane.off", 151, 0.0)
    write_off(tmp_path / "bump.off", 151, 0.8)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, "morph", "plane.off", "bump.off", "--out", "out", "--frames", "500"],
        cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        # a parent in the background of a shell would hand down that the signal is ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    while not list(out.glob("frame_*.ply")) and process.poll() is None:
        time.sleep(0.01)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in stderr
    assert not list(out.glob(".*"))
    assert not (out / "report.json").exists()
    assert len(list(out.glob("frame_*.ply"))) < 500
    for path in out.glob("frame_*.ply"):
        assert len(xyz(path)) > 0


def test_help_lists_every_setting() -> None:
    from pointmorph import options

    text = run("morph", "--help").stdout
    for option in options():
        assert f"--{option.name.replace('_', '-')}" in text


def test_version() -> None:
    import pointmorph

    assert run("--version").stdout == f"pointmorph {pointmorph.__version__}\n"


def test_real_patches_from_end_to_end(patch_pair: tuple, tmp_path: Path) -> None:
    folder, _ = patch_pair
    done = run(
        "morph", folder / "source.ply", folder / "target.ply", "--out", tmp_path,
        "--features", folder / "pair.json", "--frames", 5,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pairs = np.load(tmp_path / "pairs.npy")
    source, target = (formats.read(folder / f"{side}.ply") for side in ("source", "target"))
    np.testing.assert_array_equal(xyz(tmp_path / "frame_0000.ply"), source.positions[pairs[:, 0]])
    np.testing.assert_array_equal(xyz(tmp_path / "frame_0004.ply"), target.positions[pairs[:, 1]])


def test_resampled_frames_have_ids_and_velocities(pair: Path) -> None:
    out = pair / "out"
    done = run(
        "morph", pair / "plane.off", pair / "bump.off", "--out", out,
        "--features", pair / "features.json", "--frames", 3, "--resample", "--omega", 2,
        "--path", "linear",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pairs = np.load(out / "pairs.npy")
    counts = []
    for number in range(3):
        rows = PlyData.read(str(out / f"frame_{number:04d}.ply"))["vertex"].data
        assert rows.dtype.names[-5:] == ("radius", "id", "vx", "vy", "vz")
        np.testing.assert_array_equal(rows["id"][: len(pairs)], np.arange(len(pairs)))
        counts.append(len(rows))
    assert counts[0] == counts[2] == len(pairs)
    first, second = (xyz(out / f"frame_{number:04d}.ply")[: len(pairs)] for number in (0, 1))
    rows = PlyData.read(str(out / "frame_0000.ply"))["vertex"].data[: len(pairs)]
    velocity = np.stack([rows[c] for c in ("vx", "vy", "vz")], axis=-1)
    np.testing.assert_allclose(second - first, velocity, atol=1e-6)  # straight: a frame's way
    report = json.loads((out / "report.json").read_text())
    assert report["resampled"]["frames"] == counts
    assert report["resampled"]["inserted"] >= counts[1] - len(pairs)


def test_proposals_make_a_features_file_that_morph_takes(pair: Path) -> None:
    models, proposed = [pair / "plane.off", pair / "bump.off"], pair / "proposed.json"
    done = run("propose", *models, "--features", pair / "features.json", "--out", proposed)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[0].split() == ["vertices", "source", "target"]
    content = json.loads(proposed.read_text())
    given = json.loads((pair / "features.json").read_text())["features"]
    assert given.items() <= content["features"].items()
    assert set(content["confidence"]) == set(content["features"]) - set(given)
    assert content["confidence"]
    assert all(0 <= value <= 1 for value in content["confidence"].values())
    for side, count in enumerate((A * A, B * B)):
        rows = [rows[side] for rows in content["features"].values()]
        assert len(set(rows)) == len(rows)
        assert all(0 <= row < count for row in rows)
    again = run("morph", *models, "--features", proposed, "--out", pair / "out")
    assert again.returncode == 0, again.stderr


@pytest.mark.parametrize("samples", [[], ["--samples", 300]])
def test_proposals_keep_features_of_any_kind_as_they_were_given(pair: Path, samples: list) -> None:
    given = {
        "soft": {"source": 5, "target": 6, "weight": 0.5, "hard": False},
        "edge": {"kind": "curve", "source": [0, 8, 16], "target": [0, 12]},
        "patch": {"kind": "region", "source": [144, 145], "target": {"rows": [84]}},
    }
    file, proposed = pair / "kinds.json", pair / "proposed.json"
    file.write_text(json.dumps({"features": given, "loop": ["soft"]}))
    models = [pair / "plane.off", pair / "bump.off"]
    done = run("propose", *models, "--features", file, "--out", proposed, *samples)
    assert done.returncode == 0, done.stderr
    content = json.loads(proposed.read_text())
    assert {name: content["features"][name] for name in given} == given
    assert content["loop"] == ["soft"]
    found = [rows for name, rows in content["features"].items() if name not in given]
    assert found
    assert not {source for source, _ in found} & {5, 0, 8, 16}
    assert not {target for _, target in found} & {6, 0, 12}
    del content["loop"]
    proposed.write_text(json.dumps(content))
    again = run("morph", *models, "--features", proposed, "--out", pair / "out")
    assert again.returncode == 0, again.stderr


def test_proposals_from_samples_are_rows_of_the_files(pair: Path) -> None:
    proposed = pair / "proposed.json"
    done = run(
        "propose", pair / "plane.off", pair / "bump.off", "--samples", 300, "--out", proposed
    )
    assert done.returncode == 0, done.stderr
    for rows in json.loads(proposed.read_text())["features"].values():
        assert 0 <= rows[0] < A * A
        assert 0 <= rows[1] < B * B


def test_proposals_arent_for_the_papers_method(pair: Path) -> None:
    done = run(
        "propose", pair / "plane.off", pair / "bump.off", "--method", "paper", "--out", "x.json"
    )
    assert done.returncode == 2
    assert "Leave the method out" in done.stderr
