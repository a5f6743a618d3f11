"""The settings of a bake of frames, which the panel remembers and the operator takes."""

import bpy

from ..core.frame_plan import EASINGS
from . import frame_formats, versions


def frame_settings():
    """New properties by the operator's names for them; the scene has them after "frames_"."""
    formats = frame_formats.FORMATS.values()
    return {
        "format": bpy.props.EnumProperty(
            name="Format",
            description="Where to put the frames",
            items=[(one.identifier, one.label, one.tip) for one in formats],
            default="SCENE",
        ),
        "directory": bpy.props.StringProperty(
            name="Folder",
            description="Folder for the files. // is the folder of the blend file",
            subtype="DIR_PATH",
            options=versions.RELATIVE_PATH,
            default="//frames",
        ),
        "easing": bpy.props.EnumProperty(
            name="Easing",
            description="How the morph progresses over the frames",
            items=[(name, one.label, one.tip) for name, one in EASINGS.items()],
            default="LINEAR",
        ),
        "resample": bpy.props.BoolProperty(
            name="Fill Cracks",
            description="Add points where the surface would show cracks",
            default=True,
        ),
        "faces": bpy.props.BoolProperty(
            name="Faces",
            description="Bake a mesh for every frame instead of points: the surface through "
            "its points. PLY keeps the points as well. In the scene, Geometry "
            "Nodes make it if Blender's Python lacks pymeshlab and scipy; files "
            "need both",
            default=False,
        ),
    }


def copy_frame_settings(settings, operator):
    """Gives the operator what the panel remembers."""
    for name in frame_settings():
        setattr(operator, name, getattr(settings, f"frames_{name}"))
