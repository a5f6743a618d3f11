"""The command ``blender --command pointmorph``: morphs and bakes in a file, without a window. And
the button that writes the line which does what was done last."""

import argparse
import shlex
import subprocess
import sys

import bpy
import pointmorph

from ..core import done_steps
from ..core.settings import scene_options, settings_values
from ..data.feature_list import sync_features
from ..data.registration import Registration
from .polls import Explained

NAME = "pointmorph"
FAILED, WRONG_CALL = 1, 2


def run(words):
    """Runs the command with these words; returns the exit status."""
    try:
        chosen = _parser().parse_args(words)
    except SystemExit as end:  # of argparse, which has said why
        return int(end.code or 0)
    try:
        return _run(chosen)
    except (pointmorph.PointmorphError, RuntimeError) as error:
        sys.stderr.write(f"{NAME}: {str(error).strip()}\n")
        return WRONG_CALL if isinstance(error, pointmorph.OptionError) else FAILED


def _parser():
    parser = argparse.ArgumentParser(
        prog=f"blender --command {NAME}",
        allow_abbrev=False,
        description="Morphs and bakes in a .blend file, as the buttons do.",
    )
    parser.add_argument("file", metavar="FILE.blend", help="the file to work in")
    for side in ("source", "target"):
        parser.add_argument(f"--{side}", metavar="NAME", help=f"object to use as the {side}")
    parser.add_argument(
        "--via", metavar="NAME", action="append", help="object in between; can be repeated"
    )
    parser.add_argument("--active", metavar="NAME", help="object to make active")
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="a setting of the panel, such as path=linear; can be repeated",
    )
    parser.add_argument(
        "--do",
        metavar=("STEP", "NAME=VALUE"),
        nargs="+",
        action="append",
        default=[],
        help=f"what to do, with its options, in order: {', '.join(done_steps.REPEATED)}",
    )
    parser.add_argument(
        "--save", metavar="FILE.blend", help="file to save as (default: the same file)"
    )
    return parser


def _run(chosen):
    bpy.ops.wm.open_mainfile(filepath=chosen.file)
    settings = bpy.context.scene.pointmorph
    for side in ("source", "target"):
        if name := getattr(chosen, side):
            setattr(settings, side, _object(name))
    if chosen.via is not None:
        settings.via.clear()
        for name in chosen.via:
            settings.via.add().object = _object(name)
    for name, value in map(_split, chosen.set):
        if name not in {option.name for option in scene_options()}:
            raise pointmorph.OptionError("set", "a setting of the panel", name, "Correct the name.")
        setattr(settings, name, _value(settings, name, value))
    if chosen.active is not None:
        bpy.context.view_layer.objects.active = _object(chosen.active)
    sync_features(bpy.context.scene)
    for step, *options in chosen.do:
        if step not in done_steps.REPEATED:
            raise pointmorph.OptionError(
                "do", ", ".join(done_steps.REPEATED), step, "Correct the name."
            )
        operator = getattr(bpy.ops.pointmorph, step)
        known = operator.get_rna_type()
        given = {name: _value(known, name, value) for name, value in map(_split, options)}
        operator(**given)
    bpy.ops.wm.save_as_mainfile(filepath=chosen.save or chosen.file)
    return 0


def _object(name):
    obj = bpy.context.scene.objects.get(name)
    if obj is None:
        raise pointmorph.CloudError(name, "an object of the scene", "none", "Correct the name.")
    return obj


def _split(text):
    name, sign, value = text.partition("=")
    if not sign:
        raise pointmorph.OptionError("option", "NAME=VALUE", text, "Correct it.")
    return name, value


def _value(owner, name, text):
    """A word as the type that a property of an operator or of the settings has."""
    properties = owner.properties if hasattr(owner, "properties") else owner.bl_rna.properties
    known = properties.get(name)
    if known is None:
        found = ", ".join(sorted(p.identifier for p in properties if not p.is_readonly))
        raise pointmorph.OptionError("option", f"one of {found}", name, "Correct the name.")
    try:
        if known.type == "BOOLEAN":
            return {"true": True, "false": False}[text.lower()]
        if known.type == "ENUM" and text not in known.enum_items:
            raise ValueError(text)
        return {"INT": int, "FLOAT": float}.get(known.type, str)(text)
    except (KeyError, ValueError):
        expected = known.type.lower()
        if known.type == "ENUM":
            expected = ", ".join(known.enum_items.keys())
        raise pointmorph.OptionError(name, expected, repr(text), "Correct the value.") from None


# --- The line -------------------------------------------------------------------------------------


def words_of(context):
    """The words of the command that does again what was done last."""
    settings = context.scene.pointmorph
    words = ["blender", "--command", NAME, bpy.data.filepath]
    steps = done_steps.steps()
    for side in ("source", "target"):
        if (obj := getattr(settings, side)) is not None:
            words += [f"--{side}", obj.name]
    if any(name == "morph_chain" for name, _ in steps) or len(settings.via):
        for item in settings.via:
            words += ["--via", item.object.name]
    defaults = {option.name: option.default for option in scene_options()}
    for name, value in settings_values(settings).items():
        if value != defaults.get(name, value):
            words += ["--set", f"{name}={value}"]
    for name, options in steps:
        if name == "bake_collection" and (active := context.view_layer.objects.active) is not None:
            words += ["--active", active.name]
        words += ["--do", name, *(f"{key}={value}" for key, value in options.items())]
    return words


class POINTMORPH_OT_copy_command(Explained, bpy.types.Operator):
    """Copy a shell command that repeats, without a window, what was done last: the morph with its
    settings, and any bakes. It works on the saved file"""

    bl_idname = "pointmorph.copy_command"
    bl_label = "Copy as Command"
    bl_options = {"REGISTER"}

    @staticmethod
    def reason(context):
        if not done_steps.steps():
            return "Morph or bake something first"
        return None if bpy.data.filepath else "Save the file first: the command works on it"

    def execute(self, context):
        words = words_of(context)
        line = subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)
        context.window_manager.clipboard = line
        if bpy.data.is_dirty:
            self.report({"WARNING"}, "Save the file before you run the command")
        self.report({"INFO"}, f"Copied: {line}")
        return {"FINISHED"}


registration = Registration(classes=(POINTMORPH_OT_copy_command,), commands=((NAME, run),))
