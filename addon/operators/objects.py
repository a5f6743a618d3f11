"""Which two objects are meant."""

import bpy
import pointmorph

from ..data.feature_list import sync_features
from ..data.registration import Registration
from ..scene import as_shown, joined
from .polls import Explained, activate, fail, pick_selected, select_reason


class POINTMORPH_OT_pick_selected(Explained, bpy.types.Operator):
    """Use the selected objects as source and target. The active one, selected last, is the target.
    With more than two, the others come in between, in the order of their names"""

    bl_idname = "pointmorph.pick_selected"
    bl_label = "Use Selected"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        return select_reason(context)

    def execute(self, context):
        pick_selected(context)
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


class POINTMORPH_OT_use_as_shown(Explained, bpy.types.Operator):
    """Use a copy of the source with its modifiers, pose and shape keys applied. The source itself
    is hidden and stays unchanged"""

    bl_idname = "pointmorph.use_as_shown"
    bl_label = "Use as Shown"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        source = context.scene.pointmorph.source
        if source is None:
            return "Choose a source first"
        if source.mode != "OBJECT":
            return f'Switch "{source.name}" to Object Mode first (Tab)'
        if as_shown.left_out(source):
            return None
        return f'"{source.name}" has no modifiers or shape keys in effect'

    def execute(self, context):
        settings = context.scene.pointmorph
        try:
            copy = as_shown.copy_as_shown(context, settings.source)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        settings.source = copy
        self.report({"INFO"}, f'"{copy.name}" is the source: {len(copy.data.vertices):,} vertices')
        return {"FINISHED"}


class POINTMORPH_OT_join_copies(Explained, bpy.types.Operator):
    """Make one mesh of what the selected objects show, with all that is parented to them, to morph
    a model of several objects as a whole. The objects are hidden and stay unchanged"""

    bl_idname = "pointmorph.join_copies"
    bl_label = "Join Copies"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        if context.mode != "OBJECT":
            return "Switch to Object Mode first"
        if not context.selected_objects:
            return "Select the objects of a model first, or the one that they are parented to"
        return None

    def execute(self, context):
        chosen = sorted(context.selected_objects, key=lambda obj: obj.name)
        active = context.view_layer.objects.active
        try:
            lead = active if active in chosen else chosen[0]
            copy, count, (moved, *remarks) = joined.join(context, chosen, lead)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        activate(context.view_layer.objects, copy)
        said = f'"{copy.name}" shows {count} objects, which are hidden{moved}'
        for remark in remarks:
            self.report({"WARNING"}, remark)
        self.report({"INFO"}, said)
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_join_copies,
        POINTMORPH_OT_pick_selected,
        POINTMORPH_OT_swap_objects,
        POINTMORPH_OT_use_as_shown,
    ),
)
