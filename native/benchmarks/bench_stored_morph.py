"""A saved morph of many pairs: how long it takes to open, and a frame beside a copy in memory.

    bench_stored_morph.py [--pairs N] [--runs N] [--threads N]

The file has normals, colors and radii, and is made anew in a folder of its own. The copy is
numpy's, on one thread, of as many bytes as the frame reads and writes. Frame and copy take turns;
of each, the median counts.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pointmorph import __version__, open_morph
from pointmorph.storage import array_files

COLUMNS = {"positions": (3,), "normals": (3,), "colors": (4,), "radii": ()}


def write(path: Path, count: int) -> None:
    """A morph of two balls of so many points on straight paths."""
    rng = np.random.default_rng(1)
    arrays = {"pairs": np.repeat(np.arange(count)[:, None], 2, axis=1)}
    for t, side in enumerate(("source", "target")):
        normals = rng.normal(size=(count, 3)).astype(np.float32)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        values = {
            "positions": (1 + t) * normals,
            "normals": normals,
            "colors": rng.random((count, 4), np.float32),
            "radii": np.full(count, 0.01, np.float32),
        }
        for name, rows in values.items():
            arrays[f"frame_{t}/{name}"] = rows
            arrays[f"{side}/{name}"] = rows
        arrays[f"{side}/images"] = arrays[f"{side}/positions"]
    header = {
        "format": "pointmorph morph",
        "version": 1,
        "made_by": __version__,
        "names": ["source", "target"],
        "options": {"path": "linear"},
        "report": {},
        "origin": {},
    }
    array_files.write(path, header, arrays)


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=31)
    parser.add_argument("--threads", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "many.morph")
        write(path, chosen.pairs)
        measure(path, chosen.runs, chosen.threads)


def measure(path: Path, runs: int, threads: int) -> None:
    print(f"{path.stat().st_size / 1e6:.0f} MB, {threads} thread(s), medians of {runs} runs")
    first = seconds(lambda: open_morph(path))
    opened = statistics.median(seconds(lambda: open_morph(path)) for _ in range(runs))
    print(f"opened: {1e3 * first:.1f} ms the first time, {1e3 * opened:.1f} ms after that")
    morph = open_morph(path, threads=threads)
    out = morph.empty_frame()
    print(f"first frame, which brings the file into memory: "
          f"{1e3 * seconds(lambda: morph.frame(0.3, out)):.1f} ms")  # fmt: skip
    moved = 3 * sum(array.nbytes for array in vars(out).values())  # two ends are read, one written
    source = np.ones(moved // 2, np.uint8)
    target = np.zeros_like(source)
    frames, copies = [], []
    for _ in range(runs):
        frames.append(seconds(lambda: morph.frame(0.3, out)))
        copies.append(seconds(lambda: np.copyto(target, source)))
    frame, copy = statistics.median(frames), statistics.median(copies)
    print(
        f"a frame reads and writes {moved / 1e6:.0f} MB in {1e3 * frame:.1f} ms; "
        f"a copy of as many bytes takes {1e3 * copy:.1f} ms: {frame / copy:.2f} times"
    )


if __name__ == "__main__":
    main()
