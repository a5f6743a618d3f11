"""What the documentation says is what the library does."""

from __future__ import annotations

import doctest
import importlib
import json
import pkgutil
import re
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
import pytest
from pointmorph import formats
from shapes import ball

ROOT = Path(__file__).resolve().parents[3]


def test_settings_page_is_up_to_date() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "make_options.py"))["page"]()
    assert (ROOT / "docs" / "options.md").read_text(encoding="utf-8") == page, (
        "run: python docs/make_options.py > docs/options.md"
    )


def test_reliability_page_is_up_to_date() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "make_reliability.py"))["page"]()
    assert (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8") == page, (
        "run: python docs/make_reliability.py"
    )


@pytest.mark.parametrize(
    "page", sorted(p.relative_to(ROOT) for p in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]),
    ids=str,
)  # fmt: skip
def test_links_lead_somewhere(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)  # [](int) is C++ there
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        if not re.match(r"[a-z]+:", target):
            assert ((ROOT / page).parent / target).exists(), target


def two_balls() -> tuple[Any, Any]:
    return ball(600), 2.0 * ball(700)


@cache
def morphed() -> pointmorph.Morph:
    return pointmorph.morph(*map(pointmorph.Cloud, two_balls()))


@pytest.mark.parametrize(
    "page", ["README.md", "docs/python.md", "docs/resampling.md", "docs/morph_file.md"]
)
def test_python_examples_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    source, target = two_balls()
    for name, points in (("venus", source), ("mannequin", target)):
        count = len(points)
        colors, radii = np.ones((count, 4)), np.full(count, 0.1)
        formats.write_ply(f"{name}.ply", points, points, colors, radii)
    names = {"source_positions": source, "target_positions": target, "morph": morphed()}
    text = (ROOT / page).read_text(encoding="utf-8")
    examples = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert examples
    for example in examples:  # each may use what those before it made
        exec(compile(example, page, "exec"), names)


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    path = ROOT / "docs" / "examples" / "two_files_to_a_picture.ipynb"
    notebook = json.loads(path.read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []  # what it prints and shows isn't kept
            exec(compile("".join(cell["source"]), path.name, "exec"), names)
    names["figure"].savefig("way.png", dpi=40)
    picture = matplotlib.image.imread("way.png")[:, :, :3]
    # Each of the five shows something.
    for part in np.array_split(picture, 5, axis=1):
        assert (part.min(axis=2) < 0.9).mean() > 0.05
    assert (tmp_path / "egg.morph").is_file()
    assert names["morph"].wrapped(1.0).shape == names["egg"].vertices.shape


MODULES = [
    "pointmorph",
    *sorted(
        module.name
        for module in pkgutil.walk_packages(pointmorph.__path__, "pointmorph.")
        if not any(part.startswith("_") for part in module.name.split("."))
    ),
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings_run(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name))
    assert result.failed == 0


def test_most_examples_in_docstrings_are_found() -> None:
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = [
        example
        for name in MODULES
        for test in finder.find(importlib.import_module(name))
        for example in test.examples
    ]
    assert len(found) > 100


def test_the_command_line_page_names_every_format() -> None:
    page = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
    for format in formats.FORMATS:
        assert f"`{format.suffix}`" in page
        assert format.loses in page
