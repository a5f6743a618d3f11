"""How much memory a morph takes at most, by what is done: docs/reliability.md states these bounds.

    python native/tests/python/memory_bounds.py KIND POINTS

prints how many bytes more a process takes at its peak than before it began.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

BOUNDS = {
    "automatic": (48, 600),
    "automatic, with its quality": (48, 650),
    "paper, disk": (6, 400),
    "paper, disk, solve=full": (6, 1050),
    "paper, cut": (16, 420),
    "paper, sphere": (10, 430),
    "paper, network": (70, 250),
    "resampled frames": (48, 1000),
    "wrapped meshes": (48, 1600),
    "marks that are followed": (48, 1350),
}
"""Megabytes that it takes however few the points are, and bytes more for each point of both shapes:
a quarter more than was measured at 4,000 to 160,000 points, on two threads."""


def bound(kind: str, points: int) -> int:
    megabytes, bytes_a_point = BOUNDS[kind]
    return 1_000_000 * megabytes + bytes_a_point * points


def peak_of(kind: str, points: int) -> tuple[int, int]:
    """Bytes that it takes in a process of its own, and the points of both shapes."""
    words = [sys.executable, __file__, kind, str(points)]
    two = {**os.environ, "OMP_NUM_THREADS": "2"}  # each thread has some of its own
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=two)
    taken, count = done.stdout.split()
    return int(taken), int(count)


def _memory(what: str) -> int:
    # getrusage tells the peak of whoever started this process as well.
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(what))


def _work(kind: str, points: int) -> tuple[Callable[[], object], int]:
    """What is to be measured, and the points of both shapes."""
    import pointmorph
    from shapes import around, around_torus, ball, grid, grid_faces, torus

    if kind == "paper, network":
        across = 3 * round((points / 54) ** 0.5)
        tori = [pointmorph.Cloud(torus(tube, 3 * across, across)) for tube in (0.4, 0.3)]
        both = {name: (row, row) for name, row in around_torus(3 * across, across).items()}
        return lambda: pointmorph.morph(*tori, both, method="paper"), 6 * across**2
    if kind in ("paper, cut", "paper, sphere", "marks that are followed"):
        balls = [ball(points // 2) * axes for axes in ([1.0, 1.0, 0.8], [1.2, 1.0, 0.9])]
        rows = [around(at) for at in balls]
        marks = {name: (rows[0][name], rows[1][name]) for name in rows[0]}
        shapes = [pointmorph.Cloud(at) for at in balls]
        count = 2 * (points // 2)
        if kind == "paper, cut":
            return lambda: pointmorph.morph(*shapes, marks, loop=list(marks), method="paper"), count
        if kind == "paper, sphere":
            return lambda: pointmorph.morph(*shapes, marks, method="paper", domain="sphere"), count

        def follow() -> object:
            live = pointmorph.LiveMorph.of(pointmorph.morph(*shapes, marks))
            back = int(balls[1][:, 2].argmax())
            return live.updated({**marks, "top": (int(balls[0][:, 2].argmax()), back)})

        return follow, count
    side = round((points / 2) ** 0.5)
    faces = grid_faces(side) if kind == "wrapped meshes" else None
    sheets = [pointmorph.Cloud(grid(side, height), faces=faces) for height in (0.2, 0.5)]
    asked: dict[str, Callable[[], object]] = {
        "automatic": lambda: pointmorph.morph(*sheets),
        "automatic, with its quality": lambda: pointmorph.morph(*sheets).quality,
        "paper, disk": lambda: pointmorph.morph(*sheets, method="paper"),
        "paper, disk, solve=full": lambda: pointmorph.morph(*sheets, method="paper", solve="full"),
        "resampled frames": lambda: pointmorph.morph(*sheets).resampled_frame(0.5),
        "wrapped meshes": lambda: pointmorph.morph(*sheets).wrapped(0.5),
    }
    return asked[kind], 2 * side**2


if __name__ == "__main__":
    work, number = _work(sys.argv[1], int(sys.argv[2]))
    before = _memory("VmRSS")
    kept = work()
    print(_memory("VmHWM") - before, number)
