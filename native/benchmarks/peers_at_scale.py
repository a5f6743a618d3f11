"""Time, memory and error of Pointmorph and of peers, from ten thousand points to a million.

    peers_at_scale.py [--sizes N …] [--bcpd PROGRAM] [--json FILE] [--picture FILE]

A ball with five limbs becomes one whose limbs are longer and thinner, and the true place of each
point is known; no method gets marks, and both stand in the same way. Points are drawn evenly and
independently on both. BCPD is the program of https://github.com/ohirose/bcpd, built by its own
makefile, with the options of its own demo for the Armadillo (BCPD++). Each method runs in a process
of its own. Linux only, because of the memory.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from bench_morph import resident
from measure_row import body
from pointmorph import Cloud, formats
from scipy.spatial import cKDTree
from tabulate import tabulate

BCPD_OPTIONS = "-w0.0 -b2.0 -l50 -g10 -J300 -K70 -p -f0.3 -ue -DB,5000,0.02 -c1e-6 -n500 -r1"
SEED = 1
TITLES = {"nearest": "nearest point", "bcpd": "BCPD++", "pointmorph": "Pointmorph"}

Array = np.ndarray[Any, Any]


def drawn(shape: formats.Shape, count: int, seed: int) -> tuple[Array, Array]:
    """Faces and barycentric weights of points that are even on the surface."""
    random = np.random.default_rng(seed)
    corners = shape.positions[shape.faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    faces = random.choice(len(areas), count, p=areas / areas.sum())
    ends = np.sort(random.random((count, 2)), axis=1)
    weights = np.diff(ends, axis=1, prepend=0.0, append=1.0)
    return faces, weights


def on(shape: formats.Shape, places: tuple[Array, Array]) -> Array:
    faces, weights = places
    return np.einsum("nk,nkd->nd", weights, shape.positions[shape.faces[faces]])


def area(shape: formats.Shape) -> float:
    a, b, c = np.moveaxis(shape.positions[shape.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def make(folder: Path, count: int) -> None:
    source, target = body(0), body(1)
    places = drawn(source, count, SEED)
    np.save(folder / "source.npy", on(source, places))
    np.save(folder / "truth.npy", on(target, places))
    np.save(folder / "target.npy", on(target, drawn(target, count, SEED + 1)))


# --- The methods, each in a process of its own --------------------------------------------------


def child(method: str, folder: Path) -> None:
    """Writes images.npy, and prints seconds and the bytes that were there before."""
    source, target = (np.load(folder / f"{side}.npy") for side in ("source", "target"))
    before, began = resident("VmRSS"), time.perf_counter()
    if method == "nearest":
        images = target[cKDTree(target).query(source, workers=-1)[1]]
    else:
        import pointmorph

        images = pointmorph.morph(Cloud(source), Cloud(target)).source_to_target
    print(json.dumps([time.perf_counter() - began, before]))
    np.save(folder / "images.npy", images)


def run(words: list[str], folder: Path) -> tuple[str, float, int]:
    """What a program has printed, its seconds, and its peak of memory in bytes."""
    began = time.perf_counter()
    with (folder / "said").open("w+b") as said:
        process = subprocess.Popen(words, cwd=folder, stdout=said, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - began
        said.seek(0)
        text = said.read().decode(errors="replace")
    if process.returncode != 0:
        raise SystemExit(f"{words[0]} ended with {process.returncode}:\n{text[-2000:]}")
    return text, seconds, usage.ru_maxrss * 1024


def of_ours(method: str, folder: Path) -> tuple[float, int]:
    """Seconds, and bytes besides what was there before."""
    text, _, peak = run([sys.executable, __file__, "--child", method, str(folder)], folder)
    seconds, before = json.loads(text.splitlines()[-1])
    return seconds, peak - before


def of_bcpd(program: str, folder: Path) -> tuple[float, int]:
    """The same, the program's own reading and writing of text among them."""
    for side, name in (("target", "x"), ("source", "y")):
        np.savetxt(folder / f"{name}.txt", np.load(folder / f"{side}.npy"), fmt="%.9g")
    words = [program, "-xx.txt", "-yy.txt", *BCPD_OPTIONS.split(), "-ooutput_"]
    _, seconds, peak = run(words, folder)
    np.save(folder / "images.npy", np.loadtxt(folder / "output_y.txt"))
    return seconds, peak


# --- What becomes of it -------------------------------------------------------------------------


def measured(method: str, count: int, bcpd: str, folder: Path) -> dict[str, Any]:
    seconds, peak = of_bcpd(bcpd, folder) if method == "bcpd" else of_ours(method, folder)
    images, truth = np.load(folder / "images.npy"), np.load(folder / "truth.npy")
    errors = np.linalg.norm(images - truth, axis=1) / np.sqrt(area(body(1)))
    return {
        "method": method, "points": count, "seconds": seconds, "bytes": peak,
        "mean": float(errors.mean()), "p99": float(np.quantile(errors, 0.99)),
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    columns = ["points of each", "method", "s", "MB", "error, mean", "error, p99"]
    cells = [
        [f"{row['points']:,}", TITLES[row["method"]], f"{row['seconds']:.3g}",
         f"{row['bytes'] / 1e6:,.0f}", f"{row['mean']:.4f}", f"{row['p99']:.3f}"]
        for row in rows
    ]  # fmt: skip
    align = ["right", "left", *["right"] * 4]
    return str(tabulate(cells, columns, "pipe", disable_numparse=True, colalign=align))


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(9, 3.2), dpi=100)
    columns = [
        ("seconds", 1.0, "seconds"),
        ("bytes", 1e-6, "MB"),
        ("mean", 1.0, "mean error, √area"),
    ]
    for plot, (column, factor, label) in zip(axes, columns, strict=True):
        for method, title in TITLES.items():
            own = [row for row in rows if row["method"] == method]
            plot.plot([row["points"] for row in own], [factor * row[column] for row in own],
                      "o-", label=title)  # fmt: skip
        plot.set(xscale="log", yscale="log", xlabel="points of each", ylabel=label)
        plot.grid(True, which="both", color="0.92")
    axes[0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--bcpd", default="bcpd", help="the program (default: on the PATH)")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child:
        child(chosen.child[0], Path(chosen.child[1]))
        return 0
    rows = []
    for count in chosen.sizes:
        with tempfile.TemporaryDirectory() as name:
            make(Path(name), count)
            for method in TITLES:
                rows.append(measured(method, count, chosen.bcpd, Path(name)))
                print(f"  {rows[-1]}", file=sys.stderr)
    print(table(rows))
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if chosen.picture:
        draw(rows, chosen.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
