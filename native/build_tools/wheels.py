"""The wheels, one a Python, and what else is built in their folder."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
from collections.abc import Iterable
from pathlib import Path

from . import paths
from .python_environment import (
    Environment,
    main_environment,
    other_pythons,
    set_up_other_python,
    set_up_python,
)
from .running import digest, is_fresh, run, say, step
from .system import set_up_system

_building = threading.Lock()


def set_up_base(*groups: str) -> None:
    """.venv, and Debian's packages in `groups` (see pyproject.toml)."""
    say("Setting up")
    set_up_python(set_up_system(["build", "bpy", *groups]))


def set_up(*groups: str) -> None:
    """What every command needs, and Debian's packages in `groups`."""
    set_up_base(*groups)
    set_up_wheel()


def set_up_wheel() -> Path:
    """Builds the wheel for .venv when its sources have changed, and installs it there."""
    environment = main_environment()
    wheel = _built(environment, "native library and wheel", _settings())
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
    with _building:
        if not (is_fresh(stamp, key) and any(folder.glob("*.whl"))):
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
