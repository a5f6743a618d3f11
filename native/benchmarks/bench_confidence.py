"""How often a wrong map goes unnoticed, on kinds of shapes that confidence wasn't fitted to.

    bench_confidence.py [--seeds N] [--points N] [--harder] [--json FILE]

Bodies made by script, whose truth is known at every point (`made_bodies`), are mapped without marks
and with four; then bodies of different kinds, which have nothing in common, so that no map between
them is right. A map counts as wrong with more than 30 % of its points over 0.1 √area off, and as
noticed with a confidence below 0.8, where the report warns.

Few of these maps are wrong. With `--harder`, the bodies are bent two to six times as much instead,
and shaken, cut, or sampled with few points, so that more are; without marks and with two.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pointmorph
from compare_measures import cloud_area
from made_bodies import FAMILIES, Body, Family, body_pair

OFF, WRONG, WARNED = 0.1, 0.3, 0.8
STRENGTHS = (1.0, 2.0, 3.0)
"""How much one of them is bent, by turns."""
HARDSHIPS = {
    "bent": (4.0, 6.0),
    "noise": (2.0, 4.0),
    "cut": (2.0, 4.0),
    "few points": (3.0, 5.0),
}
"""How much they are bent besides, from and to."""
FEW = 300
Row = dict[str, float | str]


def marks(source: Body, target: Body, count: int) -> dict[str, tuple[int, int]]:
    """Far apart from each other on the source, each with the nearest row on the target."""
    shared = np.flatnonzero(source.is_shared)
    chosen: list[int] = []
    far = np.full(len(shared), np.inf)
    for _ in range(count):
        chosen.append(int(shared[far.argmax() if chosen else 0]))
        from_it = np.linalg.norm(source.positions[shared] - source.positions[chosen[-1]], axis=1)
        far = np.minimum(far, from_it)
    places = [((target.positions - source.truth[row]) ** 2).sum(axis=1).argmin() for row in chosen]
    return {f"m{k}": (row, int(to)) for k, (row, to) in enumerate(zip(chosen, places, strict=True))}


def judged(kind: str, source: Body, target: Body, number: int) -> Row:
    """A map between two draws of a kind, with so many marks."""
    morph = pointmorph.morph(source.cloud(), target.cloud(), marks(source, target, number))
    off = []
    for body, images, other in (
        (source, morph.source_to_target, target),
        (target, morph.target_to_source, source),
    ):
        away = np.linalg.norm(images - body.truth, axis=1) / np.sqrt(cloud_area(other.positions))
        off.append(away[body.is_shared] > OFF)
    confidence = morph.measure_confidence().right
    wrong = float(np.concatenate(off).mean())
    return {"kind": kind, "marks": number, "wrong": wrong, "confidence": confidence}


def cut(source: Body, target: Body, random: np.random.Generator) -> tuple[Body, Body]:
    """A fifth to two fifths of the target cut off by a plane."""
    along = random.normal(size=3)
    end = np.quantile(target.positions @ along, random.uniform(0.6, 0.8))
    rows = target.positions @ along < end
    kept = {name: getattr(target, name)[rows] for name in vars(target)}
    seen = source.is_shared & (source.truth @ along < end)
    return replace(source, is_shared=seen), replace(target, **kept)


def shaken(source: Body, target: Body, random: np.random.Generator) -> tuple[Body, Body]:
    """Both with noise of 1 to 3 % of √area, and normals as noisy."""
    bodies = []
    for body in (source, target):
        amount = random.uniform(0.01, 0.03)
        noise = random.normal(size=(2, *body.positions.shape)) * amount
        normals = body.normals + 10 * noise[1]
        positions = body.positions + noise[0] * np.sqrt(cloud_area(body.positions))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        bodies.append(replace(body, positions=positions, normals=normals))
    return bodies[0], bodies[1]


def hard_pair(family: Family, hardship: str, seed: int, points: int) -> tuple[Body, Body]:
    random = np.random.default_rng([seed, list(HARDSHIPS).index(hardship)])
    least, most = HARDSHIPS[hardship]
    few = FEW if hardship == "few points" else points
    source, target = body_pair(family, seed, few, random.uniform(least, most))
    if hardship == "cut":
        return cut(source, target, random)
    return shaken(source, target, random) if hardship == "noise" else (source, target)


def harder(seeds: int, points: int) -> list[Row]:
    """Each body with each hardship, which stands for its kind."""
    rows = []
    for seed in range(seeds):
        for family in [family for group in FAMILIES.values() for family in group]:
            for hardship in HARDSHIPS:
                source, target = hard_pair(family, hardship, 100 + seed, points)
                rows += [judged(hardship, source, target, number) for number in (0, 2)]
                print(family.__name__, seed, rows[-2:], flush=True)
    return rows


def related(seeds: int, points: int) -> list[Row]:
    rows = []
    for kind, families in FAMILIES.items():
        for family in families:
            for seed in range(seeds):
                source, target = body_pair(family, seed, points, STRENGTHS[seed % len(STRENGTHS)])
                rows += [judged(kind, source, target, number) for number in (0, 4)]
                print(family.__name__, seed, rows[-2:], flush=True)
    return rows


def unrelated(seeds: int, points: int) -> list[Row]:
    """Each kind mapped to the next ones."""
    families = [family for group in FAMILIES.values() for family in group]
    rows: list[Row] = []
    for seed in range(seeds):
        for k, family in enumerate(families):
            other = families[(k + 2 + seed % (len(families) - 3)) % len(families)]
            source = body_pair(family, 1000 + seed, points)[0]
            target = body_pair(other, 2000 + seed, points)[1]
            morph = pointmorph.morph(source.cloud(), target.cloud())
            kind = f"{family.__name__} to {other.__name__}"
            rows.append({"kind": kind, "confidence": morph.measure_confidence().right})
            print(rows[-1], flush=True)
    return rows


def table(rows: list[Row]) -> str:
    heads = ["kind", "maps", "stated doubt", "wrong", "more than 30 % wrong", "unnoticed"]
    heads += ["less than 5 % wrong", "warned of"]
    lines = ["| " + " | ".join(heads) + " |", "|---" + "|--:" * (len(heads) - 1) + "|"]
    for kind in (*dict.fromkeys(row["kind"] for row in rows), "all"):
        of = [row for row in rows if kind in ("all", row["kind"])]
        wrong = np.array([row["wrong"] for row in of], dtype=float)
        sure = np.array([row["confidence"] for row in of], dtype=float)
        bad, good = wrong > WRONG, wrong < 0.05
        cells = [len(of), f"{1 - sure.mean():.3f}", f"{wrong.mean():.3f}", bad.sum()]
        cells += [(bad & (sure >= WARNED)).sum(), good.sum(), (good & (sure < WARNED)).sum()]
        lines.append(f"| {kind} | " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def of_strangers(rows: list[Row]) -> str:
    sure = np.array([row["confidence"] for row in rows], dtype=float)
    return (f"Nothing in common: {len(sure)} maps, {(sure >= WARNED).sum()} unnoticed; "
            f"confidence {sure.mean():.2f} on average, at most {sure.max():.2f}.")  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--points", type=int, default=1500)
    parser.add_argument("--harder", action="store_true")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    found: dict[str, list[Row]] = {}
    if chosen.harder:
        found["harder"] = harder(chosen.seeds, chosen.points)
        print(table(found["harder"]))
    else:
        found["related"] = related(chosen.seeds, chosen.points)
        found["unrelated"] = unrelated(chosen.seeds, chosen.points)
        print(table(found["related"]), of_strangers(found["unrelated"]), sep="\n\n")
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
