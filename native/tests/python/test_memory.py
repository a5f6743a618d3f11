"""How much memory a morph takes at most: docs/reliability.md states these bounds."""

from __future__ import annotations

import subprocess
import sys

import pytest

COUNT = 10_000
BYTES_A_POINT = 2000
BASE = 64 << 20

SCRIPT = """
import sys
from pathlib import Path
import pointmorph

def memory(what):  # getrusage tells the peak of whoever started this process as well
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(what))

kind, side = sys.argv[1], int(sys.argv[2])
sys.path.insert(0, sys.argv[3])
from shapes import grid, grid_faces

faces = grid_faces(side) if kind == "mesh" else None
shapes = [pointmorph.Cloud(grid(side, height), faces=faces) for height in (0.2, 0.5)]
before = memory("VmRSS")
morph = pointmorph.morph(*shapes, method="paper" if kind == "paper" else "auto")
if kind == "frames":
    morph.resampled_frame(0.5)
elif kind == "mesh":
    morph.wrapped(0.5)
else:
    morph.quality
print(memory("VmHWM") - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says how much is in use")
@pytest.mark.parametrize("kind", ["auto", "paper", "mesh", "frames"])
def test_memory_stays_within_its_bound(kind: str) -> None:
    side = round((COUNT / 2) ** 0.5)
    script = [sys.executable, "-c", SCRIPT, kind, str(side), str(__file__).rpartition("/")[0]]
    done = subprocess.run(script, capture_output=True, text=True, check=True)
    assert 0 < int(done.stdout) < BASE + BYTES_A_POINT * 2 * side**2
