#!/usr/bin/env python3
"""Sets up, shows, tests, measures and packages Pointmorph.

Needs a Debian 12 with python3 and nothing else; what is missing it installs. What it makes lies in
.venv and build: both can be deleted, and a run that was interrupted can simply be run again.
docs/development.md describes the commands.
"""

from __future__ import annotations

import argparse
import ctypes
import hashlib
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import threading
import time
import xml.etree.ElementTree as ElementTree
import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent
BUILD = ROOT / "build"
LOGS = BUILD / "logs"
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
SITE_PACKAGES = VENV / "lib" / "python3.11" / "site-packages"

# Blenders that come as a Python package. The first is in .venv (pyproject.toml names it too).
BPY_VERSIONS = ("5.0", "4.5", "4.2")
# Where the system's packages can't be installed, these come from the Python package index.
PYPI_INSTEAD = {"cmake": "cmake", "ninja-build": "ninja", "libeigen3-dev": "cmeel-eigen"}

# What the C++ tests need besides what the wheel does.
CPP_TEST_SETTINGS = (
    "-DPOINTMORPH_TESTS=ON",
    "-DPOINTMORPH_BENCHMARKS=ON",
    "-DPOINTMORPH_SANITIZE=address,undefined",
    "-DPOINTMORPH_WERROR=ON",
)

packaging = threading.Lock()
building = threading.Lock()


class SetupError(Exception):
    """Something went wrong that the user can mend; the message says how."""


# --- Saying, running, remembering -----------------------------------------------------------------


def say(text: str) -> None:
    print(text, flush=True)


@contextmanager
def step(title: str) -> Iterator[None]:
    """Says what is being done, and how long it took where that was worth a wait."""
    say(f"  {title} ...")
    start = time.monotonic()
    yield
    if (seconds := time.monotonic() - start) >= 1:
        say(f"  {title}: {seconds:.0f} s")


def child_environment(**more: str) -> dict[str, str]:
    """The environment of every command: .venv first, and nothing of the user's own Python."""
    ours = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    ours["PATH"] = os.pathsep.join([str(VENV / "bin"), os.environ.get("PATH", os.defpath)])
    ours["PYTHONNOUSERSITE"] = "1"
    ours.setdefault("OMP_WAIT_POLICY", "passive")  # as the package; suites run side by side
    prefixes = [str(SITE_PACKAGES / "cmeel.prefix"), os.environ.get("CMAKE_PREFIX_PATH", "")]
    ours["CMAKE_PREFIX_PATH"] = os.pathsep.join(filter(None, prefixes))
    return ours | more


def run(
    log: str,
    *command: str | Path,
    environment: dict[str, str] | None = None,
    timeout: float | None = None,
    check: bool = True,
) -> int:
    """Runs a command, appends its output to build/logs/<log>.log, returns the exit status.

    The status is negative after a signal. With `check`, a failure raises and shows the log's end.
    """
    LOGS.mkdir(parents=True, exist_ok=True)
    path = LOGS / f"{log}.log"
    words = [str(word) for word in command]
    with path.open("a") as output:
        print("$", *words, file=output, flush=True)
        try:
            status = subprocess.run(
                words,
                cwd=ROOT,
                env=environment or child_environment(),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                timeout=timeout,
                check=False,
            ).returncode
        except OSError as error:
            raise SetupError(f"{words[0]} can't be run: {error.strerror}.") from error
        except subprocess.TimeoutExpired:
            print(f"Stopped after {timeout:.0f} s.", file=output)
            status = -9
    if check and status != 0:
        raise SetupError(f"{words[0]} failed with status {status}:\n{end_of(log)}")
    return status


def end_of(log: str) -> str:
    path = LOGS / f"{log}.log"
    lines = path.read_text(errors="replace").splitlines()[-25:]
    return "\n".join(["    " + line for line in lines] + [f"(All of it: {path})"])


def digest(*things: str | Path) -> str:
    """A hash of texts, and of the contents of files and of whole folders."""
    hasher = hashlib.sha256()
    for thing in things:
        if isinstance(thing, str):
            hasher.update(thing.encode() + b"\0")
            continue
        for path in sorted(thing.rglob("*")) if thing.is_dir() else [thing]:
            if path.is_file() and "__pycache__" not in path.parts:
                hasher.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return hasher.hexdigest()


def is_fresh(stamp: Path, key: str) -> bool:
    """Whether what `stamp` lies beside was made from what `key` is the digest of."""
    return stamp.is_file() and stamp.read_text() == key


def project() -> dict[str, Any]:
    """pyproject.toml, where all that is needed is listed."""
    import tomllib  # here, because this file has to start on an older Python as well

    return tomllib.loads((ROOT / "pyproject.toml").read_text())


# --- Setting up -----------------------------------------------------------------------------------


def check_system() -> None:
    """Goes on in Python 3.11, which Blender's Python packages need exactly."""
    if (found := f"{platform.system()} on {platform.machine()}") != "Linux on x86_64":
        raise SetupError(
            f"The add-on is built on Linux on x86_64; this is {found}. The library alone can be "
            "built here with CMake, or with: pip install ."
        )
    if sys.version_info[:2] == (3, 11):
        return
    for name in ("python3.11", "/usr/bin/python3.11"):
        other = shutil.which(name)
        test = "import sys; sys.exit(sys.version_info[:2] != (3, 11))"
        if other and subprocess.run([other, "-c", test], check=False).returncode == 0:
            os.execv(other, [other, *sys.argv])
    raise SetupError(
        "Blender's Python packages need Python 3.11; this is Python "
        f"{platform.python_version()}, and there is no python3.11. Install it "
        "(Debian 12: apt-get install python3) and run: python3.11 build_addon.py"
    )


def is_present(evidence: str) -> bool:
    kind, _, name = evidence.partition(":")
    if kind == "program":
        return shutil.which(name, path=child_environment()["PATH"]) is not None
    if kind == "module":
        return importlib.util.find_spec(name) is not None
    if kind == "library":
        try:
            ctypes.CDLL(name)
        except OSError:
            return False
        return True
    folders = (
        Path("/usr/include"),
        Path("/usr/local/include"),
        SITE_PACKAGES / "cmeel.prefix" / "include",
        Path(sysconfig.get_path("include")),
    )
    return any((folder / name).exists() for folder in folders)


def set_up_system(groups: Iterable[str]) -> list[str]:
    """Installs the system's packages that are missing.

    Returns what the Python package index has to provide because the system can't.
    """
    tables = project()["tool"]["pointmorph"]["debian"]
    wanted = {package: evidence for group in groups for package, evidence in tables[group].items()}
    missing = [package for package, evidence in wanted.items() if not is_present(evidence)]
    if not missing:
        return []
    sudo = [] if os.geteuid() == 0 else ["sudo"]
    if not shutil.which("apt-get") or (sudo and not shutil.which("sudo")):
        if rest := [package for package in missing if package not in PYPI_INSTEAD]:
            raise SetupError(
                f"Missing, and there is no way to install it from here: {', '.join(rest)}. Those "
                "are Debian's names; install them with the system's package manager (on Debian, as "
                f"root: apt-get install {' '.join(rest)}) and run this again."
            )
        return [PYPI_INSTEAD[package] for package in missing]
    apt = [*sudo, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]
    apt += ["-q", "-y", "-o", "DPkg::Lock::Timeout=300"]
    install = [*apt, "install", "--no-install-recommends", *missing]
    say(f"  missing on this system: {', '.join(missing)}")
    with step("system packages"):
        # A foreign source that is out of order must not stop what the others can deliver.
        run("apt", *apt, "update", check=False)
        if run("apt", *install, check=False) != 0:
            run("apt", *sudo, "dpkg", "--configure", "-a", check=False)
            run("apt", *install)
    if still := [package for package in missing if not is_present(wanted[package])]:
        raise SetupError(f"Installed, yet not found: {', '.join(still)}; see build/logs/apt.log.")
    return []


def pip_install(*what: str | Path) -> None:
    run("pip", PYTHON, "-m", "pip", "install", "--no-input", "--progress-bar", "off", *what)


def set_up_python(extra: Iterable[str]) -> None:
    """Makes .venv and fills it with what pyproject.toml asks for."""
    requirements = [*project()["project"]["dependencies"], *extra]
    for group in project()["dependency-groups"].values():
        requirements += group
    key = digest(sys.version, *requirements)
    stamp, unfinished = VENV / "requirements.stamp", VENV / "unfinished"
    if is_fresh(stamp, key):
        return
    # pip takes what an interrupted run has left for complete, so that means a new start.
    if not (PYTHON.exists() and SITE_PACKAGES.exists()) or unfinished.exists():
        with step("Python environment in .venv"):
            run("venv", sys.executable, "-m", "venv", "--clear", VENV)
    with step("Python packages, Blender's among them (about 500 MB to fetch)"):
        unfinished.touch()
        pip_install(*requirements)
        unfinished.unlink()
    stamp.write_text(key)


def set_up_peers() -> None:
    """What `bench --peers` compares with: an extra, which neither the build nor the tests need."""
    requirements = project()["project"]["optional-dependencies"]["peers"]
    stamp, key = VENV / "peers.stamp", digest(sys.version, *requirements)
    if not is_fresh(stamp, key):
        with step("peers' Python packages (about 100 MB to fetch)"):
            pip_install(*requirements)
            stamp.write_text(key)


def set_up_bpy(version: str) -> Path:
    """One more Blender as a Python package, outside .venv; what it needs is there already."""
    folder = BUILD / "bpy" / version
    if not folder.exists():
        with step(f"Blender {version} as a Python package (about 350 MB to fetch)"):
            unfinished = folder.with_suffix(".unfinished")
            shutil.rmtree(unfinished, ignore_errors=True)
            pip_install("--no-deps", "--target", unfinished, f"bpy=={version}.*")
            unfinished.rename(folder)
    return folder


def set_up_wheel(strict: bool = False) -> Path:
    """Builds the wheel when its sources have changed, and installs it in .venv.

    `strict`: a warning in the C++ sources is an error.
    """
    sources = [ROOT / "CMakeLists.txt", ROOT / "pyproject.toml", ROOT / "LICENSE"]
    sources += [ROOT / "native" / part for part in ("include", "src", "bindings", "python")]
    key = digest(sys.version, *sources)
    folder, raw = BUILD / "wheels", BUILD / "wheels-raw"
    stamp, installed = folder / "stamp", VENV / "wheel.stamp"
    if not (is_fresh(stamp, key) and any(folder.glob("*.whl"))):
        with step("native library and wheel"):
            for old in (folder, raw):
                shutil.rmtree(old, ignore_errors=True)
            pip = (PYTHON, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation")
            setting = f"cmake.define.POINTMORPH_WERROR={'ON' if strict else 'OFF'}"
            run("wheel", *pip, "--config-settings", setting, "--wheel-dir", raw, ROOT)
            # Takes in what another machine may lack (OpenMP) and names the oldest that it fits.
            run("wheel", PYTHON, "-m", "auditwheel", "repair", "-w", folder, *raw.glob("*.whl"))
            stamp.write_text(key)
    [wheel] = folder.glob("*.whl")
    if not is_fresh(installed, key):
        pip_install("--no-deps", "--force-reinstall", wheel)
        run("wheel", PYTHON, "-c", "import pointmorph")
        installed.write_text(key)
    return wheel


def set_up(*groups: str, strict: bool = False) -> None:
    """What every command needs, and Debian's packages in `groups` (see pyproject.toml)."""
    say("Setting up")
    set_up_python(set_up_system(["build", "bpy", *groups]))
    set_up_wheel(strict)


def build_native(targets: Iterable[str], *settings: str) -> Path:
    """Builds more targets in the wheel's folder, from the library that is compiled there already.

    The `settings` stay until others are given.
    """
    build = BUILD / "wheel"
    with building:
        run("native", "cmake", "-S", ROOT, "-B", build, "-G", "Ninja", *settings)
        run("native", "cmake", "--build", build, "--target", *targets)
    return build


# --- Packaging ------------------------------------------------------------------------------------


def edit(path: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, lambda _: replacement, path.read_text(), flags=re.MULTILINE)
    if count != 1:
        raise SetupError(f"{path.name} must have one line like {pattern}; it has {count}.")
    path.write_text(text)


def package() -> tuple[Path, Path]:
    """The extension for Blender 4.2 and later, and the legacy add-on for Debian's Blender."""
    wheel = set_up_wheel()
    version = wheel.name.split("-")[1]
    folder = BUILD / "package"
    extension = folder / f"pointmorph-{version}.zip"
    legacy = folder / f"pointmorph-{version}-legacy.zip"
    key = digest(ROOT / "addon", ROOT / "docs", ROOT / "LICENSE", ROOT / "build_addon.py", wheel)
    stamp = folder / "stamp"
    if is_fresh(stamp, key):
        return extension, legacy
    with step("extension and legacy add-on"):
        shutil.rmtree(folder, ignore_errors=True)
        stage = folder / "stage" / "pointmorph_addon"
        skip = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "addon", stage, ignore=skip)
        shutil.copy(ROOT / "LICENSE", stage)
        run("package", PYTHON, ROOT / "docs" / "make_html.py", stage / "docs")
        numbers = ", ".join(version.split("."))
        edit(stage / "__init__.py", r'"version": \([0-9, ]+\)', f'"version": ({numbers})')

        manifest = stage / "blender_manifest.toml"
        edit(manifest, r'^version = ".*"$', f'version = "{version}"')
        edit(manifest, r"^wheels = \[[^]]*\]$", f'wheels = ["./wheels/{wheel.name}"]')
        (stage / "wheels").mkdir()
        shutil.copy(wheel, stage / "wheels")
        scripts = SITE_PACKAGES / "bpy" / BPY_VERSIONS[0] / "scripts"
        blender_ext = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
        output = ("--output-filepath", extension)
        run("package", PYTHON, blender_ext, "build", "--source-dir", stage, *output)
        run("package", PYTHON, blender_ext, "validate", extension)

        # A legacy add-on can't bring a wheel: what is in it stands in the add-on's folder.
        manifest.unlink()
        shutil.rmtree(stage / "wheels")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(stage / "lib")
        shutil.make_archive(str(legacy.with_suffix("")), "zip", stage.parent, stage.name)
        shutil.rmtree(stage.parent)
        stamp.write_text(key)
    return extension, legacy


# --- Testing --------------------------------------------------------------------------------------


@dataclass
class Outcome:
    """What came of a suite: counts, and a line for everything that failed or was skipped."""

    passed: int = 0
    failures: list[str] = field(default_factory=list)
    skips: list[str] = field(default_factory=list)
    seconds: float = 0.0


def read_junit(report: Path) -> Outcome:
    """What Google Test or pytest reported."""
    outcome = Outcome()
    for case in ElementTree.parse(report).iter("testcase"):
        name = f"{case.get('classname')}.{case.get('name')}"
        bad = [child for child in case if child.tag in ("failure", "error")]
        skip = case.find("skipped")
        if bad:
            message = (bad[0].get("message") or "").strip().partition("\n")[0]
            outcome.failures.append(f"{name}: {message}")
        elif skip is not None or case.get("status") == "notrun":
            outcome.skips.append("disabled" if skip is None else skip.get("message", ""))
        else:
            outcome.passed += 1
    return outcome


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


def run_suite(name: str, *command: str | Path, **environment: str) -> Outcome:
    """Runs a suite whose last word ends in `=` or `:`, where its report's path is to stand."""
    report = BUILD / "reports" / f"{name}.xml"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    words = (*command[:-1], f"{command[-1]}{report}")
    ours = child_environment(**environment)
    return judge(run(name, *words, environment=ours, timeout=2700, check=False), report)


def checks() -> Outcome:
    """Formatting, linting and types; each counts as one test."""
    native = [path for path in (ROOT / "native").rglob("*") if path.suffix in (".cpp", ".hpp")]
    commands: dict[str, tuple[str | Path, ...]] = {
        "clang-format": (VENV / "bin" / "clang-format", "--dry-run", "--Werror", *native),
        "ruff format": (PYTHON, "-m", "ruff", "format", "--check", ROOT),
        "ruff check": (PYTHON, "-m", "ruff", "check", ROOT),
        "mypy": (PYTHON, "-m", "mypy"),
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
    return run_suite("python", PYTHON, "-m", "pytest", "--junitxml=")


def in_blender(suite: str, legacy: bool, *command: str | Path, **environment: str) -> Outcome:
    """The add-on's tests in a Blender, with the add-on packaged and installed as users do it."""
    with packaging:
        zips = package()
    environment["POINTMORPH_ZIP"] = str(zips[legacy])
    return run_suite(suite, *command, "--junitxml=", **environment)


def bpy(version: str) -> Outcome:
    path = "" if version == BPY_VERSIONS[0] else str(set_up_bpy(version))
    command = (PYTHON, "blender_tests/run.py")
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
    command = (PYTHON, "-m", "pytest", "--maxfail=3", "blender_tests/window")
    return in_blender("window", takes_legacy(), *command)


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
    start = time.monotonic()
    (LOGS / f"{name}.log").unlink(missing_ok=True)
    say(f"  {name} ...")
    try:
        outcome = SUITES[name].run()
    except SetupError as error:
        outcome = Outcome(failures=[f"could not be run\n{error}"])
    outcome.seconds = time.monotonic() - start
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
        for reason, count in Counter(outcome.skips).items():
            say(f"skipped {count} in {name}: {reason}")
        for failure in outcome.failures:
            say(f"FAILED in {name}: {failure}")
        if outcome.failures and (LOGS / f"{name}.log").exists():
            say(f"The log of {name} ends:\n{end_of(name)}")
    say(f"{'suite':<12}{'passed':>8}{'failed':>8}{'skipped':>9}{'seconds':>9}")
    sums = [0, 0, 0]
    for name, outcome in outcomes.items():
        counts = (outcome.passed, len(outcome.failures), len(outcome.skips))
        sums = [a + b for a, b in zip(sums, counts, strict=True)]
        say(f"{name:<12}{'{:>8}{:>8}{:>9}'.format(*counts)}{outcome.seconds:>9.0f}")
    say("{} passed, {} failed, {} skipped".format(*sums))
    return 1 if sums[1] else 0


# --- Demo and benchmarks --------------------------------------------------------------------------


def show(*command: str | Path) -> int:
    """Runs a command whose output is for the user to see."""
    return subprocess.run(command, env=child_environment(), check=False).returncode


def demo(files: list[str]) -> int:
    set_up()
    return show(PYTHON, ROOT / "docs" / "demo" / "demo.py", *files, "--out", BUILD / "demo")


def bench() -> int:
    """The benchmarks in native/benchmarks; each prints a table and writes JSON."""
    set_up("cpp-test")
    with step("C++ benchmarks"):
        build = build_native(["pointmorph_benchmarks"], "-DPOINTMORPH_BENCHMARKS=ON")
    folder = BUILD / "bench"
    folder.mkdir(exist_ok=True)
    output = (f"--benchmark_out={folder / 'native.json'}", "--benchmark_out_format=json")
    statuses = [show(build / "pointmorph_benchmarks", *output)]
    for script in sorted((ROOT / "native" / "benchmarks").glob("bench_*.py")):
        statuses.append(show(PYTHON, script, "--json", folder / f"{script.stem}.json"))
    say(f"As JSON: {folder}")
    return 1 if any(statuses) else 0


def pictures() -> int:
    """Takes the manual's pictures anew, from the real window."""
    set_up("blender", "window")
    script = ROOT / "blender_tests" / "window" / "make_pictures.py"
    zips = package()
    environment = child_environment(POINTMORPH_ZIP=str(zips[takes_legacy()]))
    command = (PYTHON, "-m", "pytest", script)
    return subprocess.run(command, env=environment, check=False, cwd=ROOT).returncode


def compare(source: str, target: str, features: str, *options: str) -> int:
    """Pointmorph and its peers on one pair: a table, the same as JSON, and pictures."""
    set_up()
    set_up_peers()
    folder = BUILD / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    script = ROOT / "native" / "benchmarks" / "compare_peers.py"
    output = ("--json", folder / "peers.json", "--pictures", folder / "peers")
    return show(PYTHON, script, source, target, "--features", features, *output, *options)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("setup", help="all that the other commands need, in .venv and build")
    demos = commands.add_parser("demo", help="morph real models, or one's own, in a real Blender")
    demos.add_argument("files", nargs="*", metavar="SOURCE TARGET [FEATURES]")
    tests = commands.add_parser("test", help="every test; the last line is the sum")
    tests.add_argument("--only", help=f"suites with commas between them: {','.join(SUITES)}")
    tests.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="suites side by side")
    benches = commands.add_parser("bench", help="the benchmarks, as a table and as JSON")
    benches.add_argument(
        "--peers",
        nargs=argparse.REMAINDER,
        metavar="SOURCE TARGET FEATURES",
        help="compare with other methods on this pair; options of compare_peers.py may follow",
    )
    commands.add_parser("pictures", help="the manual's pictures, taken anew from the real window")
    commands.add_parser("package", help="the extension and the legacy add-on, as zip files")
    arguments = parser.parse_args()
    try:
        check_system()
        if arguments.command == "demo":
            return demo(arguments.files)
        if arguments.command == "test":
            only = arguments.only.split(",") if arguments.only else list(SUITES)
            if unknown := set(only) - set(SUITES):
                parser.error(f"no such suite: {', '.join(sorted(unknown))}")
            return test(only, arguments.jobs)
        if arguments.command == "bench":
            if arguments.peers is None:
                return bench()
            if len(arguments.peers) < 3:
                parser.error("bench --peers: expected SOURCE TARGET FEATURES")
            return compare(*arguments.peers)
        if arguments.command == "pictures":
            return pictures()
        if arguments.command == "setup":
            set_up("cpp-test", "blender", "window")
        else:
            set_up()
            for path in package():
                say(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    except SetupError as error:
        say(str(error))
        if arguments.command == "test":
            say("0 passed, 1 failed, 0 skipped")
        return 1
    except KeyboardInterrupt:
        say("Interrupted. Run it again to go on.")
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
