"""What a package holds besides the project's own sources: a bill of materials, and licenses."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import paths
from .python_environment import pins
from .running import SetupError
from .targets import LINUX, MACOS, WINDOWS, Platform

LICENSES = paths.ROOT / "native" / "licenses"
BILL = "materials.cdx.json"
_HEADERS = (
    Path("/usr/include"),
    Path("/usr/local/include"),
    paths.SITE_PACKAGES / "cmeel.prefix" / "include",
)


@dataclass(frozen=True)
class Material:
    """Something of others that is inside a package."""

    name: str
    version: str
    license: str
    """As an SPDX expression."""
    supplier: str
    how: str
    """In which way it is inside."""
    texts: tuple[str, ...] = ()
    """Files in `LICENSES`; the GPL's text is the project's own LICENSE."""


def materials(platforms: Sequence[Platform]) -> list[Material]:
    """What the packages for these systems are made of. Raises SetupError when a version is unknown.

    Versions are those of the very headers and compilers that are used here.
    """
    found = [
        Material("Eigen", _eigen(), "MPL-2.0", "Eigen", "headers, compiled in", ("MPL-2.0.txt",)),
        Material(
            "nanoflann", _nanoflann(), "BSD-2-Clause", "J. L. Blanco and others",
            "a header, compiled in", ("nanoflann.txt",),
        ),
        Material(
            "pybind11", pins()["pybind11"].version, "BSD-3-Clause", "W. Jakob and others",
            "headers, compiled in", ("pybind11.txt",),
        ),
        Material("plyfile", pins()["plyfile"].version, "GPL-3.0-or-later", "D. Ranjan", "a wheel"),
    ]  # fmt: skip
    gnu, exception = "GPL-3.0-or-later WITH GCC-exception-3.1", ("GCC-exception-3.1.txt",)
    fsf = "Free Software Foundation"
    if LINUX in platforms:
        found += [
            Material(
                "libgomp", f"as in scikit-learn {pins()['scikit-learn'].version}", gnu, fsf,
                "a shared library in the wheel for Linux", exception,
            ),
            Material(
                "libstdc++", _compiler("c++"), gnu, fsf, "linked into the module for Linux",
                exception,
            ),
        ]  # fmt: skip
    if WINDOWS in platforms:
        compiler = _compiler("x86_64-w64-mingw32-g++-posix")
        found += [
            Material(
                "libstdc++, libgomp, libgcc", compiler, gnu, fsf,
                "linked into the module for Windows", exception,
            ),
            Material(
                "winpthreads", f"as with GCC {compiler}", "MIT AND BSD-3-Clause", "mingw-w64",
                "linked into the module for Windows", ("winpthreads.txt",),
            ),
        ]  # fmt: skip
    if MACOS in platforms:
        found.append(
            Material(
                "libc++", f"as in zig {pins()['ziglang'].version}",
                "Apache-2.0 WITH LLVM-exception", "LLVM", "linked into the module for macOS",
                ("Apache-2.0.txt", "LLVM-exception.txt"),
            )
        )  # fmt: skip
    return found


def bill(version: str, platforms: Sequence[Platform]) -> dict[str, Any]:
    """The same as CycloneDX has it."""
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "name": "pointmorph",
                "version": version,
                "licenses": [{"expression": "GPL-3.0-or-later"}],
            }
        },
        "components": [
            {
                "type": "library",
                "name": one.name,
                "version": one.version,
                "supplier": {"name": one.supplier},
                "description": one.how,
                "licenses": [{"expression": one.license}],
            }
            for one in materials(platforms)
        ],
    }


def put(folder: Path, version: str, platforms: Sequence[Platform]) -> None:
    """Writes the bill, and the licenses of what is in it, into a folder."""
    (folder / BILL).write_text(json.dumps(bill(version, platforms), indent=1) + "\n")
    (folder / "licenses").mkdir()
    for name in sorted({text for one in materials(platforms) for text in one.texts}):
        (folder / "licenses" / name).write_text((LICENSES / name).read_text())


def _header(name: str) -> str:
    for folder in _HEADERS:
        if (folder / name).is_file():
            return (folder / name).read_text(errors="replace")
    raise SetupError(f"There is no {name} in {', '.join(map(str, _HEADERS))}.")


def _eigen() -> str:
    text = _header("eigen3/Eigen/src/Core/util/Macros.h")
    found = re.findall(r"#define EIGEN_(?:WORLD|MAJOR|MINOR)_VERSION (\d+)", text)
    return ".".join(found)


def _nanoflann() -> str:
    found = re.search(r"#define NANOFLANN_VERSION 0x(\w)(\w)(\w)", _header("nanoflann.hpp"))
    if found is None:
        raise SetupError("nanoflann.hpp doesn't say its version.")
    return ".".join(str(int(digit, 16)) for digit in found.groups())


def _compiler(program: str) -> str:
    # Debian's for Windows says 12-posix when it is asked for its version.
    words = [program, "-dM", "-E", "-x", "c++", os.devnull]
    said = subprocess.run(words, capture_output=True, text=True, check=False)
    found = dict(re.findall(r"#define __GNUC_?(_|MINOR__|PATCHLEVEL__) (\d+)", said.stdout))
    if len(found) != 3:
        raise SetupError(f"{program} doesn't say its version.")
    return ".".join(found[name] for name in ("_", "MINOR__", "PATCHLEVEL__"))
