"""How much of the error at landmarks lies in the landmarks: what no map can be better than.

    bench_landmarks.py [PAIR…]

For the pairs of animals beside the checkout, two measures that need no map from one to the other:

mirrored  how far a landmark is from its counterpart of the other side, mapped by the animal's map
          onto its own mirror image; of both animals of a pair, as two errors that know nothing of
          each other add up
between   each landmark lies somewhere between two marks, at a share of the way along the surface;
          how far apart the shares of both animals are, times the way on the target

Both in √area, next to the error of the map with eight marks at the other landmarks. The second one
holds for maps that stretch the way between two marks evenly.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pointmorph
from bench_rows import ASIDE, CROSSED, GIVEN, Task, aside
from compare_measures import Floats, Ints, Surface, Yardstick, surface_distances
from pointmorph import Cloud, formats

MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Animal:
    surface: Surface
    landmarks: dict[str, int]
    marks: list[str]
    distances: Floats
    """(L, L) between landmarks along the surface, in √area"""
    mirrored: Floats
    """(L,) in √area"""


@cache
def animal(folder: Path, side: str) -> Animal:
    content = json.loads((folder / "pair.json").read_text())
    number = ("source", "target").index(side)
    cloud = formats.read(folder / f"{side}.ply").cloud()
    surface = Surface.of(cloud, formats.read(folder / f"{side}_mesh.ply"))
    landmarks = {name: int(rows[number]) for name, rows in content["landmarks"].items()}
    rows = np.array(list(landmarks.values()))
    along = surface_distances(surface, rows)[:, rows] / np.sqrt(surface.area)
    mirrored = from_mirror_image(cloud, surface, rows)
    return Animal(surface, landmarks, list(content["features"]), along, mirrored)


def from_mirror_image(cloud: Cloud, surface: Surface, rows: Ints) -> Floats:
    """How far each is from the mirror image of the one that its own image is nearest to."""
    mirror = Cloud(cloud.positions * MIRROR, normals=surface.normals * MIRROR)
    morph = pointmorph.morph(Cloud(cloud.positions, normals=surface.normals), mirror)
    images = morph.source_to_target[rows] * MIRROR
    away = np.linalg.norm(images[:, None] - surface.positions[rows][None], axis=2)
    return np.asarray(away.min(axis=1) / np.sqrt(surface.area))


def way_between(animals: list[Animal], name: str) -> tuple[str, str]:
    """The two marks between which a landmark lies: those that it is the least detour from."""

    def detour(ends: tuple[str, str]) -> float:
        total = 0.0
        for each in animals:
            names = list(each.landmarks)
            a, b, here = (names.index(n) for n in (*ends, name))
            to = each.distances
            total += (to[a, here] + to[here, b]) / to[a, b]
        return float(total)

    return min(combinations(animals[0].marks, 2), key=detour)


def share(each: Animal, name: str, ends: tuple[str, str]) -> tuple[float, float]:
    """At which share of the way between two marks a landmark lies, and the way's length."""
    names = list(each.landmarks)
    a, b, here = (names.index(n) for n in (*ends, name))
    way = each.distances[a, here] + each.distances[here, b]
    return float(each.distances[a, here] / way), float(way)


def both_of(task_name: tuple[str, str]) -> list[Animal]:
    return [
        animal(ASIDE / folder, side)
        for folder, side in zip(task_name, ("source", "target"), strict=True)
    ]


def errors_with_marks(task: Task) -> Floats:
    """Of each landmark that isn't marked, the mean of both ways, in √area."""
    marks = {f"m{k}": (int(i), int(j)) for k, (i, j) in enumerate(task.marks)}
    pairs = np.asarray(pointmorph.morph(*task.clouds, marks).pairs, dtype=np.int64)
    yardstick = Yardstick(*task.surfaces, task.marks, task.places)
    misses = np.array([yardstick.misses(0, pairs), yardstick.misses(1, pairs[:, ::-1])])
    return np.asarray(misses[:, len(task.marks) :].mean(axis=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pairs", nargs="*", help="only pairs whose name has one of these in it")
    words = parser.parse_args().pairs
    named = {name: (name, name) for name in GIVEN}
    named |= {f"{a} to {b}": (a, b) for a, b in CROSSED}
    named = {name: both for name, both in named.items()
             if not words or any(word in name for word in words)}  # fmt: skip
    if not ASIDE.is_dir():
        raise SystemExit("Skipped: the pairs aren't beside the checkout.")

    print("| pair | error | mirrored | between | correlation |\n|---|--:|--:|--:|--:|")
    rows = []
    for name, folders in named.items():
        animals = both_of(folders)
        others = [n for n in animals[0].landmarks if n not in animals[0].marks]
        errors = errors_with_marks(aside(*folders, True))
        mirrored = np.sqrt(sum(each.mirrored.mean() ** 2 for each in animals) / 2)
        shares = [[share(each, n, way_between(animals, n)) for n in others] for each in animals]
        apart = np.array([abs(s[0] - t[0]) * t[1] for s, t in zip(*shares, strict=True)])
        like = np.corrcoef(apart, errors)[0, 1]
        rows.append((errors.mean(), mirrored, apart.mean(), like))
        print(f"| {name} | " + " | ".join(f"{value:.3f}" for value in rows[-1]) + " |", flush=True)
    print("| mean | " + " | ".join(f"{value:.3f}" for value in np.mean(rows, axis=0)) + " |")


if __name__ == "__main__":
    main()
