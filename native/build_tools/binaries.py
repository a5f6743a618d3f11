"""What a built module asks of the system that it is for, read from the file itself.

    python -m build_tools.binaries PLATFORM WHEEL

Runs in .venv, which has the package that reads all three systems' files.
"""

from __future__ import annotations

import hashlib
import re
import struct
import sys
import zipfile
from pathlib import Path

import lief

from .targets import PLATFORMS, Platform

lief.logging.disable()

# Where a symbol on macOS is looked for in all that is loaded; Python's are in the program.
_ANYWHERE = -2
_WEAK = lief.MachO.DyldBindingInfo.CLASS.WEAK

# Functions whose results have other bits in one C library than in another, or on another processor.
# The library has its own, or does without.
_CHANGING = {
    f"{name}{kind}"
    for name in (
        *("acos", "asin", "atan", "atan2", "cbrt", "cos", "exp", "exp2", "expm1", "hypot", "log"),
        *("log10", "log1p", "log2", "pow", "sin", "sincos", "tan"),
    )
    for kind in ("", "f", "l")
}


def problems_of(platform: Platform, wheel: Path) -> list[str]:
    """Why the module in a wheel wouldn't do where the wheel says."""
    with zipfile.ZipFile(wheel) as content:
        names = [name for name in content.namelist() if name.endswith((".so", ".pyd"))]
        found = [f"{wheel.name} has {len(names)} modules, expected one"] if len(names) != 1 else []
        for name in names:
            found += problems(platform, content.read(name))
    return found


def problems(platform: Platform, module: bytes) -> list[str]:
    """What is wrong with a module, in words."""
    binary = lief.parse(module)
    kinds = {"linux": lief.ELF.Binary, "windows": lief.PE.Binary, "macos": lief.MachO.Binary}
    if not isinstance(binary, kinds[platform.name]):
        return [f"it isn't a program of {platform.name}"]
    if isinstance(binary, lief.ELF.Binary):
        return _of_linux(platform, binary)
    if isinstance(binary, lief.PE.Binary):
        return _other_libraries(platform, [str(entry.name) for entry in binary.imports])
    return _of_macos(platform, binary, module)


def _other_libraries(platform: Platform, names: list[str]) -> list[str]:
    """Libraries that a system needn't have."""
    return [f"it needs {name}" for name in names if not re.fullmatch(platform.libraries, name)]


def _of_linux(platform: Platform, binary: lief.ELF.Binary) -> list[str]:
    found = _other_libraries(platform, [str(name) for name in binary.libraries])
    wanted = [
        str(symbol.name)
        for library in binary.symbols_version_requirement
        for symbol in library.get_auxiliary_symbols()
    ]
    most = tuple(map(int, re.findall(r"\d+", platform.tag)[:2]))
    for name in wanted:
        version = re.fullmatch(r"GLIBC_(\d+)\.(\d+)(\.\d+)?", name)
        if version and (int(version[1]), int(version[2])) > most:
            found.append(f"it needs {name}")
    called = {str(symbol.name) for symbol in binary.imported_symbols}
    found += [f"the bits of {name} depend on the system" for name in sorted(called & _CHANGING)]
    return found


def _of_macos(platform: Platform, binary: lief.MachO.Binary, module: bytes) -> list[str]:
    libraries = [
        str(library.name)
        for library in binary.libraries
        if library.command != lief.MachO.LoadCommand.TYPE.ID_DYLIB
    ]
    found = _other_libraries(platform, libraries)
    if binary.header.cpu_type != lief.MachO.Header.CPU_TYPE.ARM64:
        found.append("it isn't for ARM")
    version = binary.build_version
    most = [int(part) for part in re.findall(r"\d+", platform.tag)[:2]]
    if version is None or list(version.minos[:2]) > most:
        found.append(f"it needs macOS {version.minos if version else 'of any version'}")
    places = {str(symbol.name): symbol.value for symbol in binary.symbols}
    moved = {relocation.address for relocation in binary.relocations}
    for binding in binary.bindings:
        name = str(binding.symbol.name) if binding.symbol else ""
        if binding.library_ordinal == _ANYWHERE and not re.match(r"__?Py", name):
            found.append(f"no library has {name}")
        # What every library may bring, one for all, must be right if no other brings it.
        if isinstance(binding, lief.MachO.DyldBindingInfo) and binding.binding_class == _WEAK:
            bytes_there = bytes(binary.get_content_from_virtual_address(binding.address, 8))
            there = int.from_bytes(bytes_there, "little")
            if binding.address not in moved or there != places.get(name):
                found.append(f"nothing brings {name}")
    signature = binary.code_signature
    if signature is None or not is_signed(module, signature.data_offset):
        found.append("its signature doesn't fit")
    return found


def is_signed(module: bytes, offset: int) -> bool:
    """Whether a Mach-O file has an ad-hoc signature, at `offset`, of its present contents."""
    magic, _, count = struct.unpack_from(">3I", module, offset)
    blobs = [struct.unpack_from(">2I", module, offset + 12 + 8 * i) for i in range(count)]
    directories = [offset + place for kind, place in blobs if kind == 0]
    if magic != 0xFADE0CC0 or not directories:
        return False
    start = directories[0]
    fields = struct.unpack_from(">9I4B", module, start)
    magic, _, _, flags, hashes, _, _, pages, end, size, kind, _, page = fields
    if magic != 0xFADE0C02 or not flags & 2 or (size, kind) != (32, 2) or end != offset:
        return False
    for number in range(pages):
        content = module[number << page : min((number + 1) << page, end)]
        place = start + hashes + size * number
        if hashlib.sha256(content).digest() != module[place : place + size]:
            return False
    return bool(pages == (end + (1 << page) - 1) >> page)


if __name__ == "__main__":
    if reasons := problems_of(PLATFORMS[sys.argv[1]], Path(sys.argv[2])):
        sys.exit(f"{sys.argv[2]} isn't fit for {sys.argv[1]}: {'; '.join(reasons)}.")
