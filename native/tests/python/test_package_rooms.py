"""The package's modules lie in rooms: no import goes up, and none runs in a circle but for a
reason. Scripts find modules that have moved by their earlier names."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from function_sizes import large

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "native" / "python" / "pointmorph"
TOP = {"__init__", "__main__", "_moved_modules", "_wait_policy"}


def table_of_rooms() -> dict[str, set[str]]:
    """Rooms and their modules, lowest first, as docs/development.md lists them."""
    page = (ROOT / "docs" / "development.md").read_text(encoding="utf-8")
    table = page.partition("### The package's rooms")[2].partition("\n#")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", table, flags=re.MULTILINE)
    return {room: set(re.findall(r"`(\w+)`", modules)) for room, modules in rows}


ROOMS = table_of_rooms()
ORDER = list(ROOMS)


def imports(body: list[ast.stmt], *, within_functions: bool) -> set[tuple[str, str]]:
    """Rooms and modules that a module imports; the module is empty where it is the room itself."""
    nodes = [node for part in body for node in ast.walk(part)] if within_functions else body
    found = set()
    for node in nodes:
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "pointmorph" and len(parts) > 1 and parts[1] in ROOMS:
                module = parts[2] if len(parts) > 2 and parts[2] in ROOMS[parts[1]] else ""
                found.add((parts[1], module))
    return found


@cache
def modules() -> dict[tuple[str, str], list[ast.stmt]]:
    return {
        (path.parent.name, path.stem.removeprefix("__init__")): ast.parse(
            path.read_text("utf-8")
        ).body
        for path in sorted(PACKAGE.glob("*/*.py"))
    }


def test_every_module_stands_in_the_table() -> None:
    rooms: dict[str, set[str]] = {}
    for room, module in modules():
        rooms.setdefault(room, set()).update({module} - {""})
    assert rooms == ROOMS
    assert {path.stem for path in PACKAGE.glob("*.py")} == TOP


def test_no_import_goes_up() -> None:
    edges = [
        (module, imported)
        for module, body in modules().items()
        for imported in imports(body, within_functions=True)
    ]
    assert len(edges) > 150
    assert [(a, b) for a, b in edges if ORDER.index(a[0]) < ORDER.index(b[0])] == []


CIRCLES = {
    (("morphs", "morphing"), ("morphs", "stored_morphs")): (
        "Morph.save writes what open_morph reads: one module knows the format"
    ),
}
"""Imports within functions that would close a circle, each with the reason."""


def test_nothing_is_imported_in_a_circle() -> None:
    """Raises CycleError, which names the modules, where there is a circle."""
    graph = {
        module: {a for a in imports(body, within_functions=True) if a[0] != module[0] or a[1]}
        for module, body in modules().items()
    }
    for module, imported in CIRCLES:
        assert module not in imports(modules()[module], within_functions=False)
        graph[module].remove(imported)
    order = list(TopologicalSorter(graph).static_order())
    assert len(order) == len(graph)


def test_the_check_finds_what_it_looks_for() -> None:
    body = ast.parse(
        "from pointmorph.base import errors\ndef f():\n    import pointmorph.commands.cli"
    ).body
    assert imports(body, within_functions=True) == {("base", "errors"), ("commands", "cli")}
    assert imports(body, within_functions=False) == {("base", "errors")}


LARGE_FUNCTIONS = {
    "shapes.clouds.Cloud.__init__": "all that a shape may have, most by name; scripts rely on it",
    "formats.table.write_ply": "a column each, most of them optional; scripts rely on it",
    "morphs.morphing.morph": "the one entry; all but shapes and features by name",
}
"""Longer functions and such with more parameters, each with the reason."""


def test_functions_are_short_and_take_few_parameters() -> None:
    trees = {
        ".".join(path.relative_to(PACKAGE).with_suffix("").parts): ast.parse(
            path.read_text("utf-8")
        )
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    count, found = large(trees)
    assert count > 400
    assert set(found) == set(LARGE_FUNCTIONS), found


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("frame_stores.FrameStore", "sequences.FrameStore"),
        ("moving.Pose", "sequences.ShapeState"),
        ("moving_shapes.MovingSequence", "sequences.MovingSequence"),
        ("sampling.sample", "meshes.sample"),
        ("source_meshes.SourceMesh", "sequences.SourceMesh"),
        ("surfaces.Surfaces", "sequences.Surfaces"),
    ],
)
def test_modules_are_found_by_their_earlier_names(old: str, new: str) -> None:
    """In a Python of its own, in which no one has imported them yet."""
    module, _, name = old.rpartition(".")
    room, _, now = new.rpartition(".")
    lines = [
        f"from pointmorph.{module} import {name}",
        f"from pointmorph import {module}, {room}",
        f"assert {module}.{name} is {name} is {room}.{now}",
    ]
    program = ["-W", "always::DeprecationWarning", "-c", "\n".join(lines)]
    done = subprocess.run([sys.executable, *program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"pointmorph.{module} is now pointmorph.{room}" in done.stderr
