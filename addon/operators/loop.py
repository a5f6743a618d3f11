"""The loop of features along which closed models are cut: chosen, proposed, shown beforehand."""

import bpy
import numpy as np
import pointmorph

from ..core import transforms
from ..data import areas, feature_list
from ..data.feature_list import sync_features
from ..data.registration import Registration
from ..scene.panel_request import read_request
from ..view import cut_curves
from .modal_operator import Computing
from .polls import Explained, busy_reason, fail, shapes_reason


def _loop_reason(settings):
    """Why the loop isn't one; None when it is."""
    names = [feature.name for feature in settings.loop]
    if len(names) < 3:
        return "Add at least three features to the loop, or use Suggest Loop"
    marked = {f.marked_name for f in settings.features if f.on_source and f.on_target and f.use}
    for name in names:
        if name not in marked:
            return f'"{name}" isn\'t marked on both objects: mark it, or remove it from the loop'
    return None


class _Loop(Explained):
    """An operator on the list of the loop's features."""

    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        settings = context.scene.pointmorph
        chosen = 0 <= settings.active_loop < len(settings.loop)
        return None if chosen else "Select a feature in the loop"


class POINTMORPH_OT_add_loop_feature(Explained, bpy.types.Operator):
    """Add a feature to the loop, after the selected one"""

    bl_idname = "pointmorph.add_loop_feature"
    bl_label = "Add to Loop"
    bl_options = {"REGISTER", "UNDO"}

    name: bpy.props.StringProperty(
        name="Name",
        description="Name of the feature. If empty, the one selected in the list of features",
        options={"SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        settings = context.scene.pointmorph
        chosen = 0 <= settings.active_feature < len(settings.features)
        return None if chosen else "Select a feature in the list"

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        name = self.name or settings.features[settings.active_feature].name
        problem = None
        if name not in settings.features:
            problem = "a marked feature", "none of that name", "Check the name."
        elif name in settings.loop:
            problem = (
                "each feature only once",
                "it twice",
                "A loop passes through each feature once.",
            )
        if problem is not None:
            return fail(self, pointmorph.FeatureError(f'feature "{name}"', *problem))
        settings.loop.add().name = name
        place = min(settings.active_loop + 1, len(settings.loop) - 1)
        settings.loop.move(len(settings.loop) - 1, place)
        settings.active_loop = place
        cut_curves.shown.clear()
        return {"FINISHED"}


class POINTMORPH_OT_remove_loop_feature(_Loop, bpy.types.Operator):
    """Remove the selected feature from the loop. It stays a feature"""

    bl_idname = "pointmorph.remove_loop_feature"
    bl_label = "Remove from Loop"

    def execute(self, context):
        settings = context.scene.pointmorph
        settings.loop.remove(settings.active_loop)
        settings.active_loop = max(0, min(settings.active_loop, len(settings.loop) - 1))
        cut_curves.shown.clear()
        return {"FINISHED"}


class POINTMORPH_OT_move_loop_feature(_Loop, bpy.types.Operator):
    """Move the selected feature to an earlier or later place in the loop"""

    bl_idname = "pointmorph.move_loop_feature"
    bl_label = "Move in Loop"

    direction: bpy.props.EnumProperty(
        name="Direction",
        description="Which way to move it",
        items=[("UP", "Up", "One place earlier"), ("DOWN", "Down", "One place later")],
    )

    def execute(self, context):
        settings = context.scene.pointmorph
        place = settings.active_loop + (-1 if self.direction == "UP" else 1)
        place %= len(settings.loop)
        settings.loop.move(settings.active_loop, place)
        settings.active_loop = place
        cut_curves.shown.clear()
        return {"FINISHED"}


class POINTMORPH_OT_clear_loop(_Loop, bpy.types.Operator):
    """Remove all features from the loop. They stay features"""

    bl_idname = "pointmorph.clear_loop"
    bl_label = "Clear Loop"

    def execute(self, context):
        feature_list.set_loop(context.scene.pointmorph, [])
        cut_curves.shown.clear()
        return {"FINISHED"}


class _Curves(Computing):
    """Finds curves on both objects and has them drawn."""

    place = "CUT"
    stopped = "Cut search canceled"

    def _read(self, context):
        sync_features(context.scene)
        request = read_request(context)
        self._names = request.source.name, request.target.name
        source = context.scene.pointmorph.source
        self._origin = np.array(source.matrix_world.translation)
        return request

    def _show(self, context, curves):
        cut_curves.shown.clear()
        for name, curve in zip(self._names, curves, strict=True):
            obj = context.scene.objects.get(name)
            if obj is not None:
                world = curve.astype(np.float64) + self._origin
                cut_curves.shown[name] = transforms.apply(obj.matrix_world.inverted_safe(), world)
        if not bpy.app.background:
            areas.redraw_viewports()


def _settings(request):
    """Those that a cut takes notice of."""
    return {k: v for k, v in request.settings.items() if k not in ("method", "domain")}


def _curves_of(request, loop, progress):
    """The curve through the loop on both shapes."""
    curves = []
    for side, shape in enumerate((request.source, request.target)):
        rows = {name: request.features[name][side] for name in loop}
        cut = pointmorph.decompose(shape.cloud(), rows, progress=progress, **_settings(request))
        curves.append(cut.curve)
    return curves


class POINTMORPH_OT_show_cut(Explained, _Curves, bpy.types.Operator):
    """Show where the loop would cut both objects. Press again to hide it"""

    bl_idname = "pointmorph.show_cut"
    bl_label = "Show Cut"
    bl_options = set()

    @staticmethod
    def reason(context):
        reason = busy_reason() or shapes_reason(context)
        if reason is None and not cut_curves.shown:
            reason = _loop_reason(context.scene.pointmorph)
        return reason

    def invoke(self, context, event):
        if not cut_curves.shown:
            return super().invoke(context, event)
        cut_curves.shown.clear()
        areas.redraw_viewports()
        return {"FINISHED"}

    def _begin(self, context):
        request = self._read(context)
        loop = request.loop
        return lambda progress: _curves_of(request, loop, progress)

    def _finish(self, context, curves):
        self._show(context, curves)
        return {"FINISHED"}


class POINTMORPH_OT_propose_loop(Explained, _Curves, bpy.types.Operator):
    """Find a loop through the features at the tips of both objects, and show the cut"""

    bl_idname = "pointmorph.propose_loop"
    bl_label = "Suggest Loop"
    bl_options = {"UNDO"}

    @staticmethod
    def reason(context):
        return busy_reason() or shapes_reason(context)

    def _begin(self, context):
        request = self._read(context)

        def compute(progress):
            loop = pointmorph.propose_loop(
                request.source.cloud(),
                request.target.cloud(),
                request.features,
                progress=progress,
                **_settings(request),
            )
            return loop, _curves_of(request, loop, progress)

        return compute

    def _finish(self, context, outcome):
        loop, curves = outcome
        feature_list.set_loop(context.scene.pointmorph, loop)
        self._show(context, curves)
        self.report({"INFO"}, f"Loop: {', '.join(loop)}")
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_add_loop_feature,
        POINTMORPH_OT_remove_loop_feature,
        POINTMORPH_OT_move_loop_feature,
        POINTMORPH_OT_clear_loop,
        POINTMORPH_OT_show_cut,
        POINTMORPH_OT_propose_loop,
    ),
)
