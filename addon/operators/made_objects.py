"""What the user does with a morph object once it is there."""

import bpy
import pointmorph

from ..data import creation, denser_source
from ..data.feature_list import sync_features
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..data.transfer_settings import transfer_settings
from ..scene import (
    attribute_transfer,
    morph_object,
    morphing_mesh,
    own_points,
    placement,
    presentation,
    recipes,
    recomputation,
    shape_follower,
    source_subdivision,
)
from . import shading
from .modal_operator import Computing
from .polls import NO_RESULT, Explained, activate, active_result, busy_reason, fail


def made_object(context):
    """The morph object, of pairs or with the source's faces, that is meant."""
    active = context.view_layer.objects.active
    return active if morph_object.is_made(active) else active_result(context)


def shown_object(context):
    """What shows the morph object that is meant, and has its slider; None where there is none."""
    obj = made_object(context)
    return obj if obj is None or obj.pointmorph.keeps_faces else morph_object.shown_of(obj)


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
        obj = made_object(context)
        placement.give_back(*morph_object.made_with(obj))
        try:
            return self.change(context, obj)
        except pointmorph.PointmorphError as error:
            return fail(self, error)


class _OnPairs(_OnMade):
    """The same, of a morph object of pairs."""

    @staticmethod
    def reason(context):
        return busy_reason() or pairs_reason(context)


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
    objects, also of a source that was morphed as shown. Press again to show the shapes as they
    were morphed. A mesh moves with the source's rig if that was in Rest Position when it was
    morphed"""

    bl_idname = "pointmorph.follow"
    bl_label = "Follow"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        reason = busy_reason() or made_reason(context)
        if reason is None and not morph_object.is_result(made_object(context)):
            reason = (
                "Show the morph as points or discs first. A mesh moves with the source's rig if "
                "that is in Rest Position, or Keep Modifiers is on, when it is morphed"
            )
        return reason

    def change(self, context, obj):
        if obj.pointmorph.follows:
            shape_follower.rest(obj)
            return {"FINISHED"}
        with creation.all_or_nothing() as created:
            shape_follower.follow(obj, context, created)
        return {"FINISHED"}


class POINTMORPH_OT_show_as(Explained, bpy.types.Operator):
    """Show the morph as the source's own faces, as the points of both shapes, or as discs at
    these points. The slider and its animation are the same"""

    bl_idname = "pointmorph.show_as"
    bl_label = "Show As"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Show As",
        description="What shows the morph",
        items=[
            ("MESH", "Mesh", "The source's faces, with its materials, UV maps and modifiers"),
            ("POINTS", "Points", "The points of both shapes, in the colors of both"),
            ("DISCS", "Discs", "Discs in the surface at these points: solid in every shading"),
        ],
    )

    @staticmethod
    def reason(context):
        return busy_reason() or (NO_RESULT if active_result(context) is None else None)

    def execute(self, context):
        try:
            obj = own_points.of_active(context, active_result(context))
            seen = presentation.show_as(context, obj, self.kind)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        context.scene.pointmorph.show_as = self.kind
        shading.show_colors(context, seen)
        activate(context.view_layer.objects, seen)
        return {"FINISHED"}


class POINTMORPH_OT_show_shapes(Explained, bpy.types.Operator):
    """Show or hide the objects that the morph was made from, also in renders. They are hidden when
    it is made. Where it is gone, those in the panel are shown"""

    bl_idname = "pointmorph.show_shapes"
    bl_label = "Originals"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        gone = made_object(context) is None and not presentation.hidden_shapes(context)
        return NO_RESULT if gone else None

    def execute(self, context):
        obj = made_object(context)
        if obj is None:
            for shape in presentation.hidden_shapes(context):
                presentation.set_visible(context, shape, True)
        else:
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


class POINTMORPH_OT_subdivide_source(Explained, Computing, bpy.types.Operator):
    """Subdivide the source where its faces are too large to show the target, and recompute the
    morph. The source keeps its surface, materials, UV maps, weights, colors and shape keys"""

    bl_idname = "pointmorph.subdivide_source"
    bl_label = "Subdivide Source"
    bl_options = {"UNDO"}
    place = "RESULT"
    stopped = "Canceled: the source is unchanged"

    recompute: bpy.props.BoolProperty(
        name="Recompute",
        description="Recompute the morph afterward. In a window, this is a separate undo step: "
        "Esc before it leaves the source as it is, and Esc during it keeps the new vertices",
        default=True,
        options={"SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        return busy_reason() or (NO_RESULT if active_result(context) is None else None)

    def _begin_steps(self, context):
        obj = active_result(context)
        self._name, self._made = obj.name, reference_to(obj)
        placement.give_back(*morph_object.made_with(obj))
        source_subdivision.check(obj)
        plan = yield from recomputation.plan_steps(context, obj)
        request, stops = plan.requests[0], source_subdivision.stops_of(obj, plan.requests)
        self._triangles = request.source.triangles
        return lambda progress: denser_source.compute(request, stops, progress)

    def _finish(self, context, finer):
        obj = find(bpy.data.objects, self._made)
        if not morph_object.is_result(obj):
            raise pointmorph.CloudError(
                self._name, "the morph whose source is subdivided", "none", "Undo the deletion."
            )
        source = source_subdivision.check(obj)
        before, after = source_subdivision.write(source, finer, self._triangles)
        if after == before:
            self.report({"INFO"}, f'"{source.name}" already has enough vertices')
            return {"CANCELLED"}
        done = f'"{source.name}" has {after:,} vertices instead of {before:,}'
        # What the morph holds of an object that is gone has no more vertices than before.
        if self.recompute and made_reason(context) is None and None not in recipes.shapes_of(obj):
            self.report({"INFO"}, done)
            mode = "INVOKE_DEFAULT" if self._in_window else "EXEC_DEFAULT"
            try:
                with denser_source.starting(self._made, finer.start):
                    bpy.ops.pointmorph.recompute(mode, name=obj.name)
            except RuntimeError as error:  # the source is subdivided nevertheless
                self.report({"ERROR"}, str(error).removeprefix("Error: ").strip())
        else:
            self.report({"INFO"}, f"{done}: recompute the morph")
        return {"FINISHED"}


class POINTMORPH_OT_transfer_attributes(Explained, Computing, bpy.types.Operator):
    """Transfer what the target has to the matching places of the morph: colors, weights, UV maps,
    shape keys and hair"""

    bl_idname = "pointmorph.transfer_attributes"
    bl_label = "Transfer from Target"
    bl_options = {"UNDO"}
    place = "TRANSFER"
    stopped = "Canceled: nothing was transferred"

    @staticmethod
    def reason(context):
        return busy_reason() or made_reason(context)

    def _begin_steps(self, context):
        obj = made_object(context)
        self._name, self._made = obj.name, reference_to(obj)
        placement.give_back(*morph_object.made_with(obj))
        wanted = self._wanted = attribute_transfer.Wanted(
            self.colors,
            self.weights,
            self.uvs,
            self.prefix,
            self.keys,
            self.hair,
            self.back,
            self.onto == "SOURCE",
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
        done, remarks = attribute_transfer.write(context, obj, self._wanted, outcome)
        for line in done:
            self.report({"INFO"}, line)
        for line in remarks:
            self.report({"WARNING"}, line)
        return {"FINISHED"}


POINTMORPH_OT_transfer_attributes.__annotations__.update(transfer_settings())


registration = Registration(
    classes=(
        POINTMORPH_OT_edit_morph,
        POINTMORPH_OT_follow,
        POINTMORPH_OT_show_as,
        POINTMORPH_OT_show_shapes,
        POINTMORPH_OT_make_mesh,
        POINTMORPH_OT_subdivide_source,
        POINTMORPH_OT_transfer_attributes,
    ),
)
