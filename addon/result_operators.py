"""What the user does with a morph object once it is there, and chains."""

from itertools import pairwise

import bpy
import pointmorph

from . import (
    carrying,
    chains,
    following,
    recipes,
    recomputing,
    result,
    session,
    states,
    transferring,
)
from .checks import activate, active_result, fail, possible, say_made
from .computation import Earlier
from .jobs import Computing
from .properties import feature_choices, settings_values, sync_features
from .reading import TYPES
from .translations import tell


def made_object(context):
    """The morph object, of pairs or with the source's faces, that is meant."""
    active = context.view_layer.objects.active
    return active if result.is_made(active) else active_result(context)


def made_reason(context):
    """Why there is none that could be changed; None when there is one."""
    obj = made_object(context)
    if obj is None:
        return "Morph first, or make a morph object the active object"
    if obj.library is not None:
        return tell('"{name}" is linked from another file: make it local first', name=obj.name)
    if obj.mode == "OBJECT":
        return None
    return tell('Leave the mode that "{name}" is in first (Tab)', name=obj.name)


def pairs_reason(context):
    """The same, for what only a morph object of pairs can do."""
    reason = made_reason(context)
    if reason is None and not result.is_result(made_object(context)):
        reason = "Make the morph object the active object: this is a mesh that was made from it"
    return reason


class _OnResult:
    """An operator on a morph object, that is greyed with a reason."""

    reason = staticmethod(made_reason)

    @classmethod
    def poll(cls, context):
        reason = cls.reason(context)
        if session.current is not None:
            reason = "Something is being computed: wait, or press Esc to stop it"
        return possible(cls, reason)

    def execute(self, context):
        try:
            return self.change(context, made_object(context))
        except pointmorph.PointmorphError as error:
            return fail(self, error)


class POINTMORPH_OT_recompute(Computing, bpy.types.Operator):
    """Compute this morph again in place, from the objects as they are now. Name, t with its keys
    and drivers, materials and baked keys stay"""

    bl_idname = "pointmorph.recompute"
    bl_label = "Recompute"
    bl_options = {"REGISTER", "UNDO"}
    stopped = "It was stopped: the morph is as it was"

    poll = _OnResult.__dict__["poll"]
    reason = staticmethod(made_reason)

    def _begin_steps(self, context):
        sync_features(context.scene)
        obj = made_object(context)
        if obj.pointmorph.keeps_faces and obj.pointmorph.made_from is not None:
            obj = obj.pointmorph.made_from  # it goes along
        self._name = obj.name
        plan = self._plan = yield from recomputing.plan_steps(context, obj)
        earlier = session.earlier if self._in_window else None
        return lambda progress: chains.compute_all(plan.requests, progress, earlier)

    def _finish(self, context, outcome):
        obj = bpy.data.objects.get(self._name)
        if not result.is_made(obj):
            raise pointmorph.CloudError(
                self._name, "the object that is computed again", "none", "Undo its removal."
            )
        if self._in_window and len(self._plan.requests) == 1:
            session.earlier = Earlier(self._plan.requests[0], outcome.maps)
        said = carrying.remake(context, obj, self._plan, outcome)
        for name in self._plan.missing:
            gone = '"{name}" is gone: the points that the morph holds were used'
            self.report({"WARNING"}, tell(gone, name=name))
        for warning in said:
            self.report({"WARNING"}, warning)
        say_made(self, obj, outcome.report)
        return {"FINISHED"}


class POINTMORPH_OT_edit_morph(_OnResult, bpy.types.Operator):
    """Pick the objects of this morph in the panel again, with its settings and features"""

    bl_idname = "pointmorph.edit_morph"
    bl_label = "Edit This Morph"
    bl_options = {"REGISTER", "UNDO"}

    def change(self, context, obj):
        recipe = recipes.recipe_of(obj)
        shapes = recipes.shapes_of(obj)
        if None in shapes:
            raise pointmorph.CloudError(
                obj.name,
                "the objects that it was made from",
                "one that is gone",
                "Undo its removal, or pick others.",
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


class POINTMORPH_OT_follow(_OnResult, bpy.types.Operator):
    """Let the points follow how the objects that were morphed move and deform: armatures, shape
    keys, modifiers; or show what was morphed again"""

    bl_idname = "pointmorph.follow"
    bl_label = "Follow"
    bl_options = {"REGISTER", "UNDO"}
    reason = staticmethod(pairs_reason)

    def change(self, context, obj):
        if obj.pointmorph.follows:
            following.rest(obj)
            return {"FINISHED"}
        with result.all_or_nothing() as created:
            following.follow(obj, context, created)
        return {"FINISHED"}


class POINTMORPH_OT_make_mesh(_OnResult, bpy.types.Operator):
    """Make a copy of the source that morphs: with its faces, materials, colours, UV maps, weights
    and modifiers, and a t of its own"""

    bl_idname = "pointmorph.make_mesh"
    bl_label = "Mesh of the Source"
    bl_options = {"REGISTER", "UNDO"}
    reason = staticmethod(pairs_reason)

    def change(self, context, obj):
        copy = carrying.make_mesh(context, obj)
        activate(context.view_layer.objects, copy)
        made = '"{name}" has the faces of "{source}"'
        self.report({"INFO"}, tell(made, name=copy.name, source=obj.pointmorph.source.name))
        return {"FINISHED"}


class POINTMORPH_OT_transfer_attributes(Computing, bpy.types.Operator):
    """Bring colours, weights and UV maps of the target over, to where its surface lands"""

    bl_idname = "pointmorph.transfer_attributes"
    bl_label = "Bring Over from Target"
    bl_options = {"REGISTER", "UNDO"}
    stopped = "It was stopped: nothing was brought over"

    poll = _OnResult.__dict__["poll"]
    reason = staticmethod(made_reason)

    colors: bpy.props.BoolProperty(
        name="Colours",
        description="Colour attributes. A mesh of the source shows them more and more with t",
        default=True,
    )
    weights: bpy.props.BoolProperty(
        name="Weights", description="Vertex groups, except features", default=True
    )
    uvs: bpy.props.BoolProperty(
        name="UV Maps",
        description="As point attributes: faces that lie across a seam of the target are smeared",
        default=False,
    )
    prefix: bpy.props.StringProperty(
        name="Prefix",
        description="Goes before the target's names, so that the source's own stay",
        default="target.",
    )

    def _begin_steps(self, context):
        obj = made_object(context)
        self._name = obj.name
        wanted = self._wanted = transferring.Wanted(
            self.colors, self.weights, self.uvs, self.prefix
        )
        return (yield from transferring.read_steps(context, obj, wanted))

    def _leave(self, context):
        self._steps.close()

    def _finish(self, context, outcome):
        obj = bpy.data.objects.get(self._name)
        if not result.is_made(obj):
            raise pointmorph.CloudError(
                self._name, "the object that attributes go to", "none", "Undo its removal."
            )
        names = transferring.write(obj, self._wanted, outcome)
        self.report({"INFO"}, tell("Brought over: {names}", names=", ".join(names)))
        return {"FINISHED"}


# --- Chains ---------------------------------------------------------------------------------------


def chain_reason(context):
    """Why no chain can be made of what is picked; None when one can."""
    shapes = states.picked_shapes(context.scene)
    if len(shapes) < 3:
        return "Add shapes between source and target first"
    if None in shapes:
        return "Pick an object for the source, the target and every shape between"
    for obj in shapes:
        if context.scene.objects.get(obj.name) != obj:
            return tell('"{name}" is no longer in the scene: pick another', name=obj.name)
    for obj, after in pairwise(shapes):
        if obj == after:
            return tell('"{name}" follows itself: take one of both out', name=obj.name)
    if len(shapes) > chains.LONGEST:
        many = "A chain has at most {most} shapes, and there are {count}"
        return tell(many, most=chains.LONGEST, count=len(shapes))
    return None


class POINTMORPH_OT_add_to_chain(bpy.types.Operator):
    """Add the selected objects, in the order of their names, as shapes between source and target;
    or the source and the target too when none is picked yet"""

    bl_idname = "pointmorph.add_to_chain"
    bl_label = "Add Selected"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if _selected_shapes(context):
            return True
        cls.poll_message_set("Select meshes or point clouds that aren't source or target")
        return False

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
        if obj.type in TYPES and obj not in picked and not result.is_made(obj)
    ]


class POINTMORPH_OT_change_chain(bpy.types.Operator):
    """Move the shape chosen in the list, or take it out of the chain"""

    bl_idname = "pointmorph.change_chain"
    bl_label = "Change the Chain"
    bl_options = {"REGISTER", "UNDO"}

    change: bpy.props.EnumProperty(
        name="Change",
        description="What happens to the shape",
        items=[
            ("UP", "Up", "Towards the source"),
            ("DOWN", "Down", "Towards the target"),
            ("REMOVE", "Remove", "Out of the chain; the object stays"),
        ],
        default="REMOVE",
    )

    @classmethod
    def poll(cls, context):
        if len(context.scene.pointmorph.via):
            return True
        cls.poll_message_set("There is no shape between source and target")
        return False

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


class POINTMORPH_OT_morph_chain(Computing, bpy.types.Operator):
    """Compute the morph from the source over all the shapes between to the target, as one object.
    In a window Blender stays usable; Esc stops it"""

    bl_idname = "pointmorph.morph_chain"
    bl_label = "Morph the Chain"
    bl_options = {"REGISTER", "UNDO"}
    stopped = "The chain was stopped"

    poll = _OnResult.__dict__["poll"]
    reason = staticmethod(chain_reason)

    def _begin_steps(self, context):
        sync_features(context.scene)
        settings = context.scene.pointmorph
        plan = self._plan = yield from recomputing.plan_of_steps(
            context,
            states.picked_shapes(context.scene),
            feature_choices(settings),
            [item.name for item in settings.loop],
            settings_values(settings),
        )
        self._names = [shape["name"] for shape in plan.recipe["shapes"]]
        return lambda progress: chains.compute_all(plan.requests, progress)

    def _finish(self, context, outcome):
        source, *via, target = (context.scene.objects.get(name) for name in self._names)
        obj = result.build(
            context,
            outcome,
            " to ".join(self._names),
            self._plan.origin,
            source,
            target,
            self._plan.source_matrix,
            via,
        )
        recipes.remember(obj, self._plan.recipe, outcome)
        activate(context.view_layer.objects, obj)
        say_made(self, obj, outcome.report)
        return {"FINISHED"}


_classes = (
    POINTMORPH_OT_recompute,
    POINTMORPH_OT_edit_morph,
    POINTMORPH_OT_follow,
    POINTMORPH_OT_make_mesh,
    POINTMORPH_OT_transfer_attributes,
    POINTMORPH_OT_add_to_chain,
    POINTMORPH_OT_change_chain,
    POINTMORPH_OT_morph_chain,
)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
