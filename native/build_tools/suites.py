"""The suites of tests, and running them side by side."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from . import other_debian, paths
from .packaging import package
from .python_environment import BLENDERS, set_up_bpy
from .reports import Outcome, judge, tell
from .running import SetupError, child_environment, end_of, processor_seconds, run, say, show
from .system import set_up_system
from .wheels import build_native, set_up, set_up_all, set_up_wheel, set_up_wheels

# What the C++ tests need besides what the wheel does.
CPP_TEST_SETTINGS = (
    "-DPOINTMORPH_TESTS=ON",
    "-DPOINTMORPH_BENCHMARKS=ON",
    "-DPOINTMORPH_SANITIZE=address,undefined",
)

# A newer Debian, and daemons.
CAN_BE_MADE = os.geteuid() == 0 and shutil.which("apt-get") is not None

# The user's own Blender for tests with a window.
BLENDER = os.environ.get("POINTMORPH_BLENDER")
# Else a Debian's: sid has the newest, trixie 4.3. Of several, the first that can be made.
WINDOW_DEBIANS = os.environ.get("POINTMORPH_WINDOW_DEBIAN", "sid,trixie").split(",")
WINDOW_PACKAGES: tuple[str, ...] = ("window",)
if BLENDER is None:
    # Where it can't be made, those tests are skipped, and say why.
    WINDOW_PACKAGES = ("other-debian",) if CAN_BE_MADE else ()

# In the oldest and the newest Blender everything is tested.
WHOLE = (min(BLENDERS), max(BLENDERS))

packaging = threading.Lock()


def run_suite(name: str, *command: str | Path, **environment: str) -> Outcome:
    """Runs a suite whose last word ends in `=` or `:`, where its report's path is to stand."""
    return run_reporting(
        name, lambda report: (*command[:-1], f"{command[-1]}{report}"), environment
    )


def run_reporting(
    name: str,
    command: Callable[[Path], Iterable[str | Path]],
    environment: dict[str, str],
) -> Outcome:
    """Runs a suite; `command` has its words for the path where it is to write its report."""
    report = paths.BUILD / "reports" / f"{name}.xml"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    ours = child_environment(**environment)
    status = run(name, *command(report), environment=ours, timeout=2700, check=False)
    return judge(status, report)


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
    """The C++ tests again, where a bad access, undefined behaviour or a race ends the run, and a
    leak fails it."""
    targets = ("pointmorph_sanitized_tests", "pointmorph_thread_tests")
    build = build_native(targets, *CPP_TEST_SETTINGS)
    halt = "halt_on_error=1:print_stacktrace=1"
    environment = {"UBSAN_OPTIONS": halt, "TSAN_OPTIONS": halt, "POINTMORPH_WATCHED": "1"}
    environment["ASAN_OPTIONS"] = "detect_leaks=1"
    outcome = Outcome()
    for name, tests in zip(("sanitizers", "threads"), targets, strict=True):
        outcome.add(run_suite(name, build / tests, "--gtest_output=xml:", **environment))
    return outcome


def python() -> Outcome:
    return run_suite("python", paths.PYTHON, "-m", "pytest", "--junitxml=")


def farm() -> Outcome:
    """Farms' engines, run for real; where Slurm can't be installed, its tests are skipped."""
    with contextlib.suppress(SetupError):
        fetch_slurm()
    return run_suite("farm", paths.PYTHON, "-m", "pytest", "native/tests/farm", "--junitxml=")


def fetch_slurm() -> None:
    """Slurm's daemons, which need root."""
    if CAN_BE_MADE:
        set_up_system(["farm"])


def in_blender(suite: str, *command: str | Path, **environment: str) -> Outcome:
    """The add-on's tests in a Blender, with the add-on packaged and installed as users do it."""
    with packaging:
        environment["POINTMORPH_ZIP"] = str(package())
    return run_suite(suite, *command, **environment)


def bpy(version: str) -> Outcome:
    """Everything in the oldest and the newest Blender; in the others, what Blender offers."""
    python, path = set_up_bpy(version)
    selection = [] if version in WHOLE else ["-m", "interface and not logic"]
    runner = ["blender_tests/run.py", *selection, "--junitxml="]
    environment = {"PYTHONPATH": path, "POINTMORPH_COMPUTED": str(computed())}
    return in_blender(f"bpy-{version}", python, *runner, **environment)


def computed() -> Path:
    """Where Blenders leave for each other what the library has computed."""
    return paths.BUILD / "computed"


def window() -> Outcome:
    """A Blender with a window, driven by mouse and keyboard: a newer Debian's, or the user's."""
    # Where nothing can be clicked, each test would wait for its own end of patience.
    options = ("-m", "pytest", "--maxfail=3", "blender_tests/window")
    if BLENDER is None and (reason := other_debian.why_not()):
        return Outcome(skips=[f"{reason}; POINTMORPH_BLENDER can name a Blender instead"])
    environment = {"POINTMORPH_COMPUTED": str(computed())}
    return in_blender("window", *with_window(*options), "--junitxml=", **environment)


def with_window(*options: str | Path) -> list[str | Path]:
    """Words that run Python where there is a Blender with a window and the add-on's zip."""
    if BLENDER is not None:
        return [paths.PYTHON, *options]
    debian = other_debian.set_up_first(WINDOW_DEBIANS)
    data = paths.ROOT.parent / "shared" / "data"  # models that aren't in the project
    shared = [paths.ROOT, *([data] if data.is_dir() else [])]
    with packaging:
        environment = {"POINTMORPH_ZIP": str(package()), "POINTMORPH_COMPUTED": str(computed())}
    # There nothing is taken over from here. Pictures are drawn on as many cores as the rest.
    if threads := os.environ.get("OMP_NUM_THREADS"):
        environment |= {"OMP_NUM_THREADS": threads, "LP_NUM_THREADS": threads}
    command = ("env", "-C", paths.ROOT, "python3", *options)
    return list(other_debian.inside(debian, command, shared, environment))


def take_pictures() -> int:
    """Takes the manual's pictures anew, from the real window."""
    set_up("cpython", *WINDOW_PACKAGES)
    if BLENDER is None and (reason := other_debian.why_not()):
        raise SetupError(f"No window: {reason}. POINTMORPH_BLENDER can name a Blender instead.")
    script = paths.ROOT / "blender_tests" / "window" / "make_pictures.py"
    environment = child_environment(POINTMORPH_ZIP=str(package()))
    return show(*with_window("-m", "pytest", script), environment=environment)


@dataclass(frozen=True)
class Suite:
    run: Callable[[], Outcome]
    debian: tuple[str, ...] = ()
    """Groups of Debian's packages that it needs."""
    fetch: Callable[[], object] | None = None
    """Gets what else it needs, where that is wanted beforehand; `run` does it where it wasn't."""
    waits: bool = False
    """Whether it waits for half of its time, as a user does: another suite runs meanwhile."""


def fetch_debian() -> None:
    if BLENDER is None and other_debian.why_not() is None:
        other_debian.set_up_first(WINDOW_DEBIANS)


def in_bpy(*versions: str) -> dict[str, Suite]:
    return {
        f"bpy-{version}": Suite(partial(bpy, version), ("cpython",), partial(set_up_bpy, version))
        for version in versions
    }


# In the order in which they are started: the longest first, so that no core idles at the end, but
# the newest Blender before the oldest, which takes over what the other has computed.
SUITES: dict[str, Suite] = {
    "window": Suite(window, ("cpython", *WINDOW_PACKAGES), fetch_debian, waits=True),
    "sanitizers": Suite(sanitizers, ("cpp-test",)),
    **in_bpy(max(BLENDERS)),
    "python": Suite(python),
    **in_bpy(min(BLENDERS)),
    "cpp": Suite(cpp, ("cpp-test",)),
    "farm": Suite(farm, (), fetch_slurm),
    **in_bpy(*(version for version in reversed(BLENDERS) if version not in WHOLE)),
    "checks": Suite(checks),
}


def groups_of(names: Iterable[str]) -> list[str]:
    """The groups of Debian's packages that suites need."""
    return [group for name in names for group in SUITES[name].debian]


def set_up_tests(names: Iterable[str]) -> list[SetupError]:
    """Gets all that suites need, side by side, while the library is compiled; what went wrong."""
    groups = groups_of(names)
    fetches = [fetch for name in names if (fetch := SUITES[name].fetch) is not None]
    # Blenders have Pythons of several versions.
    return set_up_all(groups, set_up_wheels if "cpython" in groups else set_up_wheel, fetches)


def stand_back() -> None:
    """What this thread starts from now on leaves cores to those who wait for a window."""
    if sys.platform == "linux":  # where threads have a priority of their own
        with suppress(OSError):  # a sandbox may not know priorities
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 5)


def timed(name: str, suite: Suite) -> Outcome:
    start, before = time.monotonic(), processor_seconds()
    if not suite.waits:
        stand_back()
    (paths.LOGS / f"{name}.log").unlink(missing_ok=True)
    say(f"  {name} ...")
    try:
        outcome = suite.run()
    except SetupError as error:
        outcome = Outcome(failures=[f"could not be run\n{error}"])
    outcome.seconds = time.monotonic() - start
    outcome.processor = processor_seconds() - before
    say(f"  {name}: {'FAILED' if outcome.failures else 'passed'}, {outcome.seconds:.0f} s")
    return outcome


def test(names: list[str], jobs: int) -> int:
    """Runs suites, several at a time, and all of them even when one fails.

    What only one of them needs, it gets itself, while others compute.
    """
    # A suite whose needs can't be met tries again, and fails by itself.
    set_up_all(groups_of(names), set_up_wheel, [])
    return run_suites({name: SUITES[name] for name in names}, jobs)


def run_suites(suites: Mapping[str, Suite], jobs: int) -> int:
    """Runs suites whose needs are met, and tells what came of them."""
    say("Testing (what each suite says is in build/logs)")
    shutil.rmtree(computed(), ignore_errors=True)
    computed().mkdir(parents=True)
    # Each suite has its share of the cores: with more threads than that they wait for one another.
    # Tests of what threads do choose their number themselves.
    share = max(1, (os.cpu_count() or 1) // min(jobs, len(suites)))
    os.environ.setdefault("OMP_NUM_THREADS", str(share))
    more = sum(suite.waits for suite in suites.values()) if jobs > 1 else 0
    with ThreadPoolExecutor(jobs + more) as pool:
        try:
            outcomes = dict(zip(suites, pool.map(timed, suites, suites.values()), strict=True))
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise

    for name, outcome in outcomes.items():
        if outcome.failures and (paths.LOGS / f"{name}.log").exists():
            say(f"The log of {name} ends:\n{end_of(name)}")
    for line in tell(outcomes, paths.BUILD / "reports"):
        say(line)
    return 1 if any(outcome.failures for outcome in outcomes.values()) else 0
