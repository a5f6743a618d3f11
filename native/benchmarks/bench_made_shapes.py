"""How right maps are between shapes made by script, where the truth is known at every point.

    bench_made_shapes.py [--kinds car,chair,…] [--seeds N] [--points N] [--json FILE]

Each line is a pair of `made_shapes`, mapped without marks and with default options, from samples
with normals; the parts are given, as faces give them.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import pointmorph
from compare_measures import Floats, Ints, Surface, Yardstick, cloud_area, similarity
from made_shapes import FAMILIES, MadePair, Samples, loose_pair, sampled

COLUMNS = ("error", "off", "astray", "tears", "flips", "p99", "dirichlet", "confidence", "seconds")
OFF = 0.1
"""In √area: a point farther from where it belongs is off."""


def cloud(samples: Samples) -> pointmorph.Cloud:
    return pointmorph.Cloud(samples.positions, normals=samples.normals, parts=samples.parts)


def surface(samples: Samples) -> Surface:
    none = np.empty((0, 3))
    area = cloud_area(samples.positions)
    return Surface(samples.positions, samples.normals, area, none, none)


def errors(samples: Samples, images: Floats, area: float) -> Floats:
    """Of the points that the other shape has, in √area."""
    off: Floats = np.linalg.norm(images - samples.truth, axis=1) / np.sqrt(area)
    return off[samples.is_shared]


def astray(source: Samples, target: Samples, pairs: Ints) -> float:
    """Share of the pairs of shared parts that join two parts."""
    shared = source.is_shared[pairs[:, 0]] & target.is_shared[pairs[:, 1]]
    joined = source.parts[pairs[:, 0]] != target.parts[pairs[:, 1]]
    return float(joined[shared].mean())


def measure(pair: MadePair, points: int) -> dict[str, float]:
    source = sampled(pair, points, of_source=True, seed=1)
    target = sampled(pair, round(0.8 * points), of_source=False, seed=2)
    start = time.perf_counter()
    morph = pointmorph.morph(cloud(source), cloud(target))
    seconds = time.perf_counter() - start
    on_source, on_target = surface(source), surface(target)
    off = np.concatenate(
        [
            errors(source, morph.source_to_target, on_target.area),
            errors(target, morph.target_to_source, on_source.area),
        ]
    )
    pairs = np.asarray(morph.pairs, dtype=np.int64)
    # Straight in-betweens say something about the map where both shapes lie alike.
    placed = on_target.moved(*similarity(source.truth[source.is_shared],
                                         source.positions[source.is_shared]))  # fmt: skip
    none = np.empty((0, 2), dtype=np.int64)
    found = Yardstick(on_source, placed, none, none).measure(pairs)
    return {
        "error": float(off.mean()),
        "off": 100 * float((off > OFF).mean()),
        "astray": 100 * astray(source, target, pairs),
        "tears": 100 * float(found["tears"] or 0.0),
        "flips": 100 * float(found["flips"] or 0.0),
        "p99": float(found["stretch_p99"] or 0.0),
        "dirichlet": max(float(found[k] or 0.0) for k in ("dirichlet", "dirichlet_back")),
        "confidence": float(morph.report["confidence"]),
        "seconds": seconds,
    }


def row(name: str, figures: dict[str, float]) -> str:
    return f"| {name} | " + " | ".join(f"{figures[k]:.3f}" for k in COLUMNS) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kinds", default=",".join(FAMILIES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    print("| pair | " + " | ".join(COLUMNS) + " |\n|---" + "|---" * len(COLUMNS) + "|", flush=True)
    found: dict[str, dict[str, float]] = {}
    for kind in chosen.kinds.split(","):
        for seed in range(chosen.seeds):
            pair = loose_pair(kind, seed)
            found[pair.name] = measure(pair, chosen.points)
            print(row(pair.name, found[pair.name]), flush=True)
    means = {k: float(np.mean([f[k] for f in found.values()])) for k in COLUMNS}
    print(row("**mean**", means))
    if chosen.json:
        chosen.json.write_text(json.dumps({**found, "mean": means}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
