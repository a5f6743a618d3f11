"""Kills bakes in Blender at random moments, and looks at what they leave; see `stopped_bakes` in
blender_tests.

PYTHONPATH=<folder with bpy> python native/tests/long_runs/stopped_bakes.py --report FILE.json
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
TESTS = HERE.parents[2] / "blender_tests"
sys.path[:0] = [str(TESTS), str(TESTS / "headless")]

import installing  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=16, help="of each kind of bake")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    chance = random.Random(chosen.seed)
    with tempfile.TemporaryDirectory() as folder:
        os.environ.update(installing.user_folders(folder))
        module = installing.install()
        import bpy
        import stopped_bakes

        sys.path.insert(0, str(HERE))
        from reporting import Report

        report = Report("Bakes in Blender, killed at any moment")
        report.tried["Blender"] = bpy.app.version_string
        for kind in stopped_bakes.KINDS:
            bakes = stopped_bakes.Bakes(module, kind, Path(tempfile.mkdtemp(dir=folder)))
            for number in range(chosen.kills):
                bakes.stop(stopped_bakes.WAYS[number % 2], chance)
                if number % 2:
                    bakes.finish(f"{kind} {number}")
            report.tried[f"{kind}: kills"] = bakes.stopped
            report.tried[f"{kind}: came too late"] = bakes.too_late
            report.finds += bakes.finds
    return report.end(chosen.report)


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # Blender as a Python module doesn't always survive its own end
