"""Computes the morph of the picked shapes: from source to target, and through those in between."""

import contextlib
import queue

import bpy
import pointmorph

from ..core import preview
from ..data import chains
from ..data.arrays import MADE_TYPES
from ..data.feature_list import sync_features
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import (
    as_shown,
    blended_textures,
    joined,
    morph_builder,
    morph_object,
    morphing_mesh,
    presentation,
    preview_object,
    recipes,
    recomputation,
    staleness,
)
from ..scene.feature_marks import say_what_was_found
from ..scene.shape_reader import update
from .polls import (
    Explained,
    busy_reason,
    morph_reason,
    morphs_selected,
    pick_selected,
    picked_result,
    present,
    say_looks,
)
from .recompute import Recomputing, leave_mode


class _Morphing(Recomputing):
    """Makes the morph object of the picked shapes, or computes the one that they have again."""

    new_result: bpy.props.BoolProperty(
        name="New Result",
        description="Create another morph object even if these objects have one, as Alt-click does",
        default=False,
        options={"SKIP_SAVE"},
    )

    stopped = "Morph canceled"
    _value = 0.0  # of the key when the result comes
    _shown = ""  # name of the coarse morph's object
    _made = None  # what is computed again
    _copies = ()  # references to those of shapes as shown, and how these were hidden
    _originals = {}  # by the name of each copy, that of its original
    _renewed = ()  # references to those that a morph had already, and to their meshes before
    _applied = _kept = _dropped = ()  # names of what changes the source

    def invoke(self, context, event):
        self.new_result = self.new_result or event.alt
        return super().invoke(context, event)

    def _begin_steps(self, context):
        leave_mode(context, staleness.picked_shapes(context.scene), hides=True)
        self._first_look = queue.SimpleQueue()
        if morphs_selected(context):
            pick_selected(context)
        sync_features(context.scene)
        there = self._take_as_shown(context)
        shapes = staleness.picked_shapes(context.scene)
        if there is not None:
            work = yield from self.begin_again(context, there)
        else:
            work = yield from self._begin_new(context, shapes)
        if len(shapes) == 2:
            say_what_was_found(context.scene, self._plan.requests[0])
        return work

    def _take_as_shown(self, context):
        """Puts copies in place of a source with what can't go along with a morph applied, and of
        all shapes that are no meshes. Returns the morph that is to be computed again, if any: the
        copies that it was made of get their present form."""
        settings = context.scene.pointmorph
        shapes = staleness.picked_shapes(context.scene)
        self._kept = self._applied = self._dropped = ()
        self._copies, self._renewed, self._originals = [], [], {}
        if None in shapes:
            raise pointmorph.CloudError(
                "Source and Target", "two objects", "one that is gone", "Choose it again."
            )
        update(context, *dict.fromkeys(shapes))
        names = as_shown.changed_by(context, settings.source)
        if settings.source.pointmorph.keep_modifiers:
            self._kept = names
        elif not self._is_moved_by_rig(context):
            self._applied = names
        self._dropped = as_shown.dropped_by(settings.source) if self._applied else ()
        taken = [
            shape
            for shape in dict.fromkeys(shapes)
            if shape.type in MADE_TYPES or (shape == settings.source and self._applied)
        ]

        def fits(scene, obj):
            picked, made_of = staleness.picked_shapes(scene), recipes.shapes_of(obj)
            return all(
                made.pointmorph.shown_from == shape if shape in taken else made == shape
                for shape, made in zip(picked, made_of, strict=True)
            )

        there = None if self.new_result else picked_result(context, fits)
        known = {} if there is None else dict(zip(shapes, recipes.shapes_of(there), strict=True))
        for shape in taken:
            before = as_shown.visibility_of(shape)
            if there is None:
                copy = as_shown.copy_as_shown(context, shape)
                self._copies.append((reference_to(copy), before))
            else:
                copy = known[shape]
                mesh = as_shown.renew(context, copy)
                self._renewed.append((reference_to(copy), reference_to(mesh), before))
            self._originals[copy.name] = shape.name
            staleness.pick_instead(settings, shape, copy)
            update(context, copy)
        return there

    def _is_moved_by_rig(self, context):
        """Whether these shapes have a morph that the source's rig moves, and nothing else does:
        that is computed again, in any pose."""
        source = context.scene.pointmorph.source
        there = None if self.new_result else picked_result(context, staleness.is_exactly_picked)
        return (
            there is not None
            and morph_object.shown_of(there).pointmorph.keeps_faces
            and as_shown.is_rigged(source)
            and not as_shown.is_changed_in_any_case(source)
        )

    def _told(self, error):
        """Nobody finds the copies of which it is: they are taken back."""
        words = [error.subject, error.expected, error.found, error.advice]
        for copy in sorted(self._originals, key=len, reverse=True):  # "… as Shown.001" first
            words = [text.replace(copy, self._originals[copy]) for text in words]
        return type(error)(*words)

    def _take_copies_back(self, context):
        """After an error, or Esc, the shapes are what they were."""
        copies, self._copies = self._copies, ()
        for reference, before in copies:
            copy = find(bpy.data.objects, reference)
            if copy is not None:
                for scene in bpy.data.scenes:
                    staleness.pick_instead(scene.pointmorph, copy, copy.pointmorph.shown_from)
                as_shown.remove(context, copy, before)
        renewed, self._renewed = self._renewed, ()
        for reference, mesh, before in renewed:
            copy, old = find(bpy.data.objects, reference), find(bpy.data.meshes, mesh)
            if copy is not None and old is not None:
                for scene in bpy.data.scenes:
                    staleness.pick_instead(scene.pointmorph, copy, copy.pointmorph.shown_from)
                as_shown.put_back(context, copy, old, before)

    def _say_applied(self, context, obj, shapes):
        """What became of the source's modifiers and shape keys, and of what is no mesh."""
        made = [recipes.original_of(shape) for shape in dict.fromkeys(shapes) if shape is not None]
        made = [f'"{shape.name}"' for shape in made if shape.type in MADE_TYPES]
        if made and self._copies:
            self.report({"INFO"}, f"Morphed as meshes, which are copies: {', '.join(made)}")
        if self._dropped:
            self.report(
                {"WARNING"},
                f"The morph goes without {', '.join(self._dropped)} of the source, which can't be "
                "applied",
            )
        if self._applied and shapes[0] is not None:
            original = recipes.original_of(shapes[0])
            how = as_shown.how_to_keep(original, f'"{original.name}"')
            self.report(
                {"INFO"},
                f"The source was morphed as shown, with {', '.join(self._applied)} applied. To "
                f"keep what was applied, {how}",
            )
        for shape in dict.fromkeys(shapes):
            if words := shape and joined.left_behind(context, recipes.original_of(shape), shapes):
                self.report({"INFO"}, words)
        shown = morph_object.shown_of(obj)
        left = morphing_mesh.left_off(shapes[0]) if shapes[0] is not None else ()
        kept = [name for name in self._kept if name not in left]
        if kept and shown != obj:
            self.report(
                {"WARNING"},
                f'"{shown.name}" keeps {", ".join(kept)} of the source: they change the target '
                "as well. Turn off Keep Modifiers for a morph that ends exactly there",
            )

    def execute(self, context):
        try:
            done = super().execute(context)
        except BaseException:  # Ctrl-C
            self._take_copies_back(context)
            raise
        if done == {"CANCELLED"}:
            self._take_copies_back(context)
        return done

    def cancel(self, context):
        super().cancel(context)
        with contextlib.ExitStack() as there:
            with contextlib.suppress(pointmorph.CloudError):  # that scene is gone
                there.enter_context(self._where_it_began(context))
            self._take_copies_back(bpy.context)

    def _begin_new(self, context, shapes):
        self._shapes = [reference_to(shape) for shape in shapes]
        plan = self._plan = yield from recomputation.plan_of_steps(
            context,
            shapes,
            recomputation.chosen_in(context.scene.pointmorph),
            blended_textures.wanted(context.scene),
        )
        earlier = self._starts(plan)
        textures = blended_textures.wanted(context.scene)
        one = plan.requests[0] if len(plan.requests) == 1 else None
        with_preview = self._in_window and one is not None and preview.is_worth_it(one)

        def work(progress):
            if with_preview:
                self._first_look.put(preview.compute(one, progress))
            return chains.compute_all(plan.requests, progress, earlier, textures)

        return work

    def _meanwhile(self, context):
        """Shows the coarse morph when it's there."""
        if self._first_look.empty():
            return
        outcome = self._first_look.get()
        if outcome is not None:
            self._shown = preview_object.show(context, outcome, *self._made_of(context))

    def _leave(self, context):
        self._value = preview_object.remove(self._shown)

    def _made_of(self, context):
        """What `morph_builder.build` needs besides the outcome."""
        shapes = [find(context.scene.objects, shape) for shape in self._shapes]
        known = [shape["name"] for shape in self._plan.recipe["shapes"]]
        for number, shape in enumerate(shapes):
            if shape is not None and recipes.original_of(shape) != shape:
                known[number] = recipes.original_of(shape).name
        name = " to ".join(known)
        return name, self._plan.provenance(shapes)

    def _check_copies(self):
        """Undo, while it was computed, may have taken the copies away."""
        for reference, *_ in (*self._copies, *self._renewed):
            if find(bpy.data.objects, reference) is None:
                raise pointmorph.CloudError(
                    "copy",
                    "the copy that is being morphed",
                    "none: it is gone after undo",
                    "Press Morph again.",
                )

    def _finish(self, context, outcome):
        self._check_copies()
        if self._made is not None:
            obj = self.finish_again(context, outcome)
        else:
            self._remember(outcome)
            obj = morph_builder.build(context, outcome, *self._made_of(context))
            morph_object.morph_key(obj).value = self._value
            recipes.remember(obj, self._plan.recipe, outcome)
        say_looks(self, self._plan.requests)
        again = self._made is not None
        with presentation.or_as_before(context, obj, not again):
            present(self, context, obj, outcome, again)
            self._say_applied(context, obj, recipes.shapes_of(obj))
        for reference, mesh, *_ in self._renewed:
            old = find(bpy.data.meshes, mesh)
            if old is not None and not old.users:
                name = old.name
                bpy.data.meshes.remove(old)
                find(bpy.data.objects, reference).data.name = name
        return {"FINISHED"}


def _mode_reason(context):
    """Why the result that is there can't be computed again: somebody is at work on what shows it;
    None when it can, or there is none."""
    if context.mode == "OBJECT":
        return None
    there = picked_result(context, staleness.is_picked)
    shown = there if there is None else morph_object.shown_of(there)
    for obj in (there, shown):
        if obj is not None and obj.mode != "OBJECT":
            return f'Switch "{obj.name}" to Object Mode first (Tab)'
    return None


class POINTMORPH_OT_morph(Explained, _Morphing, bpy.types.Operator):
    """Compute the morph from source to target. If none are chosen, the selected objects are
    used: the active one, selected last, is the target. If these objects have a morph, it is
    computed again in place; Alt-click makes another. Blender stays usable, and Esc cancels"""

    bl_idname = "pointmorph.morph"
    bl_label = "Morph"
    bl_options = {"UNDO"}

    @staticmethod
    def reason(context):
        return busy_reason() or morph_reason(context) or _mode_reason(context)


class POINTMORPH_OT_morph_chain(Explained, _Morphing, bpy.types.Operator):
    """Compute the morph from the source through all shapes in between to the target, as Morph
    does"""

    bl_idname = "pointmorph.morph_chain"
    bl_label = "Morph Chain"
    bl_options = {"UNDO"}

    @staticmethod
    def reason(context):
        if busy_reason():
            return busy_reason()
        if len(context.scene.pointmorph.via) == 0:
            return "Add shapes between the source and target first"
        return morph_reason(context) or _mode_reason(context)


registration = Registration(
    classes=(
        POINTMORPH_OT_morph,
        POINTMORPH_OT_morph_chain,
    ),
)
