"""What it costs to follow a feature that is dragged, and whether the map stays as good.

    bench_live.py [--json FILE] [--drags N] [PAIR...]

A PAIR is a folder with source.ply, target.ply and pair.json (`features`; `landmarks` that aren't
features are measured); without any, those of shared/data beside the checkout. First times: making
a LiveMorph, a coarse update, a whole one. Then the drag: each feature in turn is put beside its
place by a few hundredths of √area, and taken back along N steps, each a whole update from the one
before. Landmark errors, in √area, of the map that comes out, and of a map from scratch with the
same features. Times depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
from pointmorph import formats
from pointmorph._pointmorph import nearest_rows

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
RUNS = 5
BESIDE = 0.06  # √area

Pairs = dict[str, tuple[int, int]]


def seconds(call: Callable[[], Any], runs: int = RUNS) -> tuple[float, Any]:
    """The median time of some calls, and what the last returned."""
    times, result = [], None
    for _ in range(runs):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def read(folder: Path) -> tuple[list[pointmorph.Cloud], Pairs, Pairs]:
    """Both clouds, the features, and the landmarks that are none."""
    pair = json.loads((folder / "pair.json").read_text())
    shapes = [formats.read(folder / pair[side]) for side in ("source", "target")]
    clouds = [
        pointmorph.Cloud(s.positions, None if s.faces is not None else s.normals, faces=s.faces)
        for s in shapes
    ]
    features = {name: tuple(rows) for name, rows in pair["features"].items()}
    marked = set(features.values())
    landmarks = {n: tuple(r) for n, r in pair.get("landmarks", {}).items()}
    return clouds, features, {n: r for n, r in landmarks.items() if r not in marked}


def root_of_area(positions: np.ndarray[Any, Any]) -> float:
    """About √area of the surface: from the distance between samples next to each other."""
    near = nearest_rows(positions, positions, 7)
    apart = np.linalg.norm(positions[near[:, 6]] - positions, axis=1)
    return float(np.sqrt((np.pi * apart**2 / 6).sum()))


def errors(morph: pointmorph.Morph, landmarks: Pairs, unit: float) -> list[float]:
    places, images = morph.target.positions, morph.source_to_target
    return [float(np.linalg.norm(images[s] - places[t])) / unit for s, t in landmarks.values()]


def times_of(folder: Path) -> dict[str, Any]:
    clouds, features, _ = read(folder)
    cold, morph = seconds(lambda: pointmorph.morph(*clouds, features), 1)
    made, live = seconds(lambda: pointmorph.LiveMorph.of(morph), 1)
    name = next(iter(features))
    moved = beside(clouds[1], features, name, root_of_area(clouds[1].positions))
    coarse, _ = seconds(lambda: live.source_to_target(moved))
    whole, _ = seconds(lambda: live.updated(moved))
    sizes = " / ".join(f"{len(cloud):,}" for cloud in clouds)
    print(
        f"{folder.name} | {sizes} | {cold:.2f} | {made:.2f} | {1 / coarse:.1f} | {whole:.2f}",
        flush=True,
    )
    return {"pair": folder.name, "scratch": cold, "made": made, "coarse": coarse, "whole": whole}


def beside(target: pointmorph.Cloud, features: Pairs, name: str, unit: float) -> Pairs:
    """The features, one of them put beside its place on the target."""
    source, row = features[name]
    apart = np.linalg.norm(target.positions - target.positions[row], axis=1) / unit
    return {**features, name: (source, int(np.argmin(abs(apart - BESIDE))))}


def drag(folder: Path, steps: int) -> dict[str, Any]:
    clouds, features, landmarks = read(folder)
    if not landmarks:
        return {}
    target, unit = clouds[1].positions, root_of_area(clouds[1].positions)
    scratch = pointmorph.morph(*clouds, features)
    morph, updates, words = scratch, 0, set()
    for name, (source, row) in features.items():
        away = beside(clouds[1], features, name, unit)
        start = target[away[name][1]]
        for k in range(steps + 1):
            place = start + (target[row] - start) * k / steps
            on = int(np.argmin(np.linalg.norm(target - place, axis=1)))
            morph = morph.updated({**features, name: (source, row if k == steps else on)})
            updates += 1
            words.add(morph._native.report()["update"].split(":")[0])
    before, after = (np.mean(errors(m, landmarks, unit)) for m in (scratch, morph))
    print(f"{folder.name} | {updates} | {before:.4f} | {after:.4f} | {', '.join(sorted(words))}")
    return {"updates": updates, "error": before, "error_after": after}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("pairs", type=Path, nargs="*")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--drags", type=int, default=10)
    arguments = parser.parse_args()
    pairs = arguments.pairs or [
        path for name in ("koala_spot_big", "koala_spot") if (path := SHARED / name).is_dir()
    ]
    print("pair | points | from scratch, s | LiveMorph, s | coarse updates a second | whole, s")
    rows = [times_of(folder) for folder in pairs]
    print("pair | updates | landmark error from scratch | after the updates | report")
    rows = [
        {**row, **drag(folder, arguments.drags)} for row, folder in zip(rows, pairs, strict=True)
    ]
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
