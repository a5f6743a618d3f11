"""The look of a morphing mesh: blended into its target's, or left as it is."""

import bpy
import pointmorph

from ..core.look_transfer import Options
from ..data.properties import TEXTURE_SIZES
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import blended_textures, morph_object
from .made_objects import made_object, made_reason
from .modal_operator import Computing
from .polls import Explained, busy_reason


class POINTMORPH_OT_blend_textures(Explained, Computing, bpy.types.Operator):
    """Blend the look of the source into that of the target as the mesh morphs: draw the target's
    base color on images in the source's UV layout, and mix them into the mesh's materials"""

    bl_idname = "pointmorph.blend_textures"
    bl_label = "Blend Textures"
    bl_options = {"UNDO"}
    place = "TEXTURES"
    stopped = "Canceled: the textures are unchanged"

    size: bpy.props.EnumProperty(
        name="Size",
        description="Pixels along each side of the images",
        items=TEXTURE_SIZES,
        default="1024",
    )
    roughness: bpy.props.BoolProperty(
        name="Roughness", description="Also draw roughness and metalness", default=False
    )
    normal: bpy.props.BoolProperty(
        name="Normal", description="Also draw a normal map of the target's details", default=False
    )

    @staticmethod
    def reason(context):
        reason = busy_reason() or made_reason(context)
        if reason is None and not blendable_mesh(context):
            reason = "Show the morph as a mesh first: points already blend their colors"
        return reason

    def _begin_steps(self, context):
        obj = blendable_mesh(context)
        self._name, self._made = obj.name, reference_to(obj)
        options = Options(int(self.size), self.roughness, self.normal)
        return (yield from blended_textures.read_steps(context, obj, options))

    def _leave(self, context):
        self._steps.close()

    def _finish(self, context, outcome):
        obj = find(bpy.data.objects, self._made)
        if obj is None or not obj.pointmorph.keeps_faces:
            raise pointmorph.CloudError(
                self._name, "the mesh to blend textures on", "none", "Undo the deletion."
            )
        blended_textures.blend(obj, outcome)
        for remark in outcome.unread:
            self.report({"WARNING"}, remark)
        for remark in outcome.remarks:
            self.report({"INFO"}, remark)
        size = len(outcome.color) if outcome.has_images else 0
        how = (
            f"on images of {size} by {size} pixels"
            if size
            else "without an image, because it is plain"
        )
        self.report({"INFO"}, f'The look of "{obj.pointmorph.target.name}" was drawn {how}')
        return {"FINISHED"}


class POINTMORPH_OT_keep_textures(Explained, bpy.types.Operator):
    """Keep the source's own look on the mesh while it morphs"""

    bl_idname = "pointmorph.keep_textures"
    bl_label = "Keep Source's Look"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        reason = busy_reason() or made_reason(context)
        if reason is not None:
            return reason
        obj = blendable_mesh(context)
        if obj is None or blended_textures.options_of(obj) is None:
            return "There are no blended textures"
        return None

    def execute(self, context):
        blended_textures.unblend(blendable_mesh(context))
        return {"FINISHED"}


def blendable_mesh(context):
    """The mesh that shows the morph that is meant; None where points show it."""
    obj = made_object(context)
    if obj is not None and not obj.pointmorph.keeps_faces:
        obj = morph_object.shown_of(obj)
    return obj if obj is not None and obj.pointmorph.keeps_faces else None


registration = Registration(
    classes=(
        POINTMORPH_OT_blend_textures,
        POINTMORPH_OT_keep_textures,
    ),
)
