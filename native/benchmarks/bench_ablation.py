"""What each step of the default map buys: made shapes, mapped with one step off at a time.

    bench_ablation.py [--seeds N] [--points N] [--steps WORDS] [--json FILE]

No marks are given. The truth is known at every point of every shape: two poses of one figure
(`made_figures`), two draws of a kind of body (`made_bodies`), two draws of many parts
(`made_shapes`). Steps are switched off by options that the package doesn't show
(`switches/step_switches.cpp`, which is compiled first), against what `build_addon.py setup` has
installed. With --steps, only those whose names hold one of the words, split by commas.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import pointmorph
from build_tools.inner_modules import compiled
from compare_measures import Floats, Surface, cloud_area, smoothness
from made_bodies import FAMILIES as BODIES
from made_bodies import Body, body_pair
from made_figures import FIGURES, figure_pair
from made_shapes import FAMILIES as LOOSE
from made_shapes import Samples, loose_pair, sampled
from pointmorph.morphs import morphing

ROOT = Path(__file__).resolve().parents[2]
BUILT = ROOT / "build" / "bench" / "switches"
OFF, WRONG = 0.1, 0.3
"""√area by which a point is off; share of such points in a map that is wrong."""
COLUMNS = ("wrong", "error", "error of right ones", "off, %", "flips, %", "stretch, p99", "seconds")


@dataclass(frozen=True)
class Pair:
    name: str
    sides: tuple[Body | Samples, Body | Samples]


def pairs(seeds: int, points: int) -> Iterator[Pair]:
    for name, figure in FIGURES.items():
        for seed in range(2 * seeds):
            yield Pair(f"{name} {seed}", figure_pair(figure, seed, points))
    for families in BODIES.values():
        for family in families:
            for seed in range(seeds):
                yield Pair(f"{family.__name__} {seed}", body_pair(family, seed, points, 2.0))
    for kind in LOOSE:
        for seed in range(seeds):
            made = loose_pair(kind, seed)
            source, target = (sampled(made, points, of_source=k == 0, seed=k + 1) for k in (0, 1))
            yield Pair(f"loose {made.name}", (source, target))


def cloud(side: Body | Samples) -> pointmorph.Cloud:
    parts = side.parts if isinstance(side, Samples) else None
    return pointmorph.Cloud(side.positions, normals=side.normals, parts=parts)


def distances(here: Body | Samples, there: Body | Samples, images: Floats) -> Floats:
    """Of the points that both shapes have, in √area, from where each belongs."""
    away: Floats = np.linalg.norm(images - here.truth, axis=1)[here.is_shared]
    return away / np.sqrt(cloud_area(there.positions))


def surface(side: Body | Samples) -> Surface:
    none = np.empty((0, 3))
    return Surface(side.positions, side.normals, cloud_area(side.positions), none, none)


def measure(pair: Pair, module: ModuleType, step: str | None) -> dict[str, float]:
    plain = morphing.native_options

    def without_step(settings: dict[str, object]) -> object:
        options = plain(settings)
        if step:
            module.switch_off(options, step)
        return options

    source, target = pair.sides
    with mock.patch.object(morphing, "native_options", without_step):
        start = time.process_time()
        morph = pointmorph.morph(cloud(source), cloud(target))
        seconds = time.process_time() - start
    away = np.concatenate(
        [
            distances(source, target, morph.source_to_target),
            distances(target, source, morph.target_to_source),
        ]
    )
    rows = np.asarray(morph.pairs, dtype=np.int64)
    ways = [
        smoothness(surface(here), surface(there), way, np.random.default_rng(0))
        for here, there, way in ((source, target, rows), (target, source, rows[:, ::-1]))
    ]
    return {
        "error": float(away.mean()),
        "off": float((away > OFF).mean()),
        "flips": (ways[0].flips + ways[1].flips) / 2,
        "stretch": max(way.stretch_p99 for way in ways),
        "confidence": float(morph.report["confidence"]),
        "seconds": seconds,
    }


def row(step: str, found: dict[str, dict[str, float]]) -> str:
    all_of = {k: np.array([f[k] for f in found.values()]) for k in next(iter(found.values()))}
    is_wrong = all_of["off"] > WRONG
    right = float(all_of["error"][~is_wrong].mean()) if not is_wrong.all() else float("nan")
    cells = [
        f"{is_wrong.sum()} of {len(is_wrong)}",
        f"{all_of['error'].mean():.3f}",
        f"{right:.4f}",
        f"{100 * all_of['off'].mean():.1f}",
        f"{100 * all_of['flips'].mean():.2f}",
        f"{all_of['stretch'].mean():.2f}",
        f"{all_of['seconds'].mean():.2f}",
    ]
    return f"| {step} | " + " | ".join(cells) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--points", type=int, default=3000)
    parser.add_argument("--steps", default="")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    folder = Path(__file__).parent / "switches"
    module = compiled("step_switches", folder, BUILT)
    made = list(pairs(chosen.seeds, chosen.points))
    steps = [s for s in module.names() if any(w in s for w in chosen.steps.split(","))]
    print("| switched off | " + " | ".join(COLUMNS) + " |\n|---" + "|--:" * len(COLUMNS) + "|")
    result = {}
    for step in (None, *steps):
        found = {pair.name: measure(pair, module, step) for pair in made}
        result[step or "nothing"] = found
        print(row(step or "nothing", found), flush=True)
        if chosen.json:
            chosen.json.write_text(json.dumps(result, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
