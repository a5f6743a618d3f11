"""The paper's Table I again, and what a whole correspondence costs.

    bench_morph.py [--json FILE] [--quick]

Times of one run on one machine; ratios are what carries over. The unit U is what building both
kd-trees and asking 16 neighbours of every point takes, in the same process on the same threads.
Patches are faces of scanned busts where these are beside the checkout (shared/data, both
redistributable), else analytic reliefs; the table says which.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
import unit_of_time
from pointmorph import formats, meshes

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "nefertiti_demosthenes"
# Points of the paper's three pairs.
SIZES = ((40818, 109450), (98250, 84348), (118250, 34234))
RUNS = 5


def relief(waves: float) -> formats.Shape:
    """A disk with a wavy height, as a mesh."""
    side = 200
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    z = 0.3 * np.cos(waves * x) * np.cos(waves * y) + 0.4 * np.exp(-2 * (x**2 + y**2))
    positions = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + side, corner + side + 1], axis=-1),
            np.stack([corner, corner + side + 1, corner + 1], axis=-1),
        ]
    )
    return formats.Shape(f"relief {waves:g}", positions, faces=faces)


def shapes() -> tuple[list[formats.Shape], dict[str, tuple[int, int]]]:
    if SHARED.is_dir():
        features = json.loads((SHARED / "pair.json").read_text())["features"]
        pair = [formats.read(SHARED / f"{side}.ply") for side in ("source", "target")]
        pair[0].name, pair[1].name = "Nefertiti", "Demosthenes"
        return pair, {name: tuple(rows) for name, rows in features.items()}
    middle = 100 * 200 + 100
    return [relief(5.0), relief(8.0)], {"middle": (middle, middle)}


def clouds(sizes: tuple[int, int]) -> tuple[list[pointmorph.Cloud], dict[str, tuple[int, int]]]:
    """The pair sampled with these numbers of points."""
    pair, features = shapes()
    result, rows = [], []
    for side, (shape, count) in enumerate(zip(pair, sizes, strict=True)):
        cloud, kept = meshes.sample(shape, count, keep=[f[side] for f in features.values()])
        result.append(cloud)
        rows.append(kept.tolist())
    return result, dict(zip(features, zip(*rows, strict=True), strict=True))


def resident(field: str) -> int:
    """VmHWM or VmRSS of this process in bytes; 0 where the system doesn't say."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(x.split()[1]) * 1024 for x in lines if x.startswith(field)), 0)


def measured(sizes: tuple[int, int], settings: dict[str, Any], runs: int) -> dict[str, Any]:
    """One pair in a process of its own, so that the peak of memory is its own."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        return pool.apply(_measure, (sizes, settings, runs))


def _measure(sizes: tuple[int, int], settings: dict[str, Any], runs: int) -> dict[str, Any]:
    pair, features = clouds(sizes)
    unit_of_time.ready()
    units, seconds = [], []
    before = resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts again from here
    morph = pointmorph.morph(*pair, features, **settings)
    peak = resident("VmHWM") - before
    for _ in range(runs):
        start = time.perf_counter()
        for cloud in pair:
            unit_of_time.find_neighbors(cloud.positions)
        units.append(time.perf_counter() - start)
        start = time.perf_counter()
        morph = pointmorph.morph(*pair, features, **settings)
        seconds.append(time.perf_counter() - start)
    report = morph.report
    return {
        "source": pair[0].name,
        "target": pair[1].name,
        "points": list(sizes),
        "seconds": statistics.median(seconds),
        "unit_seconds": statistics.median(units),
        "units": statistics.median(s / u for s, u in zip(seconds, units, strict=True)),
        "bytes_per_point": peak / sum(sizes),
        "stages": report["stages"],
        "cracks": report["cracks"],
        "parameterization": [report["source_parameterization"], report["target_parameterization"]],
        "disks": [morph.source_domain, morph.target_domain],
    }


def deviation(full: dict[str, Any], lod: dict[str, Any]) -> list[dict[str, float]]:
    """How far the two solutions end up from each other, in disk radii, the alignment included."""
    result = []
    for a, b in zip(full["disks"], lod["disks"], strict=True):
        apart = np.linalg.norm(a - b, axis=1)
        result.append({"mean": float(apart.mean()), "p99": float(np.percentile(apart, 99))})
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="one size, one run")
    chosen = parser.parse_args()
    runs = 1 if chosen.quick else RUNS
    rows = []
    for sizes in SIZES[:1] if chosen.quick else SIZES:
        full = measured(sizes, {"solve": "full"}, 1)
        lod = measured(sizes, {"solve": "lod"}, runs)
        row = {"lod": lod, "full": full, "deviation": deviation(full, lod)}
        for solved in (full, lod):
            del solved["disks"]
        rows.append(row)

    print("Table I: the full system against the simplified one (source / target)\n")
    print("| pair | points | solve | unknowns | iterations | solve, s | morph, s | bytes a point |")
    print("|---|---|---|---|---|---|---|---|")
    for row in rows:
        for solve in ("full", "lod"):
            r = row[solve]
            p = r["parameterization"]
            columns = [
                f"{r['source']} / {r['target']}",
                f"{r['points'][0]:,} / {r['points'][1]:,}",
                solve,
                f"{p[0]['unknowns']:,} / {p[1]['unknowns']:,}",
                f"{p[0]['iterations']} / {p[1]['iterations']}",
                f"{p[0]['solve_seconds']:.3f} / {p[1]['solve_seconds']:.3f}",
                f"{r['seconds']:.2f}",
                f"{r['bytes_per_point']:.0f}",
            ]
            print("| " + " | ".join(columns) + " |")
    print("\nThe whole correspondence (lod) against U\n")
    print("| points | U, s | morph, s | ratio | disks differ from full: mean, p99 (radii) |")
    print("|---|---|---|---|---|")
    for row in rows:
        r = row["lod"]
        apart = ", ".join(f"{d['mean']:.4f}, {d['p99']:.4f}" for d in row["deviation"])
        print(
            f"| {r['points'][0]:,} / {r['points'][1]:,} | {r['unit_seconds']:.3f} "
            f"| {r['seconds']:.3f} | {r['units']:.2f} | {apart} |"
        )
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
