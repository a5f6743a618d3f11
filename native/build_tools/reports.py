"""What tests said: counts, reasons and times, read from the reports that they wrote."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

SLOWEST = 20
"""How many of the slowest tests are shown."""


@dataclass
class Outcome:
    """What came of a suite: counts, and a line for everything that failed or was skipped."""

    passed: int = 0
    failures: list[str] = field(default_factory=list)
    skips: list[str] = field(default_factory=list)
    """The reason for each test that was skipped."""
    left_out: list[str] = field(default_factory=list)
    """What was skipped, by name and with its reason."""
    times: dict[str, float] = field(default_factory=dict)
    """Seconds that each test took; the first test that needs a fixture pays for it."""
    seconds: float = 0.0
    """From the suite's start to its end, building included."""
    processor: float = 0.0
    """Processor seconds, which other suites beside it don't change."""

    def skip(self, reason: str, *names: str) -> None:
        """Notes what wasn't run at all."""
        self.skips += [reason] * len(names)
        self.left_out += [f"{name}: {reason}" for name in names]

    def add(self, other: Outcome) -> None:
        """Takes in what came of another program of the same suite."""
        self.passed += other.passed
        self.failures += other.failures
        self.skips += other.skips
        self.left_out += other.left_out
        self.times |= other.times


def read_junit(report: Path) -> Outcome:
    """What Google Test or pytest reported."""
    outcome = Outcome()
    for case in ElementTree.parse(report).iter("testcase"):
        name = f"{case.get('classname')}.{case.get('name')}"
        bad = [child for child in case if child.tag in ("failure", "error")]
        skip = case.find("skipped")
        outcome.times[name] = float(case.get("time") or 0)
        if bad:
            message = (bad[0].get("message") or "").strip().partition("\n")[0]
            outcome.failures.append(f"{name}: {message}")
        elif skip is not None or case.get("status") == "notrun":
            reason = "disabled" if skip is None else _reason(skip)
            outcome.skips.append(reason)
            outcome.left_out.append(f"{name}: {reason}")
        else:
            outcome.passed += 1
    return outcome


def _reason(skip: ElementTree.Element) -> str:
    """Why a test was skipped, without the file and line that stand beside it."""
    message = skip.get("message", "")
    # Of a whole file, pytest writes the reason elsewhere, as a tuple's last part.
    whole = re.search(r"['\"]Skipped: (.*)['\"]\)$", (skip.text or "").strip())
    if message == "collection skipped" and whole:
        return whole[1]
    return re.sub(r"^\S+:\d+\n", "", message)


def judge(status: int, report: Path) -> Outcome:
    """The outcome of a suite that ended with `status` and was to write `report`."""
    try:
        outcome = read_junit(report)
    except (OSError, ElementTree.ParseError):
        return Outcome(failures=[f"ended with status {status} and left no report"])
    if status != 0 and not outcome.failures:
        outcome.failures.append(f"ended with status {status} though no test failed")
    if not outcome.passed and not outcome.failures:
        outcome.failures.append("ran no test")
    return outcome


def times_of(outcomes: Mapping[str, Outcome]) -> list[str]:
    """Lines that say which tests were the slowest."""
    tests = [(t, name, test) for name, o in outcomes.items() for test, t in o.times.items()]
    tests.sort(key=lambda test: (-test[0], *test[1:]))
    if not tests:
        return []
    lines = [f"The {min(SLOWEST, len(tests))} slowest of {len(tests)} tests, in seconds:"]
    return lines + [f"{t:>8.1f}  {name}: {test}" for t, name, test in tests[:SLOWEST]]


def table_of(outcomes: Mapping[str, Outcome]) -> list[str]:
    """Lines with the figures of every suite; the last is the sum."""
    heads = ("passed", "failed", "skipped", "seconds", "processor", "share")
    lines = [f"{'suite':<12}" + "".join(f"{head:>10}" for head in heads)]
    whole = sum(outcome.processor for outcome in outcomes.values()) or 1.0
    sums = [0, 0, 0]
    for name, outcome in outcomes.items():
        counts = (outcome.passed, len(outcome.failures), len(outcome.skips))
        sums = [a + b for a, b in zip(sums, counts, strict=True)]
        times = f"{outcome.seconds:>10.0f}{outcome.processor:>10.0f}"
        share = f"{100 * outcome.processor / whole:>8.0f} %"
        lines.append(f"{name:<12}{'{:>10}{:>10}{:>10}'.format(*counts)}{times}{share}")
    return [*lines, "{} passed, {} failed, {} skipped".format(*sums)]


def tell(outcomes: Mapping[str, Outcome], folder: Path) -> list[str]:
    """All that is to be said of a run; the times are kept in `folder` as well."""
    lines = []
    for name, outcome in outcomes.items():
        for reason, count in Counter(outcome.skips).items():
            lines.append(f"skipped {count} in {name}: {reason}")
        lines += [f"FAILED in {name}: {failure}" for failure in outcome.failures]
    folder.mkdir(parents=True, exist_ok=True)
    left_out = [f"{suite}: {what}" for suite, o in outcomes.items() for what in o.left_out]
    (folder / "left_out.txt").write_text("\n".join([*left_out, ""]))
    kept = {
        name: {"seconds": o.seconds, "processor": o.processor, "tests": o.times}
        for name, o in outcomes.items()
    }
    (folder / "times.json").write_text(json.dumps(kept, indent=1))
    slowest, table = times_of(outcomes), table_of(outcomes)
    (folder / "times.txt").write_text("\n".join([*slowest, *table, ""]))
    return [*lines, *slowest, *table]
