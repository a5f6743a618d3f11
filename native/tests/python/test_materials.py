"""What is given to others: a bill of it, its licenses, and the very files that it's made from."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
if not Path("/usr/include/nanoflann.hpp").exists():
    pytest.skip("the headers that are compiled in aren't here", allow_module_level=True)
sys.path.insert(0, str(ROOT / "native"))

from build_tools import materials, python_environment, targets  # noqa: E402

HERE = [targets.LINUX, targets.MACOS]
if shutil.which("x86_64-w64-mingw32-g++-posix"):
    HERE.append(targets.WINDOWS)


def test_every_material_has_its_version_and_license() -> None:
    found = materials.materials(HERE)
    assert {"Eigen", "nanoflann", "pybind11", "plyfile", "libgomp"} <= {one.name for one in found}
    for one in found:
        assert re.search(r"\d+\.\d+", one.version), one
        # The GPL's text is LICENSE.
        assert one.texts or one.license == "GPL-3.0-or-later"


def test_every_license_is_that_of_something() -> None:
    used = {text for one in materials.materials(HERE) for text in one.texts}
    there = {path.name for path in materials.LICENSES.iterdir()}
    assert used <= there
    if targets.WINDOWS in HERE:
        assert used == there


def test_a_package_has_its_bill_and_licenses(tmp_path: Path) -> None:
    materials.put(tmp_path, "1.2", [targets.LINUX])
    bill = json.loads((tmp_path / materials.BILL).read_text())
    assert bill["metadata"]["component"]["version"] == "1.2"
    names = {one["name"]: one for one in bill["components"]}
    assert names["Eigen"]["licenses"] == [{"expression": "MPL-2.0"}]
    assert "winpthreads" not in names
    assert "Mozilla Public License" in (tmp_path / "licenses" / "MPL-2.0.txt").read_text()


def test_what_is_shipped_is_pinned_to_a_file() -> None:
    for pin in python_environment.pins().values():
        assert re.fullmatch(r"[\d.]+", pin.version)
        assert re.fullmatch(r"sha256:[0-9a-f]{64}", pin.hash)
    used = set(re.findall(r'pins\(\)\["([\w-]+)"\]', "".join(
        path.read_text() for path in (ROOT / "native" / "build_tools").glob("*.py")
    )))  # fmt: skip
    assert used == python_environment.pins().keys()
