"""The suites of tests, and running them side by side."""

from __future__ import annotations

import re
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from . import paths
from .packaging import package
from .python_environment import BPY_VERSIONS, set_up_bpy
from .reports import Outcome, judge, tell
from .running import SetupError, child_environment, end_of, processor_seconds, run, say, show
from .wheels import build_native, set_up

# What the C++ tests need besides what the wheel does.
CPP_TEST_SETTINGS = (
    "-DPOINTMORPH_TESTS=ON",
    "-DPOINTMORPH_BENCHMARKS=ON",
    "-DPOINTMORPH_SANITIZE=address,undefined",
    "-DPOINTMORPH_WERROR=ON",
)

packaging = threading.Lock()


def run_suite(name: str, *command: str | Path, **environment: str) -> Outcome:
    """Runs a suite whose last word ends in `=` or `:`, where its report's path is to stand."""
    report = paths.BUILD / "reports" / f"{name}.xml"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    words = (*command[:-1], f"{command[-1]}{report}")
    ours = child_environment(**environment)
    return judge(run(name, *words, environment=ours, timeout=2700, check=False), report)


def checks() -> Outcome:
    """Formatting, linting and types; each counts as one test."""
    native = [
        path for path in (paths.ROOT / "native").rglob("*") if path.suffix in (".cpp", ".hpp")
    ]
    commands: dict[str, tuple[str | Path, ...]] = {
        "clang-format": (paths.VENV / "bin" / "clang-format", "--dry-run", "--Werror", *native),
        "ruff format": (paths.PYTHON, "-m", "ruff", "format", "--check", paths.ROOT),
        "ruff check": (paths.PYTHON, "-m", "ruff", "check", paths.ROOT),
        "mypy": (paths.PYTHON, "-m", "mypy"),
    }
    outcome = Outcome()
    for name, command in commands.items():
        if run("checks", *command, check=False) == 0:
            outcome.passed += 1
        else:
            outcome.failures.append(name)
    return outcome


def cpp() -> Outcome:
    targets = ("pointmorph_tests", "pointmorph_benchmarks")
    tests = build_native(targets, *CPP_TEST_SETTINGS) / "pointmorph_tests"
    return run_suite("cpp", tests, "--gtest_output=xml:")


def sanitizers() -> Outcome:
    """The C++ tests again, where a bad access or undefined behaviour ends the run."""
    targets = ["pointmorph_sanitized_tests"]
    tests = build_native(targets, *CPP_TEST_SETTINGS) / "pointmorph_sanitized_tests"
    halt = "halt_on_error=1:print_stacktrace=1"
    return run_suite("sanitizers", tests, "--gtest_output=xml:", UBSAN_OPTIONS=halt)


def python() -> Outcome:
    return run_suite("python", paths.PYTHON, "-m", "pytest", "--junitxml=")


def in_blender(suite: str, legacy: bool, *command: str | Path, **environment: str) -> Outcome:
    """The add-on's tests in a Blender, with the add-on packaged and installed as users do it."""
    with packaging:
        zips = package()
    environment["POINTMORPH_ZIP"] = str(zips[legacy])
    return run_suite(suite, *command, "--junitxml=", **environment)


def bpy(version: str) -> Outcome:
    path = "" if version == BPY_VERSIONS[0] else str(set_up_bpy(version))
    command = (paths.PYTHON, "blender_tests/run.py")
    return in_blender(f"bpy-{version}", False, *command, PYTHONPATH=path)


def takes_legacy() -> bool:
    """Whether the installed Blender is older than extensions; Debian's 3.4 is."""
    said = subprocess.run(["blender", "--version"], capture_output=True, text=True, check=False)
    found = re.search(r"Blender (\d+)\.(\d+)", said.stdout)
    return found is not None and (int(found[1]), int(found[2])) < (4, 2)


def blender() -> Outcome:
    """The installed Blender without a window."""
    runner = ("--python-exit-code", "1", "--python", "blender_tests/run.py", "--")
    command = ("blender", "--background", "--factory-startup", *runner)
    return in_blender("blender", takes_legacy(), *command)


def window() -> Outcome:
    """The installed Blender with a window, driven by mouse and keyboard."""
    # Where nothing can be clicked, each test would wait for its own end of patience.
    command = (paths.PYTHON, "-m", "pytest", "--maxfail=3", "blender_tests/window")
    return in_blender("window", takes_legacy(), *command)


def take_pictures() -> int:
    """Takes the manual's pictures anew, from the real window."""
    set_up("blender", "window")
    script = paths.ROOT / "blender_tests" / "window" / "make_pictures.py"
    zips = package()
    environment = child_environment(POINTMORPH_ZIP=str(zips[takes_legacy()]))
    return show(paths.PYTHON, "-m", "pytest", script, environment=environment)


@dataclass(frozen=True)
class Suite:
    run: Callable[[], Outcome]
    debian: tuple[str, ...] = ()
    """Groups of Debian's packages that it needs."""


# In the order in which they are started: long ones early, so that none is left over at the end.
SUITES: dict[str, Suite] = {
    "cpp": Suite(cpp, ("cpp-test",)),
    "checks": Suite(checks),
    "python": Suite(python),
    "sanitizers": Suite(sanitizers, ("cpp-test",)),
    "window": Suite(window, ("blender", "window")),
    **{f"bpy-{version}": Suite(partial(bpy, version)) for version in BPY_VERSIONS},
    "blender": Suite(blender, ("blender",)),
}


def timed(name: str) -> Outcome:
    start, before = time.monotonic(), processor_seconds()
    (paths.LOGS / f"{name}.log").unlink(missing_ok=True)
    say(f"  {name} ...")
    try:
        outcome = SUITES[name].run()
    except SetupError as error:
        outcome = Outcome(failures=[f"could not be run\n{error}"])
    outcome.seconds = time.monotonic() - start
    outcome.processor = processor_seconds() - before
    say(f"  {name}: {'FAILED' if outcome.failures else 'passed'}, {outcome.seconds:.0f} s")
    return outcome


def test(names: list[str], jobs: int) -> int:
    """Runs suites, several at a time, and all of them even when one fails."""
    set_up(*(group for name in names for group in SUITES[name].debian), strict=True)
    say("Testing (what each suite says is in build/logs)")
    with ThreadPoolExecutor(jobs) as pool:
        try:
            outcomes = dict(zip(names, pool.map(timed, names), strict=True))
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise

    for name, outcome in outcomes.items():
        if outcome.failures and (paths.LOGS / f"{name}.log").exists():
            say(f"The log of {name} ends:\n{end_of(name)}")
    for line in tell(outcomes, paths.BUILD / "reports"):
        say(line)
    return 1 if any(outcome.failures for outcome in outcomes.values()) else 0
