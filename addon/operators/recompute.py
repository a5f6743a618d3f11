"""Computes a morph object again, in place."""

import bpy
import pointmorph

from ..core import background_job
from ..data import chains, creation, denser_source
from ..data.feature_list import sync_features
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import (
    blended_textures,
    lost_keys,
    morph_object,
    morphing_mesh,
    placement,
    presentation,
    recipes,
    recomputation,
)
from .made_objects import made_object, made_reason
from .modal_operator import Computing
from .polls import Explained, busy_reason, say_made


def leave_mode(context, shapes, hides=False):
    """Goes to Object Mode where a shape is edited: it is read as the viewport shows it there. With
    `hides`, also where one is painted, since it is hidden then, or anything is edited: the result
    can't become active."""
    active = context.view_layer.objects.active
    if active is None or active.mode == "OBJECT":
        return
    edited = any(shape is not None and shape.mode == "EDIT" for shape in shapes)
    if edited or (hides and (active in shapes or active.mode == "EDIT")):
        try:
            bpy.ops.object.mode_set(mode="OBJECT")
        except RuntimeError as error:  # Blender's own words
            raise pointmorph.CloudError(
                active.name,
                "an object in Object Mode",
                "another mode",
                "Switch to Object Mode (Tab).",
            ) from error


class Recomputing(Computing):
    """An operator that computes a morph object again."""

    def begin_again(self, context, obj, start=None):
        """A generator that yields often and returns what to call with a progress, maybe from a
        `denser_source.Start`."""
        if obj.pointmorph.keeps_faces and obj.pointmorph.made_from is not None:
            obj = obj.pointmorph.made_from  # it goes along
        for one in reversed(morph_object.made_with(obj)):  # the points follow their mesh
            lost_keys.restore(one)
        kept = placement.give_back(*morph_object.made_with(obj))
        self._lost = [f"Applied transforms were lost: {words}" for words in kept]
        for one in dict.fromkeys((obj, morph_object.shown_of(obj))):
            added = morph_object.vertices_added(one)
            if added > 0:
                self._lost.append(f'"{one.name}" lost the {added} vertices that were added to it')
        self._name, self._made = obj.name, reference_to(obj)
        textures = blended_textures.wanted_again(context.scene, morph_object.shown_of(obj))
        plan = self._plan = yield from recomputation.plan_steps(context, obj, textures)
        self._lost += plan.remarks
        earlier = self._starts(plan) if start is None else (start,)
        return lambda progress: chains.compute_all(plan.requests, progress, earlier, textures)

    def _starts(self, plan):
        """What to start from: nothing in scripts, which get the same whatever was done before."""
        return background_job.starts(len(plan.requests)) if self._in_window else ()

    def _remember(self, outcome):
        """Keeps what was found for the next time."""
        requests = self._plan.requests
        if self._in_window and len(requests) == 1:
            background_job.remember(requests[0].without_looks(), outcome)
        elif self._in_window:
            background_job.remember_ways(chains.earlier_ways(requests, outcome))

    def finish_again(self, context, outcome):
        """Puts what was computed into the morph object, and returns it."""
        obj = find(bpy.data.objects, self._made)
        if not morph_object.is_made(obj):
            raise pointmorph.CloudError(
                self._name, "the object that is being recomputed", "none", "Undo the deletion."
            )
        self._remember(outcome)
        was_there = recipes.is_there(obj)
        if not was_there:  # deleted in the viewport; its mesh knows it
            creation.link(context, obj)
            presentation.set_visible(context, obj, False)
        try:
            said = morphing_mesh.remake(context, obj, self._plan, outcome)
        except BaseException:
            for collection in () if was_there else obj.users_collection:
                collection.objects.unlink(obj)
            raise
        for words in recipes.gone_words(obj).values() if self._plan.missing else ():
            self.report({"WARNING"}, f"{words}. The points stored in the morph were used")
        for warning in (*self._lost, *said):
            self.report({"WARNING"}, warning)
        return obj


class POINTMORPH_OT_recompute(Explained, Recomputing, bpy.types.Operator):
    """Compute this morph again in place, from its objects as they are now. Its name, animation,
    drivers, materials and baked keys are kept"""

    bl_idname = "pointmorph.recompute"
    bl_label = "Recompute"
    bl_options = {"UNDO"}
    place = "RESULT"
    stopped = "Canceled: the morph is unchanged"

    name: bpy.props.StringProperty(
        name="Name",
        description="Morph object to compute again. If empty, the active one",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        return busy_reason() or made_reason(context)

    def _begin_steps(self, context):
        obj = bpy.data.objects.get(self.name) if self.name else None
        # At once: what is said here is for this time.
        start = None if obj is None else denser_source.start_of(reference_to(obj))
        return self._steps_from(context, start)

    def _steps_from(self, context, start):
        sync_features(context.scene)
        obj = bpy.data.objects.get(self.name) if self.name else made_object(context)
        if not morph_object.is_made(obj):
            raise pointmorph.CloudError(
                self.name, "a morph object of this name", "none", "Morph first."
            )
        leave_mode(context, recipes.shapes_of(obj))
        return (yield from self.begin_again(context, obj, start))

    def _finish(self, context, outcome):
        obj = self.finish_again(context, outcome)
        seen = obj if obj.pointmorph.keeps_faces else presentation.seen_of(obj)
        say_made(self, seen, outcome.report)
        return {"FINISHED"}


registration = Registration(
    classes=(POINTMORPH_OT_recompute,),
)
