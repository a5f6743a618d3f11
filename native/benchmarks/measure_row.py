"""Measures what a row or more of the table of benchmarks is about; see build_tools/benchmarks.py.

    measure_row.py NAME --runs N --json FILE

U is the time to build both kd-trees and find 16 neighbors of every point, points in Morton order,
on the same threads; it and what is measured take turns. Shapes are those of shared/data beside the
checkout, else bodies with five limbs that are made here. Samples of them are kept in
build/bench/clouds. Linux only, because of the memory.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import bench_morph
import numpy as np
import pointmorph
import unit_of_time
from build_tools.benchmarks import SIZES
from pointmorph import Cloud, formats, meshes

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data"
SAMPLES = ROOT / "build" / "bench" / "clouds"
ASIDE = ("quadruped_381_392", "quadruped_384_397", "quadruped_395_399")
LIMBS = ((1.0, 0.1, 0.2), (0.5, 0.8, -0.6), (0.5, -0.8, -0.6), (-0.6, 0.7, -0.7), (-0.8, -0.2, 0.9))

FRAMES = 40

Array = np.ndarray[Any, Any]
Marks = dict[str, tuple[int, int]]
Values = dict[str, list[float]]
"""What each run took, for every row."""


class Pair:
    """Two clouds in Morton order, and what is marked on both."""

    def __init__(self, name: str, clouds: Sequence[Cloud], rows: Sequence[Sequence[int]]) -> None:
        self.name = name
        orders = [morton_order(np.asarray(cloud.positions, float)) for cloud in clouds]
        self.clouds = [in_order(c, o) for c, o in zip(clouds, orders, strict=True)]
        places = [np.argsort(order) for order in orders]
        self.marks: Marks = {
            str(k): (int(places[0][s]), int(places[1][t]))
            for k, (s, t) in enumerate(zip(*rows, strict=True))
        }

    def unit(self) -> None:
        for cloud in self.clouds:
            unit_of_time.find_neighbors(cloud.positions)

    def morph(self, marked: bool = False, **settings: Any) -> pointmorph.Morph:
        return pointmorph.morph(*self.clouds, self.marks if marked else {}, **settings)


def morton_order(positions: Array) -> Array:
    """Rows so that those near each other in space are near each other in the order."""
    low = positions.min(axis=0)
    cells = ((positions - low) / max(np.ptp(positions, axis=0).max(), 1e-300) * 65535).astype(int)
    keys = np.zeros(len(positions), np.int64)
    for bit in range(16):
        for axis in range(3):
            keys |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(keys, kind="stable")


def in_order(cloud: Cloud, order: Array) -> Cloud:
    normals = None if cloud.normals is None else cloud.normals[order]
    return Cloud(cloud.positions[order], normals)


def body(number: int) -> formats.Shape:
    """A ball with limbs, thinner and longer with every number."""
    side = 160
    turn, height = np.meshgrid(
        np.linspace(0, 2 * np.pi, 2 * side, endpoint=False), np.linspace(0, np.pi, side + 1)
    )
    round_ = np.sin(height)
    out = np.stack([np.cos(turn) * round_, np.sin(turn) * round_, np.cos(height)], -1)
    radius = np.ones(out.shape[:2])
    for limb in LIMBS:
        along = out @ (np.array(limb) / np.linalg.norm(limb))
        radius += (0.8 + 0.2 * number) * np.exp((14 + 3 * number) * (along - 1))
    row, column = np.arange(side)[:, None] * 2 * side, np.arange(2 * side)
    a, b = row + column, row + (column + 1) % (2 * side)
    corners = [np.stack([a, a + 2 * side, b], -1), np.stack([b, a + 2 * side, b + 2 * side], -1)]
    faces = np.concatenate([c.reshape(-1, 3) for c in corners])
    return formats.Shape(f"body {number}", (out * radius[..., None]).reshape(-1, 3), faces=faces)


def limb_rows(shape: formats.Shape) -> list[int]:
    return [int(np.argmax(shape.positions @ np.array(limb))) for limb in LIMBS]


def shapes() -> tuple[str, list[formats.Shape], list[list[int]]]:
    """Two closed models with faces, and what is marked on them."""
    folder = SHARED / "koala_spot"
    if not folder.is_dir():
        both = [body(0), body(1)]
        return "bodies", both, [limb_rows(shape) for shape in both]
    content = json.loads((folder / "pair.json").read_text())
    both = [formats.read(folder / content[side]) for side in ("source", "target")]
    return (
        folder.name,
        both,
        [list(rows) for rows in zip(*content["features"].values(), strict=True)],
    )


def sampled(counts: Sequence[int]) -> Pair:
    """The closed models with so many points each."""
    name, both, rows = shapes()
    clouds, kept = [], []
    for shape, count, keep in zip(both, counts, rows, strict=True):
        key = hashlib.sha256(np.ascontiguousarray(shape.positions).tobytes()).hexdigest()[:12]
        path = SAMPLES / f"{key}_{count}.npz"
        if not path.is_file():
            cloud, found = meshes.sample(shape, count, keep=keep)
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(".part.npz")
            np.savez(part, positions=cloud.positions, normals=cloud.normals, rows=found)
            part.replace(path)
        with np.load(path) as stored:
            clouds.append(Cloud(stored["positions"], stored["normals"]))
            kept.append(stored["rows"].tolist())
    return Pair(name, clouds, kept)


def disks() -> Pair:
    clouds, marks = bench_morph.clouds((98_250, 84_348))
    name = "nefertiti_demosthenes" if bench_morph.SHARED.is_dir() else "reliefs"
    return Pair(name, clouds, list(zip(*marks.values(), strict=True)))


def small_pairs() -> list[Pair]:
    """Three pairs that nothing was fitted to, of 10,000 and 8,000 points."""
    folders = [SHARED / "evaluation_only" / name for name in ASIDE]
    pairs = []
    for number, folder in enumerate(folders):
        if all(folder.is_dir() for folder in folders):
            content = json.loads((folder / "pair.json").read_text())
            files = [formats.read(folder / content[side]) for side in ("source", "target")]
            rows = list(zip(*content["features"].values(), strict=True))
            pairs.append(Pair("quadrupeds", [shape.cloud() for shape in files], rows))
        else:
            both = [body(number), body(number + 1)]
            found = [
                meshes.sample(shape, count, keep=limb_rows(shape))
                for shape, count in zip(both, (10_000, 8_000), strict=True)
            ]
            pairs.append(Pair("bodies", [c for c, _ in found], [r.tolist() for _, r in found]))
    return pairs


def seconds(run: Callable[[], Any]) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def in_turns(first: Callable[[], Any], second: Callable[[], Any], runs: int) -> list[list[float]]:
    """The times of both, which take turns, so that whatever else the machine does meets both."""
    times = [(seconds(first), seconds(second)) for _ in range(runs)]
    return [[pair[k] for pair in times] for k in (0, 1)]


def ratios(over: Callable[[], Any], run: Callable[[], Any], runs: int) -> list[float]:
    """How often what `run` takes has what `over` takes, run by run."""
    below, above = in_turns(over, run, runs)
    return [a / b for a, b in zip(above, below, strict=True)]


def map_of(pair: Pair, name: str, runs: int, **settings: Any) -> tuple[str, Values]:
    units, times = in_turns(pair.unit, lambda: pair.morph(**settings), runs)
    found = {name: [t / u for t, u in zip(times, units, strict=True)], f"{name}_seconds": times}
    return pair.name, found


def small(runs: int, marked: bool) -> tuple[str, Values]:
    pairs = small_pairs()
    each = [ratios(pair.unit, lambda pair=pair: pair.morph(marked), runs) for pair in pairs]
    by_run = list(zip(*each, strict=True))
    means = [statistics.mean(values) for values in by_run]
    name = "small_marks" if marked else "small"
    return pairs[0].name, {name: means, f"{name}_most": [max(values) for values in by_run]}


def write(pair: Pair, folder: Path) -> list[Path]:
    """Both clouds as files."""
    found = []
    for side, cloud in zip(("source", "target"), pair.clouds, strict=True):
        colors, radii = np.ones((len(cloud), 4), np.float32), np.full(len(cloud), 0.01, np.float32)
        found.append(folder / f"{side}.ply")
        formats.write_ply(found[-1], cloud.positions, cloud.normals, colors, radii)
    return found


def command(inputs: Sequence[Path], out: Path, threads: int = 0) -> float:
    """Runs the whole command; the largest memory that it had, in GiB."""
    words = [sys.executable, "-m", "pointmorph", "morph", *map(str, inputs), "--out", str(out)]
    process = subprocess.Popen([*words, "--threads", str(threads)], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{' '.join(words)}: status {process.returncode}")
    return usage.ru_maxrss / 1024**2


def whole_command(name: str, points: int, runs: int) -> tuple[str, Values]:
    pair, memory = sampled((points, points)), []
    with tempfile.TemporaryDirectory() as folder:
        inputs, out = write(pair, Path(folder)), Path(folder, "out")
        found = ratios(pair.unit, lambda: memory.append(command(inputs, out)), runs)
    return pair.name, {name: found, f"{name}_memory": memory}


def threads_of_command(runs: int) -> tuple[str, Values]:
    pair = sampled((1_000_000, 1_000_000))
    with tempfile.TemporaryDirectory() as folder:
        inputs, out = write(pair, Path(folder)), Path(folder, "out")
        runs_of = [lambda n=n: command(inputs, out, n) for n in (2, 1)]
        return pair.name, {"threads_command": ratios(*runs_of, runs)}


def threads_of_map(runs: int) -> tuple[str, Values]:
    pair = sampled((1_000_000, 1_000_000))
    of = [lambda n=n: pair.morph(threads=n) for n in (2, 1)]
    return pair.name, {"threads": ratios(*of, runs)}


@contextmanager
def blender() -> Iterator[Any]:
    """The Blender that is a package of this Python, with the add-on of this folder; gives what
    makes scenes for its tests."""
    sys.path[:0] = [str(ROOT / "blender_tests"), str(ROOT / "blender_tests" / "headless")]
    import installing

    with tempfile.TemporaryDirectory() as folder:
        os.environ.update(installing.user_folders(folder))
        import scenes

        installing.install()
        yield scenes


def operator(runs: int) -> tuple[str, Values]:
    with blender() as scenes:
        import bpy

        pair = sampled((98_250, 84_348))
        clouds = list(zip(("Source", "Target"), pair.clouds, strict=True))
        scenes.pick(*(scenes.add_mesh(name, cloud.positions) for name, cloud in clouds))
        bare = [Cloud(cloud.positions) for cloud in pair.clouds]
        bpy.ops.pointmorph.morph()  # groups of nodes are made once
        found = ratios(lambda: pointmorph.morph(*bare), bpy.ops.pointmorph.morph, runs)
    return pair.name, {"operator": found}


def playing(shown: Any, runs: int) -> list[float]:
    """How long Blender takes to go to another frame of what is shown, in ms, without drawing it. A
    run is the median of many."""
    import bpy

    slider = shown.data.shape_keys.key_blocks["Morph"]
    moments = iter(np.linspace(0.05, 0.95, FRAMES * runs + 2))

    def go() -> None:
        slider.value = next(moments)
        bpy.context.view_layer.update()

    go(), go()  # what is made ahead is made, on both sides of the driver
    each = [1000 * seconds(go) for _ in range(FRAMES * runs)]
    return [statistics.median(each[k::runs]) for k in range(runs)]


def playback(runs: int) -> tuple[str, Values]:
    """Points and discs of two clouds, and the source's faces of two meshes."""
    with blender() as scenes:
        import bpy

        found: Values = {}
        pair = sampled((120_008, 100_009))
        clouds = list(zip(("Source", "Target"), pair.clouds, strict=True))
        scenes.pick(*(scenes.add_mesh(name, cloud.positions) for name, cloud in clouds))
        points = scenes.morph()
        found["playback_points"] = playing(points, runs)
        bpy.ops.pointmorph.show_as(kind="DISCS")
        found["playback_discs"] = playing(points, runs)
        bpy.data.objects.remove(points)
        both = shapes()[1]
        scenes.pick(*(scenes.add_mesh(s.name, s.positions, s.faces) for s in both))
        bpy.context.scene.pointmorph.show_as = "MESH"
        found["playback_mesh"] = playing(scenes.morph(), runs)
    return pair.name, found


def copying(size: int) -> Callable[[], None]:
    """Copies that many bytes, half of them read and half written, on all threads."""
    source, target = np.ones(size // 2, np.uint8), np.ones(size // 2, np.uint8)
    parts = len(os.sched_getaffinity(0))
    pool = ThreadPoolExecutor(parts)
    cuts = np.linspace(0, size // 2, parts + 1).astype(int)
    pieces = [slice(a, b) for a, b in pairwise(cuts)]
    return lambda: [
        *pool.map(lambda piece: np.copyto(target[piece], source[piece]), pieces)
    ].clear()


def share_of_copy(morph: pointmorph.Morph, runs: int) -> list[float]:
    """The bandwidth of frames in % of a copy's. A run is the median of many: each is short."""
    out = morph.empty_frame()
    # Both ends are read and the frame is written: 11 numbers a pair.
    copy = copying(3 * 11 * len(morph.pairs) * out.positions.dtype.itemsize)
    morph.frame(0.5, out)  # paths are laid out once
    moments = iter(np.linspace(0.05, 0.95, FRAMES * runs))
    each = ratios(copy, lambda: morph.frame(next(moments), out), FRAMES * runs)
    return [100 / statistics.median(each[k::runs]) for k in range(runs)]


def frames(runs: int) -> tuple[str, Values]:
    pair = sampled((140_300, 117_000))
    paths = ("linear", "rigid")
    return pair.name, {f"frame_{p}": share_of_copy(pair.morph(path=p), runs) for p in paths}


def frame_in_units(morph: pointmorph.Morph, t: float) -> float:
    """What a frame with new points takes over the neighborhoods of its own points."""
    start = time.perf_counter()
    frame = morph.resampled_frame(t)
    taken = time.perf_counter() - start
    return taken / seconds(lambda: unit_of_time.find_neighbors(frame.positions))


def resampling(runs: int) -> tuple[str, Values]:
    pair = sampled((120_008, 100_009))
    found: Values = {"resampling": [], "resampling_frame": []}
    for _ in range(runs):
        morph, unit = pair.morph(), seconds(pair.unit)
        found["resampling"].append(seconds(morph.inserted) / unit)
        each = [frame_in_units(morph, t) for t in (0.05, 0.25, 0.5, 0.75, 0.95)]
        found["resampling_frame"].append(statistics.median(each))
    return pair.name, found


def measured(name: str, runs: int) -> tuple[str, Values]:
    if name in SIZES:
        return map_of(sampled((SIZES[name], SIZES[name])), name, runs)
    if name.startswith("command"):
        return whole_command(name, SIZES[name.replace("command", "map")], runs)
    closed, paper = (98_250, 84_348), {"method": "paper"}
    calls: dict[str, Callable[[], tuple[str, Values]]] = {
        "marks": lambda: map_of(sampled(closed), name, runs, marked=True),
        "small": lambda: small(runs, marked=False),
        "small_marks": lambda: small(runs, marked=True),
        "disk": lambda: map_of(disks(), name, runs, marked=True, **paper, domain="disk"),
        "cut": lambda: map_of(sampled(closed), name, runs, marked=True, **paper, domain="cut"),
        "sphere": lambda: map_of(
            sampled(closed), name, runs, marked=True, **paper, domain="sphere"
        ),
        "operator": lambda: operator(runs),
        "playback": lambda: playback(runs),
        "threads": lambda: threads_of_map(runs),
        "threads_command": lambda: threads_of_command(runs),
        "frames": lambda: frames(runs),
        "resampling": lambda: resampling(runs),
    }
    return calls[name]()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name")
    parser.add_argument("--runs", type=int, required=True)
    parser.add_argument("--json", type=Path, required=True)
    arguments = parser.parse_args()
    unit_of_time.ready()
    shapes, values = measured(arguments.name, arguments.runs)
    arguments.json.write_text(json.dumps({"shapes": shapes, "values": values}))
    # Blender as a Python module doesn't always survive its own end.
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
