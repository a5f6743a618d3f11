"""Runs the tests in `headless` inside a Blender: the one whose Python this is.

    PYTHONPATH=<folder with bpy> python blender_tests/run.py [PYTEST ARGUMENTS]
    blender --background --factory-startup --python blender_tests/run.py -- [PYTEST ARGUMENTS]

The exit status is pytest's. Environment:

POINTMORPH_ZIP
    The packaged add-on: it's installed as users do it, and the library that it brings is the one
    that is tested. Without it the folder `addon` is tested, and the package `pointmorph` must be
    importable.
POINTMORPH_PYTHONPATH
    Folders, separated as in PYTHONPATH, for a Blender whose Python lacks pytest (or, without a zip,
    pointmorph). The packages of `.venv` are always added.
POINTMORPH_NO_RENDERING
    Why nothing can be rendered: tests marked `renders` are skipped.
POINTMORPH_OUTPUT
    Where pictures go; `build/blender_tests` by default.

The tests with a window are in `window`: `python -m pytest blender_tests/window`, with any Python
that has pytest and numpy, and Xvfb, xdotool, ImageMagick's import and `blender` (or the program
that POINTMORPH_BLENDER names). The variables mean the same there.
"""

import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import installing


def main():
    inside = "--background" in sys.argv or "-b" in sys.argv
    arguments = sys.argv[sys.argv.index("--") + 1 :] if inside else sys.argv[1:]
    sys.path.extend(installing.library_paths())
    import pytest

    # Windows removes no library that is loaded.
    folder = tempfile.TemporaryDirectory(prefix="pointmorph-", ignore_cleanup_errors=True)
    os.environ.update(installing.user_folders(folder.name))
    options = ("-p", "no:cacheprovider", "--rootdir", str(HERE.parent))
    status = pytest.main([*options, str(HERE / "headless"), *arguments])
    folder.cleanup()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender as a Python module doesn't always survive its own end.
    os._exit(int(status))


if __name__ == "__main__":
    main()
