"""The add-on's modules lie in rooms: none imports from a room above it, and none in a circle; the
lowest needs no Blender."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pointmorph
import pytest
from function_sizes import LONGEST_FUNCTION, large, sizes

ADDON = Path(__file__).resolve().parents[3] / "addon"
ROOMS = ("core", "data", "scene", "view", "operators", "ui")
"""The lowest first."""
BLENDERS = {"bpy", "bmesh", "mathutils", "bpy_extras", "gpu", "gpu_extras", "blf"}


@cache
def modules() -> dict[str, ast.Module]:
    """Every module by its name within the add-on."""
    found = {}
    for path in sorted(ADDON.rglob("*.py")):
        parts = path.relative_to(ADDON).with_suffix("").parts
        found[".".join(parts)] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def imports(name: str, tree: ast.Module, known: set[str]) -> set[str]:
    """The modules of the add-on that a module imports, wherever in it."""
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        base = [*name.split(".")[: -node.level], *(node.module or "").split(".")]
        package = ".".join(filter(None, base))
        for item in node.names:
            inner = f"{package}.{item.name}".strip(".")
            found.add(inner if inner in known else package)
    return found


@cache
def graph() -> dict[str, set[str]]:
    trees = modules()
    return {name: imports(name, tree, set(trees)) for name, tree in trees.items()}


def test_every_module_has_a_room() -> None:
    names = [name for name in graph() if name != "__init__"]
    assert len(names) > 40
    assert {name.split(".")[0] for name in names} == set(ROOMS)


def test_no_import_goes_up() -> None:
    edges = [(a, b) for a, found in graph().items() for b in found if a != "__init__"]
    assert len(edges) > 100
    up = [(a, b) for a, b in edges if ROOMS.index(a.split(".")[0]) < ROOMS.index(b.split(".")[0])]
    assert up == []


def test_no_imports_in_a_circle() -> None:
    """Raises CycleError, which names the modules, where there is one."""
    order = list(TopologicalSorter(graph()).static_order())
    assert len(order) == len(graph())


def test_the_check_finds_what_it_looks_for() -> None:
    known = {"core.a", "data.b", "data.c"}
    tree = ast.parse("def f():\n    from ..data import b\n    from ..data.c import d")
    assert imports("core.a", tree, known) == {"data.b", "data.c"}


def test_one_module_moves_arrays() -> None:
    """No other calls foreach_get or foreach_set, but for the script that another Blender runs."""
    paths = [path for path in ADDON.rglob("*.py") if "foreach_" in path.read_text("utf-8")]
    assert [path.relative_to(ADDON).as_posix() for path in sorted(paths)] == [
        "data/arrays.py",
        "scene/color_bake.py",
    ]


def test_one_module_asks_for_blenders_version() -> None:
    asking = {
        name
        for name, tree in modules().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and node.attr.startswith("version")
        and ast.unparse(node.value) == "bpy.app"
    }
    assert asking == {"data.versions"}


# --- What the extensions site asks for (docs/release.md) ------------------------------------------

NETWORK = {"ftplib", "http", "requests", "smtplib", "socket", "ssl", "urllib", "xmlrpc"}


def imported_packages(tree: ast.Module) -> set[str]:
    """Packages that a module imports from outside of the add-on."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").split(".")[0])
    return found


def test_imports_nothing_that_blender_or_the_extension_lacks() -> None:
    brought = BLENDERS | {"numpy", "pointmorph"}
    for name, tree in modules().items():
        assert imported_packages(tree) <= brought | sys.stdlib_module_names, name


def test_uses_no_network() -> None:
    for name, tree in modules().items():
        assert not imported_packages(tree) & NETWORK, name


def test_leaves_the_search_path_and_the_console_alone() -> None:
    for name, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute):
                assert ast.unparse(node) != "sys.path", name
            if isinstance(node, ast.Call):
                assert ast.unparse(node.func) != "print", name


# --- Size of functions ----------------------------------------------------------------------------

GIVEN_BY_BLENDER = {"draw_item"}
"""Methods whose parameters Blender chooses."""


def test_functions_are_short_and_take_few_parameters() -> None:
    count, found = large(modules())
    assert count > 300
    assert {
        name: size
        for name, size in found.items()
        if size[0] > LONGEST_FUNCTION or name.rpartition(".")[2] not in GIVEN_BY_BLENDER
    } == {}


def test_the_size_of_functions_is_measured() -> None:
    tree = ast.parse("class A:\n    def f(self, a, /, b, *c, d=1, **e):\n        pass\n")
    assert sizes(tree) == {"A.f": (2, 3)}
    tree = ast.parse("def f(a):\n" + "    g()\n" * 90 + "    def h(): pass\n")
    assert sizes(tree) == {"f": (92, 1), "f.h": (1, 0)}
    many = ast.parse("if 1:\n    def f(a, b, c, d, e, f, g): pass\n")
    assert large({"m": tree, "n": many, "o": ast.parse("def f(): pass")}) == (
        4,
        {"m.f": (92, 1), "n.f": (1, 7)},
    )


# --- The core -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def core() -> ModuleType:
    """The room as a package of its own."""
    folder = ADDON / "core"
    spec = importlib.util.spec_from_file_location(
        "addon_core", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["addon_core"] = package
    spec.loader.exec_module(package)
    return package


def part(core: ModuleType, name: str) -> ModuleType:
    return importlib.import_module(f"{core.__name__}.{name}")


WITHOUT_BLENDER = """
import importlib, importlib.util, sys
folder, *blenders = sys.argv[1:]
sys.modules.update(dict.fromkeys(blenders))  # importing one of them fails
spec = importlib.util.spec_from_file_location(
    "addon_core", f"{folder}/__init__.py", submodule_search_locations=[folder]
)
sys.modules["addon_core"] = package = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
import pathlib
for path in pathlib.Path(folder).glob("[!_]*.py"):
    importlib.import_module(f"addon_core.{path.stem}")
    print(path.stem)
"""


def test_the_core_needs_no_blender() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_BLENDER, str(ADDON / "core"), *sorted(BLENDERS)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    names = {path.stem for path in (ADDON / "core").glob("[!_]*.py")}
    assert set(done.stdout.split()) == names
    assert len(names) > 7


def sheet(side: int, height: float) -> np.ndarray:
    u, v = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    z = height * np.exp(-3 * (u**2 + v**2))
    return np.stack([u, v, z], axis=-1).reshape(-1, 3).astype(np.float32)


def test_the_core_morphs_without_blender(core: ModuleType) -> None:
    """From two objects' arrays and marks to all that the scene gets of a morph."""
    computation, features = part(core, "computation"), part(core, "features")
    marks = features.Marks("vertex group", {"corner": (np.array([0]), np.array([1.0]))})
    source, target = (
        computation.Shape(name, sheet(side, height), None, None, None, None, marks)
        for name, side, height in (("a", 12, 0.2), ("b", 10, 0.6))
    )
    request = computation.Request(
        source, target, features.match(source, target), [], {"domain": "disk"}
    )
    assert request.features == {"corner": (0, 0)}
    outcome = computation.compute(request, lambda stage, fraction: True)
    assert set(outcome.source.rows) == set(range(144))
    assert set(outcome.target.rows) == set(range(100))
    pairs = set(zip(outcome.source.rows.tolist(), outcome.target.rows.tolist(), strict=True))
    assert (0, 0) in pairs
    assert np.array_equal(outcome.source.positions, source.positions[outcome.source.rows])
    assert np.array_equal(outcome.target.positions, target.positions[outcome.target.rows])
    plan, frame_plan = (10, 20, 5), part(core, "frame_plan")
    times = frame_plan.Plan(*plan, "SMOOTH", False, False).times()
    assert times == [0.0, 0.5, 1.0]


def test_a_library_that_is_not_there_is_explained(core: ModuleType) -> None:
    library = part(core, "library")

    def fail(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    with pytest.raises(ImportError, match=r"has no library for .* with Python .* Install the zip"):
        library.check(fail)


def test_a_library_that_does_not_load_is_explained(core: ModuleType) -> None:
    library = part(core, "library")

    def fail(name: str) -> None:
        raise ImportError("libgomp.so: cannot open", name=f"{name}._pointmorph")

    with pytest.raises(ImportError, match=r"can't be loaded on .* install it again.*libgomp"):
        library.check(fail)


def test_a_library_that_loads_needs_no_words(core: ModuleType) -> None:
    part(core, "library").check()


@pytest.mark.parametrize(
    ("name", "value", "domain", "changes"),
    [
        ("covariance_neighbors", 20, "auto", True),
        ("domain", "sphere", "auto", True),
        ("influence", 3.0, "auto", False),  # for the paper's method alone
        ("influence", 3.0, "disk", True),
        ("path", "rigid", "disk", False),
        ("omega", 0.0, "disk", False),
        ("threads", 1, "disk", False),
        ("influence_radius", 0.5, "disk", True),  # automatic before
        ("of_an_earlier_version", 1, "disk", True),
    ],
)
def test_a_setting_makes_a_morph_stale_where_it_changes_the_map(
    core: ModuleType, name: str, value: object, domain: str, changes: bool
) -> None:
    changed_settings = part(core, "settings").changed_settings
    now = {o.name: o.default for o in pointmorph.options() if o.default is not None}
    now["domain"] = domain
    assert changed_settings(now, now) == []
    assert changed_settings({**now, name: value}, now) == ([name] if changes else [])


def test_the_panel_shows_what_the_method_uses(core: ModuleType) -> None:
    def shown(method: str, domain: str, *affects: str) -> set[str]:
        settings = SimpleNamespace(method=method, domain=domain)
        return {option.name for option in part(core, "settings").shown_options(settings, *affects)}

    kinds = {option.affects for option in pointmorph.options()}
    # What staggers is chosen on the result, and Blender says what is up.
    names = {option.name for option in pointmorph.options()} - {"up"}
    every = {name for name in names if not name.startswith("stagger")}
    assert shown("auto", "disk", *kinds) == every
    of_auto = {option.name for option in pointmorph.options() if option.method == "auto"}
    assert {"missing_parts", "wrap_conform", "wrap_relax"} <= of_auto
    assert shown("paper", "auto", *kinds) == every - of_auto
    assert not shown("auto", "auto", *kinds) & {"up"}
    assert {"influence", "solve"} <= every - shown("auto", "auto", *kinds)
    assert shown("auto", "auto", "path") == {"path"}
    apart = [shown("auto", "disk", kind) for kind in kinds]
    assert sum(map(len, apart)) == len(every)
