"""Whether memory grows: over a thousand morphs, ten thousand frames, and everything between.

python native/tests/long_runs/memory.py --morphs 1000 --frames 10000 --report FILE.json

Needs Linux.
"""

from __future__ import annotations

import argparse
import gc
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "python")]

import pointmorph  # noqa: E402
from reporting import Report  # noqa: E402
from shapes import ball, grid, grid_faces  # noqa: E402

ALLOWED = 8 << 20
"""Bytes that may come once everything has run for a while: the allocator keeps some."""


def resident() -> int:
    """Bytes of memory that this process has now."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096


def morph(number: int) -> pointmorph.Morph:
    """One of a few kinds, by turns, and what people ask of it; each fifth is cancelled."""
    faces = grid_faces(20) if number % 2 else None
    sheets = [pointmorph.Cloud(grid(20, height), faces=faces) for height in (0.1, 0.6)]
    balls = [pointmorph.Cloud(ball(300 + 40 * k)) for k in range(2)]
    shapes = sheets if number % 3 else balls
    steps = 0

    def progress(stage: str, done: float) -> bool:
        nonlocal steps
        steps += 1
        return number % 5 != 0 or steps < number % 17

    made = pointmorph.morph(*shapes, path="rigid" if number % 2 else "linear", progress=progress)
    _ = made.quality, made.report
    made.frame(0.5)
    made.resampled_frame(0.5)
    if made.has_mesh:
        made.wrapped(0.5)
    with tempfile.TemporaryDirectory() as folder:
        made.save(Path(folder) / "a.morph")
        pointmorph.open_morph(Path(folder) / "a.morph").frame(0.2)
    return made


def grown(report: Report, what: str, count: int, step: Callable[[int], object]) -> None:
    """Bytes that a number of repeats adds after a tenth of them."""
    for number in range(count // 10):
        step(number)
    before = resident()
    for number in range(count // 10, count):
        step(number)
    more = resident() - before
    report.tried[what] = count
    report.tried[f"{what}: KiB more"] = more // 1024
    if more > ALLOWED:
        report.finds.append(f"{what}: {more / 1e6:.1f} MB more")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--morphs", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    report = Report("Growth of memory")

    def one_morph(number: int) -> None:
        with suppress(pointmorph.Cancelled):
            morph(number)

    grown(report, "morphs", chosen.morphs, one_morph)
    kept = morph(1)
    grown(report, "frames", chosen.frames, lambda n: kept.frame(0.01 * (n % 100)))
    few = chosen.frames // 10
    grown(report, "resampled frames", few, lambda n: kept.resampled_frame(0.01 * (n % 100)))
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
