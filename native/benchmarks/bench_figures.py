"""How thin parts are mapped: tails, ears and fingers of figures made by script, in two poses.

    bench_figures.py [--seeds N] [--points N,N] [--thin FACTOR] [--symmetric]

Two poses of one build (`made_figures`), without marks. Lengths are in spacings of the points:

error           mean distance from where a point belongs
thin            the same for points of thin parts
strays          share of thin parts' points whose image lies next to another part, in %
short           by how much the image of a tail or a finger ends before its counterpart; mean, most

With --symmetric, two builds of beasts and of people that are alike on both sides. How far a point's
image lies from where it is if the point is mirrored, mapped and mirrored again: mean, median, 95th
percentile, and the share of points, in %, for which it is more than one spacing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from unittest import mock

import made_figures
import numpy as np
import pointmorph
from compare_measures import Floats, Ints, cloud_area
from made_bodies import Body
from made_figures import ACROSS, FIGURES, THIN, Limb, figure_pair, limb_numbers, symmetric_pair
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


Mirror = Callable[[Floats], Floats]


class SampledMap:
    """A map known at samples of a surface, and continued between them by affine fits."""

    NEAR = 8

    def __init__(self, body: Body, images: Floats) -> None:
        self.positions, self.images = body.positions, images
        spacing = np.sqrt(cloud_area(body.positions) / len(body.positions))
        self.normal_weight = 4 * spacing
        self.tree = cKDTree(np.hstack([body.positions, self.normal_weight * body.normals]))

    def at(self, positions: Floats, normals: Floats) -> Floats:
        keys = np.hstack([positions, self.normal_weight * normals])
        away, near = self.tree.query(keys, self.NEAR)
        steps = self.positions[near] - positions[:, None]
        terms = np.concatenate([np.ones((*near.shape, 1)), steps / away[:, -1:, None]], axis=2)
        weights = 1 / (away + 0.1 * away[:, -1:])
        weighted = terms * weights[:, :, None]
        # Slopes across the surface, which nothing tells, are damped away.
        square = np.einsum("ikl,ikm->ilm", weighted, terms) + 1e-6 * np.diag([0, 1, 1, 1])
        fitted = np.linalg.solve(square, np.einsum("ikl,ikm->ilm", weighted, self.images[near]))
        found: Floats = fitted[:, 0]
        return found


def mirror_between(here: Floats, there: Floats) -> Mirror:
    """The mirror image that takes points nearest to others (orthogonal Procrustes)."""
    middle, other = here.mean(axis=0), there.mean(axis=0)
    left, _, right = np.linalg.svd((there - other).T @ (here - middle))
    turn = left @ np.diag([1, 1, -np.sign(np.linalg.det(left @ right))]) @ right
    return lambda positions: (positions - middle) @ turn.T + other


def asymmetries(here: Body, images: Floats, own: Mirror, other: Mirror) -> Floats:
    """Of each point, by how much its mirrored one's image is not its image, mirrored."""
    across = own(here.positions)
    turned = own(here.positions + here.normals) - across
    return np.linalg.norm(SampledMap(here, images).at(across, turned) - other(images), axis=1)


def mirrors(kind: str, source: Body) -> tuple[Mirror, Mirror]:
    """Of the source of a symmetric pair, and of its target."""
    sides = np.ones(3)
    sides[ACROSS[kind]] = -1
    there = SampledMap(source, source.truth).at(source.positions * sides, source.normals * sides)
    return lambda positions: positions * sides, mirror_between(source.truth, there)


def measure_symmetry(kind: str, seed: int, points: int) -> list[float]:
    source, target = symmetric_pair(kind, seed, points)
    morph = pointmorph.morph(source.cloud(), target.cloud())
    of_source, of_target = mirrors(kind, source)
    found = []
    for here, there, images, own, other in (
        (source, target, morph.source_to_target, of_source, of_target),
        (target, source, morph.target_to_source, of_target, of_source),
    ):
        spacing = np.sqrt(cloud_area(there.positions) / len(there.positions))
        found.append(asymmetries(here, images, own, other) / spacing)
    off = np.concatenate(found)
    return [off.mean(), np.median(off), np.quantile(off, 0.95), 100 * (off > 1).mean()]


def print_symmetry(seeds: int, points: list[int]) -> None:
    print("| figures | points | mean | median | 95 % | over 1, % |\n|---" + "|--:" * 5 + "|")
    for kind in ACROSS:
        for count in points:
            rows = np.array([measure_symmetry(kind, seed, count) for seed in range(seeds)])
            cells = " | ".join(f"{value:.2f}" for value in rows.mean(axis=0))
            print(f"| {kind} | {count} | {cells} |", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--points", default="5000,10000")
    parser.add_argument("--thin", type=float, default=1.0, help="times as thick")
    parser.add_argument("--symmetric", action="store_true", help="how symmetric maps are")
    chosen = parser.parse_args()
    points = [int(count) for count in chosen.points.split(",")]
    if chosen.symmetric:
        print_symmetry(chosen.seeds, points)
        return 0
    grow = Limb.grow

    def thinner(limb: Limb, length: float, radius: float, bend: tuple[float, float, float]) -> Part:
        is_thin = any(word in limb.name for word in THIN)
        return grow(limb, length, radius * (chosen.thin if is_thin else 1.0), bend)

    print("| figures | points | " + " | ".join(HEADS) + " |\n|---" + "|--:" * 6 + "|")
    with mock.patch.object(made_figures.Limb, "grow", thinner):
        for kind in FIGURES:
            for count in points:
                rows = np.array([measure(kind, seed, count) for seed in range(chosen.seeds)])
                means = [*rows[:, :4].mean(axis=0), rows[:, 4].max()]
                cells = " | ".join(f"{value:.2f}" for value in means)
                print(f"| {kind} | {count} | {cells} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
