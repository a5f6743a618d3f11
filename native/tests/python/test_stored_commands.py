"""``pointmorph morph --save``, ``frames`` and ``info``, as a script or a farm calls them."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pointmorph
import pytest
from command_runs import COMMAND
from pointmorph.commands import cli, terminal
from pointmorph.storage import files
from shapes import grid, grid_faces

COUNT = 5


def run(*words: object) -> subprocess.CompletedProcess[str]:
    """The command line in this process, as if it were one of its own."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        try:
            status = cli.main([str(word) for word in words])
        except SystemExit as end:  # of argparse
            status = int(str(end.code))
    return subprocess.CompletedProcess(words, status, out.getvalue(), errors.getvalue())


def write_obj(path: Path, side: int, height: float) -> None:
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in grid(side, height)]
    lines += [f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in grid_faces(side)]
    path.write_text("# kept\n" + "".join(lines))


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two models, a saved morph, and the frames of the same run in `out`."""
    folder = tmp_path_factory.mktemp("saved")
    write_obj(folder / "flat.obj", 17, 0.0)
    write_obj(folder / "bump.obj", 13, 0.8)
    done = run(
        "morph", folder / "flat.obj", folder / "bump.obj", "--out", folder / "out", "--save",
        folder / "pair.morph", "--frames", COUNT, "--resample", "--mesh", "source",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "out and " in done.stdout
    return folder


def frames(folder: Path, out: Path, *options: object) -> subprocess.CompletedProcess[str]:
    return run("frames", folder / "pair.morph", "--frames", COUNT, "--resample", "--mesh",
               "source", "--out", out, *options)  # fmt: skip


def same_files(folder: Path, out: Path) -> bool:
    names = [f"frame_{k:04d}.ply" for k in range(COUNT)]
    names += [f"mesh_{k:04d}.obj" for k in range(COUNT)]
    return all((out / n).read_bytes() == (folder / "out" / n).read_bytes() for n in names)


def test_ranges_in_any_order_make_the_very_files_of_the_run(saved: Path, tmp_path: Path) -> None:
    for part, made in (("3:", 2), (":2", 2), ("2", 1)):
        done = frames(saved, tmp_path, "--range", part, "--threads", made)
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        assert done.stdout.startswith(f"{made} frames made")
    assert same_files(saved, tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert frames(saved, tmp_path).stdout.startswith("0 frames made, 5 already done")
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_what_is_broken_or_of_another_run_is_made_anew(saved: Path, tmp_path: Path) -> None:
    assert frames(saved, tmp_path).returncode == 0
    with (tmp_path / "frame_0001.ply").open("r+b") as file:
        file.seek(-3, os.SEEK_END)
        file.write(b"x")
    (tmp_path / "mesh_0002.obj").unlink()
    (tmp_path / "records" / "frame_0003.json").write_text("{}")
    left = tmp_path / ".frame_0003.ply.0.pointmorph-part"
    left.write_text("of a killed process")
    os.utime(left, (0, 0))  # Windows can't tell a new one from a file that is being written
    checked = frames(saved, tmp_path, "--check")
    assert checked.returncode == 3
    assert checked.stdout.splitlines() == [
        *(f"frame {k} is missing or broken" for k in (1, 2, 3)),
        f"2 of 5 frames are done, in {tmp_path}",
    ]
    assert frames(saved, tmp_path, "--range", "1:3", "--check").returncode == 3
    assert frames(saved, tmp_path).stdout.startswith("3 frames made")
    assert same_files(saved, tmp_path)
    assert not list(tmp_path.glob(".*"))
    assert frames(saved, tmp_path, "--check").returncode == 0
    # Another number of frames is another run.
    other = run("frames", saved / "pair.morph", "--frames", 3, "--out", tmp_path, "--check")
    assert other.returncode == 3


def test_a_folder_with_a_long_name_holds_frames_and_their_records(
    saved: Path, tmp_path: Path
) -> None:
    folder = tmp_path.joinpath(*["ä " + "x" * 50] * 5)
    assert frames(saved, folder).stdout.startswith("5 frames made")
    assert frames(saved, folder).stdout.startswith("0 frames made, 5 already done")
    assert same_files(saved, files.reachable(folder))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without asking them")
@pytest.mark.parametrize(("how", "status"), [("SIGKILL", -9), ("SIGTERM", 143), ("SIGINT", 130)])
def test_a_run_that_is_killed_goes_on_where_it_was(
    saved: Path, tmp_path: Path, how: str, status: int
) -> None:
    options = ["--frames", "400", "--out", str(tmp_path)]
    job = subprocess.Popen(
        [*COMMAND, "frames", str(saved / "pair.morph"), *options],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    records = tmp_path / "records"
    while job.poll() is None and not list(records.glob("frame_00*.json")):
        time.sleep(0.01)
    job.send_signal(signal.Signals[how])
    _, errors = job.communicate(timeout=60)
    assert job.returncode == status
    if how != "SIGKILL":
        assert "again" in errors
        assert "Traceback" not in errors
        assert not [path for path in tmp_path.rglob("*") if path.name.endswith("-part")]
    done = {path.stem for path in records.glob("*.json")}
    assert 0 < len(done) < 400
    before = {name: (tmp_path / f"{name}.ply").stat().st_mtime_ns for name in done}
    again = run("frames", saved / "pair.morph", "--range", "0:30", *options)
    assert again.returncode == 0, again.stderr
    kept = [name for name in sorted(done) if name < "frame_0030"]
    assert all((tmp_path / f"{n}.ply").stat().st_mtime_ns == before[n] for n in kept)
    assert (
        run("frames", saved / "pair.morph", "--range", "0:30", "--check", *options).returncode == 0
    )


def test_two_processes_share_a_run(saved: Path, tmp_path: Path) -> None:
    words = [*COMMAND, "frames", str(saved / "pair.morph"), "--frames", str(COUNT), "--resample"]
    words += ["--mesh", "source", "--out", str(tmp_path), "--range"]
    jobs = [subprocess.Popen([*words, part], stdout=subprocess.DEVNULL) for part in ("0:2", "2:5")]
    assert [job.wait(timeout=100) for job in jobs] == [0, 0]
    assert same_files(saved, tmp_path)


def test_the_model_s_own_file_has_to_be_there_unchanged(saved: Path, tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    for name in ("flat.obj", "bump.obj", "pair.morph"):
        shutil.copy(saved / name, tmp_path / "models")
    out = tmp_path / "out"
    # Where it lies elsewhere than it did, whoever asks says where.
    moved = run("frames", tmp_path / "models" / "pair.morph", "--frames", COUNT, "--resample",
                "--mesh", "source", "--out", out,
                "--source", tmp_path / "models" / "flat.obj")  # fmt: skip
    assert moved.returncode == 0, moved.stderr
    assert same_files(saved, out)
    with (tmp_path / "models" / "flat.obj").open("a") as file:
        file.write("# changed\n")
    for given, words, status in (
        (tmp_path / "models" / "flat.obj", "has changed since", 1),
        (tmp_path / "models" / "none.obj", "nothing at", 2),
    ):
        done = frames(saved, out, "--range", ":1", "--source", given)
        assert done.returncode == status
        assert words in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--range", "7:9"], "found none"),
        (["--range", "3-4"], "expected A:B"),
        (["--frames", "1"], "at least 2"),
        (["--mesh", "ply", "--threads", "0"], "at least 1"),
    ],
)
def test_wrong_calls(saved: Path, tmp_path: Path, options: list[str], words: str) -> None:
    done = run("frames", saved / "pair.morph", "--frames", COUNT, "--out", tmp_path, *options)
    assert done.returncode == 2
    assert words in done.stderr
    neither = run("morph", saved / "flat.obj", saved / "bump.obj")
    assert neither.returncode == 2
    assert "--out DIR or --save FILE" in neither.stderr


def test_info_tells_what_a_file_is_and_whether_it_is_whole(saved: Path, tmp_path: Path) -> None:
    path = saved / "pair.morph"
    done = run("info", path)
    assert done.returncode == 0, done.stderr
    for words in ("flat to bump", "source and target", "kept", str(saved / "flat.obj"),
                  "All checksums match."):  # fmt: skip
        assert words in done.stdout, done.stdout
    header = json.loads(run("info", path, "--json").stdout)
    assert header["origin"]["command"][0] == "morph"
    assert header == pointmorph.open_morph(path).header

    changed = bytearray(path.read_bytes())
    changed[changed.index(pointmorph.open_morph(path).pairs.tobytes()) + 9] ^= 1
    (tmp_path / "broken.morph").write_bytes(changed)
    (tmp_path / "other.morph").write_text("ply\n")
    for name in ("broken", "other", "none"):
        file = tmp_path / f"{name}.morph"
        for command in (["info", file], ["frames", file, "--frames", 3, "--out", tmp_path / "o"]):
            refused = run(*command)
            assert refused.returncode == 1, refused.stdout
            assert f"{name}.morph: expected" in refused.stderr
            assert "Traceback" not in refused.stderr
    assert not list(tmp_path.glob("o/frame*"))


def test_a_morph_is_saved_without_a_folder(saved: Path, tmp_path: Path) -> None:
    done = run("morph", saved / "flat.obj", saved / "bump.obj", "--save", tmp_path / "a.morph")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.morph"]
    ours, theirs = (pointmorph.open_morph(p) for p in (tmp_path / "a.morph", saved / "pair.morph"))
    for name in ("pairs", "source/ends", "frame_1/normals"):
        assert ours.header["arrays"][name] == theirs.header["arrays"][name]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without asking them")
@pytest.mark.parametrize("fails", [True, False])
def test_an_end_that_an_import_took_for_its_failure_is_an_end(fails: bool) -> None:
    def run_on() -> None:
        with terminal.orderly_end(), terminal.bars() as progress:
            assert progress("matching", 0.0)
            with contextlib.suppress(BaseException):
                os.kill(os.getpid(), signal.SIGTERM)
            if fails:
                raise pointmorph.FileError("a.obj", "a module", "none", "Install it.")
            progress("matching", 0.1)

    with pytest.raises(terminal.Terminated):
        run_on()
    with terminal.orderly_end(), terminal.bars() as progress:  # the next run isn't ended
        assert progress("matching", 0.0)
