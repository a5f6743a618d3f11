"""Installs the add-on in a Blender, as users do it, with folders of its own for user files.

POINTMORPH_ZIP is the packaged add-on; without it, the folder `addon` is taken as it is.
"""

import os
import sys
from importlib.machinery import PathFinder
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def user_folders(folder):
    """Environment that keeps the user's own Blender files and settings out of it."""
    names = {"RESOURCES": "", "CONFIG": "config", "SCRIPTS": "scripts", "EXTENSIONS": "extensions"}
    paths = {f"BLENDER_USER_{name}": Path(folder, sub) for name, sub in names.items()}
    for path in paths.values():
        path.mkdir(parents=True, exist_ok=True)
    return {name: str(path) for name, path in paths.items()}


def library_paths():
    """Folders that POINTMORPH_PYTHONPATH names, and the packages of `.venv`."""
    paths = os.environ.get("POINTMORPH_PYTHONPATH", "").split(os.pathsep)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    return [*filter(None, paths), str(ROOT / ".venv" / "lib" / version / "site-packages")]


class _PackagedLibrary:
    """Finds what the packaged add-on has to bring where it puts it, and nowhere else."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name not in ("pointmorph", "plyfile"):
            return None
        user = os.environ["BLENDER_USER_RESOURCES"]
        spec = PathFinder.find_spec(name, [p for p in sys.path if p.startswith(user)])
        if spec is None:
            raise ModuleNotFoundError(f"the packaged add-on brings no {name}", name=name)
        return spec


def install():
    """Installs and enables the add-on; returns the name of its module."""
    import bpy

    packaged = os.environ.get("POINTMORPH_ZIP")
    if not packaged:
        addons = Path(bpy.utils.user_resource("SCRIPTS", path="addons", create=True))
        module = "pointmorph_addon"
        (addons / module).symlink_to(ROOT / "addon")
        bpy.utils.refresh_script_paths()
        bpy.ops.preferences.addon_enable(module=module)
    else:
        sys.meta_path.insert(0, _PackagedLibrary)
        module = "bl_ext.user_default.pointmorph"
        bpy.ops.extensions.package_install_files(
            filepath=packaged, repo="user_default", enable_on_install=True
        )
    if module not in bpy.context.preferences.addons:
        raise RuntimeError(f"the add-on {module} could not be enabled")
    return module
