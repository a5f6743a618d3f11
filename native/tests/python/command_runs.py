"""Runs of the command line, and the models that they morph."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData
from pointmorph.commands import cli, terminal
from shapes import grid, grid_faces

PAIR = ["morph", "plane.off", "bump.off"]
A, B = 17, 13  # points along a side of the plane and of the bump
COMMAND = [sys.executable, "-m", "pointmorph"]


def run_apart(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs the command line as a user does, in a process of its own."""
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True)


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs it here: a process of its own imports for longer than small morphs take."""
    words = list(map(str, arguments))
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = cli.main(words)
        except SystemExit as end:  # how argparse refuses
            status = int(end.code or 0)
    if status in (terminal.INTERRUPTED, terminal.TERMINATED):
        pytest.exit("ended from outside")  # the command line took the signal that was for pytest
    return subprocess.CompletedProcess(words, status, out.getvalue(), err.getvalue())


def write_off(path: Path, side: int, height: float) -> None:
    positions, faces = grid(side, height), grid_faces(side)
    path.write_text(
        f"OFF\n{len(positions)} {len(faces)} 0\n"
        + "".join(f"{x} {y} {z}\n" for x, y, z in positions)
        + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
    )


def xyz(path: Path) -> np.ndarray:
    rows = PlyData.read(str(path))["vertex"].data
    return np.stack([rows[c] for c in "xyz"], axis=-1)


def write_pair(folder: Path) -> Path:
    """Puts a plane, a bump and a features file for both into a folder."""
    write_off(folder / "plane.off", A, 0.0)
    write_off(folder / "bump.off", B, 0.8)
    marks = {
        "features": {
            "middle": [8 * A + 8, 6 * B + 6],
            "north": [12 * A + 8, 9 * B + 6],
            "west": [8 * A + 4, 6 * B + 3],
            "corner": [0, 0],
        }
    }
    (folder / "features.json").write_text(json.dumps(marks))
    return folder
