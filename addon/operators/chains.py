"""Chains: which shapes a morph goes through, and the morph over all of them."""

from itertools import pairwise

import bpy

from ..core.settings import settings_values
from ..data import arrays, chains
from ..data.feature_list import feature_choices, sync_features
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import (
    blended_textures,
    morph_builder,
    morph_object,
    recipes,
    recomputation,
    staleness,
)
from .modal_operator import Computing
from .polls import Explained, busy_reason, present, say_looks


def chain_reason(context):
    """Why no chain can be made of what is picked; None when one can."""
    shapes = staleness.picked_shapes(context.scene)
    if len(shapes) < 3:
        return "Add shapes between the source and target first"
    if None in shapes:
        return "Choose an object for the source, the target and every shape in between"
    for obj in shapes:
        if context.scene.objects.get(obj.name) != obj:
            return f'"{obj.name}" is no longer in the scene: choose another object'
    for obj, after in pairwise(shapes):
        if obj == after:
            return f'"{obj.name}" comes twice in a row: remove one of the two'
    if len(shapes) > chains.LONGEST:
        return f"A chain can have {chains.LONGEST} shapes at most, but there are {len(shapes)}"
    return None


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
        return "Select meshes or point clouds other than the source and target"

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
        if obj.type in arrays.SHAPE_TYPES and obj not in picked and not morph_object.is_made(obj)
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


class POINTMORPH_OT_morph_chain(Explained, Computing, bpy.types.Operator):
    """Compute the morph from the source through all shapes in between to the target, as one
    object. Blender stays usable meanwhile, and Esc cancels"""

    bl_idname = "pointmorph.morph_chain"
    bl_label = "Morph Chain"
    bl_options = {"UNDO"}
    stopped = "Chain morph canceled"

    @staticmethod
    def reason(context):
        return busy_reason() or chain_reason(context)

    def _begin_steps(self, context):
        sync_features(context.scene)
        settings = context.scene.pointmorph
        shapes = staleness.picked_shapes(context.scene)
        self._shapes = [reference_to(shape) for shape in shapes if shape is not None]
        plan = self._plan = yield from recomputation.plan_of_steps(
            context,
            shapes,
            feature_choices(settings),
            [item.name for item in settings.loop],
            settings_values(settings),
        )
        self._names = [shape["name"] for shape in plan.recipe["shapes"]]
        textures = blended_textures.wanted(context.scene)
        return lambda progress: chains.compute_all(plan.requests, progress, textures=textures)

    def _finish(self, context, outcome):
        shapes = [find(context.scene.objects, shape) for shape in self._shapes]
        provenance = self._plan.provenance(shapes)
        obj = morph_builder.build(context, outcome, " to ".join(self._names), provenance)
        recipes.remember(obj, self._plan.recipe, outcome)
        say_looks(self, self._plan.requests)
        present(self, context, obj, outcome)
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_add_to_chain,
        POINTMORPH_OT_change_chain,
        POINTMORPH_OT_morph_chain,
    ),
)
