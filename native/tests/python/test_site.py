"""The documentation as a site."""

from __future__ import annotations

import html
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pointmorph
import pytest

ROOT = Path(__file__).resolve().parents[3]
pytest.importorskip("mkdocs")
pytest.importorskip("mkdocstrings")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, which has to be built without a warning."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)],
        cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def text_of(page: Path) -> str:
    return html.unescape(re.sub("<[^>]+>", "", page.read_text(encoding="utf-8")))


def test_the_readme_is_the_first_page_with_its_picture(site: Path) -> None:
    page = (site / "index.html").read_text(encoding="utf-8")
    assert 'href="site.css"' in page
    assert (site / "site.css").is_file()
    [picture] = re.findall(r'<img[^>]*src="([^"]*calf_to_koala\.png)"', page)
    assert (site / picture).is_file()
    assert 'href="manual/"' in page


def test_every_link_within_the_site_leads_somewhere(site: Path) -> None:
    links = 0
    for page in [*site.glob("*/index.html"), *site.glob("stages/*/*/index.html")]:
        for target in re.findall(r'href="([^"#?:]+)(?:#[^"]*)?"', page.read_text("utf-8")):
            path = (page.parent / target).resolve()
            assert path.is_file() or (path / "index.html").is_file(), (page, target)
            links += 1
    assert links > 1000


def test_the_reference_has_all_that_the_package_has(site: Path) -> None:
    page = (site / "api" / "python" / "index.html").read_text(encoding="utf-8")
    headings = set(re.findall(r'id="pointmorph\.([\w.]+)"', page))
    names = {name for name in pointmorph.__all__ if not name.startswith("_")}
    assert names <= headings
    assert {"Morph.frame", "Morph.wrapped", "Cloud"} <= headings
    # From the docstrings: tables of parameters and errors.
    assert page.count("Parameters:") > 20
    headers = {path.stem for path in (ROOT / "native" / "include").rglob("*.hpp")}
    listed = text_of(site / "api" / "cpp" / "index.html").split()
    assert headers <= set(listed)


def test_the_search_finds_pages_and_headers_but_not_tests(site: Path) -> None:
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    text = {entry["location"]: entry["text"] for entry in index["docs"]}
    assert any("scancel" in words for place, words in text.items() if place.startswith("farm"))
    assert any(place.startswith("source/native/include/") for place in text)
    assert not any(place.startswith("source/native/tests/") for place in text)
