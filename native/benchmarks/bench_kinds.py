"""Kinds of figures, and builds that are unlike: how many maps of them are off, and how far.

    bench_kinds.py [KIND…] [--pairs N] [--points N] [--first SEED] [--strength S]

Two builds of a kind, each held its own way (`made_kinds`, and if named those of `made_figures`),
without marks. A map is off if of the points that both have, of both ways together, more than 5 %
are over .1 √area from where they belong:

wrong, in part  maps that are off, with more than 30 % of such points, and with less
error           mean distance of the other maps' points from where they belong, in √area
off             of each map that is off: its seed, the share of such points, and its confidence
seconds         of processor time a map, that of the clouds not counted
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np
import pointmorph
from bench_rows import OFF, from_truth
from made_bodies import Body, Family, body_pair
from made_figures import FIGURES, any_build
from made_kinds import KINDS

FAMILIES: dict[str, Family] = KINDS | {kind: any_build(figure) for kind, figure in FIGURES.items()}
IN_PART, WRONG = 0.05, 0.3
"""Shares of points that are off, from which on a map is."""
COLUMNS = ("kind", "pairs", "wrong", "in part", "error", "seconds", "off")


@dataclass(frozen=True)
class Found:
    seed: int
    share: float
    """Of points that are off."""
    error: float
    """√area"""
    confidence: float
    seconds: float


def measured(seed: int, bodies: tuple[Body, Body]) -> Found:
    source, target = (body.cloud() for body in bodies)
    start = time.process_time()
    morph = pointmorph.morph(source, target)
    seconds = time.process_time() - start
    away = np.concatenate(from_truth(bodies, (morph.source_to_target, morph.target_to_source)))
    share, error = float((away > OFF).mean()), float(away.mean())
    return Found(seed, share, error, float(morph.report["confidence"]), seconds)


def line(kind: str, found: list[Found]) -> str:
    off = [one for one in found if one.share > IN_PART]
    wrong = sum(one.share > WRONG for one in off)
    others = [one.error for one in found if one.share <= IN_PART]
    cells = [
        kind,
        str(len(found)),
        str(wrong),
        str(len(off) - wrong),
        f"{np.mean(others):.4f}" if others else "",
        f"{np.mean([one.seconds for one in found]):.2f}",
        ", ".join(f"{one.seed}: {100 * one.share:.0f} % {one.confidence:.2f}" for one in off),
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(FAMILIES))
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=2000, help="seed of the first pair")
    parser.add_argument("--strength", type=float, default=0.3, help="of the second one's bend")
    chosen = parser.parse_args()
    unknown = sorted(set(chosen.kinds) - set(FAMILIES))
    if unknown:
        parser.error(f"no such kind: {', '.join(unknown)}; there are {', '.join(FAMILIES)}")
    print("| " + " | ".join(COLUMNS) + " |\n|---" + "|--:" * (len(COLUMNS) - 2) + "|---|")
    for kind in chosen.kinds or KINDS:
        seeds = range(chosen.first, chosen.first + chosen.pairs)
        found = [
            measured(seed, body_pair(FAMILIES[kind], seed, chosen.points, chosen.strength))
            for seed in seeds
        ]
        print(line(kind, found), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
