"""Which shapes a morph goes through between source and target."""

import bpy

from ..data import arrays
from ..data.registration import Registration
from ..scene import morph_object
from .polls import Explained


class POINTMORPH_OT_add_to_chain(Explained, bpy.types.Operator):
    """Add the selected objects, in the order of their names, as shapes between source and target.
    If neither is chosen yet, the first becomes the source and the last the target"""

    bl_idname = "pointmorph.add_to_chain"
    bl_label = "Add Selected"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        if _selected_shapes(context):
            return None
        return "Select objects with faces or points other than the source and target"

    def execute(self, context):
        settings = context.scene.pointmorph
        shapes = sorted(_selected_shapes(context), key=lambda obj: obj.name)
        if settings.source is None and settings.target is None and len(shapes) > 1:
            settings.source, settings.target = shapes[0], shapes[-1]
            shapes = shapes[1:-1]
        for obj in shapes:
            settings.via.add().object = obj
        settings.active_via = len(settings.via) - 1
        return {"FINISHED"}


def _selected_shapes(context):
    settings = context.scene.pointmorph
    picked = {settings.source, settings.target}
    return [
        obj
        for obj in context.view_layer.objects.selected
        if obj.type in arrays.MORPHED_TYPES and obj not in picked and not morph_object.is_made(obj)
    ]


class POINTMORPH_OT_change_chain(Explained, bpy.types.Operator):
    """Move the selected shape within the chain, or remove it from the chain"""

    bl_idname = "pointmorph.change_chain"
    bl_label = "Change Chain"
    bl_options = {"REGISTER", "UNDO"}

    change: bpy.props.EnumProperty(
        name="Change",
        description="What to do with the shape",
        items=[
            ("UP", "Up", "Move it toward the source"),
            ("DOWN", "Down", "Move it toward the target"),
            ("REMOVE", "Remove", "Remove it from the chain. The object stays"),
        ],
        default="REMOVE",
    )

    @staticmethod
    def reason(context):
        if len(context.scene.pointmorph.via):
            return None
        return "There are no shapes between the source and target"

    def execute(self, context):
        settings = context.scene.pointmorph
        last = len(settings.via) - 1
        index = min(max(settings.active_via, 0), last)
        if self.change == "REMOVE":
            settings.via.remove(index)
            settings.active_via = max(min(index, last - 1), 0)
        else:
            other = min(max(index + (1 if self.change == "DOWN" else -1), 0), last)
            settings.via.move(index, other)
            settings.active_via = other
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_add_to_chain,
        POINTMORPH_OT_change_chain,
    ),
)
