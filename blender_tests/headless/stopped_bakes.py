"""Bakes that are killed at random moments, and what they leave."""

import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import scenes
from baking_process import FRAMES

KINDS = ("KEYS", "SCENE", "PLY", "ALEMBIC", "USD")
WAYS = (signal.SIGKILL, signal.SIGTERM)
_PROCESS = Path(__file__).with_name("baking_process.py")


class Bakes:
    """One kind of bake of one file: undisturbed at first, then stopped again and again."""

    def __init__(self, module, kind, folder, side=20):
        self.module, self.kind, self.folder = module, kind, Path(folder)
        self.out = self.folder / "out"
        self.blend = self.out / "morph.blend"
        self.finds, self.stopped, self.too_late = [], 0, 0
        bpy.ops.wm.read_homefile(use_empty=True)
        scenes.pair(side, side - 2)
        obj = scenes.morph()
        scenes.select(obj)
        self.kept = self.folder / "kept.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(self.kept))
        self.start_anew()
        process = self._start()
        began = time.monotonic()
        assert self._ended(process) == "done"
        self.seconds = time.monotonic() - began
        self.whole = self.result()

    def start_anew(self):
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir()
        shutil.copyfile(self.kept, self.blend)

    def _start(self):
        """A process that is about to bake."""
        words = [self.module, self.kind, str(self.blend), str(self.out)]
        process = subprocess.Popen(
            [sys.executable, str(_PROCESS), *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        said = []
        for line in process.stdout:
            said.append(line)
            if line.strip() == "ready":
                return process
        raise AssertionError(f"it ended before it baked: {''.join(said)[-2000:]}")

    def _ended(self, process):
        """What it said last."""
        said = process.communicate(timeout=600)[0]
        return (said.split() or [""])[-1]

    def stop(self, way, chance):
        """Has it bake, and stops that at a random moment; then nothing may be broken."""
        if self.kind == "KEYS" and self._keys():
            self.start_anew()  # another bake would add others
        process = self._start()
        time.sleep(chance.uniform(0.0, 0.95 * self.seconds))
        process.send_signal(way)
        if self._ended(process) == "done":
            self.too_late += 1
        else:
            self.stopped += 1
        self.look(f"{self.kind} {way.name} {self.stopped + self.too_late}")

    def look(self, what):
        """That what has its own name is whole."""
        files = self.result()
        for name, content in files.items():
            if self._is_left(name):
                continue
            if name == "keys":
                if content not in ({}, self.whole["keys"]):
                    self.finds.append(f"{what}: some keys are saved, {sorted(content)}")
            elif self._like(name) not in (self._like(n) for n in self.whole):
                self.finds.append(f"{what}: {name} is new")
            elif content not in self.whole.values():
                self.finds.append(f"{what}: {name} is broken")

    def finish(self, what):
        """That the next bake cleans up, and leaves what an undisturbed one does."""
        is_done = self.kind == "KEYS" and bool(self._keys())
        if not is_done and (said := self._ended(self._start())) != "done":
            self.finds.append(f"{what}: baked again, it said {said}")
        found = self.result()
        if sorted(map(str, found.values())) != sorted(map(str, self.whole.values())):
            names = sorted({*found} ^ {*self.whole})
            names += [n for n in found if n in self.whole and found[n] != self.whole[n]]
            self.finds.append(f"{what}: baked again, it left others: {names}")
        self.start_anew()

    @staticmethod
    def _is_left(name):
        """Whether a file's name says that it isn't whole, or that frames wait there."""
        parts = Path(name).parts
        return (
            any(p.endswith(".frames") for p in parts[:-1])
            or ".part" in parts[-1]
            or "pointmorph-part" in parts[-1]
            or parts[-1].endswith(".blend@")
        )

    @staticmethod
    def _like(name):
        """A cache of another bake has a number."""
        return re.sub(r"(_\d+)?\.pc2$", ".pc2", name)

    def result(self):
        """What was baked: the bytes of all files; of the .blend file its shape keys, and of what
        Blender exports as Alembic, each time in another order, the places by frame."""
        found = {"keys": self._keys()} if self.kind == "KEYS" else {}
        for path in sorted(self.out.rglob("*")):
            name = str(path.relative_to(self.out))
            # What Blender saves holds addresses: no two are the same.
            if path.is_file() and not name.startswith("morph.blend"):
                is_whole = path.suffix == ".abc" and not self._is_left(name)
                found[name] = self._imported(path) if is_whole else path.read_bytes()
        return found

    @staticmethod
    def _imported(path):
        """By frame, where an Alembic file has its points."""
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
        [obj] = bpy.context.scene.objects
        found = {}
        for frame in (1, FRAMES // 2, FRAMES):
            bpy.context.scene.frame_set(frame)
            shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
            found[frame] = scenes.coordinates(shown.data.vertices).tobytes()
        return found

    def _keys(self):
        """Shape keys that are saved on the source; reading them fails for a broken file."""
        bpy.ops.wm.open_mainfile(filepath=str(self.blend))
        keys = bpy.data.objects["Hill"].data.shape_keys
        found = {}
        for key in keys.key_blocks if keys is not None else ():
            places = np.empty(3 * len(key.data), np.float32)
            key.data.foreach_get("co", places)
            found[key.name] = places.tobytes()
        return found
