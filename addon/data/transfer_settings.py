"""The settings of a transfer from the target, which the panel remembers and the operator takes."""

import bpy

TRANSFER_TO = [
    ("RESULT", "Result", "The mesh that morphs, or the points"),
    ("SOURCE", "Source", "The source itself, which otherwise stays unchanged"),
]


def transfer_settings():
    """New properties by the operator's names for them; the scene has them after "transfer_"."""
    return {
        "colors": bpy.props.BoolProperty(
            name="Colors",
            description="Color attributes. A morphing mesh blends to them as it morphs",
            default=True,
        ),
        "weights": bpy.props.BoolProperty(
            name="Weights", description="Vertex groups, except features", default=True
        ),
        "uvs": bpy.props.BoolProperty(
            name="UV Maps",
            description="UV maps. A face across a seam belongs to the side of its center. The "
            "points of a morph get them as point attributes",
            default=False,
        ),
        "keys": bpy.props.BoolProperty(
            name="Shape Keys",
            description="Shape keys, rotated and scaled as the surface is by the map. On a "
            "morphing mesh, they fit the source at the start and the target at the "
            "end",
            default=True,
        ),
        "hair": bpy.props.BoolProperty(
            name="Hair",
            description="Hair curves that are attached to the target's surface. On a morphing mesh "
            "they follow it",
            default=True,
        ),
        "back": bpy.props.BoolProperty(
            name="Weights to Target",
            description="Also give the target the source's vertex groups, except features. "
            "Recompute doesn't repeat this",
            default=False,
        ),
        "onto": bpy.props.EnumProperty(
            name="To", description="What to transfer to", items=TRANSFER_TO, default="RESULT"
        ),
        "prefix": bpy.props.StringProperty(
            name="Prefix",
            description="Added before the names of transferred attributes. With Weights to "
            'Target, "target" in it becomes "source" there. Leave empty to keep '
            "the names that a rig expects",
            default="target.",
        ),
    }
