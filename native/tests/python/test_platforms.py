"""What is built for other systems: the table, modules as those systems see them, and Wine."""

from __future__ import annotations

import hashlib
import re
import struct
import sys
from dataclasses import replace
from pathlib import Path

import pointmorph._pointmorph
import pytest
from build_tools import binaries, paths, python_environment, running, wheels, windows
from build_tools.targets import LINUX, MACOS, PLATFORMS, WINDOWS, Platform


@pytest.mark.parametrize("platform", PLATFORMS.values(), ids=list(PLATFORMS))
def test_every_blender_has_a_wheel(platform: Platform) -> None:
    assert set(python_environment.BLENDERS.values()) <= set(platform.pythons)
    known = python_environment.table("cpython")
    assert set(platform.cpython) <= set(known)
    for python in set(platform.pythons) - set(platform.cpython):
        assert (platform, python) == (LINUX, "3.11")  # the one that runs here
    assert platform.toolchain_file is None or platform.toolchain_file.is_file()
    assert wheels.build_folder(platform, platform.pythons[0]) == wheels.build_folder(platform)


def test_every_platform_has_folders_of_its_own() -> None:
    folders = [wheels.build_folder(p, python) for p in PLATFORMS.values() for python in p.pythons]
    assert len(set(folders)) == len(folders)


@pytest.mark.parametrize("more", [0, 1])
def test_a_wheel_that_is_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: int
) -> None:
    def run(log: str, *command: object, **_: object) -> None:
        if "--wheel-dir" in command:
            raw = tmp_path / "raw"
            raw.mkdir()
            with (raw / "x.whl").open("wb") as wheel:
                wheel.truncate(wheels.LARGEST_WHEEL + more)

    monkeypatch.setattr(wheels, "_settings", lambda platform, python: {})
    monkeypatch.setattr(wheels, "run", run)
    if not more:
        wheels._build(WINDOWS, "3.13", tmp_path)
        return
    size = wheels.LARGEST_WHEEL + 1
    with pytest.raises(running.SetupError, match=rf"x\.whl has {size:,} bytes, 1 more than"):
        wheels._build(WINDOWS, "3.13", tmp_path)


def test_the_page_says_how_large_a_wheel_may_be() -> None:
    page = (paths.ROOT / "docs" / "release.md").read_text(encoding="utf-8")
    assert f"at most {wheels.LARGEST_WHEEL:,} bytes" in page


@pytest.fixture(scope="module")
def module() -> bytes:
    return Path(pointmorph._pointmorph.__file__).read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="reads this system's module")
def test_the_module_asks_for_nothing_that_an_older_linux_lacks(module: bytes) -> None:
    assert binaries.problems(LINUX, module) == []


@pytest.mark.skipif(sys.platform != "linux", reason="reads this system's module")
def test_what_a_system_lacks_is_named(module: bytes) -> None:
    older = replace(LINUX, tag="manylinux_2_5_x86_64")
    assert any(
        problem.startswith("it needs GLIBC_2.") for problem in binaries.problems(older, module)
    )
    alone = replace(LINUX, libraries=r"libc\.so\.6")
    assert "it needs libm.so.6" in binaries.problems(alone, module)
    for other in (WINDOWS, MACOS):
        assert binaries.problems(other, module) == [f"it isn't a program of {other.name}"]


def signed(content: bytes, *, page: int = 12, flags: int = 2) -> bytes:
    """Contents with an ad-hoc signature behind them, as Apple's header cs_blobs.h describes it."""
    pages = [content[at : at + (1 << page)] for at in range(0, len(content), 1 << page)]
    hashes = b"".join(hashlib.sha256(part).digest() for part in pages)
    head = struct.Struct(">9I4B")
    size = head.size + len(hashes)
    fields = (0xFADE0C02, size, 0x20400, flags, head.size, 0, 0, len(pages), len(content))
    directory = head.pack(*fields, 32, 2, 0, page) + hashes
    start = struct.pack(">5I", 0xFADE0CC0, 20 + size, 1, 0, 20)
    return content + start + directory


@pytest.mark.parametrize("length", [1, 4096, 10000])
def test_a_signature_fits_its_contents_alone(length: int) -> None:
    module = signed(bytes(range(256)) * (length // 256) + bytes(length % 256))
    assert binaries.is_signed(module, length)
    changed = bytearray(module)
    changed[length // 2] ^= 1
    assert not binaries.is_signed(bytes(changed), length)
    assert not binaries.is_signed(signed(module[:length], flags=0), length)
    assert not binaries.is_signed(module[:length] + b"x" + module[length:], length + 1)


def test_files_have_names_on_wines_disk() -> None:
    assert windows.path("/a folder/ä.ply") == "Z:\\a folder\\ä.ply"


def test_other_bits_than_here_are_failures() -> None:
    here = {"a": {"pairs": "1", "map": "2"}, "b": {"pairs": "3", "map": "4"}}
    outcome = windows.compared(here, {"a": here["a"], "b": {"pairs": "3", "map": "5"}})
    assert outcome.passed == 1
    assert outcome.failures == ["b: other bits than on Linux: map"]
    outcome = windows.compared(here, {"a": here["a"]})
    assert outcome.failures == ["b: other bits than on Linux: pairs, map"]


def test_what_wine_leaves_out_is_listed_with_its_reason() -> None:
    root = Path(__file__).resolve().parents[3]
    page = (root / "docs" / "development.md").read_text()
    [listed] = re.findall(r"^What Wine leaves out.*?\n\n((?:\|.*\n)+)", page, flags=re.MULTILINE)
    ignored = [f"test_{name}.py" for name in windows.BUILDING]
    files = [root / "native" / "build_tools" / "windows.py"]
    files += sorted((root / "native" / "tests").rglob("*.cpp"))
    for folder in (root / "native" / "tests" / "python", root / "blender_tests" / "headless"):
        files += [path for path in sorted(folder.glob("*.py")) if path.name not in ignored]
    # How a test of pytest's, a line in one, a test of Google's and a suite say it.
    ways = (
        r'skipif\(sys\.platform (?:== "win32"|!= "linux"), reason="(.*)"\)',
        r'if sys\.platform == "win32":\n\s+pytest\.skip\("(.*)"\)',
        r'^TEST\w*\([^{]*\{\n    GTEST_SKIP\(\) << "(.*)";\n\}',
        r'outcome\.skip\("(.*?)"',
        r'POINTMORPH_NO_RENDERING="(.*)"',
    )
    text = "\n".join(path.read_text() for path in files)
    said = {reason for way in ways for reason in re.findall(way, text, flags=re.MULTILINE)}
    assert said == set(re.findall(r"\*(.*?)\*", listed))
