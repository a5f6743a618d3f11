"""The Python in .venv, and Blenders that come as Python packages."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

from . import paths
from .running import digest, is_fresh, run, step
from .system import project

# Blenders that come as a Python package. The first is in .venv (pyproject.toml names it too).
BPY_VERSIONS = ("5.0", "4.5", "4.2")


def pip_install(*what: str | Path) -> None:
    run("pip", paths.PYTHON, "-m", "pip", "install", "--no-input", "--progress-bar", "off", *what)


def set_up_python(extra: Iterable[str]) -> None:
    """Makes .venv and fills it with what pyproject.toml asks for."""
    requirements = [*project()["project"]["dependencies"], *extra]
    for group in project()["dependency-groups"].values():
        requirements += group
    key = digest(sys.version, *requirements)
    stamp, unfinished = paths.VENV / "requirements.stamp", paths.VENV / "unfinished"
    if is_fresh(stamp, key):
        return
    # pip takes what an interrupted run has left for complete, so that means a new start.
    if not (paths.PYTHON.exists() and paths.SITE_PACKAGES.exists()) or unfinished.exists():
        with step("Python environment in .venv"):
            run("venv", sys.executable, "-m", "venv", "--clear", paths.VENV)
    with step("Python packages, Blender's among them (about 500 MB to fetch)"):
        unfinished.touch()
        pip_install(*requirements)
        unfinished.unlink()
    stamp.write_text(key)


def set_up_peers() -> None:
    """What `bench --peers` compares with: an extra, which neither the build nor the tests need."""
    requirements = project()["project"]["optional-dependencies"]["peers"]
    stamp, key = paths.VENV / "peers.stamp", digest(sys.version, *requirements)
    if not is_fresh(stamp, key):
        with step("peers' Python packages (about 100 MB to fetch)"):
            pip_install(*requirements)
            stamp.write_text(key)


def set_up_bpy(version: str) -> Path:
    """One more Blender as a Python package, outside .venv; what it needs is there already."""
    folder = paths.BUILD / "bpy" / version
    if not folder.exists():
        with step(f"Blender {version} as a Python package (about 350 MB to fetch)"):
            unfinished = folder.with_suffix(".unfinished")
            shutil.rmtree(unfinished, ignore_errors=True)
            pip_install("--no-deps", "--target", unfinished, f"bpy=={version}.*")
            unfinished.rename(folder)
    return folder
