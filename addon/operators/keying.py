"""Animates a morph."""

import bpy
import pointmorph

from ..data.registration import Registration
from ..scene import morph_object, slider_keys
from .made_objects import made_reason, shown_object
from .polls import Explained, fail


class POINTMORPH_OT_key_morph(Explained, bpy.types.Operator):
    """Key the slider from the first shape to the last. Keys that this button made earlier
    are replaced; others are kept"""

    bl_idname = "pointmorph.key_morph"
    bl_label = "Key Morph"
    bl_options = {"REGISTER", "UNDO"}

    start: bpy.props.IntProperty(
        name="Start", description="Frame that shows the first shape", options={"SKIP_SAVE"}
    )
    end: bpy.props.IntProperty(
        name="End", description="Frame that shows the last shape", options={"SKIP_SAVE"}
    )
    easing: bpy.props.EnumProperty(
        name="Easing",
        description="How the slider moves from one shape to the other",
        items=slider_keys.EASINGS,
        default="SINE",
        options={"SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        reason = made_reason(context)
        if reason is not None:
            return reason
        obj = shown_object(context)
        if not morph_object.is_in_file(obj):
            return (
                f'The slider of "{obj.name}" is linked from another file: make a library override '
                "of its mesh in the Outliner, or make it local"
            )
        try:
            driven = slider_keys.is_driven(obj)
        except pointmorph.PointmorphError as error:
            return str(error)
        return f'A driver moves the slider of "{obj.name}": remove it first' if driven else None

    def execute(self, context):
        obj = shown_object(context)
        kept = obj.pointmorph
        for name in ("start", "end", "easing"):
            if not self.properties.is_property_set(name):
                setattr(self, name, getattr(kept, f"key_{name}"))
        try:
            slider_keys.put(obj, self.start, self.end, self.easing)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        kept.key_frames, kept.has_key_frames = (self.start, self.end), True
        kept.key_easing = self.easing
        morph_object.t_key(obj).value = slider_keys.value_at(obj, context.scene.frame_current)
        self.report({"INFO"}, f'"{obj.name}" morphs from frame {self.start} to {self.end}')
        return {"FINISHED"}


registration = Registration(
    classes=(POINTMORPH_OT_key_morph,),
)
