"""The system's packages: which are missing, and installing them."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import sysconfig
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from . import paths
from .running import SetupError, child_environment, run, say, step

# Where the system's packages can't be installed, these come from the Python package index.
PYPI_INSTEAD = {"cmake": "cmake", "ninja-build": "ninja", "libeigen3-dev": "cmeel-eigen"}


def project() -> dict[str, Any]:
    """pyproject.toml, where all that is needed is listed."""
    return tomllib.loads((paths.ROOT / "pyproject.toml").read_text())


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
        paths.SITE_PACKAGES / "cmeel.prefix" / "include",
        Path(sysconfig.get_path("include")),
    )
    return any((folder / name).exists() for folder in folders)


def _missing(groups: Iterable[str]) -> dict[str, str]:
    """The packages that the system lacks, and what would show that they are there."""
    tables = project()["tool"]["pointmorph"]["debian"]
    wanted = {package: evidence for group in groups for package, evidence in tables[group].items()}
    return {package: known for package, known in wanted.items() if not is_present(known)}


def _can_install() -> bool:
    may = os.geteuid() == 0 or shutil.which("sudo") is not None
    return may and shutil.which("apt-get") is not None


def refuse_missing(groups: Iterable[str]) -> None:
    """Says what is missing where nothing can install it."""
    rest = [package for package in _missing(groups) if package not in PYPI_INSTEAD]
    if rest and not _can_install():
        raise SetupError(
            f"Missing, and there is no way to install it from here: {', '.join(rest)}. Those are "
            "Debian's names; install them with the system's package manager (on Debian, as root: "
            f"apt-get install {' '.join(rest)}) and run this again."
        )


def set_up_system(groups: Iterable[str]) -> list[str]:
    """Installs the system's packages that are missing.

    Returns what the Python package index has to provide because the system can't.
    """
    missing = _missing(groups)
    if not missing:
        return []
    if not _can_install():
        refuse_missing(groups)
        return [PYPI_INSTEAD[package] for package in missing]
    sudo = [] if os.geteuid() == 0 else ["sudo"]
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
    if still := list(_missing(groups)):
        raise SetupError(f"Installed, yet not found: {', '.join(still)}; see build/logs/apt.log.")
    return []
