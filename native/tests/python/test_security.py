"""What docs/security.md says isn't used, and that the tests it names are there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
SHIPPED = [*(ROOT / "addon").rglob("*.py"), *(ROOT / "native/python/pointmorph").rglob("*.py")]
MODULES = {
    *("ctypes", "ftplib", "http", "marshal", "multiprocessing", "pickle", "requests", "shelve"),
    *("smtplib", "socket", "ssl", "subprocess", "telnetlib", "urllib", "xmlrpc"),
}
CALLS = {"__import__", "compile", "eval", "exec", "popen", "system"}
# Each with the reason.
KNOWN = {
    ("runs.py", "subprocess"): "Python itself, for each pair of a batch",
    ("tasks.py", "subprocess"): "the same",
    ("commands.py", "subprocess"): "list2cmdline alone, which is about text",
    ("other_blender.py", "subprocess"): "Blender itself, which bakes colors beside the window",
    ("file_checks.py", "urllib"): "unquote alone, which is about text",
    ("free_memory.py", "ctypes"): "asks Windows how much memory is free",
    ("slurm_jobs.py", "subprocess"): "sbatch and its like, where the user asks for Slurm",
    ("surfaces.py", "subprocess"): "Python itself, for surfaces through points",
    ("_wait_policy.py", "ctypes"): "the environment on Windows, before OpenMP reads it",
}


def uses(text: str) -> set[str]:
    """Modules and functions that Python text uses, of those above."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found |= {(node.module or "").partition(".")[0]} & MODULES
        elif isinstance(node, ast.Call):
            function = node.func
            bare = isinstance(function, ast.Name) and function.id in CALLS
            of_os = isinstance(function, ast.Attribute) and ast.unparse(function) in (
                "os.popen",
                "os.system",
            )
            if bare or of_os:
                found.add(ast.unparse(function))
            found |= {
                "allow_pickle"
                for word in node.keywords
                if word.arg == "allow_pickle" and ast.unparse(word.value) != "False"
            }
    return found


def test_uses_are_found() -> None:
    text = (
        "import pickle\nfrom urllib.parse import quote\neval('1')\nos.system('x')\nre.compile('a')"
    )
    assert uses(text) == {"pickle", "urllib", "eval", "os.system"}
    assert uses("np.load(f, allow_pickle=True)\nnp.load(f, allow_pickle=False)") == {"allow_pickle"}


def test_what_is_shipped_runs_no_text_and_opens_no_connection() -> None:
    assert len(SHIPPED) > 100
    found = {
        (path.name, name) for path in SHIPPED for name in uses(path.read_text(encoding="utf-8"))
    }
    assert found == set(KNOWN)


def test_the_page_names_tests_that_there_are() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    tests = {path.name for path in ROOT.glob("*/tests/**/test_*")}
    tests |= {path.name for path in ROOT.glob("blender_tests/**/test_*")}
    named = set(re.findall(r"`(test_\w+\.\w+)`", page))
    assert named
    assert named <= tests, named - tests
