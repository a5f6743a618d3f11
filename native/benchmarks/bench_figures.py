"""How thin parts are mapped: tails, ears and fingers of figures made by script, in two poses.

    bench_figures.py [--seeds N] [--points N,N] [--thin FACTOR]

Two poses of one build (`made_figures`), without marks. Lengths are in spacings of the points:

error           mean distance from where a point belongs
thin            the same for points of thin parts
strays          share of thin parts' points whose image lies next to another part, in %
short           by how much the image of a tail or a finger ends before its counterpart; mean, most
"""

from __future__ import annotations

import argparse
import sys
from unittest import mock

import made_figures
import numpy as np
import pointmorph
from compare_measures import Floats, Ints, cloud_area
from made_bodies import Body
from made_figures import FIGURES, THIN, Limb, figure_pair, limb_numbers
from made_shapes import Part
from scipy.spatial import cKDTree

HEADS = ("error", "thin", "strays", "short", "most short")
JOINTS = 3
"""A limb of as many parts has an end whose direction is clear."""


def shortfalls(here: Body, there: Body, images: Floats, limbs: Ints, thin: set[int]) -> list[float]:
    """Of thin limbs with joints, by how much images end before the limb, seen along it."""
    found = []
    for limb in thin:
        parts = np.flatnonzero(limbs == limb)
        mine = limbs[here.parts] == limb
        its = [there.positions[there.parts == part] for part in parts]
        if len(parts) < JOINTS or not mine.any() or min(map(len, its)) == 0:
            continue
        outward = its[-1].mean(axis=0) - its[0].mean(axis=0)
        outward /= np.linalg.norm(outward)
        found.append(float((its[-1] @ outward).max() - (images[mine] @ outward).max()))
    return found


def measure(kind: str, seed: int, points: int) -> list[float]:
    source, target = figure_pair(FIGURES[kind], seed, points)
    names, limbs = limb_numbers(FIGURES[kind], seed)
    thin = {k for k, name in enumerate(names) if any(word in name for word in THIN)}
    morph = pointmorph.morph(source.cloud(), target.cloud())
    rows = []
    for here, there, images in (
        (source, target, morph.source_to_target),
        (target, source, morph.target_to_source),
    ):
        spacing = np.sqrt(cloud_area(there.positions) / len(there.positions))
        away = np.linalg.norm(images - here.truth, axis=1) / spacing
        of_thin = np.isin(limbs[here.parts], list(thin))
        _, next_to = cKDTree(there.positions).query(images)
        stray = limbs[here.parts] != limbs[there.parts[next_to]]
        short = np.array(shortfalls(here, there, images, limbs, thin)) / spacing
        rows.append([away[here.is_shared].mean(), away[of_thin & here.is_shared].mean(),
                     100 * stray[of_thin].mean(), short.mean(), short.max()])  # fmt: skip
    both = np.array(rows)
    return [*both[:, :4].mean(axis=0), both[:, 4].max()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--points", default="5000,10000")
    parser.add_argument("--thin", type=float, default=1.0, help="times as thick")
    chosen = parser.parse_args()
    grow = Limb.grow

    def thinner(limb: Limb, length: float, radius: float, bend: tuple[float, float, float]) -> Part:
        is_thin = any(word in limb.name for word in THIN)
        return grow(limb, length, radius * (chosen.thin if is_thin else 1.0), bend)

    print("| figures | points | " + " | ".join(HEADS) + " |\n|---" + "|--:" * 6 + "|")
    with mock.patch.object(made_figures.Limb, "grow", thinner):
        for kind in FIGURES:
            for points in map(int, chosen.points.split(",")):
                rows = np.array([measure(kind, seed, points) for seed in range(chosen.seeds)])
                means = [*rows[:, :4].mean(axis=0), rows[:, 4].max()]
                cells = " | ".join(f"{value:.2f}" for value in means)
                print(f"| {kind} | {points} | {cells} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
