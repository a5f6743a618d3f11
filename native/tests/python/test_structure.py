"""The library's rooms: no include goes up, and every stage has its four files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
NATIVE = ROOT / "native"


def table_of_rooms() -> list[tuple[str, set[str]]]:
    """Rooms and their stems, lowest first, as docs/development.md lists them."""
    page = (ROOT / "docs" / "development.md").read_text(encoding="utf-8")
    table = page.partition("### Rooms")[2].partition("\n##")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", table, flags=re.MULTILINE)
    return [(room, set(re.findall(r"`(\w+)`", stems))) for room, stems in rows]


ROOMS = table_of_rooms()
ORDER = [room for room, _ in ROOMS]


def files(folder: str) -> list[Path]:
    return sorted(p for p in (NATIVE / folder).rglob("*") if p.suffix in (".cpp", ".hpp"))


def upward_includes(room: str, text: str) -> list[str]:
    included = re.findall(r'#include "(?:pointmorph/)?(\w+)/(\w+)\.hpp"', text)
    return [f"{to}/{stem}" for to, stem in included if ORDER.index(to) > ORDER.index(room)]


@pytest.mark.parametrize("folder", ["include/pointmorph", "src"])
def test_no_include_goes_up(folder: str) -> None:
    found = files(folder)
    assert found
    upward = {
        str(path.relative_to(NATIVE)): names
        for path in found
        if (names := upward_includes(path.parent.name, path.read_text(encoding="utf-8")))
    }
    assert upward == {}


def test_an_upward_include_would_be_noticed() -> None:
    assert upward_includes("cloud", '#include "pointmorph/morph/morph.hpp"\n') == ["morph/morph"]
    assert upward_includes("morph", '#include "cloud/bucket_tree.hpp"\n') == []


def test_the_table_of_rooms_is_complete() -> None:
    stems: dict[str, set[str]] = {}
    for path in files("include/pointmorph") + files("src"):
        stems.setdefault(path.parent.name, set()).add(path.stem)
    assert stems == dict(ROOMS)


@pytest.mark.parametrize(
    "header", files("include/pointmorph"), ids=lambda p: f"{p.parent.name}/{p.stem}"
)
def test_source_and_test_stand_in_the_header_s_room(header: Path) -> None:
    room, stem = header.parent.name, header.stem
    sources = [NATIVE / "src" / room / f"{stem}.cpp"]
    tests = [NATIVE / "tests" / room / f"test_{stem}.cpp"]
    elsewhere = [p for p in files("src") if p.stem == stem and p not in sources]
    elsewhere += [p for p in files("tests") if p.stem == f"test_{stem}" and p not in tests]
    assert elsewhere == []


@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs" / "stages").glob("*/*.md")), ids=lambda p: p.stem
)
def test_a_stage_has_its_header_source_and_test(page: Path) -> None:
    room, stem = page.parent.name, page.stem
    assert (NATIVE / "include" / "pointmorph" / room / f"{stem}.hpp").exists()
    assert (NATIVE / "src" / room / f"{stem}.cpp").exists()
    assert (NATIVE / "tests" / room / f"test_{stem}.cpp").exists()


@pytest.mark.parametrize(
    "header", files("include/pointmorph"), ids=lambda p: f"{p.parent.name}/{p.stem}"
)
def test_a_stage_has_its_page(header: Path) -> None:
    if header.read_text(encoding="utf-8").startswith("// Stage "):
        room, stem = header.parent.name, header.stem
        assert (ROOT / "docs" / "stages" / room / f"{stem}.md").exists()
