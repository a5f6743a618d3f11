"""Runs batches through the real Slurm and the real runner of Open Job Description.

Many pairs, and a re-sampled morph of which Cycles renders some frames: in each, tasks are killed in
the middle, and all files must be those of a plain loop in one process, byte for byte. Then each
engine runs the pairs and nothing is killed, by turns with the loop, to see what it takes besides.

python native/tests/long_runs/farm.py --pairs 100 --frames 240 --renders 24 --report FILE.json

Needs Linux, root, Slurm, and what `build_addon.py setup --tests` installs.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), *(str(HERE.parent / name) for name in ("farm", "python"))]

from farm_trials import (  # noqa: E402
    RENDER_FRAMES,
    Engine,
    Kill,
    LocalBatch,
    Loop,
    OpenJD,
    Slurm,
    differences,
    rendering,
    results,
    run_with_kills,
    write_balls,
)
from reporting import Report, processor_seconds  # noqa: E402
from slurm_cluster import Cluster, why_not  # noqa: E402

RINGS = 27
"""The smallest ball has 1,406 vertices, the largest 1,862."""
MAPS = Kill(("--maps",), "*/job.json", 5)
FRAMES = Kill(("--part", "0/2"), "*/frames/frame_*.ply", 20)
RENDERS = Kill((str(RENDER_FRAMES),), "*/renders/*.png", 2)
_PR_SET_CHILD_SUBREAPER = 36
_REST = 1.0
"""Seconds until what ends with a batch has ended."""


class Trial:
    """A file of jobs, and what a plain loop makes of it."""

    def __init__(self, jobs: Path, what: str, report: Report, chunk: int | None = None) -> None:
        self.jobs, self.what, self.report, self.chunk = jobs, what, report, chunk
        self._expected: dict[str, object] = {}

    def compare(self, engine: Engine, kills: Sequence[Kill]) -> None:
        """Has an engine run it, with kills, and looks at all files."""
        if not self._expected:
            self._expected = self._made(Loop(), ())
            self.report.tried[f"{self.what}: files compared, by each engine"] = len(self._expected)
        what = f"{self.what}, {engine.name}"
        found = differences(self._made(engine, kills), self._expected)
        self.report.tried[f"{what}: tasks killed"] = len(kills)
        self.report.finds += [f"{what}: {words}" for words in found[:10]]
        _say(f"{what}: {len(found)} of {len(self._expected)} files differ")

    def measure(self, engines: Sequence[Engine], cluster: Cluster, rounds: int) -> None:
        """What engines take, in seconds and of the processor, next to the first of them."""
        taken: dict[str, list[tuple[float, float]]] = {one.name: [] for one in engines}
        for number in range(rounds):
            for engine in engines[:: 1 if number % 2 == 0 else -1]:
                before = time.monotonic(), _processor(cluster)
                self._made(engine, ())
                time.sleep(_REST)
                seconds = time.monotonic() - before[0] - _REST, _processor(cluster) - before[1]
                taken[engine.name].append(seconds)
                _say(f"{self.what}, {engine.name}: {seconds[0]:.1f} s, processor {seconds[1]:.1f}")
        middle = {
            name: [statistics.median(column) for column in zip(*rows, strict=True)]
            for name, rows in taken.items()
        }
        loop = engines[0].name
        for name, seconds in middle.items():
            for number, kind in enumerate(("wall time", "processor time")):
                words = f"{seconds[number]:.1f} s"
                if name != loop:
                    more = seconds[number] / middle[loop][number] - 1
                    words += f", {100 * more:+.1f} % next to {loop}"
                self.report.tried[f"{self.what}, {name}: {kind} of {rounds} runs"] = words

    def _made(self, engine: Engine, kills: Sequence[Kill]) -> dict[str, object]:
        """What an engine makes of it, in a folder of its own."""
        out = self.jobs.parent / "out"
        shutil.rmtree(out, ignore_errors=True)
        run_with_kills(engine, self.jobs, out, kills, self.chunk)
        return results(out)


def _processor(cluster: Cluster) -> float:
    """Seconds of all that this program has started."""
    _wait_for_orphans()
    return processor_seconds() + cluster.processor_seconds()


def _wait_for_orphans() -> None:
    """Tasks of Slurm's are this program's children once what has started them is gone; their time
    counts when they have been waited for."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


def run(chosen: argparse.Namespace, folder: Path, report: Report) -> None:
    cluster = Cluster(_made_folder(folder / "slurm"), cpus=1)
    try:
        cluster.start()
        known = {"slurm": Slurm(cluster.environment), "openjd": OpenJD(), "batch": LocalBatch()}
        engines = [known[name] for name in chosen.engines]
        jobs = write_balls(folder / "pairs", chosen.pairs, RINGS, frames=4, resample=True)
        pairs = Trial(jobs, f"{chosen.pairs} pairs", report)
        every = chosen.frames // chosen.renders
        said = rendering(every, width=chosen.width, samples=chosen.samples)
        jobs = write_balls(
            folder / "renders", 1, chosen.rings, frames=chosen.frames, resample=True, **said
        )
        what = f"{chosen.frames} frames, {chosen.renders} rendered"
        renders = Trial(jobs, what, report, chosen.frames // 2)
        farms = [one for one in engines if not isinstance(one, LocalBatch)]
        for engine in farms if "kills" in chosen.only else ():
            if "renders" in chosen.jobs:
                renders.compare(engine, (FRAMES, RENDERS))
            if "pairs" in chosen.jobs:
                pairs.compare(engine, (MAPS,))
        if "times" in chosen.only and "pairs" in chosen.jobs:
            pairs.measure([Loop(), *engines], cluster, chosen.rounds)
        if "times" in chosen.only and "renders" in chosen.jobs:
            # Tasks as large as the engine's own command makes them.
            Trial(renders.jobs, what, report).measure([Loop(), *farms], cluster, chosen.rounds)
    finally:
        cluster.stop()
        _wait_for_orphans()


def _made_folder(path: Path) -> Path:
    path.mkdir()
    return path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--renders", type=int, default=24)
    parser.add_argument("--rings", type=int, default=RINGS, help="of the balls that are rendered")
    parser.add_argument("--width", type=int, default=96, help="pixels of a render")
    parser.add_argument("--samples", type=int, default=4, help="of a pixel")
    kinds = ["pairs", "renders"]
    parser.add_argument("--jobs", choices=kinds, nargs="+", default=kinds)
    parser.add_argument("--rounds", type=int, default=3, help="runs that are measured")
    parser.add_argument("--only", choices=["kills", "times"], nargs="+", default=["kills", "times"])
    engines = ["slurm", "openjd", "batch"]
    parser.add_argument("--engines", choices=engines, nargs="+", default=engines)
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    if reason := why_not():
        parser.error(reason)
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    report = Report("Batches through farms' engines")
    with tempfile.TemporaryDirectory() as folder:
        run(chosen, Path(folder), report)
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
