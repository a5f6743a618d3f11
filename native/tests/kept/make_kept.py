"""Makes the files that later versions must open: a saved morph, a batch and a .blend file.

    POINTMORPH_ZIP=<the add-on's zip> PYTHONPATH=<folder with bpy 4.2> python make_kept.py

writes a folder named after the version, beside this file. What a version has written stays as it is
after its release.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(ROOT / "native" / "tests" / "python"), str(ROOT / "blender_tests")]
sys.path.append(str(ROOT / "blender_tests" / "headless"))

import installing  # noqa: E402

SIDES, HEIGHTS, TIME = (5, 6), (0.1, 0.6), 0.4
MARKS = {"middle": (12, 14), "corner": (0, 0)}
"""Rows of both sheets."""


def make_morph(folder: Path) -> None:
    """A morph of two sheets with faces, and its frame at a time."""
    import numpy as np
    import pointmorph
    from shapes import grid, grid_faces

    shapes = [
        pointmorph.Cloud(grid(side, height), faces=grid_faces(side))
        for side, height in zip(SIDES, HEIGHTS, strict=True)
    ]
    morph = pointmorph.morph(*shapes, MARKS)
    morph.save(folder / "sheets.morph", resample=True)
    np.save(folder / "frame.npy", morph.frame(TIME).positions)
    np.save(folder / "wrapped.npy", morph.wrapped(TIME))


def make_batch(folder: Path) -> None:
    """The folder of a batch of one pair that is done."""
    import numpy as np
    from pointmorph import formats
    from pointmorph.commands.cli import main
    from shapes import grid, grid_faces

    folder.mkdir()
    for name, side, height in zip(("low", "high"), SIDES, HEIGHTS, strict=True):
        up, white = np.tile(np.float32([0, 0, 1]), (side**2, 1)), np.ones((side**2, 4))
        formats.write_mesh(folder / f"{name}.obj", grid(side, height), up, white, grid_faces(side))
    jobs = {"pairs": [{"source": "low.obj", "target": "high.obj"}], "out": "made"}
    (folder / "jobs.json").write_text(json.dumps(jobs, indent=1) + "\n")
    assert main(["batch", str(folder / "jobs.json")]) == 0
    for name in ("index.html", "pictures/low_to_high.png", "low_to_high/log.txt"):
        (folder / "made" / name).unlink()  # for people, not for later versions


def make_blend(path: Path) -> None:
    """A morph object with a slider at TIME, and shape keys baked on its source."""
    import bpy
    import scenes

    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.data.batch_remove(bpy.data.brushes)  # Blender's own
    bpy.context.scene.pointmorph.show_as = "POINTS"
    source, _ = scenes.pair(9, 8)
    obj = scenes.morph()
    scenes.slider(obj).value = TIME
    scenes.select(obj)
    bpy.ops.pointmorph.bake_shape_keys(steps=2)
    assert len(source.data.shape_keys.key_blocks) == 3
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)


def main() -> None:
    with tempfile.TemporaryDirectory() as user:
        os.environ.update(installing.user_folders(user))
        installing.install()
        import pointmorph

        made, folder = Path(user) / "kept", HERE / pointmorph.__version__
        made.mkdir()  # elsewhere: what is written holds its place
        make_morph(made)
        make_batch(made / "batch")
        make_blend(made / "morph.blend")
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(made, folder)
    print(folder, sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()))


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender as a Python module doesn't always survive its own end
