"""The wheels, one for each Python of each platform, and what else is built in their folders."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import threading
import zipfile
from collections import defaultdict
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from . import paths
from .python_environment import (
    fetch_cpython,
    main_environment,
    pins,
    set_up_building,
    set_up_python,
)
from .running import SetupError, child_environment, digest, is_fresh, run, say, step
from .system import refuse_missing, set_up_system
from .targets import LINUX, MACOS, Platform, number

LARGEST_WHEEL = 2_450_000
"""Bytes, as docs/release.md says."""

_building: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
"""For each of CMake's folders, who builds in it."""


def set_up_all(
    groups: Iterable[str], install: Callable[[], object], fetches: Iterable[Callable[[], object]]
) -> list[SetupError]:
    """Sets up Debian's packages in `groups` (see pyproject.toml), .venv, and what `fetches` bring,
    all while the library is compiled, which takes longest; then `install`s the wheel.

    Returns what went wrong.
    """
    say("Setting up")
    groups = ["bpy", *groups]
    refuse_missing(["build", *groups])
    set_up_building(set_up_system(["build"]))
    with ThreadPoolExecutor() as pool:
        compiled = pool.submit(build_wheel)
        set_up_system(groups)
        set_up_python()
        done = [pool.submit(fetch) for fetch in fetches]
        done.insert(0, pool.submit(lambda: (compiled.result(), install())))
        errors = [future.exception() for future in done]
    for error in errors:
        if error is not None and not isinstance(error, SetupError):
            raise error
    return [error for error in errors if isinstance(error, SetupError)]


def set_up(*groups: str) -> None:
    """What every command needs, and Debian's packages in `groups`."""
    for error in set_up_all(groups, set_up_wheel, []):
        raise error


def build_wheel() -> Path:
    """Builds the wheel for .venv when its sources have changed."""
    return wheel_of(LINUX, main_environment().version)


def set_up_wheel() -> Path:
    """Installs the wheel in .venv."""
    environment = main_environment()
    wheel = build_wheel()
    installed = environment.folder / "wheel.stamp"
    key = digest(wheel)
    if not is_fresh(installed, key):
        environment.pip_install("--no-deps", "--force-reinstall", wheel)
        run("wheel", environment.python, "-c", "import pointmorph")
        installed.write_text(key)
    return wheel


def set_up_wheels(platform: Platform = LINUX) -> list[Path]:
    """A wheel for every Python that a supported Blender has on a platform."""
    if platform is LINUX:
        set_up_wheel()
    wheel_of(platform, platform.pythons[0])
    # Of a module, half of the time goes into headers that one core reads.
    with ThreadPoolExecutor() as pool:
        return list(pool.map(partial(wheel_of, platform), platform.pythons))


def build_folder(platform: Platform, python: str | None = None) -> Path:
    """CMake's folder for a Python's module; the library is in the first one's."""
    python = python or platform.pythons[0]
    if platform is LINUX and python == platform.pythons[0]:
        return paths.BUILD / "wheel"
    return paths.BUILD / f"wheel-{platform.name}-cp{number(python)}"


def _settings(platform: Platform, python: str) -> dict[str, str]:
    """How scikit-build-core makes a wheel.

    The same for every command: a setting that changes has everything compiled anew.
    """
    defines = {"POINTMORPH_WERROR": _strictness(platform)}
    if platform is LINUX:
        defines["POINTMORPH_PORTABLE"] = "ON"
    else:
        defines["CMAKE_TOOLCHAIN_FILE"] = str(platform.toolchain_file)
    if system := platform.cpython.get(python):
        # Not the Python that runs here, of which CMake would ask all this.
        cpython = fetch_cpython(python, system)
        defines["POINTMORPH_PYTHON_HEADERS"] = str(cpython / platform.headers.format(python))
        defines["POINTMORPH_MODULE_SUFFIX"] = platform.suffix.format(number(python))
        if platform.import_library:
            library = cpython / platform.import_library.format(number(python))
            defines["POINTMORPH_PYTHON_LIBRARY"] = str(library)
    if python != platform.pythons[0]:
        defines["POINTMORPH_CORE"] = str(_library(platform))
    settings = {f"cmake.define.{name}": value for name, value in defines.items()}
    settings["build-dir"] = str(build_folder(platform, python).relative_to(paths.ROOT))
    tag = "linux_x86_64" if platform is LINUX else platform.tag
    settings["wheel.tags"] = f"cp{number(python)}-cp{number(python)}-{tag}"
    if platform is MACOS:
        _set_up_zig()
        settings["install.strip"] = "false"  # it would no longer fit its signature
    return settings


def _set_up_zig() -> None:
    """The compiler for macOS, where its toolchain file looks for it."""
    folder = paths.BUILD / "zig"
    pin = pins()["ziglang"]
    if not is_fresh(stamp := folder / "stamp", str(pin)):
        with step("zig (about 100 MB to fetch)"):
            shutil.rmtree(folder, ignore_errors=True)
            main_environment().pip_install("--target", folder, *pin.options())
            stamp.write_text(str(pin))


def _library(platform: Platform) -> Path:
    """The library without Python, which all modules of a platform are linked with."""
    return build_folder(platform) / "libpointmorph_core.a"


def _strictness(platform: Platform) -> str:
    """Warnings are errors with Debian 12's compiler; a newer one's don't stop a user."""
    return "ON" if not platform.toolchain_file and _is_debian_12s_compiler() else "OFF"


def _is_debian_12s_compiler() -> bool:
    said = subprocess.run(["c++", "-dumpversion"], capture_output=True, text=True, check=False)
    return said.stdout.strip() == "12"


def refuse_large(wheel: Path) -> None:
    size = wheel.stat().st_size
    if size > LARGEST_WHEEL:
        raise SetupError(
            f"{wheel.name} has {size:,} bytes, {size - LARGEST_WHEEL:,} more than a wheel may "
            "have. Leave code or words out, or raise LARGEST_WHEEL in native/build_tools/wheels.py "
            "and what docs/release.md says of it."
        )


def wheel_of(platform: Platform, python: str) -> Path:
    """The wheel for a Python, built anew when its sources have changed."""
    first = python == platform.pythons[0]
    if not first:
        wheel_of(platform, platform.pythons[0])
    parts = ["CMakeLists.txt", "pyproject.toml", "LICENSE", "native/cmake"]
    own = ("bindings", "include", "licenses", "portable", "python", "src")
    parts += [f"native/{part}" for part in own]
    key = digest(sys.version, repr(platform), python, *(paths.ROOT / part for part in parts))
    folder = paths.BUILD / "wheels" / f"{platform.name}-cp{number(python)}"
    stamp = folder / "stamp"
    building = _building[str(build_folder(platform, python))]

    def is_built() -> bool:
        there = any(folder.glob("*.whl")) and (not first or _library(platform).exists())
        return there and is_fresh(stamp, key)

    # Who finds it built doesn't wait for what else is compiled.
    with contextlib.nullcontext() if is_built() else building:
        if not is_built():
            with step(f"wheel for {platform.name}, Python {python}"):
                shutil.rmtree(folder, ignore_errors=True)
                _build(platform, python, folder)
                stamp.write_text(key)
    [wheel] = folder.glob("*.whl")
    return wheel


def _build(platform: Platform, python: str, folder: Path) -> None:
    settings = _settings(platform, python)
    words = [f"--config-settings={name}={value}" for name, value in settings.items()]
    pip = (paths.PYTHON, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation")
    raw = folder / "raw"
    run("wheel", *pip, *words, "--wheel-dir", str(raw), paths.ROOT)
    [wheel] = raw.glob("*.whl")
    if platform is LINUX:
        # Takes in what another machine may lack: OpenMP.
        auditwheel = (paths.PYTHON, "-m", "auditwheel", "repair", "-z", "9")
        repair = (*auditwheel, "--only-plat", "--plat", platform.tag)
        environment = child_environment(LD_LIBRARY_PATH=str(_older_openmp()))
        run("wheel", *repair, "-w", folder, wheel, environment=environment)
    else:
        shutil.move(wheel, folder)
    [wheel] = folder.glob("*.whl")
    # The same format, with a better search for what repeats than zlib's.
    run("wheel", "advzip", "--recompress", "--shrink-extra", "--quiet", wheel)
    environment = child_environment(PYTHONPATH=str(paths.ROOT / "native"))
    check = (paths.PYTHON, "-m", "build_tools.binaries", platform.name, wheel)
    run("wheel", *check, environment=environment)
    # Other compilers make other sizes, which don't stop a user.
    if platform.toolchain_file or _is_debian_12s_compiler():
        refuse_large(wheel)


def _older_openmp() -> Path:
    """The folder of an OpenMP runtime that older systems load. Debian's needs its own glibc."""
    folder = paths.BUILD / "openmp"
    pin = pins()["scikit-learn"]
    stamp = folder / "stamp"
    if not is_fresh(stamp, str(pin)):
        with step("OpenMP for older systems (about 13 MB to fetch)"):
            shutil.rmtree(folder, ignore_errors=True)
            pip = (paths.PYTHON, "-m", "pip", "download", "--no-input", "--progress-bar", "off")
            run("wheel", *pip, "--dest", folder, *pin.options())
            [archive] = folder.glob("*.whl")
            with zipfile.ZipFile(archive) as content:
                [name] = [name for name in content.namelist() if "/libgomp-" in name]
                (folder / "libgomp.so.1").write_bytes(content.read(name))
            archive.unlink()
            stamp.write_text(str(pin))
    return folder


def build_native(targets: Iterable[str], *settings: str, platform: Platform = LINUX) -> Path:
    """Builds more targets in a platform's folder, from the library that is compiled there already.

    The `settings` stay until others are given.
    """
    build = build_folder(platform)
    with _building[str(build)]:
        run("native", "cmake", "-S", paths.ROOT, "-B", build, "-G", "Ninja", *settings)
        run("native", "cmake", "--build", build, "--target", *targets)
    return build
