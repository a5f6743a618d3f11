"""The add-on as a zip file."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from . import paths
from .python_environment import MAIN_BLENDER
from .running import SetupError, digest, is_fresh, run, step
from .system import project
from .wheels import set_up_wheels


def edit(path: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, lambda _: replacement, path.read_text(), flags=re.MULTILINE)
    if count != 1:
        raise SetupError(f"{path.name} must have one line like {pattern}; it has {count}.")
    path.write_text(text)


def others_wheels() -> list[Path]:
    """Wheels of other packages that the library needs in Blender; they run on any system."""
    wanted = project()["dependency-groups"]["extension"]
    folder = paths.BUILD / "wheels" / "others"
    stamp, key = folder / "stamp", digest(*wanted)
    if not is_fresh(stamp, key):
        with step("wheels of other packages"):
            shutil.rmtree(folder, ignore_errors=True)
            options = ("--no-deps", "--only-binary=:all:", "--dest", folder)
            run("package", paths.PYTHON, "-m", "pip", "download", "--no-input", *options, *wanted)
            stamp.write_text(key)
    return sorted(folder.glob("*-none-any.whl"))


def package() -> Path:
    """The extension, with a wheel for every Python that a supported Blender has."""
    wheels = set_up_wheels()
    version = wheels[0].name.split("-")[1]
    wheels += others_wheels()
    folder = paths.BUILD / "package"
    extension = folder / f"pointmorph-{version}.zip"
    parts = [paths.ROOT / part for part in ("addon", "docs", "LICENSE")]
    key = digest(*parts, Path(__file__), *wheels)
    stamp = folder / "stamp"
    if is_fresh(stamp, key):
        return extension
    with step("extension"):
        shutil.rmtree(folder, ignore_errors=True)
        stage = folder / "stage"
        shutil.copytree(paths.ROOT / "addon", stage, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(paths.ROOT / "LICENSE", stage)
        run("package", paths.PYTHON, paths.ROOT / "docs" / "make_html.py", stage / "docs")
        manifest = stage / "blender_manifest.toml"
        edit(manifest, r'^version = ".*"$', f'version = "{version}"')
        names = "\n".join(f'  "./wheels/{wheel.name}",' for wheel in wheels)
        edit(manifest, r"^wheels = \[[^]]*\]$", f"wheels = [\n{names}\n]")
        (stage / "wheels").mkdir()
        for wheel in wheels:
            shutil.copy(wheel, stage / "wheels")
        scripts = paths.SITE_PACKAGES / "bpy" / MAIN_BLENDER / "scripts"
        blender_ext = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
        output = ("--output-filepath", extension)
        run("package", paths.PYTHON, blender_ext, "build", "--source-dir", stage, *output)
        run("package", paths.PYTHON, blender_ext, "validate", extension)
        shutil.rmtree(stage)
        stamp.write_text(key)
    return extension
