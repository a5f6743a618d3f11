"""What a release refuses, and what it puts into its folder."""

from __future__ import annotations

import hashlib
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from build_tools import paths, releases
from build_tools.running import SetupError

CHANGES = "# Changelog\n\n## [Unreleased]\n\n## [1.2.3] - 2026-01-31\n\n### Added\n\n- A morph.\n"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of version 1.2.3, committed, that is ready for a release."""
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    monkeypatch.setattr(paths, "LOGS", tmp_path.parent / "logs")
    (tmp_path / "CMakeLists.txt").write_text("project(pointmorph VERSION 1.2.3 LANGUAGES CXX)\n")
    (tmp_path / "CHANGELOG.md").write_text(CHANGES)
    (tmp_path / ".gitignore").write_text("dist*\n")
    git(tmp_path, "init", "-q")
    commit(tmp_path)
    return tmp_path


def git(folder: Path, *words: str) -> None:
    who = ("-c", "user.name=Test", "-c", "user.email=test@example.org")
    subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)


def commit(folder: Path) -> None:
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "--allow-empty", "-m", "State")


def test_reads_version_and_notes(project: Path) -> None:
    assert releases.version() == "1.2.3"
    releases.check_tree("1.2.3")
    assert releases.notes("1.2.3") == "# Pointmorph 1.2.3\n\n### Added\n\n- A morph.\n"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (CHANGES.replace("[Unreleased]\n", "[Unreleased]\n\n- More.\n"), "under .Unreleased."),
        (CHANGES.replace("1.2.3", "1.2.2"), "the newest in CHANGELOG.md is 1.2.2"),
        ("# Changelog\n", "the newest in CHANGELOG.md is none"),
        (CHANGES.replace(" - 2026-01-31", ""), "must give the date"),
    ],
)
def test_refuses_a_changelog_that_is_not_ready(project: Path, changes: str, words: str) -> None:
    (project / "CHANGELOG.md").write_text(changes)
    with pytest.raises(SetupError, match=words):
        releases.notes("1.2.3")


def test_refuses_changes_that_are_not_committed(project: Path) -> None:
    (project / "new.txt").write_text("new")
    with pytest.raises(SetupError, match=r"aren't committed:\n.. new.txt"):
        releases.check_tree("1.2.3")


def test_refuses_a_tag_of_another_commit(project: Path) -> None:
    git(project, "tag", "v1.2.3")
    releases.check_tree("1.2.3")
    commit(project)
    with pytest.raises(SetupError, match=r"tag v1\.2\.3 is on another commit"):
        releases.check_tree("1.2.3")
    releases.check_tree("1.2.4")


def test_refuses_wheels_of_another_version(project: Path) -> None:
    right = ["pointmorph-1.2.3-cp311-cp311-win_amd64.whl", "plyfile-1.1.3-py3-none-any.whl"]
    releases.check_wheels("1.2.3", map(Path, right))
    with pytest.raises(SetupError, match=r"pointmorph-1\.2\.2.* isn't of version 1\.2\.3"):
        releases.check_wheels("1.2.3", [Path("pointmorph-1.2.2-cp311-cp311-win_amd64.whl")])


def test_collects_files_with_checksums_and_notes(
    project: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_sources(folder: Path) -> None:
        (folder / "pointmorph-1.2.3.tar.gz").write_bytes(b"sources")

    monkeypatch.setattr(releases, "source_package", write_sources)
    zip_file = tmp_path_factory.mktemp("made") / "pointmorph-1.2.3.zip"
    zip_file.write_bytes(b"zip")
    (project / "dist").mkdir()
    (project / "dist" / "pointmorph-1.2.2.zip").write_text("of the release before")
    found = releases.collect("1.2.3", "notes", [zip_file])
    names = ["NOTES.md", "SHA256SUMS", "pointmorph-1.2.3.tar.gz", "pointmorph-1.2.3.zip"]
    assert [path.name for path in found] == names
    assert (project / "dist" / "NOTES.md").read_text() == "notes"
    sums = (project / "dist" / "SHA256SUMS").read_text().splitlines()
    assert sums[1] == f"{hashlib.sha256(b'zip').hexdigest()}  pointmorph-1.2.3.zip"
    subprocess.run(["sha256sum", "--check", "SHA256SUMS"], cwd=project / "dist", check=True)


def test_packs_the_commit_and_follows_no_link(
    project: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    (project / ".gitignore").write_text("build/\n")
    commit(project)
    (project / "build").mkdir()
    (project / "build" / "z:").symlink_to("/")  # as Wine has it
    folder = tmp_path_factory.mktemp("made")
    packed: list[str] = []

    def pack(log: str, *command: str | Path) -> None:
        packed.extend(path.name for path in Path(command[-1]).rglob("*"))
        (folder / "pointmorph-1.2.3.tar.gz").touch()

    monkeypatch.setattr(releases, "run", pack)
    assert releases.source_package(folder) == folder / "pointmorph-1.2.3.tar.gz"
    assert sorted(packed) == [".gitignore", "CHANGELOG.md", "CMakeLists.txt"]


def test_workflows_test_what_the_page_says() -> None:
    root = Path(__file__).resolve().parents[3]
    tests = (root / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    steps = re.findall(r"^ +- run: (.+)$", tests, re.MULTILINE)
    assert {".ci/run", "python3 build_addon.py test --platform windows"} <= set(steps)
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    there = settings["tool"]["cibuildwheel"]["test-command"].rpartition("/")[2]
    page = (root / "docs" / "release.md").read_text(encoding="utf-8")
    assert f"`{there}` alone" in page
