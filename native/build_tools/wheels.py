"""The wheel, and what else is built in its folder."""

from __future__ import annotations

import shutil
import sys
import threading
from collections.abc import Iterable
from pathlib import Path

from . import paths
from .python_environment import pip_install, set_up_python
from .running import digest, is_fresh, run, say, step
from .system import set_up_system

building = threading.Lock()


def set_up(*groups: str, strict: bool = False) -> None:
    """What every command needs, and Debian's packages in `groups` (see pyproject.toml)."""
    say("Setting up")
    set_up_python(set_up_system(["build", "bpy", *groups]))
    set_up_wheel(strict)


def set_up_wheel(strict: bool = False) -> Path:
    """Builds the wheel when its sources have changed, and installs it in .venv.

    `strict`: a warning in the C++ sources is an error.
    """
    parts = ["CMakeLists.txt", "pyproject.toml", "LICENSE"]
    parts += [f"native/{part}" for part in ("include", "src", "bindings", "python")]
    sources = [paths.ROOT / part for part in parts]
    key = digest(sys.version, *sources)
    folder, raw = paths.BUILD / "wheels", paths.BUILD / "wheels-raw"
    stamp, installed = folder / "stamp", paths.VENV / "wheel.stamp"
    if not (is_fresh(stamp, key) and any(folder.glob("*.whl"))):
        with step("native library and wheel"):
            for old in (folder, raw):
                shutil.rmtree(old, ignore_errors=True)
            pip = (paths.PYTHON, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation")
            setting = f"cmake.define.POINTMORPH_WERROR={'ON' if strict else 'OFF'}"
            run("wheel", *pip, "--config-settings", setting, "--wheel-dir", raw, paths.ROOT)
            # Takes in what another machine may lack (OpenMP) and names the oldest that it fits.
            repair = (paths.PYTHON, "-m", "auditwheel", "repair", "-w", folder)
            run("wheel", *repair, *raw.glob("*.whl"))
            stamp.write_text(key)
    [wheel] = folder.glob("*.whl")
    if not is_fresh(installed, key):
        pip_install("--no-deps", "--force-reinstall", wheel)
        run("wheel", paths.PYTHON, "-c", "import pointmorph")
        installed.write_text(key)
    return wheel


def build_native(targets: Iterable[str], *settings: str) -> Path:
    """Builds more targets in the wheel's folder, from the library that is compiled there already.

    The `settings` stay until others are given.
    """
    build = paths.BUILD / "wheel"
    with building:
        run("native", "cmake", "-S", paths.ROOT, "-B", build, "-G", "Ninja", *settings)
        run("native", "cmake", "--build", build, "--target", *targets)
    return build
