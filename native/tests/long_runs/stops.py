"""Stops `pointmorph morph` at random moments and in every way, and looks at what it leaves.

It is killed, asked to end, runs out of disk or memory, and loses its folder. After each, every file
that has its name must be whole, nothing half-written may be left once it is run again, and that
run must write the same bytes as one that was never stopped.

python native/tests/long_runs/stops.py --kills 200 --report FILE.json

Needs Linux; without root, no disk can be filled.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "python")]

import numpy as np  # noqa: E402
import pointmorph  # noqa: E402
from pointmorph import formats  # noqa: E402
from reporting import Report  # noqa: E402
from shapes import grid, grid_faces  # noqa: E402

SIDE = 40
FRAMES = 8
PART = "pointmorph-part"
_LEAST_MEMORY = 256
"""MiB. With less, the libraries that Python loads may not start: scipy's OpenBLAS tries forever."""
REPORT, KEPT = "report.json", "kept.morph"  # they hold seconds: no two runs write the same


class Trial:
    """One command, its undisturbed result, and what it is compared with."""

    def __init__(self, folder: Path, report: Report) -> None:
        self.folder, self.report = folder, report
        self.out = folder / "out"
        self.models = [folder / "flat.obj", folder / "bump.obj"]
        for path, height in zip(self.models, (0.0, 0.6), strict=True):
            up = np.tile(np.float32([0, 0, 1]), (SIDE**2, 1))
            white = np.ones((SIDE**2, 4))
            formats.write_mesh(path, grid(SIDE, height), up, white, grid_faces(SIDE))
        start = time.monotonic()
        assert self.run().returncode == 0
        self.seconds = time.monotonic() - start
        self.whole = self.files()
        assert (self.out / KEPT).exists()
        shutil.rmtree(self.out)

    def command(self, out: Path) -> list[str]:
        options = ["--frames", str(FRAMES), "--resample", "--mesh", "source", "--threads", "1"]
        options += ["--save", str(out / KEPT), "--out", str(out)]
        return [sys.executable, "-m", "pointmorph", "morph", *map(str, self.models), *options]

    def start(self, out: Path | None = None, **more: object) -> subprocess.Popen[str]:
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen(self.command(out or self.out), **pipes, **more)  # type: ignore[call-overload]

    def run(self, out: Path | None = None, **more: object) -> subprocess.CompletedProcess[str]:
        process = self.start(out, **more)
        _, errors = process.communicate(timeout=600)
        return subprocess.CompletedProcess([], process.returncode, "", errors)

    def files(self, out: Path | None = None) -> dict[str, bytes]:
        out = out or self.out
        paths = [path for path in out.rglob("*") if path.is_file()]
        paths = [path for path in paths if path.name not in (REPORT, KEPT)]
        return {str(path.relative_to(out)): path.read_bytes() for path in sorted(paths)}

    def look(self, what: str, out: Path | None = None, *, may_leave: bool) -> None:
        """That everything with a name of its own is whole."""
        for name, content in self.files(out).items():
            if name.endswith(PART):
                if not may_leave:
                    self.report.finds.append(f"{what}: left {name}")
            elif self.whole.get(name) != content:
                self.report.finds.append(f"{what}: {name} is broken or new")
        out = out or self.out
        try:
            if (out / REPORT).exists():
                json.loads((out / REPORT).read_text())
            if (out / KEPT).exists():
                pointmorph.open_morph(out / KEPT).check()
        except (ValueError, pointmorph.FileError) as error:
            self.report.finds.append(f"{what}: {error}")

    def again(self, what: str) -> None:
        """That a run to the end cleans up and makes the same bytes."""
        done = self.run()
        if done.returncode != 0:
            self.report.finds.append(f"{what}: run again, it ended with {done.returncode}")
        elif self.files() != self.whole:
            self.report.finds.append(f"{what}: run again, it made other files")
        shutil.rmtree(self.out, ignore_errors=True)

    def say(self, what: str, errors: str, status: int, expected: tuple[int, ...]) -> None:
        """That it ended with that status, and with words."""
        if status not in expected or "Traceback" in errors or (status > 0 and not errors.strip()):
            self.report.finds.append(f"{what}: ended with {status}: {errors[-300:]}")


def kills(trial: Trial, count: int, chance: random.Random) -> None:
    ways = {signal.SIGKILL: (-9,), signal.SIGTERM: (143,), signal.SIGINT: (130,)}
    for number in range(count):
        how = [*ways][number % 3]
        process = trial.start()
        time.sleep(chance.uniform(0, 1.1 * trial.seconds))
        process.send_signal(how)
        _, errors = process.communicate(timeout=600)
        what = f"{how.name} {number}"
        # While Python loads the modules, a signal ends it as it ends any program of Python's; after
        # the end, it comes too late.
        if process.returncode != -how:
            trial.say(what, errors, process.returncode, (*ways[how], 0))
        trial.look(what, may_leave=how == signal.SIGKILL)
        if number % 4 == 0:
            trial.again(what)


def full_disks(trial: Trial, count: int) -> None:
    room = sum(map(len, trial.whole.values())) // 1024
    for number in range(count):
        size = 16 + (room - 16) * number // count
        out = trial.folder / "disk" / "out"
        out.parent.mkdir(exist_ok=True)
        script = 'mount -t tmpfs -o size="$1"k tmpfs "$2" && shift 2 && "$@"; s=$?; '
        script += f'cp -a "{out}" "{trial.out}"; exit $s'
        words = ["unshare", "--mount", "sh", "-c", script, "sh", str(size), str(out.parent)]
        done = subprocess.run([*words, *trial.command(out)], capture_output=True, text=True)
        what = f"disk of {size} KiB"
        trial.say(what, done.stderr, done.returncode, (1,))
        trial.look(what, may_leave=False)
        shutil.rmtree(trial.out, ignore_errors=True)


def vanished_folders(trial: Trial, count: int, chance: random.Random) -> None:
    for number in range(count):
        process = trial.start()
        time.sleep(chance.uniform(0.2, 1.0) * trial.seconds)
        shutil.rmtree(trial.out, ignore_errors=True)
        _, errors = process.communicate(timeout=600)
        trial.say(f"folder {number}", errors, process.returncode, (0, 1))
        shutil.rmtree(trial.out, ignore_errors=True)


def little_memory(trial: Trial, count: int) -> None:
    for number in range(count):
        limit = (_LEAST_MEMORY + 700 * number // count) << 20
        limited = partial(resource.setrlimit, resource.RLIMIT_AS, (limit, limit))
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        done = trial.run(preexec_fn=limited, env=environment)
        what = f"{limit >> 20} MiB of memory"
        imported = "import" not in done.stderr  # Python itself may not start
        if imported:
            trial.say(what, done.stderr, done.returncode, (0, 1))
        trial.look(what, may_leave=False)
        shutil.rmtree(trial.out, ignore_errors=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    chance, others = random.Random(chosen.seed), max(chosen.kills // 8, 1)
    report = Report("Stopped at any moment")
    with tempfile.TemporaryDirectory() as folder:
        trial = Trial(Path(folder), report)
        report.tried["kills and signals"] = chosen.kills
        kills(trial, chosen.kills, chance)
        if os.geteuid() == 0:
            report.tried["full disks"] = others
            full_disks(trial, others)
        report.tried["folders that vanished"] = others
        vanished_folders(trial, others, chance)
        report.tried["limits of memory"] = others
        little_memory(trial, others)
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
