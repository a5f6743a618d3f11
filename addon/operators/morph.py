"""Computes the morph from source to target."""

import queue

import bpy
import numpy as np

from ..core import background_job, preview, transforms
from ..core.computation import Earlier
from ..data import chains
from ..data.feature_list import feature_choices, sync_features
from ..data.references import find, reference_to
from ..data.registration import Registration
from ..scene import blended_textures, morph_builder, morph_object, preview_object, recipes
from ..scene.feature_marks import say_what_was_found
from ..scene.shape_reader import read_request_steps
from .modal_operator import Computing
from .polls import Explained, busy_reason, present, say_looks, shapes_reason


class POINTMORPH_OT_morph(Explained, Computing, bpy.types.Operator):
    """Compute the morph from source to target. Blender stays usable meanwhile, and Esc cancels"""

    bl_idname = "pointmorph.morph"
    bl_label = "Morph"
    bl_options = {"UNDO"}

    @staticmethod
    def reason(context):
        return busy_reason() or shapes_reason(context)

    stopped = "Morph canceled"
    _value = 0.0  # of the key when the result comes
    _shown = ""  # name of the coarse morph's object

    def _begin_steps(self, context):
        request = self._request = yield from self._read(context)
        # A script gets the same whatever was done before it.
        earlier = background_job.earlier if self._in_window else None
        self._first_look = queue.SimpleQueue()
        textures = blended_textures.wanted(context.scene)
        with_preview = self._in_window and preview.is_worth_it(request)

        def work(progress):
            if with_preview:
                self._first_look.put(preview.compute(request, progress))
            return chains.compute_all([request], progress, earlier, textures)

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
        provenance = morph_builder.Provenance(shapes, self._origin, self._source_matrix)
        return " to ".join(self._names), provenance

    def _read(self, context):
        """The request. What _finish needs is kept by reference: objects move in memory on undo."""
        sync_features(context.scene)
        request = yield from read_request_steps(context)
        say_what_was_found(context.scene, request)
        source = context.scene.pointmorph.source
        self._origin = np.array(source.matrix_world.translation)
        self._source_matrix = transforms.relative_to(source.matrix_world, self._origin)
        self._names = request.source.name, request.target.name
        self._shapes = [reference_to(source), reference_to(context.scene.pointmorph.target)]
        yield
        self._recipe = yield from recipes.take_down_steps(
            [source, context.scene.pointmorph.target],
            [request],
            self._origin,
            feature_choices(context.scene.pointmorph),
        )
        return request

    def _finish(self, context, outcome):
        if self._in_window:
            background_job.earlier = Earlier(self._request.without_looks(), outcome.maps)
        obj = morph_builder.build(context, outcome, *self._made_of(context))
        morph_object.morph_key(obj).value = self._value
        recipes.remember(obj, self._recipe, outcome)
        say_looks(self, [self._request])
        present(self, context, obj, outcome)
        return {"FINISHED"}


registration = Registration(
    classes=(POINTMORPH_OT_morph,),
)
