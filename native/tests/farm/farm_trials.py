"""Batches that an engine runs, with tasks that are killed, next to a plain loop."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pointmorph
import pytest

HERE = Path(__file__).resolve().parent
RENDER_FRAMES = HERE.parents[2] / "docs" / "examples" / "render_frames.py"
POINTMORPH = [sys.executable, "-m", "pointmorph"]
TRIES = 5
"""To end a task in the middle."""
_PAUSE = 0.02
needs_blender = pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None,
    reason="Blender as a Python package isn't installed",
)
# What says when and how it was made; and Python's records of what was done with which morph file.
_OF_A_RUN = ("report.json", "job.json", "log.txt", "batch.json", "index.html")
_FOLDERS_OF_A_RUN = ("farm", "rendered")


# --- What is morphed ------------------------------------------------------------------------------


def write_ball(path: Path, rings: int, number: int) -> None:
    """A closed mesh with 2 `rings` (`rings` - 1) + 2 vertices, and three bumps of its own."""
    around = 2 * rings
    down = np.pi * np.arange(1, rings)[:, None] / rings
    along = 2 * np.pi * np.arange(around) / around
    inner = np.stack(
        [np.sin(down) * np.cos(along), np.sin(down) * np.sin(along), np.cos(down) + 0 * along], -1
    )
    points = np.concatenate([[[0, 0, 1]], inner.reshape(-1, 3), [[0, 0, -1]]])
    random = np.random.default_rng(number)
    bumps = random.normal(size=(3, 3))
    bumps /= np.linalg.norm(bumps, axis=1, keepdims=True)
    heights = np.array([0.9, 0.6, 0.4])
    points *= 1 + (heights * np.exp(-8 * (1 - points @ bumps.T))).sum(axis=1, keepdims=True)
    row = np.arange(around)
    after = (row + 1) % around
    last = len(points) - 1
    faces = [*np.stack([np.zeros_like(row), 1 + row, 1 + after], 1)]
    for ring in range(rings - 2):
        first, below = 1 + ring * around, 1 + (ring + 1) * around
        faces += [*np.stack([first + row, below + row, below + after, first + after], 1)]
    faces += [*np.stack([last - around + after, last - around + row, last + 0 * row], 1)]
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}\n" for x, y, z in points]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) + "\n" for face in faces]
    path.write_text("".join(lines))


def write_balls(folder: Path, pairs: int, rings: int, **content: object) -> Path:
    """A file of jobs: one ball onto so many others, each with another number of vertices."""
    (folder / "balls").mkdir(parents=True)
    write_ball(folder / "base.obj", rings, 0)
    for number in range(1, pairs + 1):
        write_ball(folder / "balls" / f"ball_{number:03d}.obj", rings + number % 5, number)
    template = {"source": "base.obj", "targets": "balls/*.obj"}
    path = folder / "jobs.json"
    path.write_text(json.dumps({"template": template, **content}))
    return path


def rendering(every: int, width: int, samples: int) -> dict[str, object]:
    """What a file of jobs has to say so that Cycles renders each frame whose number is a multiple
    of `every`."""
    words = ["{python}", str(RENDER_FRAMES), "--", "{frames}", "{out}", "{first}", "{last}"]
    words += ["--every={every}", f"--width={width}", f"--samples={samples}"]
    return {"render": words, "render_every": every}


# --- What becomes of it ---------------------------------------------------------------------------


def results(out: Path) -> dict[str, object]:
    """Every file of an output folder by its path, but for what says how long it took: its bytes,
    of a morph what it is but for its report, of a render all but Cycles' own notes."""
    found: dict[str, object] = {}
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        name = path.relative_to(out)
        if name.name in _OF_A_RUN or set(name.parts) & set(_FOLDERS_OF_A_RUN):
            continue
        if path.suffix == ".morph":
            header = pointmorph.open_morph(path).header
            found[str(name)] = {key: header[key] for key in ("arrays", "names", "options")}
        else:
            content = path.read_bytes()
            found[str(name)] = _without_times(content) if "renders" in name.parts else content
    return found


def _without_times(png: bytes) -> bytes:
    """A PNG file without the notes in which Cycles says how long it took."""
    kept, at = png[:8], 8
    while at < len(png):
        end = at + 12 + int.from_bytes(png[at : at + 4], "big")
        if not png[at + 4 :].startswith(b"tEXtcycles."):
            kept += png[at:end]
        at = end
    return kept


def differences(found: Mapping[str, object], expected: Mapping[str, object]) -> list[str]:
    """Files that are missing, too many or not the same, in words."""
    words = [f"{name} is missing" for name in sorted(expected.keys() - found.keys())]
    words += [f"{name} is too much" for name in sorted(found.keys() - expected.keys())]
    both = sorted(found.keys() & expected.keys())
    return words + [f"{name} has other bytes" for name in both if found[name] != expected[name]]


# --- Who runs it ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Kill:
    """The end of a task in the middle."""

    words: tuple[str, ...]
    """of the command line of its program, which also names the output folder"""
    done: str
    """pattern of files in the output folder"""
    least: int
    """how many of these there are by then"""


@dataclass
class Engine:
    """What runs a file of jobs into an output folder until all is over."""

    name: str
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))

    def start(self, jobs: Path, out: Path, chunk: int | None = None) -> subprocess.Popen[bytes]:
        """Begins. What it says is in a file beside the output folder."""
        with out.with_suffix(".log").open("ab") as log:
            return subprocess.Popen(
                self.words(jobs, out, chunk), env=self.environment, stdout=log, stderr=log
            )

    def words(self, jobs: Path, out: Path, chunk: int | None) -> list[str]:
        raise NotImplementedError


class Loop(Engine):
    """One process that makes all maps, frames, renders and the page, one after another."""

    def __init__(self) -> None:
        super().__init__("a plain loop", {**os.environ, "OMP_NUM_THREADS": "1"})

    def words(self, jobs: Path, out: Path, chunk: int | None) -> list[str]:
        return [sys.executable, str(HERE / "plain_loop.py"), str(jobs), str(out)]


class LocalBatch(Engine):
    """`pointmorph batch`, one process at a time."""

    def __init__(self) -> None:
        super().__init__("pointmorph batch --jobs 1", {**os.environ, "OMP_NUM_THREADS": "1"})

    def words(self, jobs: Path, out: Path, chunk: int | None) -> list[str]:
        return [*POINTMORPH, "batch", str(jobs), "--out", str(out), "--jobs", "1"]


class Slurm(Engine):
    """Tasks that are killed are run again by itself."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        super().__init__("Slurm", environment)

    def words(self, jobs: Path, out: Path, chunk: int | None) -> list[str]:
        words = [*POINTMORPH, "farm", "slurm", str(jobs), "--out", str(out), "--wait"]
        return words if chunk is None else [*words, "--chunk", str(chunk)]


class OpenJD(Engine):
    """The reference runner. It ends with a task that is killed, and is started again."""

    def __init__(self) -> None:
        super().__init__("Open Job Description", {**os.environ, "OMP_NUM_THREADS": "1"})

    def words(self, jobs: Path, out: Path, chunk: int | None) -> list[str]:
        template = jobs.parent / f"{out.name}.template.json"
        words = [*POINTMORPH, "farm", "openjd", str(jobs), "--out", str(out)]
        words += ["--template", str(template)]
        words += [] if chunk is None else ["--chunk", str(chunk)]
        subprocess.run(words, check=True, capture_output=True)
        run = [sys.executable, "-m", "openjd", "run", str(template)]
        return [*run, "-p", f"Python={sys.executable}"]


def processes(*words: str, within: str = "") -> list[int]:
    """Programs whose command line has these words, and one that lies in the folder `within`."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().decode(errors="replace").split("\0")
        except OSError:  # it has ended
            continue
        if set(words) <= set(line) and any(f"{one}/".startswith(f"{within}/") for one in line):
            found.append(int(path.parent.name))
    return found


def run_with_kills(
    engine: Engine, jobs: Path, out: Path, kills: Sequence[Kill], chunk: int | None = None
) -> None:
    """Has an engine run a file of jobs; on the way, tasks are killed, in this order. All over
    again where one of them was over before it could be killed. Raises AssertionError."""
    for _ in range(TRIES):
        left = list(kills)
        for _ in range(1 + len(kills)):  # an engine may end with a task that is killed
            process = engine.start(jobs, out, chunk)
            try:
                while process.poll() is None:
                    if left and _killed(left[0], out):
                        del left[0]
                    time.sleep(_PAUSE)
            finally:
                process.kill()
                process.wait()
            if process.returncode == 0:
                break
        assert process.returncode == 0, out.with_suffix(".log").read_text()[-3000:]
        if not left:
            return
        shutil.rmtree(out)
    raise AssertionError(f"{kills} could not be killed")


def _killed(kill: Kill, out: Path) -> bool:
    """Whether it was time to kill, and something was there."""
    if len(list(out.glob(kill.done))) < kill.least:
        return False
    found = processes(*kill.words, within=str(out))
    for process in found:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    return bool(found)


def small_trials(folder: Path) -> list[tuple[Path, list[Kill]]]:
    """A few pairs of which a task of maps is killed, and a morph of which one of renders is; what
    native/tests/long_runs/farm.py does with many."""
    pairs = write_balls(folder / "pairs", 4, 6, frames=3, resample=True)
    said = rendering(every=6, width=48, samples=2)
    morph = write_balls(folder / "morph", 1, 6, frames=24, resample=True, **said)
    return [
        (pairs, [Kill(("--maps",), "*/job.json", 1)]),
        (morph, [Kill((str(RENDER_FRAMES),), "*/renders/*.png", 1)]),
    ]


def trial_differences(engine: Engine, jobs: Path, kills: Sequence[Kill]) -> list[str]:
    """Has an engine run a file of jobs, with kills, and a plain loop; where their files differ."""
    with ThreadPoolExecutor(2) as pool:
        ours, loops = jobs.parent / "engine", jobs.parent / "loop"
        runs = [
            pool.submit(run_with_kills, engine, jobs, ours, kills),
            pool.submit(run_with_kills, Loop(), jobs, loops, []),
        ]
        for one in runs:
            one.result()
    return differences(results(ours), results(loops))
