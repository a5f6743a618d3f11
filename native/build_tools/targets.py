"""What wheels are made for: a system, its compiler, and the Pythons that Blender has there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from . import paths


@dataclass(frozen=True)
class Platform:
    """A system that wheels are made for, on Linux."""

    name: str
    """As after `--platform`."""
    tag: str
    """As in the names of wheels; it says which is the oldest system that they run on."""
    blender: str
    """As in the extension's manifest."""
    pythons: tuple[str, ...]
    """With the first one, the library is compiled; the others' modules are linked with it."""
    libraries: str
    """What modules may need of the system, as a regular expression."""
    suffix: str
    """How the names of modules end; {} is the Python's number, as 311."""
    headers: str
    """Where Python.h lies in a CPython; {} is the version, as 3.11."""
    cpython: dict[str, str]
    """What the Maven repository calls the system, for each Python that comes from there."""
    debian: tuple[str, ...] = ()
    """Groups of Debian's packages that building for it needs."""
    import_library: str | None = None
    """What modules are linked with, in a CPython; {} is the Python's number."""
    toolchain: str | None = None
    """A file in native/cmake; none for the system that this is."""

    @property
    def toolchain_file(self) -> Path | None:
        return paths.ROOT / "native" / "cmake" / self.toolchain if self.toolchain else None


def number(python: str) -> str:
    """A version as in file names: 311 of 3.11."""
    return python.replace(".", "")


LINUX = Platform(
    name="linux",
    tag="manylinux_2_28_x86_64",
    blender="linux-x64",
    pythons=("3.11", "3.13", "3.14"),
    libraries=r"lib(c|m|gcc_s|pthread)\.so\.\d|ld-linux-x86-64\.so\.2|libgomp-\w+\.so\S*",
    suffix=".cpython-{}-x86_64-linux-gnu.so",
    headers="include/python{}",
    cpython={"3.13": "linux-x86_64", "3.14": "linux-x86_64"},
    debian=("build", "cpython"),
)
WINDOWS = Platform(
    name="windows",
    tag="win_amd64",
    blender="windows-x64",
    pythons=("3.11", "3.13"),
    libraries=r"(?i)(python3\d+|kernel32|msvcrt)\.dll",
    suffix=".cp{}-win_amd64.pyd",
    headers="include",
    cpython={"3.11": "windows-x86_64", "3.13": "windows-x86_64"},
    import_library="libs/python{}.lib",
    debian=("build", "cpython", "windows"),
    toolchain="windows-x86_64.cmake",
)
MACOS = Platform(
    name="macos",
    tag="macosx_11_0_arm64",
    blender="macos-arm64",
    pythons=("3.11", "3.13"),
    libraries=r"/usr/lib/libSystem\.B\.dylib",
    suffix=".cpython-{}-darwin.so",
    headers="include/python{}",
    # There is no 3.11 for ARM; Clang's predefined macros tell its headers what differs.
    cpython={"3.11": "macosx-x86_64", "3.13": "macosx-arm64"},
    debian=("build", "cpython"),
    toolchain="macos-arm64.cmake",
)
PLATFORMS = {platform.name: platform for platform in (LINUX, WINDOWS, MACOS)}
