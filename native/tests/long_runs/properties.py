"""The tests of native/tests/python/test_properties.py with other examples, and many times as many.

python native/tests/long_runs/properties.py --times 100 --report FILE.json

The case that was tried last is kept: where the library ends the program, it is that one.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "python")]

import morph_cases  # noqa: E402
from reporting import Report  # noqa: E402

TEST = HERE.parent / "python" / "test_properties.py"


class Results:
    """What pytest says of each test."""

    def __init__(self) -> None:
        self.finds: list[str] = []
        self.cases: dict[str, int] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        for item in items:
            count = item.function._hypothesis_internal_use_settings.max_examples
            self.cases[item.name.removeprefix("test_").replace("_", " ")] = count

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.finds.append(f"{report.nodeid}: {report.longreprtext[-2000:]}")


def keep_each_case(path: Path) -> None:
    """Each case is written down before it is tried."""
    names = ("name", "positions", "normals", "colors", "radii", "faces")
    tried = morph_cases.Case.morph

    def morph(case: morph_cases.Case, **more: Any) -> Any:
        clouds = [{n: getattr(c, n) for n in names} for c in (case.source, case.target)]
        settings = {**case.settings, **{k: v for k, v in more.items() if k != "start"}}
        path.write_bytes(pickle.dumps((clouds, case.features, settings, "start" in more)))
        return tried(case, **more)

    morph_cases.Case.morph = morph  # type: ignore[method-assign]


def try_all(finds: Path) -> int:
    """Runs the tests, and prints what came of them in its last line."""
    faulthandler.enable()
    keep_each_case(finds)
    results = Results()
    pytest.main(["-q", "-p", "no:cacheprovider", str(TEST)], plugins=[results])
    print(json.dumps({"cases": results.cases, "finds": results.finds}))
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--last", type=Path, default=Path("build/finds/last_case.pickle"))
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.inside:
        return try_all(chosen.last)
    chosen.last.parent.mkdir(parents=True, exist_ok=True)
    report = Report("Properties of any morph", {"times": chosen.times})
    # In a process of its own, whose end can be told.
    words = [sys.executable, __file__, "--inside", "--last", str(chosen.last)]
    environment = {**os.environ, "POINTMORPH_TIMES": str(chosen.times)}
    done = subprocess.run(words, env=environment, stdout=subprocess.PIPE, text=True)
    if done.returncode == 0:
        said = json.loads(done.stdout.splitlines()[-1])
        report.tried |= said["cases"]
        report.finds += said["finds"]
    else:
        report.finds.append(f"ended with {done.returncode} in the case that {chosen.last} holds")
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
