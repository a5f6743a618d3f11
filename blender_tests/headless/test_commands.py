"""``blender --command pointmorph``, and the line that the panel copies."""

import re
import shlex
from pathlib import Path

import bpy
import numpy as np
import pytest
from scenes import add_mesh, key, mark, morph, pair, patch, select


@pytest.fixture
def commands(addon):
    return addon("operators.commands")


def keys(name):
    return bpy.data.objects[name].data.shape_keys.key_blocks.keys()


def saved(tmp_path):
    path = tmp_path / "a scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_the_copied_line_repeats_what_was_done(settings, commands, tmp_path):
    pair()
    path = saved(tmp_path)
    settings.path = "rigid"
    settings.refinement_resolution = 0.75
    morph()
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=7)
    bpy.ops.pointmorph.bake_shape_keys(kind="SOURCE", steps=2, path="LINEAR")
    bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3, format="PLY", directory="//made")
    assert bpy.ops.pointmorph.copy_command() == {"FINISHED"}
    words = commands.words_of(bpy.context)
    expected = key(bpy.data.objects["Hill"], "Dune")
    frames = {p.name: p.read_bytes() for p in (tmp_path / "made").glob("*.ply")}
    assert len(frames) == 3
    for name in frames:
        (tmp_path / "made" / name).unlink()
    # Its words are those of a shell's line.
    assert shlex.split(shlex.join(words)) == words
    assert words[:4] == ["blender", "--command", "pointmorph", str(path)]
    assert words.count("bake_shape_keys") == 1

    bpy.ops.wm.read_homefile(use_empty=True)
    with pytest.raises(RuntimeError, match="Morph or bake something first"):
        bpy.ops.pointmorph.copy_command()
    assert commands.run(words[3:]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert keys("Hill") == ["Basis", "Dune 50 %", "Dune"]
    assert np.array_equal(key(bpy.data.objects["Hill"], "Dune"), expected)
    assert {p.name: p.read_bytes() for p in (tmp_path / "made").glob("*.ply")} == frames


def test_a_collection_is_baked_into_another_file(settings, commands, tmp_path):
    settings.domain = "disk"
    heads = bpy.data.collections.new("Heads")
    bpy.context.scene.collection.children.link(heads)
    for name in ("Base", "Other"):
        obj = add_mesh(name, *patch(8))
        mark(obj, "peak", 0, 0)
        mark(obj, "slope", 0.5, 0.3)
    heads.objects.link(bpy.data.objects["Other"])
    path = saved(tmp_path)
    select(bpy.data.objects["Base"])
    bpy.ops.pointmorph.bake_collection(collection="Heads", in_place=False)
    words = commands.words_of(bpy.context)
    assert words[-4:] == ["--do", "bake_collection", "collection=Heads", "in_place=False"]
    before = path.read_bytes()
    assert commands.run([*words[3:], "--save", str(tmp_path / "made.blend")]) == 0
    assert path.read_bytes() == before
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "made.blend"))
    assert keys("Base") == ["Basis", "Other"]


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--source", "Nobody"], 1, "Nobody: expected an object"),
        (["--set", "path"], 2, "NAME=VALUE"),
        (["--set", "path=sideways"], 2, "linear"),
        (["--set", "source=Hill"], 2, "a setting of the panel"),
        (["--do", "delete"], 2, "morph_chain"),
        (["--do", "morph", "speed=3"], 2, "new_result"),
        (["--do", "morph", "new_result=2"], 2, "boolean"),
        (["--do", "bake_shape_keys"], 1, "Morph first"),
        (["--frames", "3"], 2, "unrecognized arguments"),
    ],
)
def test_wrong_calls_change_nothing(settings, commands, tmp_path, capsys, words, status, said):
    pair()
    path = saved(tmp_path)
    before = path.read_bytes()
    assert commands.run([str(path), *words]) == status
    assert said in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_file_that_is_not_there(commands, tmp_path, capsys):
    assert commands.run([str(tmp_path / "none.blend")]) == 1
    assert "none.blend" in capsys.readouterr().err


# --- What the documentation says ------------------------------------------------------------------

DOCS = Path(__file__).resolve().parents[2]
EXPRESSION = re.compile(r'```\n(blender -b .*?"\n.*?")\n```', re.DOTALL)
COMMAND = re.compile(r"^blender --command pointmorph scene.*$", re.MULTILINE)


def in_a_folder(monkeypatch, tmp_path, names):
    """Two sheets of these names, in `scene.blend` of the folder where a shell would be."""
    for obj, name in zip(pair(), names, strict=True):
        obj.name = name
    bpy.context.scene.pointmorph.source = bpy.context.scene.pointmorph.target = None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PWD", str(tmp_path))  # as a shell does; Blender 4.2 asks for it


@pytest.mark.parametrize(
    ("page", "names"),
    [("README.md", ("Venus", "Mannequin")), ("docs/manual/headless.md", ("Hound", "Giraffe"))],
)
def test_the_expression_of_a_page(settings, monkeypatch, tmp_path, page, names):
    [text] = EXPRESSION.findall((DOCS / page).read_text(encoding="utf-8"))
    _, background, file, option, script = shlex.split(text)
    assert (background, option) == ("-b", "--python-expr")
    in_a_folder(monkeypatch, tmp_path, names)
    bpy.ops.wm.read_homefile(use_empty=True)
    # As Blender does with these words.
    bpy.ops.wm.open_mainfile(filepath=file)
    exec(compile(script, page, "exec"), {"__name__": "__main__"})
    bpy.ops.wm.open_mainfile(filepath=file)
    if page == "README.md":
        assert keys(names[0]) == ["Basis", names[1]]
    else:
        assert bpy.data.objects[" to ".join(names)].pointmorph.report
        assert len(list((tmp_path / "frames").glob("frame_*.ply"))) == 48


def test_the_command_of_the_manual(settings, commands, monkeypatch, tmp_path):
    [line] = COMMAND.findall((DOCS / "docs" / "manual" / "headless.md").read_text(encoding="utf-8"))
    in_a_folder(monkeypatch, tmp_path, ("Hound", "Giraffe"))
    assert commands.run(shlex.split(line)[3:]) == 0
    bpy.ops.wm.open_mainfile(filepath="scene.blend")
    assert bpy.context.scene.pointmorph.path == "rigid"
    assert bpy.data.objects["Hound to Giraffe"].pointmorph.report
    assert len(list((tmp_path / "frames").glob("frame_*.ply"))) > 1
