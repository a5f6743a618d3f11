"""Tests of what is built for Windows, under Wine.

Wine keeps what it takes for a Windows disk in `build/windows`, and packages for Windows lie beside
it. No window is opened and nothing is drawn.
"""

from __future__ import annotations

import json
import shutil
import threading
import zipfile
from pathlib import Path

from . import paths
from .packaging import package
from .python_environment import fetch_cpython
from .reports import Outcome
from .running import child_environment, digest, is_fresh, run, step
from .suites import Suite, run_reporting, run_suites
from .system import project
from .targets import WINDOWS
from .wheels import build_native, set_up_wheels, wheel_of
from .wheels import set_up as set_up_base

WINE = "/usr/lib/wine/wine64"
WINE_SERVER = "/usr/lib/wine/wineserver64"
PYTHON = "3.11"
BLENDER = "4.2"
# Real pairs beside the checkout, a closed and an open one.
PAIRS = ("koala_spot", "face_nefertiti")
# Of the Python tests, those of building, which is done on Linux.
BUILDING = ("build_addon", "materials", "platforms", "releases")

_setting_up = threading.Lock()


def _folder() -> Path:
    return paths.BUILD / "windows"


def path(here: str | Path) -> str:
    """The name of a file of this system on Wine's Z: drive."""
    return "Z:" + str(here).replace("/", "\\")


def variables(**more: str) -> dict[str, str]:
    """What programs for Windows find in their environment."""
    ours = {
        "WINEPREFIX": str(_folder() / "wine"),
        "WINEDEBUG": "-all",
        # Wine would ask whether to fetch two of them; the debugger waits for somebody.
        "WINEDLLOVERRIDES": "mscoree,mshtml,winedbg.exe=",
        "DISPLAY": "",
        "PYTHONUTF8": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    return ours | more


def words(*command: str | Path) -> tuple[str | Path, ...]:
    """A command under Wine. Its output goes through a pipe: into a file, Python can't write it."""
    return ("bash", "-o", "pipefail", "-c", '"$@" 2>&1 | cat', "wine", WINE, *command)


def run_suite(name: str, *command: str | Path, **environment: str) -> Outcome:
    """As for this system: runs a suite, at the end of whose last word its report's path stands."""

    def command_for(report: Path) -> tuple[str | Path, ...]:
        return words(*command[:-1], f"{command[-1]}{path(report)}")

    return run_reporting(name, command_for, variables(**environment))


def python_program(python: str = PYTHON) -> Path:
    return fetch_cpython(python, WINDOWS.cpython[python]) / "python.exe"


def set_up() -> None:
    """Wine's disk, and the packages that Python and the tests need there."""
    with _setting_up:
        prefix = _folder() / "wine"
        if not (prefix / "made").exists():
            with step("Wine's disk"):
                prefix.mkdir(parents=True, exist_ok=True)
                ours = child_environment(**variables())
                run("wine", WINE, "wineboot", "--init", environment=ours)
                run("wine", WINE_SERVER, "--wait", environment=ours)
                (prefix / "made").touch()
        groups = project()["dependency-groups"]
        for python in WINDOWS.pythons:
            title = f"packages for Windows, Python {python}"
            group = groups["windows" if python == PYTHON else "windows-bits"]
            _install(f"packages-{python}", title, *group, python=python)


def _install(name: str, title: str, *requirements: str | Path, python: str = PYTHON) -> Path:
    """A folder with packages for a Python on Windows."""
    folder = _folder() / name
    stamp, key = _folder() / f"{name}.stamp", digest(*requirements)
    if not is_fresh(stamp, key):
        with step(title):
            shutil.rmtree(folder, ignore_errors=True)
            system = ("--platform", WINDOWS.tag, "--python-version", python)
            pip = (paths.PYTHON, "-m", "pip", "install", "--no-input", "--progress-bar", "off")
            options = (*system, "--only-binary=:all:", "--no-compile", "--target", folder)
            run("pip-windows", *pip, *options, *requirements)
            stamp.write_text(key)
    return folder


def python_path(*more: Path, python: str = PYTHON) -> str:
    """The library as its wheel has it, and packages, as PYTHONPATH."""
    wheel = wheel_of(WINDOWS, python)
    folder = _folder() / f"pointmorph-{python}"
    stamp = _folder() / f"pointmorph-{python}.stamp"
    with _setting_up:
        if not is_fresh(stamp, key := digest(wheel)):
            shutil.rmtree(folder, ignore_errors=True)
            with zipfile.ZipFile(wheel) as content:
                content.extractall(folder)
            stamp.write_text(key)
    return ";".join(map(path, (folder, _folder() / f"packages-{python}", *more)))


def cpp() -> Outcome:
    """The C++ tests."""
    build = build_native(["pointmorph_tests"], "-DPOINTMORPH_TESTS=ON", platform=WINDOWS)
    return run_suite("windows-cpp", build / "pointmorph_tests.exe", "--gtest_output=xml:")


def python() -> Outcome:
    """The Python tests, but for those of building."""
    building = [f"test_{name}.py" for name in BUILDING]
    ignored = [f"--ignore-glob=*{name}" for name in building]
    pytest = ("-m", "pytest", "-p", "no:cacheprovider", *ignored)
    command: tuple[str | Path, ...] = (python_program(), *pytest)
    outcome = run_suite("windows-python", *command, "--junitxml=", PYTHONPATH=python_path())
    outcome.skip("building is done on Linux", *building)
    return outcome


def bits() -> Outcome:
    """The same morphs with OpenMP here, with the pool of threads here, and there: all have the same
    bits. Later Pythons there, whose modules are linked with the same library, do the small pairs.
    """
    script = paths.ROOT / "native" / "tests" / "same_bits.py"
    made = _folder() / "pairs"
    run("windows-bits", paths.PYTHON, script, "--make", made)
    small = sorted(made.iterdir())
    data = paths.ROOT.parent / "shared" / "data"
    pairs = small + [data / name for name in PAIRS if (data / name).is_dir()]
    folder = _folder() / "bits"
    folder.mkdir(parents=True, exist_ok=True)
    linux, pool = (folder / f"{name}.json" for name in ("linux", "pool"))
    run("windows-bits", paths.PYTHON, script, linux, *pairs)
    ours = child_environment(POINTMORPH_THREADS="pool")
    run("windows-bits", paths.PYTHON, script, pool, *pairs, environment=ours)
    outcome, expected = Outcome(), json.loads(linux.read_text())
    outcome.add(compared(expected, json.loads(pool.read_text())))
    for python in WINDOWS.pythons:
        there = folder / f"windows-{python}.json"
        morphed = pairs if python == PYTHON else small
        command = words(python_program(python), path(script), path(there), *map(path, morphed))
        theirs = child_environment(**variables(PYTHONPATH=python_path(python=python)))
        run("windows-bits", *command, environment=theirs)
        names = {pair.name for pair in morphed}
        of_them = {name: found for name, found in expected.items() if name.split(",")[0] in names}
        outcome.add(compared(of_them, json.loads(there.read_text())))
    return outcome


def compared(here: dict[str, dict[str, str]], there: dict[str, dict[str, str]]) -> Outcome:
    """One test for each morph here. One that is missing there has no bits in common."""
    outcome = Outcome()
    for name, digests in here.items():
        found = there.get(name, {})
        if other := [what for what, digest in digests.items() if found.get(what) != digest]:
            outcome.failures.append(f"{name}: other bits than on Linux: {', '.join(other)}")
        else:
            outcome.passed += 1
    return outcome


def bpy() -> Outcome:
    """The add-on in a Blender for Windows, packaged and installed as users do it. Without drawing,
    which needs a graphics card."""
    title = f"Blender {BLENDER} for Windows (about 350 MB to fetch)"
    blender = _install("bpy", title, "--no-deps", f"bpy=={BLENDER}.*")
    extension = package((WINDOWS,))
    runner = path(paths.ROOT / "blender_tests" / "run.py")
    return run_suite(
        "windows-bpy",
        python_program(),
        runner,
        "--junitxml=",
        PYTHONPATH=python_path(blender),
        POINTMORPH_ZIP=path(extension),
        POINTMORPH_NO_RENDERING="it renders, which Wine can't without a graphics card",
    )


# The longest first, as on Linux.
SUITES = {
    "windows-python": Suite(python),
    "windows-bpy": Suite(bpy),
    "windows-cpp": Suite(cpp),
    "windows-bits": Suite(bits),
}


def test(names: list[str], jobs: int) -> int:
    """Builds for Windows and runs the suites."""
    set_up_base(*WINDOWS.debian, "windows-test")
    set_up_wheels(WINDOWS)
    set_up()
    try:
        return run_suites({name: SUITES[name] for name in names}, jobs)
    finally:
        # What a suite that was stopped has left.
        environment = child_environment(**variables())
        run("wine", WINE_SERVER, "--kill", environment=environment, check=False)
