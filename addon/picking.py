"""Which two objects are meant."""

import bpy

from .checks import possible
from .properties import sync_features


def _reason(context):
    """Why the selection can't be taken; None when it can."""
    shapes = [obj for obj in context.selected_objects if obj.type in {"MESH", "POINTCLOUD"}]
    if len(shapes) == len(context.selected_objects) == 2:
        return None
    return "Select two meshes or point clouds, the target last"


class POINTMORPH_OT_pick_selected(bpy.types.Operator):
    """Take the two selected objects: the active one, which was selected last, is the target"""

    bl_idname = "pointmorph.pick_selected"
    bl_label = "Take Selected"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return possible(cls, _reason(context))

    def execute(self, context):
        settings = context.scene.pointmorph
        source, target = context.selected_objects
        if source == context.view_layer.objects.active:
            source, target = target, source
        settings.source, settings.target = source, target
        return {"FINISHED"}


class POINTMORPH_OT_swap_objects(bpy.types.Operator):
    """Make the target the source and the source the target"""

    bl_idname = "pointmorph.swap_objects"
    bl_label = "Swap"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        settings = context.scene.pointmorph
        if settings.source is not None or settings.target is not None:
            return True
        cls.poll_message_set("Pick a source or a target first")
        return False

    def execute(self, context):
        settings = context.scene.pointmorph
        settings.source, settings.target = settings.target, settings.source
        sync_features(context.scene)
        return {"FINISHED"}


_classes = (POINTMORPH_OT_pick_selected, POINTMORPH_OT_swap_objects)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
