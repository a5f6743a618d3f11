"""The packaged add-on in a Blender that has nothing else: no package of the developers' Python."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import installing
import pytest

pytestmark = pytest.mark.interface

# What Blender itself comes with. Where it is a Python package, that lies beside other packages.
BLENDERS_OWN = (
    *("numpy", "numpy.libs", "cattr", "cattrs", "attr", "attrs", "typing_extensions.py"),
    *("requests", "urllib3", "certifi", "idna", "charset_normalizer", "zstandard"),
)

CODE = """
import importlib.util, os, sys
sys.path.insert(0, sys.argv[1])
for name in ("plyfile", "trimesh", "scipy", "pytest", "pointmorph"):
    assert importlib.util.find_spec(name) is None, name
import bpy
bpy.ops.extensions.package_install_files(
    filepath=os.environ["POINTMORPH_ZIP"], repo="user_default", enable_on_install=True
)
sys.path.append(sys.argv[2])
import scenes
bpy.ops.wm.read_homefile(use_empty=True)
scenes.pair(12, 10)
print(bpy.ops.pointmorph.morph())
print(bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=1))
print(bpy.ops.pointmorph.bake_frames(
    format="PLY", directory=sys.argv[3], frame_start=1, frame_end=3, resample=True
))
sys.stdout.flush()
os._exit(0)  # Blender as a Python module doesn't always survive its own end
"""


def share(source, place):
    """The same files in another place; Windows lets only administrators make links."""
    if sys.platform != "win32":
        place.symlink_to(source)
    elif source.is_dir():
        shutil.copytree(source, place)
    else:
        shutil.copy(source, place)


@pytest.mark.logic
@pytest.mark.skipif("POINTMORPH_ZIP" not in os.environ, reason="about the packaged add-on")
def test_it_says_what_it_is_made_of():
    with zipfile.ZipFile(os.environ["POINTMORPH_ZIP"]) as package:
        names = package.namelist()
        bill = json.loads(package.read("materials.cdx.json"))
    wheels = [Path(name).name.split("-")[0] for name in names if name.endswith(".whl")]
    listed = {one["name"] for one in bill["components"]}
    assert set(wheels) - {"pointmorph"} <= listed
    assert {"LICENSE", "licenses/MPL-2.0.txt", "licenses/nanoflann.txt"} <= set(names)


@pytest.mark.skipif("POINTMORPH_ZIP" not in os.environ, reason="about the packaged add-on")
@pytest.mark.skipif(bool(bpy.app.binary_path), reason="about Blender as a Python module")
def test_everything_that_it_imports_is_inside(tmp_path):
    only = tmp_path / "packages"
    only.mkdir()
    # In sys.path stands what it has taken out of itself by now.
    share(Path(bpy.__file__).parents[4], only / "bpy")
    for name in BLENDERS_OWN:
        for folder in map(Path, filter(None, sys.path)):
            if "scripts" in folder.parts:  # Blender's own, which it finds itself
                continue
            if (folder / name).exists() and not (only / name).exists():
                share(folder / name, only / name)
    user = installing.user_folders(tmp_path / "user")
    frames = tmp_path / "frames"
    arguments = [str(only), str(Path(__file__).parent), str(frames)]
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", CODE, *arguments],
        env=os.environ | user,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("{'FINISHED'}") == 3, done.stdout + done.stderr
    assert len(list(frames.glob("*.ply"))) == 3
