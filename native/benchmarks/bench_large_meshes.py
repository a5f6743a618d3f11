"""What it costs to wrap a large mesh onto another, and how soon that stops when it's canceled.

    bench_large_meshes.py [--vertices N] [--json FILE] [PAIR...]

A PAIR is a folder with pair.json and the meshes that it names (`source_mesh`, `target_mesh`);
without any, those of shared/data beside the checkout that have faces. Faces are quartered until
both meshes have N vertices or more. Each row is a process of its own: the map, then the wrapped
mesh with one thread and with two. U is the time to find 16 neighbors of all vertices, with two
threads. Memory is what wrapping adds to the process at its largest, for each vertex of the source.
Times depend on the machine. Linux only.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
import unit_of_time
from pointmorph import formats

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
STOPS = 20

Array = np.ndarray[Any, Any]


def quartered(positions: Array, faces: Array) -> tuple[Array, Array]:
    """The same surface, every triangle cut into four at the middles of its sides."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, number = np.unique(sides, axis=0, return_inverse=True)
    a, b, c = faces.T
    ab, bc, ca = (number.reshape(-1, 3) + len(positions)).T
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    middles = positions[edges].mean(axis=1)
    return np.concatenate([positions, middles]), np.concatenate([np.stack(p, 1) for p in parts])


def meshes(folder: Path) -> list[formats.Shape]:
    """Source and target."""
    pair = json.loads((folder / "pair.json").read_text())
    names = [pair.get(f"{side}_mesh") or pair[side] for side in ("source", "target")]
    return [formats.read(folder / name) for name in names]


def large(shape: formats.Shape, vertices: int) -> pointmorph.Cloud:
    """With one vertex at each place, and so many of them."""
    places, number = np.unique(np.asarray(shape.positions, float), axis=0, return_inverse=True)
    faces = number.reshape(-1)[np.asarray(shape.faces)]
    while len(places) < vertices:
        places, faces = quartered(places, faces)
    return pointmorph.Cloud(places, faces=faces)


def memory(what: str) -> int:
    """A figure of the process, in bytes."""
    found = re.search(rf"{what}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1]) * 1024


def latest_stop(morph: pointmorph.Morph, seconds: float) -> float:
    """The longest time from when a run is to stop until it has, of some random moments."""
    moments, latest = random.Random(1), 0.0
    for _ in range(STOPS):
        begin = time.perf_counter()
        due = begin + moments.uniform(0.0, 0.9 * seconds)
        try:
            morph.wrapped(1.0, lambda *_, due=due: time.perf_counter() < due)
        except pointmorph.Cancelled:
            latest = max(latest, time.perf_counter() - due)
    return latest


def row(folder: Path, vertices: int, threads: int, expected: float) -> dict[str, Any]:
    """`expected` seconds with one thread; runs are stopped within two fifths of that."""
    source, target = clouds = [large(shape, vertices) for shape in meshes(folder)]
    unit_of_time.ready()
    start = time.perf_counter()
    for cloud in clouds:
        unit_of_time.find_neighbors(cloud.positions)
    unit = time.perf_counter() - start
    morph = pointmorph.morph(source, target, threads=threads)
    latest = 0.0
    if threads > 1:
        # The faces are prepared once, by the first that asks.
        latest = latest_stop(morph, 0.4 * expected)
    Path("/proc/self/clear_refs").write_text("5")
    before, start = memory("VmRSS"), time.perf_counter()
    places = morph.wrapped(1.0)
    seconds = time.perf_counter() - start
    return {
        "pair": folder.name,
        "vertices": [len(cloud) for cloud in clouds],
        "unit": unit,
        "seconds": seconds,
        "bytes": (memory("VmHWM") - before) / len(clouds[0]),
        "latest_stop": latest,
        "bits": hashlib.sha256(np.ascontiguousarray(places).tobytes()).hexdigest(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vertices", type=int, default=150_000)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--threads", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--expected", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("pairs", nargs="*", type=Path, metavar="PAIR")
    chosen = parser.parse_args()
    if chosen.threads is not None:
        print(json.dumps(row(chosen.pairs[0], chosen.vertices, chosen.threads, chosen.expected)))
        return 0
    folders = chosen.pairs or [path.parent for path in sorted(SHARED.glob("*/pair.json"))]
    found = []
    print("pair | vertices | U, s | 1 thread, s | 2 threads, s | ratio | bytes | latest stop, s")
    for folder in folders:
        if any(shape.faces is None for shape in meshes(folder)):
            print(f"{folder.name} | left out: no faces")
            continue
        runs = []
        for threads in (1, 2):
            words = [sys.executable, __file__, "--threads", str(threads)]
            if runs:
                words += ["--expected", str(runs[0]["seconds"])]
            words += ["--vertices", str(chosen.vertices), str(folder)]
            runs.append(json.loads(subprocess.check_output(words, text=True).splitlines()[-1]))
        one, two = runs
        if one["bits"] != two["bits"]:
            raise SystemExit(f"{folder.name}: other bits with two threads")
        print(
            folder.name,
            " / ".join(f"{count:,}" for count in one["vertices"]),
            f"{two['unit']:.2f}",
            f"{one['seconds']:.1f}",
            f"{two['seconds']:.1f}",
            f"{one['seconds'] / two['seconds']:.2f}",
            f"{one['bytes']:.0f}",
            f"{two['latest_stop']:.2f}",
            sep=" | ",
            flush=True,
        )
        found += runs
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
