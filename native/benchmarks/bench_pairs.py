"""Every pair in a folder through `pointmorph morph`, without options: what comes of it.

    bench_pairs.py FOLDER... [--out DIR] [--seconds N] [--option NAME=VALUE ...]

A folder with a pair.json (`features`, as the command line reads them) is a pair, its source.ply to
its target.ply. Of any other folder that holds several models, all ordered pairs are tried, without
features. Each run is a process of its own on one thread, with a limit of time, and its result is
checked on what it wrote: exact end frames, every point of both models in a pair. Results are kept
in DIR, one file a run, and not computed again: what was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pointmorph import formats
from pointmorph.storage import files

HEADER = (
    "pair",
    "points",
    "outcome",
    "topology",
    "torn %",
    "flips %",
    "dirichlet",
    "U",
)


@dataclass(frozen=True)
class Run:
    name: str
    source: Path
    target: Path
    features: Path | None


def runs_of(folder: Path) -> Iterator[Run]:
    """A pair, those of the models in the folder, or those of the folders below."""
    if (folder / "pair.json").is_file():
        yield Run(folder.name, folder / "source.ply", folder / "target.ply", folder / "pair.json")
        return
    models = sorted(p for p in folder.iterdir() if p.suffix.lower() in formats.SUFFIXES)
    for source in models:
        for target in models:
            if source != target:
                yield Run(f"{source.stem} to {target.stem}", source, target, None)
    for below in sorted(p for p in folder.iterdir() if p.is_dir()):
        yield from runs_of(below)


def morph(run: Run, options: Sequence[str], seconds: float) -> dict[str, Any]:
    """What came of one run: `outcome`, and the report's figures where there is one."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "pointmorph", "morph", str(run.source), str(run.target)]
        command += ["--out", out, "--frames", "2", *options]
        if run.features:
            command += ["--features", str(run.features)]
        settings = {**os.environ, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=seconds, env=settings, check=False
            )
        except subprocess.TimeoutExpired:
            return {"outcome": f"FAILED: over {seconds:g} s"}
        if done.returncode != 0:
            message = (done.stderr.strip().splitlines() or [""])[-1]
            refused = done.returncode in (1, 2) and message.startswith("pointmorph: ")
            return {"outcome": ("refused: " if refused else "FAILED: ") + message}
        report = json.loads((Path(out) / "report.json").read_text())
        return {"outcome": checked(Path(out)), **figures(report)}


def checked(folder: Path) -> str:
    """Says "morphs", or what is wrong with what a run wrote."""
    pairs = np.load(folder / "pairs.npy")
    for side, name in enumerate(("source", "target")):
        cloud = formats.read(folder / f"{name}.ply")
        frame = formats.read(folder / f"frame_{side:04d}.ply")
        if set(pairs[:, side].tolist()) != set(range(len(cloud.positions))):
            return f"FAILED: points of the {name} in no pair"
        if not np.array_equal(frame.positions, cloud.positions[pairs[:, side]]):
            return f"FAILED: the frame at t = {side} isn't the {name}"
        for values in (frame.positions, frame.normals, frame.colors, frame.radii):
            if values is None or not np.isfinite(values).all():
                return f"FAILED: numbers missing at t = {side}"
    return "morphs"


def figures(report: dict[str, Any]) -> dict[str, Any]:
    quality = report["quality"].values()
    return {
        "points": report["points"],
        "topology": report["choice"],
        "torn": 100 * max(report["cracks"].values()),
        "flips": 100 * max(way["flipped"] for way in quality),
        "dirichlet": [way["dirichlet"] for way in quality],
        "units": report["seconds"] / report["stages"]["neighborhoods"],
        "warnings": report["warnings"],
    }


def row_of(name: str, result: dict[str, Any]) -> str:
    cells = [name, "", result["outcome"], *[""] * (len(HEADER) - 3)]
    if "points" in result:
        first, second = result["dirichlet"]
        cells[1] = " / ".join(f"{count:,}" for count in result["points"])
        cells[3:] = [
            result["topology"],
            f"{result['torn']:.2f}",
            f"{result['flips']:.1f}",
            f"{first:.2f} / {second:.2f}",
            f"{result['units']:.0f}",
        ]
    return "| " + " | ".join(cells) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--out", type=Path, default=Path("bench_pairs"), metavar="DIR")
    parser.add_argument("--seconds", type=float, default=300.0, help="limit of a run")
    parser.add_argument("--option", action="append", default=[], metavar="NAME=VALUE")
    chosen = parser.parse_args()
    options = [word for o in chosen.option for word in ("--" + o.split("=")[0], o.split("=")[1])]
    chosen.out.mkdir(parents=True, exist_ok=True)
    print("| " + " | ".join(HEADER) + " |\n" + "|---" * len(HEADER) + "|", flush=True)
    failed = 0
    for run in (run for folder in chosen.folders for run in runs_of(folder)):
        kept = chosen.out / f"{run.name}.json"
        if not kept.is_file():
            result = morph(run, options, chosen.seconds)
            files.write_bytes(kept, json.dumps(result, indent=1).encode())
        result = json.loads(kept.read_text())
        failed += result["outcome"].startswith("FAILED")
        print(row_of(run.name, result), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
