"""Bakes once, in a process of its own that may be killed; see `stopped_bakes`.

    python baking_process.py MODULE KIND FILE.blend FOLDER

opens the file, whose active object is a morph, says "ready" on a line of its own, bakes, saves the
file where what was baked is in there, and says "done".
"""

import os
import sys

import bpy

STEPS, FRAMES = 6, 12


def bake(kind, folder):
    if kind == "KEYS":
        bpy.ops.pointmorph.bake_shape_keys(steps=STEPS)
    else:
        options = {} if kind == "SCENE" else {"directory": folder}
        bpy.ops.pointmorph.bake_frames(format=kind, frame_start=1, frame_end=FRAMES, **options)
    if kind in ("KEYS", "SCENE"):
        bpy.ops.wm.save_mainfile()


def main():
    module, kind, path, folder = sys.argv[1:]
    bpy.ops.preferences.addon_enable(module=module)
    bpy.ops.wm.open_mainfile(filepath=path)
    print("ready", flush=True)
    bake(kind, folder)
    print("done", flush=True)
    os._exit(0)  # Blender as a Python module doesn't always survive its own end


if __name__ == "__main__":
    main()
