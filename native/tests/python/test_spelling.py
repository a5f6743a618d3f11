"""American spelling in all that users read: messages, help, tooltips, docstrings and pages."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from spelling import british

ROOT = Path(__file__).resolve().parents[3]
NATIVE = ("native/src", "native/include", "native/bindings")
# Names that scripts rely on: an exception, and what Blender's operators return.
NAMES = {"Cancelled", "CANCELLED"}
CPP = re.compile(
    r"""//[^\n]*|/\*.*?\*/|'(?:[^'\\\n]|\\.)+'|R"\((?P<raw>.*?)\)"|"(?P<text>(?:[^"\\\n]|\\.)*)\"""",
    re.DOTALL,
)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Otherwise precise, clockwise: noise, raised, promising, devised, an exercise", []),
        ("Existing users consist of an axis and its bases, by size, likewise, denoised", []),
        ("An hour of labels, four controlled parameters, symmetrical; toward the fibers", []),
        ("Normalise", ["normalise"]),
        ("It was organised by optimising the parameterisation", ["organised", "optimising",
                                                                 "parameterisation"]),
        ("a Grey colour, in millimetres", ["grey", "colour", "millimetres"]),
        ("Cancelled: points inwards, behaviour modelled", ["cancelled", "inwards", "behaviour",
                                                           "modelled"]),
        ("analysed analysis", ["analysed"]),
    ],
)  # fmt: skip
def test_british_spellings_are_found(text: str, found: list[str]) -> None:
    assert sorted(british(text)) == sorted(found)


def cpp_literals(path: Path) -> Iterator[str]:
    for match in CPP.finditer(path.read_text(encoding="utf-8")):
        if (text := match["raw"] or match["text"]) and text not in NAMES:
            yield text


def python_literals(path: Path) -> Iterator[str]:
    """With the docstrings, in which the names may stand in a sentence."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) in docstrings:
                yield re.sub(rf"\b(?:{'|'.join(NAMES)})\b", "", node.value)
            elif node.value not in NAMES:
                yield node.value


def sentences(path: Path) -> Iterator[str]:
    """A page's, without code and names of models."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```|`[^`\n]*`", "", text, flags=re.MULTILINE | re.DOTALL)
    yield re.sub(r"\w+_\w+|\]\([^)]*\)", "", text)


def files() -> list[Path]:
    found = [path for folder in NATIVE for path in (ROOT / folder).rglob("*.[ch]pp")]
    for folder, name in (("native/python/pointmorph", "*.py"), ("addon", "*.py")):
        found += (ROOT / folder).rglob(name)
    found += [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md"]
    return sorted(found)


def test_what_users_read_is_in_american_spelling() -> None:
    read = {".cpp": cpp_literals, ".hpp": cpp_literals, ".md": sentences}
    count: dict[str, int] = {}
    found = []
    for path in files():
        for text in read.get(path.suffix, python_literals)(path):
            count[path.suffix] = count.get(path.suffix, 0) + 1
            found += [(str(path.relative_to(ROOT)), word) for word in british(text)]
    assert min(count.values()) > 50, count
    assert found == []
