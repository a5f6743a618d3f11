"""The add-on as zip files."""

from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path

from . import paths
from .python_environment import BPY_VERSIONS
from .running import SetupError, digest, is_fresh, run, step
from .wheels import set_up_wheel


def edit(path: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, lambda _: replacement, path.read_text(), flags=re.MULTILINE)
    if count != 1:
        raise SetupError(f"{path.name} must have one line like {pattern}; it has {count}.")
    path.write_text(text)


def package() -> tuple[Path, Path]:
    """The extension for Blender 4.2 and later, and the legacy add-on for Debian's Blender."""
    wheel = set_up_wheel()
    version = wheel.name.split("-")[1]
    folder = paths.BUILD / "package"
    extension = folder / f"pointmorph-{version}.zip"
    legacy = folder / f"pointmorph-{version}-legacy.zip"
    parts = [paths.ROOT / part for part in ("addon", "docs", "LICENSE")]
    key = digest(*parts, Path(__file__), wheel)
    stamp = folder / "stamp"
    if is_fresh(stamp, key):
        return extension, legacy
    with step("extension and legacy add-on"):
        shutil.rmtree(folder, ignore_errors=True)
        stage = folder / "stage" / "pointmorph_addon"
        skip = shutil.ignore_patterns("__pycache__")
        shutil.copytree(paths.ROOT / "addon", stage, ignore=skip)
        shutil.copy(paths.ROOT / "LICENSE", stage)
        run("package", paths.PYTHON, paths.ROOT / "docs" / "make_html.py", stage / "docs")
        manifest = stage / "blender_manifest.toml"
        edit(manifest, r'^version = ".*"$', f'version = "{version}"')
        edit(manifest, r"^wheels = \[[^]]*\]$", f'wheels = ["./wheels/{wheel.name}"]')
        (stage / "wheels").mkdir()
        shutil.copy(wheel, stage / "wheels")
        scripts = paths.SITE_PACKAGES / "bpy" / BPY_VERSIONS[0] / "scripts"
        blender_ext = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
        output = ("--output-filepath", extension)
        run("package", paths.PYTHON, blender_ext, "build", "--source-dir", stage, *output)
        run("package", paths.PYTHON, blender_ext, "validate", extension)

        # A legacy add-on can't bring a wheel: what is in it stands in the add-on's folder.
        manifest.unlink()
        shutil.rmtree(stage / "wheels")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(stage / "lib")
        shutil.make_archive(str(legacy.with_suffix("")), "zip", stage.parent, stage.name)
        shutil.rmtree(stage.parent)
        stamp.write_text(key)
    return extension, legacy
