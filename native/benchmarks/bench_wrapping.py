"""How good meshes look where they are wrapped onto their targets, as docs/comparison.md lists it.

    bench_wrapping.py PAIR...

A PAIR is a folder with pair.json: the files `source` and `target`, `features` as the command line
reads them, all of them points, and where these are of clouds, the meshes `source_mesh` and
`target_mesh`, whose nearest vertices are taken. Prints the figures of `Morph.mesh_quality` in %,
without features and with them, no option changed; last, their means.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pointmorph
from pointmorph import Cloud, formats
from pointmorph.commands import cli
from pointmorph.meshes.geometry import nearest_rows
from pointmorph.shapes.clouds import SIDES

DECIMALS = {"folded": 3, "creased": 2, "uncovered": 2, "off": 3}

Marks = dict[str, tuple[int, int]]
Figures = tuple[list[float], list[float]]
"""Those of DECIMALS, in %, without features and with them."""


def read(folder: Path) -> tuple[list[Cloud], Marks]:
    """Both meshes, and which of their vertices belong together."""
    pair = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    marks, _ = cli.read_features(folder / "pair.json")
    clouds, rows = [], []
    for number, side in enumerate(SIDES):
        shape = formats.read(folder / pair[side])
        marked = [row for mark in marks.values() for row in mark.rows(number)]
        if f"{side}_mesh" in pair:
            places = shape.positions[marked]
            shape = formats.read(folder / pair[f"{side}_mesh"])
            marked = nearest_rows(shape.positions, places, 1)[:, 0].tolist()
        clouds.append(shape.cloud())
        rows.append(marked)
    return clouds, dict(zip(marks, zip(*rows, strict=True), strict=True))


def figures(folder: Path) -> Figures:
    (source, target), marks = read(folder)

    def measured(morph: pointmorph.Morph) -> list[float]:
        return [100.0 * float(getattr(morph.mesh_quality, name)) for name in DECIMALS]

    without = measured(pointmorph.morph(source, target))
    return without, measured(pointmorph.morph(source, target, marks))


def row_of(name: str, found: Figures) -> str:
    cells = [
        f"{without:.{decimals}f} · {marked:.{decimals}f}"
        for without, marked, decimals in zip(*found, DECIMALS.values(), strict=True)
    ]
    return f"| {name} | {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("pairs", nargs="+", type=Path, metavar="PAIR")
    folders = parser.parse_args(arguments).pairs
    print(f"| pair | {' | '.join(DECIMALS)} |\n{'|---' * (len(DECIMALS) + 1)}|", flush=True)
    found = []
    for folder in folders:
        found.append(figures(folder))
        print(row_of(folder.resolve().name, found[-1]), flush=True)
    without, marked = np.mean(found, axis=0).tolist()
    print(row_of("mean", (without, marked)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
