"""The lines of the docs that need no window: a shell runs them, in a real Blender."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2]
RECIPE = re.compile(r'```\n(blender -b .*?"\n.*?")\n```', re.DOTALL)
COMMAND = re.compile(r"^blender --command pointmorph scene.*$", re.MULTILINE)
# Two sheets whose names the first words of the command line give.
SCENE = """
import os, sys
sys.path.insert(0, os.environ["POINTMORPH_SCENES"])
import bpy, scenes
for obj, name in zip(scenes.pair(), sys.argv[-2:], strict=True):
    obj.name = name
bpy.context.scene.pointmorph.source = bpy.context.scene.pointmorph.target = None
bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath("scene.blend"))
"""
LOOK = """
import bpy, json
found = {obj.name: [key.name for key in obj.data.shape_keys.key_blocks] if obj.data.shape_keys
         else [] for obj in bpy.data.objects if obj.type == "MESH"}
open("found.json", "w").write(json.dumps(found))
"""
# The words are taken from where the button takes them: without a window, there is no clipboard.
DONE = """
import bpy, shlex, sys
s = bpy.context.scene.pointmorph
s.source, s.target = bpy.data.objects["Hound"], bpy.data.objects["Giraffe"]
s.path = "rigid"
bpy.ops.pointmorph.morph()
bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=2)
bpy.ops.pointmorph.bake_frames(format="PLY", directory="//frames", frame_start=1, frame_end=3)
commands = next(m for n, m in sys.modules.items() if n.endswith(".operators.commands"))
open("line.txt", "w").write(shlex.join(commands.words_of(bpy.context)))
"""


@pytest.fixture
def shell(environment, tmp_path):
    """Runs a line where `scene.blend` is; what came of it."""
    programs = tmp_path / "bin"
    programs.mkdir()
    program = shutil.which(os.environ.get("POINTMORPH_BLENDER", "blender"))
    (programs / "blender").write_text(f'#!/bin/sh\nexec "{program}" "$@"\n')
    (programs / "blender").chmod(0o755)
    known = {**environment, "PATH": f"{programs}:{environment['PATH']}"}

    def run(line):
        return subprocess.run(
            ["sh", "-c", line], cwd=tmp_path, env=known, capture_output=True, text=True
        )

    return run


def made(shell, names):
    """`scene.blend` with two sheets of these names."""
    done = shell(f"blender -b --python-exit-code 1 --python-expr '{SCENE}' -- {' '.join(names)}")
    assert done.returncode == 0, done.stdout + done.stderr


def found(shell, tmp_path):
    """The meshes that the file has now, with their shape keys."""
    done = shell(f"blender -b scene.blend --factory-startup --python-expr '{LOOK}'")
    assert (tmp_path / "found.json").exists(), done.stdout + done.stderr
    return json.loads((tmp_path / "found.json").read_text())


def test_the_expression_of_the_readme(shell, tmp_path):
    [line] = RECIPE.findall((DOCS / "README.md").read_text(encoding="utf-8"))
    made(shell, ("Venus", "Mannequin"))
    done = shell(line)
    assert done.returncode == 0, done.stdout + done.stderr
    assert found(shell, tmp_path)["Venus"] == ["Basis", "Mannequin"]


def test_the_expression_and_the_command_of_the_manual_make_the_same_frames(shell, tmp_path):
    text = (DOCS / "docs" / "manual" / "headless.md").read_text(encoding="utf-8")
    [recipe], [command] = RECIPE.findall(text), COMMAND.findall(text)
    made(shell, ("Hound", "Giraffe"))
    shutil.copy(tmp_path / "scene.blend", tmp_path / "before.blend")
    done = shell(recipe)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Hound to Giraffe" in found(shell, tmp_path)
    (tmp_path / "frames").rename(tmp_path / "by_expression")
    assert len(list((tmp_path / "by_expression").glob("frame_*.ply"))) == 48

    shutil.copy(tmp_path / "before.blend", tmp_path / "scene.blend")
    failed = shell(command.replace("Hound", "Nobody"))
    assert failed.returncode == 1
    assert "Nobody: expected an object" in failed.stderr
    assert (tmp_path / "scene.blend").read_bytes() == (tmp_path / "before.blend").read_bytes()
    done = shell(command)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Hound to Giraffe" in found(shell, tmp_path)
    for path in (tmp_path / "by_expression").glob("frame_*.ply"):
        assert (tmp_path / "frames" / path.name).read_bytes() == path.read_bytes()


def test_the_line_that_the_button_copies_repeats_what_was_done(shell, tmp_path):
    made(shell, ("Hound", "Giraffe"))
    done = shell(f"blender -b scene.blend --python-exit-code 1 --python-expr '{DONE}'")
    assert done.returncode == 0, done.stdout + done.stderr
    line = (tmp_path / "line.txt").read_text()
    (tmp_path / "frames").rename(tmp_path / "first")
    again = shell(line)
    assert again.returncode == 0, again.stdout + again.stderr
    first = sorted((tmp_path / "first").glob("frame_*.ply"))
    assert len(first) == 3
    for path in first:
        assert (tmp_path / "frames" / path.name).read_bytes() == path.read_bytes()
    assert found(shell, tmp_path)["Hound"] == ["Basis", "Giraffe 50 %", "Giraffe"]
