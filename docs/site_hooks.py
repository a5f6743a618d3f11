"""What MkDocs calls while it makes the site (mkdocs.yml): pages from what lies outside of docs, and
links to them.

The README becomes the first page. Sources that pages link to become pages, headers of C++ among
them, which are its reference; Python's reference is made from the docstrings.
"""

from __future__ import annotations

import ast
import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
PACKAGE = ROOT / "native" / "python" / "pointmorph"

_PAGES = {
    "index.md": ROOT / "README.md",
    "changelog.md": ROOT / "CHANGELOG.md",
    "contributing.md": ROOT / "CONTRIBUTING.md",
}
_LANGUAGES = {
    ".hpp": "cpp",
    ".cpp": "cpp",
    ".py": "python",
    ".json": "json",
    ".toml": "toml",
    ".yml": "yaml",
    ".txt": "cmake",
}
_CODE = re.compile(r"^(```+).*?^\1", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?<=\]\()([^)\s#]+)(#[^)\s]*)?(?=\))")


def on_files(files: Any, config: Any) -> Any:
    """Adds the pages that aren't in docs."""
    sources = {
        path
        for page in [*DOCS.rglob("*.md"), *_PAGES.values()]
        for path in linked(page, page.read_text(encoding="utf-8"))
        if path.suffix in _LANGUAGES
    }
    sources |= set((ROOT / "native" / "include").rglob("*.hpp"))
    for uri, path in _PAGES.items():
        content = path.read_text(encoding="utf-8")
        files.append(File.generated(config, uri, content=content))
    files.append(File.generated(config, "api/python.md", content=python_reference()))
    files.append(File.generated(config, "api/cpp.md", content=cpp_reference(sources)))
    for path in sorted(sources):
        files.append(File.generated(config, page_of(path), content=source_page(path)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Leads links to where their targets are on the site."""
    uri = page.file.src_uri
    home = _PAGES[uri].parent if uri in _PAGES else (DOCS / uri).parent

    def led(match: re.Match[str]) -> str:
        target = (home / match[1]).resolve()
        if re.match("[a-z]+:", match[1]) or not target.exists():
            return match[0]
        return os.path.relpath(page_of(target), Path(uri).parent) + (match[2] or "")

    parts, at = [], 0
    for code in _CODE.finditer(markdown):
        parts += [_LINK.sub(led, markdown[at : code.start()]), code[0]]
        at = code.end()
    return "".join([*parts, _LINK.sub(led, markdown[at:])])


def linked(page: Path, text: str) -> list[Path]:
    """The files that a page links to."""
    targets = (match[1] for match in _LINK.finditer(_CODE.sub("", text)))
    paths = ((page.parent / target).resolve() for target in targets if ":" not in target)
    return [path for path in paths if path.is_file()]


def page_of(path: Path) -> str:
    """Where a file of the project is on the site."""
    for uri, known in _PAGES.items():
        if path == known:
            return uri
    if path.is_dir():
        path = path / "README.md"
    inside = path.is_relative_to(DOCS) and path.suffix not in _LANGUAGES
    relative = path.relative_to(DOCS if inside else ROOT).as_posix()
    return f"source/{relative}.md" if path.suffix in _LANGUAGES else relative


def source_page(path: Path) -> str:
    """A source as a page. The search finds headers alone; coloring all would take long."""
    is_header = path.suffix == ".hpp"
    head = "" if is_header else "---\nsearch:\n  exclude: true\n---\n"
    language = _LANGUAGES[path.suffix] if is_header or path.is_relative_to(DOCS) else "text"
    code = path.read_text(encoding="utf-8")
    name = path.relative_to(ROOT).as_posix()
    return f"{head}# {path.name}\n\n`{name}`\n\n`````{language}\n{code}`````\n"


def python_reference() -> str:
    """All that `import pointmorph` has, by the docstrings."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    [names] = [
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    shown = [name for name in names if not name.startswith("_")]
    return "# Python reference\n\n" + "\n".join(f"::: pointmorph.{name}" for name in shown) + "\n"


def cpp_reference(sources: set[Path]) -> str:
    """The headers, by room; their comments are the reference."""
    headers = sorted(path for path in sources if path.suffix == ".hpp")
    rooms = dict.fromkeys(path.parent.name for path in headers)
    lines = [
        "# C++ reference",
        "",
        "Each header says what goes in, what comes out, and how it fails.",
    ]
    for room in rooms:
        lines += ["", f"## {room}", ""]
        for path in headers:
            if path.parent.name == room:
                lines.append(f"- [{path.stem}](../{page_of(path)})")
    return "\n".join(lines) + "\n"
