"""Writes the documentation as pages for a browser, which the packaged add-on brings along.

    python docs/make_html.py FOLDER

Pictures come along for the manual only; the others are large.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import markdown

DOCS = Path(__file__).resolve().parent
STYLE = (
    "body { font: 16px/1.5 sans-serif; max-width: 48em; margin: 2em auto; padding: 0 1em } "
    "img { max-width: 100% } table { border-collapse: collapse } "
    "td, th { border: 1px solid #ccc; padding: .2em .6em; text-align: left } "
    "pre { background: #f4f4f4; padding: .6em; overflow: auto }"
)


def page(path: Path) -> str:
    """A page of the documentation as HTML."""
    text = path.read_text(encoding="utf-8")
    title = re.search("^# (.*)$", text, re.MULTILINE)
    # Links between pages, but not those that lead out of the documentation.
    linked = re.sub(r"\]\((?![a-z]+:)([^)#]+)\.md(#[^)]*)?\)", r"](\1.html\2)", text)
    body = markdown.markdown(linked, extensions=["tables", "fenced_code", "toc"])
    head = f"<meta charset=utf-8><title>{title[1] if title else path.stem}</title>"
    return (
        f"<!doctype html><html><head>{head}<style>{STYLE}</style></head><body>{body}</body></html>"
    )


def write(folder: Path) -> None:
    """All pages, in the folders in which they are here."""
    for path in sorted(DOCS.glob("**/*.md")):
        to = folder / path.relative_to(DOCS).with_suffix(".html")
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_text(page(path), encoding="utf-8")
    shutil.copytree(DOCS / "manual" / "images", folder / "manual" / "images", dirs_exist_ok=True)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
