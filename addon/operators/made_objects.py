"""What the user does with a morph object once it is there, and chains."""

import bpy
import pointmorph

from ..core import background_job
from ..core.computation import Earlier
from ..core.look_transfer import Options
from ..data import chains, creation
from ..data.feature_list import sync_features
from ..data.properties import TEXTURE_SIZES
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import (
    attribute_transfer,
    blended_textures,
    morph_object,
    morphing_mesh,
    presentation,
    recipes,
    recomputation,
    shape_follower,
    source_subdivision,
)
from .modal_operator import Computing
from .polls import NO_RESULT, Explained, activate, active_result, busy_reason, fail, say_made


def made_object(context):
    """The morph object, of pairs or with the source's faces, that is meant."""
    active = context.view_layer.objects.active
    return active if morph_object.is_made(active) else active_result(context)


def made_reason(context):
    """Why there is none that could be changed; None when there is one."""
    obj = made_object(context)
    if obj is None:
        return "Morph first, or make a morph object the active object"
    if obj.library is not None:
        return f'"{obj.name}" is linked from another file: make it local first'
    if obj.mode == "OBJECT":
        return None
    return f'Switch "{obj.name}" to Object Mode first (Tab)'


def pairs_reason(context):
    """The same, for what only a morph object of pairs can do."""
    reason = made_reason(context)
    if reason is None and not morph_object.is_result(made_object(context)):
        reason = "Make the morph object the active object: this mesh was made from it"
    return reason


class _OnMade(Explained):
    """An operator that changes what `made_object` finds."""

    @staticmethod
    def reason(context):
        return busy_reason() or made_reason(context)

    def execute(self, context):
        try:
            return self.change(context, made_object(context))
        except pointmorph.PointmorphError as error:
            return fail(self, error)


class _OnPairs(_OnMade):
    """The same, of a morph object of pairs."""

    @staticmethod
    def reason(context):
        return busy_reason() or pairs_reason(context)


class POINTMORPH_OT_recompute(Explained, Computing, bpy.types.Operator):
    """Compute this morph again in place, from its objects as they are now. Its name, animation,
    drivers, materials and baked keys are kept"""

    bl_idname = "pointmorph.recompute"
    bl_label = "Recompute"
    bl_options = {"UNDO"}
    stopped = "Canceled: the morph is unchanged"

    @staticmethod
    def reason(context):
        return busy_reason() or made_reason(context)

    def _begin_steps(self, context):
        sync_features(context.scene)
        obj = made_object(context)
        if obj.pointmorph.keeps_faces and obj.pointmorph.made_from is not None:
            obj = obj.pointmorph.made_from  # it goes along
        self._name, self._made = obj.name, reference_to(obj)
        plan = self._plan = yield from recomputation.plan_steps(context, obj)
        earlier = background_job.earlier if self._in_window else None
        textures = blended_textures.options_of(morph_object.shown_of(obj))
        if textures is not None and textures.normal:
            textures = None  # for which more is read, afterward
        return lambda progress: chains.compute_all(plan.requests, progress, earlier, textures)

    def _finish(self, context, outcome):
        obj = find(bpy.data.objects, self._made)
        if not morph_object.is_made(obj):
            raise pointmorph.CloudError(
                self._name, "the object that is being recomputed", "none", "Undo the deletion."
            )
        if self._in_window and len(self._plan.requests) == 1:
            request = self._plan.requests[0].without_looks()
            background_job.earlier = Earlier(request, outcome.maps)
        said = morphing_mesh.remake(context, obj, self._plan, outcome)
        for name in self._plan.missing:
            gone = f'"{name}" no longer exists: the points stored in the morph were used'
            self.report({"WARNING"}, gone)
        for warning in said:
            self.report({"WARNING"}, warning)
        say_made(self, obj, outcome.report)
        return {"FINISHED"}


class POINTMORPH_OT_edit_morph(_OnMade, bpy.types.Operator):
    """Choose the objects of this morph in the panel again, with its settings and features"""

    bl_idname = "pointmorph.edit_morph"
    bl_label = "Edit This Morph"
    bl_options = {"REGISTER", "UNDO"}

    def change(self, context, obj):
        recipe = recipes.recipe_of(obj)
        shapes = recipes.shapes_of(obj)
        if None in shapes:
            raise pointmorph.CloudError(
                obj.name,
                "the objects it was made from",
                "one that no longer exists",
                "Undo the deletion, or choose other objects.",
            )
        settings = context.scene.pointmorph
        settings.source, settings.target = shapes[0], shapes[-1]
        settings.via.clear()
        for shape in shapes[1:-1]:
            settings.via.add().object = shape
        sync_features(context.scene)
        if recipes.is_known(recipe):
            recipes.put_settings(settings, recipe)
        return {"FINISHED"}


class POINTMORPH_OT_follow(_OnPairs, bpy.types.Operator):
    """Let the points follow the armatures, shape keys, modifiers and motion of the original
    objects. Press again to show the shapes as they were morphed"""

    bl_idname = "pointmorph.follow"
    bl_label = "Follow"
    bl_options = {"REGISTER", "UNDO"}

    def change(self, context, obj):
        if obj.pointmorph.follows:
            shape_follower.rest(obj)
            return {"FINISHED"}
        with creation.all_or_nothing() as created:
            shape_follower.follow(obj, context, created)
        return {"FINISHED"}


class POINTMORPH_OT_show_as(Explained, bpy.types.Operator):
    """Show the morph by the source's own faces, or as the points of both shapes. The slider and its
    animation are the same"""

    bl_idname = "pointmorph.show_as"
    bl_label = "Show As"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Show As",
        description="What shows the morph",
        items=[
            ("MESH", "Mesh", "The source's faces, with its materials, UV maps and modifiers"),
            ("POINTS", "Points", "The points of both shapes, in the colors of both"),
        ],
    )

    @staticmethod
    def reason(context):
        return busy_reason() or (NO_RESULT if active_result(context) is None else None)

    def execute(self, context):
        try:
            seen = presentation.show_as(context, active_result(context), self.kind)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        context.scene.pointmorph.show_as = self.kind
        activate(context.view_layer.objects, seen)
        return {"FINISHED"}


class POINTMORPH_OT_show_shapes(Explained, bpy.types.Operator):
    """Show or hide the objects that the morph was made from. They are hidden when it is made"""

    bl_idname = "pointmorph.show_shapes"
    bl_label = "Originals"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        return NO_RESULT if active_result(context) is None else None

    def execute(self, context):
        obj = active_result(context)
        presentation.show_shapes(context, obj, not presentation.shows_shapes(obj))
        return {"FINISHED"}


class POINTMORPH_OT_make_mesh(_OnPairs, bpy.types.Operator):
    """Create a copy of the source that morphs, with its faces, materials, colors, UV maps, weights
    and modifiers, and hide the points"""

    bl_idname = "pointmorph.make_mesh"
    bl_label = "Create Morphing Mesh"
    bl_options = {"REGISTER", "UNDO"}

    def change(self, context, obj):
        copy = morphing_mesh.make_mesh(context, obj)
        presentation.hide(context, obj)  # in the same place
        activate(context.view_layer.objects, copy)
        source = obj.pointmorph.source.name
        self.report({"INFO"}, f'Created "{copy.name}" with the faces of "{source}"')
        return {"FINISHED"}


class POINTMORPH_OT_subdivide_source(Explained, bpy.types.Operator):
    """Subdivide the source where its faces are too large to show the target. Its surface stays as
    it is, and UV maps, weights, colors and shape keys go along. Recompute the morph afterwards"""

    bl_idname = "pointmorph.subdivide_source"
    bl_label = "Subdivide Source"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        return busy_reason() or (NO_RESULT if active_result(context) is None else None)

    def execute(self, context):
        obj = active_result(context)
        try:
            before, after = source_subdivision.subdivide(obj)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        source = obj.pointmorph.source
        if after == before:
            self.report({"INFO"}, f'"{source.name}" already has enough vertices')
            return {"CANCELLED"}
        self.report(
            {"INFO"},
            f'"{source.name}" has {after:,} vertices instead of {before:,}: recompute the morph',
        )
        return {"FINISHED"}


class POINTMORPH_OT_transfer_attributes(Explained, Computing, bpy.types.Operator):
    """Transfer colors, weights and UV maps from the target to the matching places of the morph"""

    bl_idname = "pointmorph.transfer_attributes"
    bl_label = "Transfer from Target"
    bl_options = {"UNDO"}
    stopped = "Canceled: nothing was transferred"

    @staticmethod
    def reason(context):
        return busy_reason() or made_reason(context)

    colors: bpy.props.BoolProperty(
        name="Colors",
        description="Color attributes. A morphing mesh blends to them as it morphs",
        default=True,
    )
    weights: bpy.props.BoolProperty(
        name="Weights", description="Vertex groups, except features", default=True
    )
    uvs: bpy.props.BoolProperty(
        name="UV Maps",
        description="Stored as point attributes. Textures are smeared on faces that cross a "
        "seam of the target",
        default=False,
    )
    prefix: bpy.props.StringProperty(
        name="Prefix",
        description="Put before the names of the target's attributes, so that the source "
        "keeps its own",
        default="target.",
    )

    def _begin_steps(self, context):
        obj = made_object(context)
        self._name, self._made = obj.name, reference_to(obj)
        wanted = self._wanted = attribute_transfer.Wanted(
            self.colors, self.weights, self.uvs, self.prefix
        )
        return (yield from attribute_transfer.read_steps(context, obj, wanted))

    def _leave(self, context):
        self._steps.close()

    def _finish(self, context, outcome):
        obj = find(bpy.data.objects, self._made)
        if not morph_object.is_made(obj):
            raise pointmorph.CloudError(
                self._name, "the object to transfer to", "none", "Undo the deletion."
            )
        names = attribute_transfer.write(obj, self._wanted, outcome)
        self.report({"INFO"}, f"Transferred: {', '.join(names)}")
        return {"FINISHED"}


class POINTMORPH_OT_blend_textures(Explained, Computing, bpy.types.Operator):
    """Blend the look of the source into that of the target as the mesh morphs: draw the target's
    base color on images in the source's UV layout, and mix them into the mesh's materials"""

    bl_idname = "pointmorph.blend_textures"
    bl_label = "Blend Textures"
    bl_options = {"UNDO"}
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
        how = f"on images of {size} by {size} pixels" if size else "without an image: it is plain"
        self.report({"INFO"}, f'The look of "{obj.pointmorph.target.name}" was drawn {how}')
        return {"FINISHED"}


class POINTMORPH_OT_keep_textures(Explained, bpy.types.Operator):
    """Leave the mesh the source's own look while it morphs"""

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
        POINTMORPH_OT_recompute,
        POINTMORPH_OT_edit_morph,
        POINTMORPH_OT_follow,
        POINTMORPH_OT_show_as,
        POINTMORPH_OT_show_shapes,
        POINTMORPH_OT_make_mesh,
        POINTMORPH_OT_subdivide_source,
        POINTMORPH_OT_transfer_attributes,
        POINTMORPH_OT_blend_textures,
        POINTMORPH_OT_keep_textures,
    ),
)
