"""The add-on as a zip file."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from . import materials, paths
from .python_environment import MAIN_BLENDER, pins
from .running import SetupError, digest, is_fresh, run, step
from .targets import LINUX, Platform
from .wheels import set_up_wheels


def edit(path: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, lambda _: replacement, path.read_text(), flags=re.MULTILINE)
    if count != 1:
        raise SetupError(f"{path.name} must have one line like {pattern}; it has {count}.")
    path.write_text(text)


def others_wheels() -> list[Path]:
    """Wheels of other packages that the library needs in Blender; they run on any system."""
    pin = pins()["plyfile"]
    folder = paths.BUILD / "wheels" / "others"
    stamp, key = folder / "stamp", str(pin)
    if not is_fresh(stamp, key):
        with step("wheels of other packages"):
            shutil.rmtree(folder, ignore_errors=True)
            pip = (paths.PYTHON, "-m", "pip", "download", "--no-input", "--dest", folder)
            run("package", *pip, *pin.options())
            stamp.write_text(key)
    return sorted(folder.glob("*-none-any.whl"))


def _folder(platforms: Sequence[Platform]) -> Path:
    """`build/package`; for others than this system, their names stand behind it."""
    names = [platform.name for platform in platforms]
    return paths.BUILD / "-".join(["package", *(names if names != [LINUX.name] else [])])


def package(platforms: Sequence[Platform] = (LINUX,)) -> Path:
    """The extension, with a wheel for every Python that a supported Blender has on `platforms`.

    Where there are several, a zip for each lies beside the one for all.
    """
    wheels = [wheel for platform in platforms for wheel in set_up_wheels(platform)]
    version = wheels[0].name.split("-")[1]
    wheels += others_wheels()
    folder = _folder(platforms)
    extension = folder / f"pointmorph-{version}.zip"
    parts = [paths.ROOT / part for part in ("addon", "docs", "LICENSE", "native/licenses")]
    key = digest(*parts, Path(__file__), Path(materials.__file__), *wheels)
    stamp = folder / "stamp"
    if is_fresh(stamp, key):
        return extension
    with step("extension"):
        shutil.rmtree(folder, ignore_errors=True)
        stage = folder / "stage"
        shutil.copytree(paths.ROOT / "addon", stage, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(paths.ROOT / "LICENSE", stage)
        materials.put(stage, version, platforms)
        run("package", paths.PYTHON, paths.ROOT / "docs" / "make_html.py", stage / "docs")
        manifest = stage / "blender_manifest.toml"
        edit(manifest, r'^version = ".*"$', f'version = "{version}"')
        names = "\n".join(f'  "./wheels/{wheel.name}",' for wheel in wheels)
        edit(manifest, r"^wheels = \[[^]]*\]$", f"wheels = [\n{names}\n]")
        systems = ", ".join(f'"{platform.blender}"' for platform in platforms)
        edit(manifest, r"^platforms = \[.*\]$", f"platforms = [{systems}]")
        (stage / "wheels").mkdir()
        for wheel in wheels:
            shutil.copy(wheel, stage / "wheels")
        scripts = paths.SITE_PACKAGES / "bpy" / MAIN_BLENDER / "scripts"
        blender_ext = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
        build = (paths.PYTHON, blender_ext, "build", "--source-dir", stage)
        run("package", *build, "--output-filepath", extension)
        if len(platforms) > 1:
            run("package", *build, "--split-platforms", "--output-dir", folder)
        for zipped in folder.glob("*.zip"):
            run("package", paths.PYTHON, blender_ext, "validate", zipped)
        shutil.rmtree(stage)
        stamp.write_text(key)
    return extension
