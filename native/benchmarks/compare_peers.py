"""Holds Pointmorph against other ways to find a correspondence, on any pair of models.

    compare_peers.py SOURCE TARGET --features FILE [--points N] [--methods NAME,…]
                     [--json FILE] [--pictures DIR]

Files and features are those of `pointmorph morph`. FILE may also hold "landmarks", in the same form
as "features": places that belong together, which no method is told and all are measured by.
Every method gets the same clouds and features and runs in a process of its own. One that isn't
installed, that needs faces where there are none, or that takes too long is named with the reason.
`python3 build_addon.py bench --peers SOURCE TARGET FEATURES` installs the peers and runs this.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib
import json
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Iterable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph.meshes
import unit_of_time
from bench_morph import resident
from compare_measures import Ints, Surface, Yardstick
from compare_methods import METHODS, NotApplicableError, Pair
from pointmorph import Cloud, Feature, FeatureError, PointmorphError, formats
from pointmorph.commands import cli
from tabulate import tabulate

Marks = dict[str, tuple[int, int]]

POINTS = 4000
"""Points of each cloud by default: more, and the slow peers take many minutes."""
TIMEOUT = 900.0
"""Seconds after which a method is stopped."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a method in its process."""

    pairs: Ints | None = None
    skipped: str = ""
    seconds: float = float("nan")
    unit_seconds: float = float("nan")
    peak_bytes: int = 0
    """Growth of the process' peak while the method ran; imports don't count."""


# --- Input ----------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Input:
    pair: Pair
    shapes: tuple[formats.Shape, formats.Shape]
    landmarks: Marks
    """Rows of the clouds; features are not among them."""


def read(files: tuple[Path, Path], marks: Path, points: int, hold_out: Iterable[str]) -> Input:
    """Reads a pair as the command line does, and samples it with `points` points a side.

    Parameters
    ----------
    points : int
        Of each cloud; fewer where a bare cloud hasn't as many. 0 takes the files' vertices.
    hold_out : names of features
        They become landmarks: no method is told of them.

    Raises
    ------
    FileError, FeatureError, OptionError
    """
    shapes = (formats.read(files[0]), formats.read(files[1]))
    features, loop = read_points(marks, "features")
    landmarks, _ = read_points(marks, "landmarks")
    for name in hold_out:
        if name not in features:
            known = ", ".join(features)
            raise FeatureError(
                f'feature "{name}"', f"one of {known}", "no such name", "Correct it."
            )
        landmarks[name] = features.pop(name)
    landmarks = {name: rows for name, rows in landmarks.items() if name not in features}
    everything = features | landmarks
    cli.check_rows(list(shapes), everything)
    clouds: list[Cloud]
    if points:
        count = min([points, *(len(s.positions) for s in shapes if s.faces is None)])
        clouds, everything = pointmorph.meshes.sample_pair(shapes, everything, count)
    else:
        clouds = [shape.cloud() for shape in shapes]
    pair = Pair(
        clouds[0],
        clouds[1],
        pairs(everything, features),
        [name for name in loop if name in features],
        meshes(shapes, points),
    )
    return Input(pair, shapes, pairs(everything, landmarks))


def read_points(marks: Path, key: str) -> tuple[dict[str, Feature], list[str]]:
    """Features that all methods know, and the loop."""
    features, loop = cli.read_features(marks, key)
    for name, feature in features.items():
        if feature.kind != "point":
            raise FeatureError(
                f'feature "{name}"',
                "a point, which all methods know",
                f"a {feature.kind}",
                "Leave it out of the comparison.",
            )
    return features, loop


def pairs(features: dict[str, Feature], names: Iterable[str]) -> dict[str, tuple[int, int]]:
    """Rows of source and target."""
    return {name: (features[name].rows(0)[0], features[name].rows(1)[0]) for name in names}


def meshes(
    shapes: tuple[formats.Shape, formats.Shape], points: int
) -> tuple[formats.Shape, formats.Shape] | None:
    """The models with about `points` vertices each; None when one has no faces."""
    if any(shape.faces is None for shape in shapes):
        return None
    first, second = (simplified(shape, points) for shape in shapes)
    return first, second


def simplified(shape: formats.Shape, points: int) -> formats.Shape:
    if points == 0 or len(shape.positions) <= points:
        return shape
    import trimesh

    mesh = trimesh.Trimesh(shape.positions, shape.faces, process=False)
    try:
        # Twice as many triangles as vertices, as on any closed surface.
        mesh = mesh.simplify_quadric_decimation(face_count=2 * points)
    except ImportError:  # the whole mesh does as well, it only takes longer
        return shape
    return formats.Shape(shape.name, np.asarray(mesh.vertices), faces=np.asarray(mesh.faces))


# --- Running --------------------------------------------------------------------------------------


def run(name: str, pair: Pair, timeout: float) -> Outcome:
    """One method in a process of its own, so that its memory and its crashes are its own."""
    if METHODS[name].needs_faces and pair.faces is None:
        return Outcome(skipped="needs faces, and these models have none")
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(name, pair, sender))
    process.start()
    sender.close()
    try:
        if not receiver.poll(timeout):
            return Outcome(skipped=f"stopped after {timeout:.0f} s")
        outcome: Outcome = receiver.recv()
        return outcome
    except EOFError:
        process.join()
        return Outcome(skipped=f"its process ended with status {process.exitcode}")
    finally:
        process.kill()
        process.join()


def _run(name: str, pair: Pair, sender: Connection) -> None:
    # What peers print about their progress isn't part of the table.
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        outcome = _measured(name, pair)
    sender.send(outcome)


def _measured(name: str, pair: Pair) -> Outcome:
    method = METHODS[name]
    for module in method.modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            return Outcome(skipped=f"not installed ({error})")
    units = [_unit_seconds(pair) for _ in range(3)]
    before = resident("VmRSS")
    with contextlib.suppress(OSError):  # the peak starts again from here
        Path("/proc/self/clear_refs").write_text("5")
    start = time.perf_counter()
    try:
        pairs = method.run(pair)
    except NotApplicableError as error:
        return Outcome(skipped=str(error))
    except Exception as error:  # a peer raises whatever it meets
        return Outcome(skipped=f"failed: {type(error).__name__}: {error}")
    seconds = time.perf_counter() - start
    peak = max(resident("VmHWM") - before, 0)
    return Outcome(pairs, "", seconds, statistics.median(units), peak)


def _unit_seconds(pair: Pair) -> float:
    unit_of_time.ready()
    start = time.perf_counter()
    for cloud in (pair.source, pair.target):
        unit_of_time.find_neighbors(cloud.positions)
    return time.perf_counter() - start


# --- Output ---------------------------------------------------------------------------------------

COLUMNS = (
    "method", "landmarks", "features", "tears, %", "dirichlet", "p99", "flips, %", "covered, %",
    "seconds", "U", "MB",
)  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown, aligned; methods that were skipped stand below with their reasons."""
    cells = [_cells(row) for row in rows if "skipped" not in row]
    align = ["left"] + ["right"] * (len(COLUMNS) - 1)
    text = (
        "" if not cells else tabulate(cells, COLUMNS, "pipe", disable_numparse=True, colalign=align)
    )
    reasons = [f"- {row['title']}: {row['skipped']}" for row in rows if "skipped" in row]
    return "\n".join([text, *(["", "Skipped:", "", *reasons] if reasons else [])])


def _cells(row: dict[str, Any]) -> list[str]:
    def number(name: str, digits: int, factor: float = 1.0) -> str:
        return "-" if row[name] is None else f"{factor * row[name]:.{digits}f}"

    return [
        row["title"],
        number("landmarks", 3),
        number("features_max", 3),
        number("tears", 2, 100),
        f"{number('dirichlet', 2)} / {number('dirichlet_back', 2)}",
        number("stretch_p99", 1),
        number("flips", 1, 100),
        number("covered", 0, 100),
        number("seconds", 2),
        number("units", 0),
        number("peak_bytes", 0, 1e-6),
    ]


def compare(given: Input, names: Iterable[str], timeout: float) -> dict[str, tuple[Outcome, Any]]:
    """By method, what became of it and, unless it was skipped, its row of measures."""
    pair, landmarks = given.pair, np.array(list(given.landmarks.values()), np.int64).reshape(-1, 2)
    sides = [
        Surface.of(cloud, shape)
        for cloud, shape in zip((pair.source, pair.target), given.shapes, strict=True)
    ]
    yardstick = Yardstick(sides[0], sides[1], pair.marks, landmarks)
    result = {}
    for name in names:
        print(f"  {METHODS[name].title} …", file=sys.stderr, flush=True)
        outcome = run(name, pair, timeout)
        row: dict[str, Any] = {"method": name, "title": METHODS[name].title}
        if outcome.pairs is None:
            row["skipped"] = outcome.skipped
        else:
            row |= yardstick.measure(outcome.pairs)
            row |= {
                "seconds": outcome.seconds,
                "unit_seconds": outcome.unit_seconds,
                "units": outcome.seconds / outcome.unit_seconds,
                "peak_bytes": outcome.peak_bytes,
            }
        result[name] = outcome, row
    return result


def _names(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if name not in METHODS]:
        raise argparse.ArgumentTypeError(
            f"no such method: {', '.join(unknown)}; there are {', '.join(METHODS)}"
        )
    return names


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", metavar="SOURCE", type=Path)
    parser.add_argument("target", metavar="TARGET", type=Path)
    parser.add_argument("--features", metavar="FILE", type=Path, required=True)
    parser.add_argument(
        "--methods", type=_names, default=list(METHODS), help=f"of {','.join(METHODS)}"
    )
    parser.add_argument(
        "--points",
        type=int,
        default=POINTS,
        metavar="N",
        help="of each cloud; 0: the files' vertices (default: %(default)s)",
    )
    parser.add_argument(
        "--hold-out",
        metavar="NAME,…",
        type=lambda text: text.split(","),
        default=[],
        help="features that no method is told, to measure by them",
    )
    parser.add_argument("--timeout", type=float, default=TIMEOUT, help="seconds a method may take")
    parser.add_argument("--json", type=Path, metavar="FILE", help="the figures, unrounded")
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="a texture that each map carries along"
    )
    parser.add_argument(
        "--view",
        type=lambda text: [float(part) for part in text.split(",")],
        help="X,Y,Z: from where pictures look at the source (default: across its longest sides)",
    )
    parser.add_argument("--up", choices=("x", "y", "z"), default="y", help="in pictures")
    chosen = parser.parse_args()
    try:
        given = read(
            (chosen.source, chosen.target), chosen.features, chosen.points, chosen.hold_out
        )
        results = compare(given, chosen.methods, chosen.timeout)
    except PointmorphError as error:
        print(f"compare_peers: {error}", file=sys.stderr)
        return 1
    rows = [row for _, row in results.values()]
    pair = given.pair
    print(
        f"{given.shapes[0].name} ({len(pair.source):,} points) to {given.shapes[1].name} "
        f"({len(pair.target):,}), {len(pair.features)} features, {len(given.landmarks)} "
        "landmarks held out\n"
    )
    print(table(rows))
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n")
    if chosen.pictures:
        import compare_pictures

        maps = {
            METHODS[name].title: outcome.pairs
            for name, (outcome, _) in results.items()
            if outcome.pairs is not None
        }
        print(f"\n{compare_pictures.sheet(given, maps, chosen.pictures, chosen.view, chosen.up)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
