"""The tests of native/tests/python/test_properties.py with other examples, and many times as many.

python native/tests/long_runs/properties.py --times 100 --report FILE.json
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]

from reporting import Report  # noqa: E402


class Results:
    """What pytest says of each test."""

    def __init__(self, report: Report) -> None:
        self.report = report
        self.cases: dict[str, int] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        for item in items:
            count = item.function._hypothesis_internal_use_settings.max_examples
            self.cases[item.name.removeprefix("test_").replace("_", " ")] = count

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.report.finds.append(f"{report.nodeid}: {report.longreprtext[-2000:]}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--report", type=Path)
    chosen = parser.parse_args()
    os.environ["POINTMORPH_TIMES"] = str(chosen.times)
    report = Report("Properties of any morph")
    test = HERE.parent / "python" / "test_properties.py"
    results = Results(report)
    pytest.main(["-q", "-p", "no:cacheprovider", str(test)], plugins=[results])
    report.tried = {"times": chosen.times, **results.cases}
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
