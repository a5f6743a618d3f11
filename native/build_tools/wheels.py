"""The wheels, one a Python, and what else is built in their folder."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from . import paths
from .python_environment import (
    Environment,
    main_environment,
    other_pythons,
    set_up_building,
    set_up_other_python,
    set_up_python,
)
from .running import SetupError, digest, is_fresh, run, say, step
from .system import refuse_missing, set_up_system

_building = threading.Lock()


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
    return _built(main_environment(), "native library and wheel", _settings())


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


def set_up_wheels() -> list[Path]:
    """A wheel for every Python that a supported Blender has."""
    wheels = [set_up_wheel()]
    # The library is compiled once; only the module is compiled for each.
    library = paths.BUILD / "wheel" / "libpointmorph_core.a"
    if not library.exists():
        build_native(["pointmorph_core"])
    for version in other_pythons():
        environment = set_up_other_python(version)
        settings = {
            **_settings(),
            "build-dir": f"build/wheel-{environment.tag}",
            "cmake.define.POINTMORPH_CORE": str(library),
        }
        wheels.append(_built(environment, f"wheel for Python {version}", settings))
    return wheels


def _settings() -> dict[str, str]:
    """Warnings are errors with Debian 12's compiler; a newer one's don't stop a user.

    The same for every command: a setting that changes has everything compiled anew.
    """
    said = subprocess.run(["c++", "-dumpversion"], capture_output=True, text=True, check=False)
    strict = said.stdout.strip() == "12"
    return {"cmake.define.POINTMORPH_WERROR": "ON" if strict else "OFF"}


def _built(environment: Environment, title: str, settings: dict[str, str]) -> Path:
    """The wheel for a Python, built anew when its sources have changed."""
    parts = ["CMakeLists.txt", "pyproject.toml", "LICENSE"]
    parts += [f"native/{part}" for part in ("include", "src", "bindings", "python")]
    key = digest(sys.version, environment.tag, *(paths.ROOT / part for part in parts))
    folder = paths.BUILD / "wheels" / environment.tag
    raw, stamp = folder / "raw", folder / "stamp"

    def is_built() -> bool:
        return is_fresh(stamp, key) and any(folder.glob("*.whl"))

    # Who finds it built doesn't wait for what else is compiled.
    with contextlib.nullcontext() if is_built() else _building:
        if not is_built():
            with step(title):
                shutil.rmtree(folder, ignore_errors=True)
                words = [f"--config-settings={name}={value}" for name, value in settings.items()]
                pip = (environment.python, "-m", "pip", "wheel", "--no-deps")
                options = ("--no-build-isolation", *words, "--wheel-dir", str(raw))
                run("wheel", *pip, *options, paths.ROOT)
                # Takes in what another machine may lack (OpenMP), names the oldest that it fits.
                repair = (paths.PYTHON, "-m", "auditwheel", "repair", "-w", folder)
                run("wheel", *repair, *raw.glob("*.whl"))
                stamp.write_text(key)
    [wheel] = folder.glob("*.whl")
    return wheel


def build_native(targets: Iterable[str], *settings: str) -> Path:
    """Builds more targets in the wheel's folder, from the library that is compiled there already.

    The `settings` stay until others are given.
    """
    build = paths.BUILD / "wheel"
    with _building:
        run("native", "cmake", "-S", paths.ROOT, "-B", build, "-G", "Ninja", *settings)
        run("native", "cmake", "--build", build, "--target", *targets)
    return build
