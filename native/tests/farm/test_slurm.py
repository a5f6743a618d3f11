"""``pointmorph farm slurm`` on a real Slurm, on this machine alone."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import slurm_cluster
from command_runs import COMMAND
from farm_models import FRAMES, TRIES, frames_of, same_frames, write_models
from farm_trials import Kill, Slurm, needs_blender, processes, small_trials, trial_differences
from test_stored_commands import run

pytestmark = pytest.mark.skipif(
    slurm_cluster.why_not() is not None, reason=slurm_cluster.why_not() or ""
)

CHUNK = FRAMES // 2
# Writes down which of its frames are there.
RENDER = """
import sys; from pathlib import Path
frames, out, first, last = sys.argv[1:]
Path(out).mkdir(exist_ok=True)
there = [k for k in range(int(first), int(last) + 1) if Path(frames, f"frame_{k:04d}.ply").exists()]
Path(out, f"{first}.txt").write_text(f"{there[0]} {there[-1]} {len(there)}")
"""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[slurm_cluster.Cluster]:
    running = slurm_cluster.Cluster(tmp_path_factory.mktemp("slurm"))
    try:
        try:
            running.start()
        except TimeoutError as error:  # it may not be allowed what it needs
            pytest.skip(f"Slurm doesn't start here: {error}")
        yield running
    finally:
        running.stop()


@pytest.fixture(scope="module")
def jobs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of jobs with a pair that can be morphed and one that can't, and in `local` what the
    former becomes without Slurm."""
    folder = tmp_path_factory.mktemp("jobs")
    command = [sys.executable, "-c", RENDER, "{frames}", "{out}", "{first}", "{last}"]
    path = write_models(folder, render=command)
    done = run("batch", path, "--out", folder / "local", "--range", "0")
    assert done.returncode == 0, done.stderr
    return path


def submit(
    cluster: slurm_cluster.Cluster, jobs: Path, out: Path, *options: str
) -> subprocess.Popen[str]:
    words = [*COMMAND, "farm", "slurm", str(jobs), "--out", str(out), "--chunk", str(CHUNK)]
    return subprocess.Popen(
        [*words, *options], env=cluster.environment, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def until(holds: Callable[[], object], seconds: float = 200.0) -> None:
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def was_killed(log: Path) -> bool:
    return log.exists() and "was killed and runs again" in log.read_text()


def states(out: Path) -> dict[str, str]:
    rows = json.loads((out / "batch.json").read_text())["pairs"]
    return {row["pair"]: row["state"] for row in rows}


def test_a_task_that_is_killed_is_run_again_and_all_is_as_without_slurm(
    cluster: slurm_cluster.Cluster, jobs: Path, tmp_path: Path
) -> None:
    part = f"0/{FRAMES // CHUNK}"
    for attempt in range(TRIES):  # one may be over before it can be killed
        out = tmp_path / str(attempt)
        log = out / "farm" / "logs" / "frames_0_0.log"
        farm = submit(cluster, jobs, out, "--wait")
        until(lambda out=out: len(frames_of(out)) > 5)
        for process in processes("--part", part, str(out)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        until(lambda farm=farm, log=log: was_killed(log) or farm.poll() is not None)
        if was_killed(log):
            break
    assert was_killed(log)
    before = {path: path.stat().st_mtime_ns for path in frames_of(out)}
    said, errors = farm.communicate(timeout=300)
    # The other pair can't be morphed, and says why; its other tasks find no map.
    assert farm.returncode == 3, errors
    assert "a_to_c: the map, the frames and the renders to do" in said
    assert states(out) == {"a_to_b": "kept", "a_to_c": "pending"}
    assert "c.obj: expected" in (out / "farm" / "logs" / "maps_0.log").read_text()
    for name in ("frames", "renders"):
        assert "Compute it first" in (out / "farm" / "logs" / f"{name}_1_0.log").read_text()
    assert not cluster.ask("squeue", "-h")
    assert same_frames(out, jobs.parent / "local")
    assert 5 < len(before) < FRAMES
    whole = {path.stem for path in before if path.stat().st_mtime_ns == before[path]}
    assert len(whole) >= len(before) - 4  # those that were being written
    # Renders come after the frames that they show.
    rendered = sorted(path.read_text() for path in (out / "a_to_b" / "renders").iterdir())
    assert rendered == [f"0 {CHUNK - 1} {CHUNK}", f"{CHUNK} {FRAMES - 1} {CHUNK}"]
    assert not (out / "a_to_c" / "renders").exists()


@needs_blender
def test_pairs_and_renders_are_those_of_a_loop_after_kills(
    cluster: slurm_cluster.Cluster, tmp_path: Path
) -> None:
    def differ(trial: tuple[Path, list[Kill]]) -> list[str]:
        return trial_differences(Slurm(cluster.environment), *trial)

    # Side by side: a task that was killed waits a while until it is run again.
    with ThreadPoolExecutor() as pool:
        assert list(pool.map(differ, small_trials(tmp_path))) == [[], []]


def test_scancel_leaves_nothing_half_written(
    cluster: slurm_cluster.Cluster, jobs: Path, tmp_path: Path
) -> None:
    for attempt in range(TRIES):  # one may be over before it is canceled
        out = tmp_path / str(attempt)
        said, errors = submit(cluster, jobs, out).communicate(timeout=60)
        [numbers] = re.findall(r"scancel ([\d ]+)", said)
        assert "array jobs submitted" in said, errors
        until(lambda out=out: len(frames_of(out)) > 5)
        cluster.ask("scancel", *numbers.split())
        cluster.until_over()
        until(lambda out=out: not processes(str(out)))
        if len(frames_of(out)) < FRAMES:
            break
    assert 5 < len(frames_of(out)) < FRAMES
    assert not [path for path in out.rglob("*") if path.name.endswith("-part")]
    report = run("batch", jobs, "--out", out, "--report")
    assert report.returncode == 1
    assert "a_to_b: the frames to do" in report.stdout
    done = run("batch", jobs, "--out", out, "--range", "0")
    assert done.returncode == 0, done.stderr
    assert same_frames(out, jobs.parent / "local")


def test_what_slurm_refuses_is_said_and_nothing_stays_in_the_queue(
    cluster: slurm_cluster.Cluster, jobs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = submit(cluster, jobs, tmp_path, "--sbatch=--partition=none")
    _, errors = farm.communicate(timeout=60)
    assert farm.returncode == 2
    assert "invalid partition" in errors
    assert not cluster.ask("squeue", "-h")
    monkeypatch.setenv("PATH", str(tmp_path))
    missing = run("farm", "slurm", jobs, "--out", tmp_path)
    assert missing.returncode == 2
    assert "found no sbatch" in missing.stderr
