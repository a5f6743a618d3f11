#!/usr/bin/env python3
"""Sets up, shows, tests, measures and packages Pointmorph.

Needs a Debian 12 with python3 and nothing else; what is missing it installs. What it makes lies in
.venv and build: both can be deleted, and a run that was interrupted can simply be run again.
docs/development.md describes the commands, native/build_tools is what they do.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).resolve().parent


def find_python() -> str | None:
    """Goes on in Python 3.11, which Blender's Python packages need; else says what is missing.

    All else is imported after that, so that this file starts on an older Python as well.
    """
    if (found := f"{platform.system()} on {platform.machine()}") != "Linux on x86_64":
        return (
            f"The add-on is built on Linux on x86_64; this is {found}. The library alone can be "
            "built here with CMake, or with: pip install ."
        )
    if sys.version_info[:2] == (3, 11):
        return None
    for name in ("python3.11", "/usr/bin/python3.11"):
        other = shutil.which(name)
        test = "import sys; sys.exit(sys.version_info[:2] != (3, 11))"
        if other and subprocess.run([other, "-c", test], check=False).returncode == 0:
            os.execv(other, [other, *sys.argv])
    return (
        "Blender's Python packages need Python 3.11; this is Python "
        f"{platform.python_version()}, and there is no python3.11. Install it "
        "(Debian 12: apt-get install python3) and run: python3.11 build_addon.py"
    )


def set_up(tests: bool) -> int:
    """What the commands need; with `tests`, also what only suites of tests do."""
    if not tests:
        wheels.set_up()
        return 0
    errors = suites.set_up_tests(suites.SUITES)
    for error in errors:
        say(str(error))
    return 1 if errors else 0


def demo(files: list[str], everything: bool) -> int:
    wheels.set_up()
    script = ROOT / "docs" / "demo" / "demo.py"
    options = ("--all",) if everything else ()
    return show(paths.PYTHON, script, *files, *options, "--out", paths.BUILD / "demo")


def bench_scripts() -> int:
    """What is beside the table: stages one by one, and scripts that print tables of their own."""
    wheels.set_up("cpp-test")
    with step("C++ benchmarks"):
        build = wheels.build_native(["pointmorph_benchmarks"], "-DPOINTMORPH_BENCHMARKS=ON")
    folder = paths.BUILD / "bench"
    folder.mkdir(exist_ok=True)
    output = (f"--benchmark_out={folder / 'native.json'}", "--benchmark_out_format=json")
    statuses = [show(build / "pointmorph_benchmarks", *output)]
    for name in ("bench_large_meshes", "bench_live", "bench_morph"):
        script = ROOT / "native" / "benchmarks" / f"{name}.py"
        statuses.append(show(paths.PYTHON, script, "--json", folder / f"{name}.json"))
    say(f"As JSON: {folder}")
    return 1 if any(statuses) else 0


def bench(arguments: argparse.Namespace) -> int:
    if arguments.peers is not None:
        return compare(*arguments.peers)
    if arguments.scripts:
        return bench_scripts()
    wheels.set_up("bpy")
    return benchmarks.bench(arguments.rows, arguments.quick, arguments.runs, arguments.keep)


def compare(source: str, target: str, features: str, *options: str) -> int:
    """Pointmorph and its peers on one pair: a table, the same as JSON, and pictures."""
    wheels.set_up()
    python_environment.set_up_peers()
    folder = paths.BUILD / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    script = ROOT / "native" / "benchmarks" / "compare_peers.py"
    output = ("--json", folder / "peers.json", "--pictures", folder / "peers")
    return show(paths.PYTHON, script, source, target, "--features", features, *output, *options)


def site() -> int:
    """The documentation as a site; a warning is an error."""
    wheels.set_up()
    return show(paths.PYTHON, "-m", "mkdocs", "build", "--strict")


def packages(platforms: list[targets.Platform]) -> list[Path]:
    """The wheels for some platforms, and the extension's zips."""
    wheels.set_up(*{group: None for platform in platforms for group in platform.debian})
    extension = packaging.package(platforms)
    built = [wheel for platform in platforms for wheel in wheels.set_up_wheels(platform)]
    return [*built, *sorted(extension.parent.glob("*.zip"))]


def release() -> list[Path]:
    """Everything that is given to others, in the folder `dist`."""
    version = releases.version()
    notes = releases.notes(version)
    releases.check_tree(version)
    return releases.collect(version, notes, packages(list(targets.PLATFORMS.values())))


def list_files(files: list[Path]) -> int:
    for path in files:
        say(f"{path.relative_to(paths.ROOT)} ({path.stat().st_size / 1e6:.2f} MB)")
    return 0


def add_bench(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    benches = commands.add_parser("bench", help="the table of benchmarks, and what became slower")
    benches.add_argument("rows", nargs="*", metavar="ROW", help="rows to measure, instead of all")
    benches.add_argument("--quick", action="store_true", help="without the millions; three runs")
    benches.add_argument("--runs", type=int, metavar="N", help="runs of each row (default: 5)")
    benches.add_argument(
        "--keep", action="store_true", help="write records, docs/benchmarks.md and its picture"
    )
    benches.add_argument(
        "--scripts", action="store_true", help="stages one by one, and what has tables of its own"
    )
    benches.add_argument(
        "--peers",
        nargs=argparse.REMAINDER,
        metavar="SOURCE TARGET FEATURES",
        help="compare with other methods on this pair; options of compare_peers.py may follow",
    )


def arguments_of(words: list[str]) -> argparse.Namespace:
    """The command line, checked; a wrong one ends with status 2."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    setups = commands.add_parser("setup", help="what the other commands need, in .venv and build")
    setups.add_argument(
        "--tests",
        action="store_true",
        help="also what tests alone need and else fetch: more Blenders, a newer Debian, Slurm",
    )
    demos = commands.add_parser("demo", help="morph real models, or one's own, in a real Blender")
    demos.add_argument("files", nargs="*", metavar="SOURCE TARGET [FEATURES]")
    demos.add_argument("--all", action="store_true", help="all pairs of models, not only the first")
    tests = commands.add_parser("test", help="every test; the last line is the sum")
    known = ",".join([*suites.SUITES, *windows.SUITES])
    tests.add_argument("--only", help=f"suites with commas between them: {known}")
    tests.add_argument(
        "--platform",
        choices=("linux", "windows"),
        default="linux",
        help="what is built for Windows is tested under Wine",
    )
    tests.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="suites side by side")
    add_bench(commands)
    commands.add_parser("pictures", help="the manual's pictures, taken anew from the real window")
    commands.add_parser("site", help="the documentation as a site, in build/site")
    packing = commands.add_parser("package", help="the extension, as a zip file")
    which = packing.add_mutually_exclusive_group()
    names = list(targets.PLATFORMS)
    which.add_argument(
        "--platform", choices=names, default="linux", help="the system that it is for"
    )
    which.add_argument("--all", action="store_true", help="for all, and a zip for each besides")
    commands.add_parser("release", help="wheels, zips, sources, checksums and notes, in dist")
    arguments = parser.parse_args(words)
    if arguments.command == "test":
        there = windows.SUITES if arguments.platform == "windows" else suites.SUITES
        arguments.suites = arguments.only.split(",") if arguments.only else list(there)
        if unknown := set(arguments.suites) - set(there):
            parser.error(f"no such suite: {', '.join(sorted(unknown))}")
    if arguments.command == "bench" and arguments.peers is not None and len(arguments.peers) < 3:
        parser.error("bench --peers: expected SOURCE TARGET FEATURES")
    return arguments


def do(arguments: argparse.Namespace) -> int:
    if arguments.command == "demo":
        return demo(arguments.files, arguments.all)
    if arguments.command == "test":
        run = windows.test if arguments.platform == "windows" else suites.test
        return run(arguments.suites, arguments.jobs)
    if arguments.command == "bench":
        return bench(arguments)
    if arguments.command == "pictures":
        return suites.take_pictures()
    if arguments.command == "site":
        return site()
    if arguments.command == "setup":
        return set_up(arguments.tests)
    if arguments.command == "release":
        return list_files(release())
    chosen = list(targets.PLATFORMS) if arguments.all else [arguments.platform]
    return list_files(packages([targets.PLATFORMS[name] for name in chosen]))


def interrupt(number: int, frame: FrameType | None) -> None:
    """Ends what commands have started, which Ctrl-C at a terminal doesn't reach."""
    stop_all()
    raise KeyboardInterrupt


def main() -> int:
    arguments = arguments_of(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    try:
        return do(arguments)
    except SetupError as error:
        say(str(error))
        if arguments.command == "test":
            say("0 passed, 1 failed, 0 skipped")
        return 1
    except KeyboardInterrupt:
        say("Interrupted. Run it again to go on.")
        return 130


if reason := find_python():
    sys.exit(reason)
sys.path.insert(0, str(ROOT / "native"))

from build_tools import (  # noqa: E402
    benchmarks,
    packaging,
    paths,
    python_environment,
    releases,
    suites,
    targets,
    wheels,
    windows,
)
from build_tools.running import SetupError, say, show, step, stop_all  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
