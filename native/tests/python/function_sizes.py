"""How long Python functions are, and how many parameters they take."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping

LONGEST_FUNCTION = 80
MOST_PARAMETERS = 6


def functions(
    tree: ast.AST, within: str = ""
) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Every function by its name within the module, as in `Class.method`."""
    for node in ast.iter_child_nodes(tree):
        name = within
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            name = f"{within}.{node.name}".strip(".")
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield name, node
        yield from functions(node, name)


def sizes(tree: ast.Module) -> dict[str, tuple[int, int]]:
    """Lines and parameters of every function; the object that a method belongs to isn't counted.
    Of functions with the same name, such as a property's, the most."""
    found: dict[str, tuple[int, int]] = {}
    for name, node in functions(tree):
        lines = (node.end_lineno or node.lineno) - node.lineno + 1
        given = node.args
        names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        parameters = len(names) - (names[:1] in (["self"], ["cls"]))
        known = found.get(name, (0, 0))
        found[name] = max(known[0], lines), max(known[1], parameters)
    return found


def large(trees: Mapping[str, ast.Module]) -> tuple[int, dict[str, tuple[int, int]]]:
    """How many functions the modules have, and which of them are too large."""
    found = {
        f"{module}.{name}": size
        for module, tree in trees.items()
        for name, size in sizes(tree).items()
    }
    most = LONGEST_FUNCTION, MOST_PARAMETERS
    return len(found), {
        name: size for name, size in found.items() if size[0] > most[0] or size[1] > most[1]
    }
