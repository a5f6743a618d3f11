"""Random operations on scenes in Blender, thousands of them; see `random_walk` in blender_tests.

PYTHONPATH=<folder with bpy> python native/tests/long_runs/random_walks.py --report FILE.json
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
TESTS = HERE.parents[2] / "blender_tests"
sys.path[:0] = [str(HERE), str(TESTS), str(TESTS / "headless")]

import installing  # noqa: E402
from reporting import Report  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--walks", type=int, default=5)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    report = Report("Random walks through Blender")
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        os.environ.update(installing.user_folders(folder))
        module = installing.install()
        import bpy
        import random_walk

        report.tried["Blender"] = bpy.app.version_string
        for number in range(chosen.walks):
            bpy.ops.wm.read_homefile(use_empty=True)
            walk = random_walk.Walk(
                lambda name: importlib.import_module(f"{module}.{name}"),
                module,
                folder,
                chosen.seed + number,
            )
            try:
                walk.take(chosen.steps)
                random_walk.check_kept(Path(folder) / "end.blend")
            except Exception:
                report.finds.append(f"walk {number}: {traceback.format_exc()[-1500:]}")
            counts.update(walk.counts)
    report.tried |= {"walks": chosen.walks, "steps each": chosen.steps}
    report.tried |= {what.replace("_", " "): count for what, count in counts.most_common()}
    return report.end(chosen.report)


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # Blender as a Python module doesn't always survive its own end
