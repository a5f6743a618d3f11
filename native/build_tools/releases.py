"""A release: everything that is given to others, in one folder, from one commit."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from . import paths
from .running import SetupError, run, step


def dist() -> Path:
    return paths.ROOT / "dist"


def version() -> str:
    """The version in CMakeLists.txt, where it stands for all."""
    text = (paths.ROOT / "CMakeLists.txt").read_text()
    found = re.search(r"project\(pointmorph VERSION ([0-9.]+)", text)
    if found is None:
        raise SetupError("CMakeLists.txt names no version: expected project(pointmorph VERSION …).")
    return found[1]


def notes(version: str) -> str:
    """What CHANGELOG.md says of a version. Raises SetupError where it isn't ready for a release."""
    text = (paths.ROOT / "CHANGELOG.md").read_text()
    parts = re.split(r"^## \[([^]]+)\](.*)$", text, flags=re.MULTILINE)[1:]
    sections = {
        name: (rest.strip(" -"), body.strip())
        for name, rest, body in zip(parts[::3], parts[1::3], parts[2::3], strict=True)
    }
    if sections.get("Unreleased", ("", ""))[1]:
        raise SetupError(
            f"CHANGELOG.md lists changes under [Unreleased]. Move them to a section "
            f"[{version}] with the date."
        )
    newest = next((name for name in sections if name != "Unreleased"), None)
    if newest != version:
        raise SetupError(
            f"CMakeLists.txt says version {version}, the newest in CHANGELOG.md is "
            f"{newest or 'none'}. Make them agree."
        )
    date, body = sections[version]
    if not re.fullmatch(r"\d{4}-\d\d-\d\d", date):
        raise SetupError(
            f"CHANGELOG.md must give the date of {version}: ## [{version}] - YYYY-MM-DD"
        )
    return f"# Pointmorph {version}\n\n{body}\n"


def check_tree(version: str) -> None:
    """Raises SetupError where the files aren't those of one commit, or another bears the tag."""
    if changed := _git("status", "--porcelain"):
        raise SetupError(f"There are changes that aren't committed:\n{changed}\nCommit them first.")
    tag = f"v{version}"
    if _git("tag", "--list", tag) and _git("rev-list", "-n1", tag) != _git("rev-parse", "HEAD"):
        raise SetupError(f"The tag {tag} is on another commit. Choose a new version.")


def check_wheels(version: str, files: Iterable[Path]) -> None:
    """Raises SetupError for a file of another version of Pointmorph."""
    for path in files:
        words = path.name.split("-")
        if words[0] == "pointmorph" and not words[1].startswith(version):
            raise SetupError(f"{path.name} isn't of version {version}. Delete the folder build.")


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=paths.ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise SetupError(f"git {words[0]} failed: {done.stderr.strip()}")
    return done.stdout.strip()


def source_package(folder: Path) -> Path:
    """The sources of this commit, as pip takes them.

    They are packed elsewhere: packing follows links, and on Wine's disk, in `build`, one leads to
    the root of this system.
    """
    with step("source package"), tempfile.TemporaryDirectory() as name:
        archive, sources = Path(name) / "sources.tar", Path(name) / "pointmorph"
        _git("archive", "--format=tar", f"--output={archive}", "HEAD")
        shutil.unpack_archive(archive, sources)
        build = (paths.PYTHON, "-m", "build", "--sdist", "--no-isolation")
        run("release", *build, "--outdir", folder, sources)
    [path] = folder.glob("*.tar.gz")
    return path


def checksums(files: Iterable[Path]) -> str:
    """As `sha256sum --check` reads them."""
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}" for path in files]
    return "\n".join(lines) + "\n"


def collect(version: str, text: str, files: Iterable[Path]) -> list[Path]:
    """Fills `dist` with copies of `files`, the sources, checksums and notes."""
    whole = dist()
    unfinished = whole.with_name("dist.unfinished")
    for folder in (unfinished, whole):
        shutil.rmtree(folder, ignore_errors=True)
    unfinished.mkdir()
    for path in files:
        shutil.copy(path, unfinished)
    source_package(unfinished)
    found = sorted(unfinished.iterdir())
    check_wheels(version, found)
    (unfinished / "SHA256SUMS").write_text(checksums(found))
    (unfinished / "NOTES.md").write_text(text)
    unfinished.rename(whole)
    return sorted(whole.iterdir())
