"""Which two objects are meant."""

import bpy

from ..data.arrays import SHAPE_TYPES
from ..data.feature_list import sync_features
from ..data.registration import Registration
from .polls import Explained


class POINTMORPH_OT_pick_selected(Explained, bpy.types.Operator):
    """Use the two selected objects. The active one, which was selected last, is the target"""

    bl_idname = "pointmorph.pick_selected"
    bl_label = "Use Selected"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        shapes = [obj for obj in context.selected_objects if obj.type in SHAPE_TYPES]
        if len(shapes) == len(context.selected_objects) == 2:
            return None
        return "Select two meshes or point clouds, the target last"

    def execute(self, context):
        settings = context.scene.pointmorph
        source, target = context.selected_objects
        if source == context.view_layer.objects.active:
            source, target = target, source
        settings.source, settings.target = source, target
        return {"FINISHED"}


class POINTMORPH_OT_swap_objects(Explained, bpy.types.Operator):
    """Swap source and target"""

    bl_idname = "pointmorph.swap_objects"
    bl_label = "Swap"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        settings = context.scene.pointmorph
        picked = settings.source is not None or settings.target is not None
        return None if picked else "Choose a source or a target first"

    def execute(self, context):
        settings = context.scene.pointmorph
        settings.source, settings.target = settings.target, settings.source
        sync_features(context.scene)
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_pick_selected,
        POINTMORPH_OT_swap_objects,
    ),
)
