"""The goals for the quality of maps, measured on one kind of pairs each, with default options.

    bench_rows.py [ROW…] [--json FILE]

Prints a line for each goal, with what was measured for it, and one for each pair. Pairs are made by
script (`made_shapes`, `made_bodies`, `made_figures`, `made_models`), or models beside the checkout;
without these, their rows are left out. Measures are those of `compare_measures`:

landmarks, worst  how far a place's image is from where it belongs, along the surface, in √area:
                  the mean of both ways, and the worst place
spacings          the same in spacings of the points; of the images themselves: `off the truth`
tears, flips, p99 in %, in %, and the 99th percentile of the stretch
true flips        flips of the true map: as many come from pairing samples with samples
wrong             share of the points that are over .1 √area off, in %
confidence        how much of the map is likely right
unsaid            places over .15 √area off of which nothing warns

Of shapes whose truth is known everywhere, 300 places are measured.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import made_models
import numpy as np
import pointmorph
from compare_measures import Floats, Ints, Surface, Yardstick, cloud_area, similarity
from made_bodies import Body
from made_figures import FIGURES, figure_pair
from made_shapes import FAMILIES, Samples, loose_pair, sampled
from pointmorph import Cloud, formats
from scipy.spatial import cKDTree

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
ASIDE = SHARED / "evaluation_only"
POINTS = 10_000, 8_000
PLACES = 300
OFF, FAR = 0.1, 0.15
WARNED, DOUBTED = 0.8, 0.5
Figures = dict[str, float]
NO_ROWS = np.empty((0, 2), dtype=np.int64)


@dataclass(frozen=True)
class Task:
    """A pair to map."""

    name: str
    clouds: tuple[Cloud, Cloud]
    surfaces: tuple[Surface, Surface]
    marks: Ints
    """(K, 2) rows that the map is told"""
    places: Ints
    """(L, 2) rows that belong together besides"""
    bodies: tuple[Body, Body] | None = None
    """Where the truth is known everywhere."""


@dataclass(frozen=True)
class Row:
    what: str
    tasks: Callable[[], Iterator[Task]]
    aims: dict[str, float]
    """The most that each figure may be, or the least if it is a share of pairs that are right."""
    is_least: frozenset[str] = field(default=frozenset({"right", "said"}))

    def is_met(self, figures: Figures) -> bool:
        return all(
            figures[name] >= aim if name in self.is_least else figures[name] <= aim
            for name, aim in self.aims.items()
        )


# --- Pairs ----------------------------------------------------------------------------------------


def of_bodies(
    name: str, source: Body, target: Body, *, marks: Ints = NO_ROWS, parts: bool = False
) -> Task:
    clouds, surfaces = [], []
    for body in (source, target):
        clouds.append(Cloud(body.positions, normals=body.normals,
                            parts=body.parts if parts else None))  # fmt: skip
        none = np.empty((0, 3))
        area = cloud_area(body.positions)
        surfaces.append(Surface(body.positions, body.normals, area, none, none))
    spacing = np.sqrt(surfaces[1].area / len(target.positions))
    away, rows = cKDTree(target.positions).query(source.truth)
    known = np.flatnonzero(source.is_shared & (away < spacing))
    known = known[np.linspace(0, len(known) - 1, PLACES).astype(int)]
    places = np.stack([known, rows[known]], axis=1)
    is_marked = [np.isin(places[:, side], marks[:, side]) for side in (0, 1)]
    places = places[~np.logical_or(*is_marked)]
    # Across a crease, the sample nearest to where a place belongs is of another part.
    places = places[source.parts[places[:, 0]] == target.parts[places[:, 1]]]
    scale, turn, shift = similarity(source.truth[source.is_shared],
                                    source.positions[source.is_shared])  # fmt: skip
    placed = surfaces[0], surfaces[1].moved(scale, turn, shift)
    return Task(name, (clouds[0], clouds[1]), placed, marks, places, (source, target))


def onto(target: Surface, source: Surface, known: Ints) -> Surface:
    """The target placed by what is known to belong together."""
    rows = target.positions[known[:, 1]], source.positions[known[:, 0]]
    return target.moved(*similarity(*rows))


def fewer(body: Body, count: int) -> Body:
    return Body(**{name: values[:count] for name, values in vars(body).items()})


def of_samples(samples: Samples) -> Body:
    return Body(**vars(samples))


def aside(first: str, second: str, marked: bool) -> Task:
    """The source of one pair to the target of another one."""
    folders = ASIDE / first, ASIDE / second
    contents = [json.loads((folder / "pair.json").read_text()) for folder in folders]
    clouds, surfaces = [], []
    for folder, side in zip(folders, ("source", "target"), strict=True):
        clouds.append(formats.read(folder / f"{side}.ply").cloud())
        surfaces.append(Surface.of(clouds[-1], formats.read(folder / f"{side}_mesh.ply")))
    every = {
        name: (contents[0]["landmarks"][name][0], contents[1]["landmarks"][name][1])
        for name in contents[0]["landmarks"]
    }
    marks = np.array([every[name] for name in contents[0]["features"]] if marked else NO_ROWS)
    places = [
        rows for name, rows in every.items() if not (marked and name in contents[0]["features"])
    ]
    known = np.array(list(every.values()))
    placed = onto(surfaces[1], surfaces[0], known)
    name = first if first == second else f"{first} to {second}"
    return Task(name, (clouds[0], clouds[1]), (surfaces[0], placed), marks, np.array(places))


GIVEN = ("cat_horse", "quadruped_381_389", "quadruped_381_392", "quadruped_384_397",
         "quadruped_389_395", "quadruped_392_399", "quadruped_395_399")  # fmt: skip
CROSSED = (
    ("quadruped_381_389", "quadruped_389_395"),
    ("quadruped_381_389", "quadruped_395_399"),
    ("quadruped_389_395", "quadruped_381_392"),
    ("quadruped_389_395", "quadruped_392_399"),
    ("quadruped_392_399", "quadruped_389_395"),
)
"""381 to 395 and 399, 389 to 392 and 399, 392 to 395."""


def given(marked: bool) -> Iterator[Task]:
    return (aside(name, name, marked) for name in GIVEN if ASIDE.is_dir())


def crossed(marked: bool) -> Iterator[Task]:
    return (aside(*names, marked) for names in CROSSED if ASIDE.is_dir())


def animals() -> Iterator[Task]:
    yield from given(False)
    yield from crossed(False)


def from_files(name: str, paths: list[Path], places: Ints) -> Task:
    shapes = [formats.read(path) for path in paths]
    clouds = [shape.cloud() for shape in shapes]
    surfaces = [Surface.of(cloud, shape) for cloud, shape in zip(clouds, shapes, strict=True)]
    placed = onto(surfaces[1], surfaces[0], places)
    return Task(name, (clouds[0], clouds[1]), (surfaces[0], placed), NO_ROWS, places)


def poses() -> Iterator[Task]:
    for kind in FIGURES:
        for seed in range(2):
            source, target = figure_pair(FIGURES[kind], seed, POINTS[0])
            yield of_bodies(f"{kind} {seed}", source, fewer(target, POINTS[1]))
    folder = SHARED / "man_woman"
    if folder.is_dir():
        truth = np.loadtxt(folder / "gt.txt", dtype=np.int64)
        truth = truth[np.linspace(0, len(truth) - 1, PLACES).astype(int)]
        yield from_files("man_woman", [folder / "source.ply", folder / "target.ply"], truth)


def loose() -> Iterator[Task]:
    for kind in FAMILIES:
        for seed in range(3):
            pair = loose_pair(kind, seed)
            both = (
                of_samples(sampled(pair, count, of_source=is_source, seed=1 if is_source else 2))
                for count, is_source in zip(POINTS, (True, False), strict=True)
            )
            yield of_bodies(pair.name, *both, parts=True)


def lopped() -> Iterator[Task]:
    for seed in range(len(made_models.LOST)):
        source, target = made_models.cut_pair(seed, POINTS[0])
        name = "beast without " + ", ".join(made_models.LOST[seed])
        yield of_bodies(name, source, fewer(target, POINTS[1]))
    model = SHARED / "extras" / "cat_stretching.ply"
    for tips in (1, 2) if model.is_file() else ():
        shape = formats.read(model)
        assert shape.faces is not None
        pair = made_models.lopped_pair(shape.positions.astype(float), shape.faces.astype(np.int64),
                                       tips, np.random.default_rng(tips))  # fmt: skip
        both = (
            of_samples(sampled(pair, count, of_source=is_source, seed=1 if is_source else 2))
            for count, is_source in zip(POINTS, (True, False), strict=True)
        )
        yield of_bodies(f"cat without {tips} tips", *both)


def alone() -> Iterator[Task]:
    for seed in range(2 * len(made_models.ALONE)):
        source, target = made_models.alone_pair(seed, POINTS[0])
        kind, words = made_models.ALONE[seed % len(made_models.ALONE)]
        name = f"{', '.join(words)} of {kind} {seed // len(made_models.ALONE)}"
        yield of_bodies(name, source, fewer(target, POINTS[1]))


def heads() -> Iterator[Task]:
    for seed in range(4):
        source, target, marks = made_models.head_pair(seed, POINTS[0])
        yield of_bodies(f"heads {seed}", source, target, marks=np.array(list(marks.values())))


def airplanes() -> Iterator[Task]:
    for seed in range(6):
        source, target = made_models.airplane_pair(seed, POINTS[0])
        yield of_bodies(f"airplanes {seed}", source, fewer(target, POINTS[1]))


def busts() -> Iterator[Task]:
    folder = SHARED / "nefertiti_demosthenes"
    if not folder.is_dir():
        return
    rows = np.array(list(json.loads((folder / "pair.json").read_text())["features"].values()))
    paths, places = [], []
    for side, name in enumerate(("nefertiti_full", "demosthenes_bust")):
        paths.append(SHARED / "extras" / f"{name}.ply")
        face = formats.read(folder / f"{('source', 'target')[side]}.ply").positions
        places.append(cKDTree(formats.read(paths[-1]).positions).query(face[rows[:, side]])[1])
    yield from_files("nefertiti_full to demosthenes_bust", paths, np.stack(places, axis=1))


ROWS = {
    "marked": Row("five other pairings of quadrupeds, eight marks",
                  lambda: crossed(True),
                  {"landmarks": 0.036, "worst pair": 0.050,
                   "tears": 0.1, "flips": 0.4, "p99": 1.9}),
    "animals": Row("twelve pairs of animals, no marks", animals,
                   {"landmarks": 0.033, "worst pair": 0.055, "unsaid": 0}),
    "poses": Row("beasts, people and hands in other poses; man and woman", poses,
                 {"most spacings": 0.8, "most flips": 0.6}),
    "loose": Row("many loose parts", loose, {"tears": 0.5, "flips": 1.0}),
    "lopped": Row("beasts and a cat with parts cut away, onto the whole", lopped,
                  {"landmarks": 0.02, "worst": 0.1, "tears": 0.5, "said": 100}),
    "alone": Row("heads and halves of figures alone, onto whole ones of other builds", alone,
                 {"landmarks": 0.02, "worst": 0.1, "said": 100}),
    "heads": Row("heads with open mouths, nine marks", heads, {"tears": 0.3, "flips": 0.8}),
    "airplanes": Row("airplanes of unlike builds, no marks", airplanes, {"right": 100}),
    "busts": Row("two busts, no marks", busts, {"landmarks": 0.025}),
    "given": Row("the seven pairs of quadrupeds, eight marks", lambda: given(True),
                 {"landmarks": 0.040}),
}  # fmt: skip


# --- Figures --------------------------------------------------------------------------------------


def measured(task: Task) -> Figures:
    source, target = task.clouds
    marks = {f"m{k}": (int(i), int(j)) for k, (i, j) in enumerate(task.marks)}
    start = time.process_time()
    morph = pointmorph.morph(source, target, marks)
    seconds = time.process_time() - start
    confidence = morph.measure_confidence()
    pairs = np.asarray(morph.pairs, dtype=np.int64)
    yardstick = Yardstick(*task.surfaces, task.marks, task.places)
    found = yardstick.measure(pairs)
    misses = np.array([yardstick.misses(0, pairs), yardstick.misses(1, pairs[:, ::-1])])
    misses = misses[:, len(task.marks) :]
    sure = np.array([confidence.source[task.places[:, 0]], confidence.target[task.places[:, 1]]])
    is_sure = (sure > DOUBTED) & (confidence.right >= WARNED)
    report = morph.report
    words = json.dumps([report[key] for key in ("warnings", "worst", "doubtful")])
    figures = {
        "landmarks": misses.mean(),
        "worst": misses.max(),
        "spacings": (misses * np.sqrt([[len(target.positions)], [len(source.positions)]])).mean(),
        "tears": 100 * float(found["tears"] or 0),
        "flips": 100 * float(found["flips"] or 0),
        "p99": float(found["stretch_p99"] or 0),
        "confidence": confidence.right,
        "unsaid": float(((misses > FAR) & is_sure).sum()),
        "said": 100.0 * ("no counterpart" in words),
        "seconds": seconds,
    }
    if task.bodies:
        figures |= of_truth(task.bodies, (morph.source_to_target, morph.target_to_source))
        of_true_map = yardstick.measure(true_pairs(task.bodies))
        figures["true flips"] = 100 * float(of_true_map["flips"] or 0)
    return {name: float(value) for name, value in figures.items()}


def true_pairs(bodies: tuple[Body, Body]) -> Ints:
    """Every point that the other body has, too, with the sample there that is nearest to it."""
    ways = []
    for body, other in (bodies, bodies[::-1]):
        rows = np.flatnonzero(body.is_shared)
        ways.append(np.stack([rows, cKDTree(other.positions).query(body.truth[rows])[1]], axis=1))
    return np.concatenate([ways[0], ways[1][:, ::-1]])


def from_truth(bodies: tuple[Body, Body], images: tuple[Floats, Floats]) -> list[Floats]:
    """How far from where it belongs the image of each point is that both have, in √area."""
    return [
        np.linalg.norm(its - body.truth, axis=1)[body.is_shared]
        / np.sqrt(cloud_area(other.positions))
        for body, other, its in zip(bodies, bodies[::-1], images, strict=True)
    ]


def of_truth(bodies: tuple[Body, Body], images: tuple[Floats, Floats]) -> Figures:
    away = from_truth(bodies, images)
    spacings = [
        its * np.sqrt(len(other.positions)) for its, other in zip(away, bodies[::-1], strict=True)
    ]
    wrong = 100 * float((np.concatenate(away) > OFF).mean())
    return {
        "off the truth": float(np.concatenate(spacings).mean()),
        "wrong": wrong,
        "right": 100.0 * (wrong < 5),
    }


def summary(pairs: dict[str, Figures]) -> Figures:
    """Means, and the worst where a name says so."""
    names = dict.fromkeys(name for figures in pairs.values() for name in figures)
    of = {name: [f[name] for f in pairs.values() if name in f] for name in names}
    means = {name: float(np.mean(values)) for name, values in of.items()}
    means["worst"] = max(of["worst"])
    means["worst pair"] = max(of["landmarks"])
    means["most spacings"] = max(of["spacings"])
    means["most flips"] = max(of["flips"])
    means["unsaid"] = sum(of["unsaid"])
    return means


def number(value: float) -> str:
    return f"{value:.4f}" if abs(value) < 0.2 else f"{value:.2f}" if value < 20 else f"{value:.0f}"


def line(row: Row, figures: Figures) -> str:
    found = " · ".join(f"{name} {number(figures[name])}" for name in row.aims)
    aims = " · ".join(
        f"{'≥' if name in row.is_least else '≤'} {aim:g}" for name, aim in row.aims.items()
    )
    met = "yes" if row.is_met(figures) else "no"
    return f"| {row.what} | {found} | {aims} | {met} | {figures['seconds']:.2f} |"


COLUMNS = ("landmarks", "worst", "spacings", "off the truth", "wrong", "tears", "flips",
           "true flips", "p99", "confidence", "unsaid", "said", "seconds")  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    unknown = sorted(set(chosen.rows) - set(ROWS))
    if unknown:
        parser.error(f"no such row: {', '.join(unknown)}; there are {', '.join(ROWS)}")
    every: dict[str, dict[str, Figures]] = {}
    lines = []
    print("| pair | " + " | ".join(COLUMNS) + " |\n|---" + "|--:" * len(COLUMNS) + "|")
    for name in chosen.rows or ROWS:
        found = {}
        for task in ROWS[name].tasks():
            found[task.name] = measured(task)
            cells = [number(found[task.name][k]) if k in found[task.name] else "" for k in COLUMNS]
            print(f"| {task.name} | " + " | ".join(cells) + " |", flush=True)
        if found:
            every[name] = found
            lines.append(line(ROWS[name], summary(found)))
    print("\n| what | today | aim | met | seconds a map |\n|---|---|---|---|--:|")
    print("\n".join(lines))
    if chosen.json:
        chosen.json.write_text(json.dumps(every, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
