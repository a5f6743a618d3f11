"""The loop of features along which closed models are cut: chosen, proposed, shown beforehand."""

import bpy
import gpu
import numpy as np
import pointmorph
from gpu_extras.batch import batch_for_shader

from . import markers, session, transforms
from .checks import busy_reason, fail, possible, shapes_reason
from .jobs import Computing
from .properties import sync_features
from .reading import read_request
from .translations import tell

_COLOR = (1.0, 0.55, 0.1, 1.0)

shown = {}
"""By the name of an object, the curve that was last looked at: (K, 3) in its own space."""

_handle = None


def _loop_reason(settings):
    """Why the loop isn't one; None when it is."""
    names = [feature.name for feature in settings.loop]
    if len(names) < 3:
        return "List at least three features in the loop, or let one be proposed"
    marked = {f.marked_name for f in settings.features if f.on_source and f.on_target and f.use}
    for name in names:
        if name not in marked:
            unmarked = '"{name}" isn\'t marked on both objects: take it out of the loop, or mark it'
            return tell(unmarked, name=name)
    return None


def set_loop(settings, names):
    settings.loop.clear()
    for name in names:
        settings.loop.add().name = name
    settings.active_loop = 0


class _Loop:
    """An operator on the list of the loop's features."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        settings = context.scene.pointmorph
        if 0 <= settings.active_loop < len(settings.loop):
            return True
        cls.poll_message_set("Choose a feature of the loop")
        return False


class POINTMORPH_OT_add_loop_feature(bpy.types.Operator):
    """Add a feature to the loop, after the one that is chosen there"""

    bl_idname = "pointmorph.add_loop_feature"
    bl_label = "Add to Loop"
    bl_options = {"REGISTER", "UNDO"}

    name: bpy.props.StringProperty(
        name="Name",
        description="The feature; without one, that which is chosen in the list of features",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context):
        settings = context.scene.pointmorph
        if 0 <= settings.active_feature < len(settings.features):
            return True
        cls.poll_message_set("Choose a feature in the list")
        return False

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        name = self.name or settings.features[settings.active_feature].name
        problem = None
        if name not in settings.features:
            problem = "one that is marked", "none of that name", "Check the name."
        elif name in settings.loop:
            problem = "each feature once", "it twice", "A loop passes each feature once."
        if problem is not None:
            return fail(self, pointmorph.FeatureError(f'feature "{name}"', *problem))
        settings.loop.add().name = name
        place = min(settings.active_loop + 1, len(settings.loop) - 1)
        settings.loop.move(len(settings.loop) - 1, place)
        settings.active_loop = place
        shown.clear()
        return {"FINISHED"}


class POINTMORPH_OT_remove_loop_feature(_Loop, bpy.types.Operator):
    """Take the chosen feature out of the loop; it stays a feature"""

    bl_idname = "pointmorph.remove_loop_feature"
    bl_label = "Remove from Loop"

    def execute(self, context):
        settings = context.scene.pointmorph
        settings.loop.remove(settings.active_loop)
        settings.active_loop = max(0, min(settings.active_loop, len(settings.loop) - 1))
        shown.clear()
        return {"FINISHED"}


class POINTMORPH_OT_move_loop_feature(_Loop, bpy.types.Operator):
    """Have the loop pass the chosen feature earlier or later"""

    bl_idname = "pointmorph.move_loop_feature"
    bl_label = "Move in Loop"

    direction: bpy.props.EnumProperty(
        name="Direction",
        description="Where to in the list",
        items=[("UP", "Up", "One earlier"), ("DOWN", "Down", "One later")],
    )

    def execute(self, context):
        settings = context.scene.pointmorph
        place = settings.active_loop + (-1 if self.direction == "UP" else 1)
        place %= len(settings.loop)
        settings.loop.move(settings.active_loop, place)
        settings.active_loop = place
        shown.clear()
        return {"FINISHED"}


class POINTMORPH_OT_clear_loop(_Loop, bpy.types.Operator):
    """Empty the loop; the features stay"""

    bl_idname = "pointmorph.clear_loop"
    bl_label = "Clear Loop"

    def execute(self, context):
        set_loop(context.scene.pointmorph, [])
        shown.clear()
        return {"FINISHED"}


class _Curves(Computing):
    """Finds curves on both objects and has them drawn."""

    stopped = "The search for the cut was stopped"

    def _read(self, context):
        sync_features(context.scene)
        request = read_request(context)
        self._names = request.source.name, request.target.name
        source = context.scene.pointmorph.source
        self._origin = np.array(source.matrix_world.translation)
        return request

    def _show(self, context, curves):
        shown.clear()
        for name, curve in zip(self._names, curves, strict=True):
            obj = context.scene.objects.get(name)
            if obj is not None:
                world = curve.astype(np.float64) + self._origin
                shown[name] = transforms.apply(obj.matrix_world.inverted_safe(), world)
        if not bpy.app.background:
            markers.redraw()


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


class POINTMORPH_OT_show_cut(_Curves, bpy.types.Operator):
    """Show on both objects where the loop would cut them; once more, and it's hidden"""

    bl_idname = "pointmorph.show_cut"
    bl_label = "Show Cut"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context):
        reason = busy_reason() or shapes_reason(context)
        return possible(cls, reason or (None if shown else _loop_reason(context.scene.pointmorph)))

    def invoke(self, context, event):
        if not shown:
            return super().invoke(context, event)
        shown.clear()
        markers.redraw()
        return {"FINISHED"}

    def _begin(self, context):
        request = self._read(context)
        loop = request.loop
        return lambda progress: _curves_of(request, loop, progress)

    def _finish(self, context, curves):
        self._show(context, curves)
        return {"FINISHED"}


class POINTMORPH_OT_propose_loop(_Curves, bpy.types.Operator):
    """Find an order in which a curve runs through the features on tips of both, and show it"""

    bl_idname = "pointmorph.propose_loop"
    bl_label = "Propose Loop"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return possible(cls, busy_reason() or shapes_reason(context))

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
        set_loop(context.scene.pointmorph, loop)
        self._show(context, curves)
        self.report({"INFO"}, tell("Loop: {names}", names=", ".join(loop)))
        return {"FINISHED"}


# --- Drawing --------------------------------------------------------------------------------------


def _draw():
    context = bpy.context
    settings, space = context.scene.pointmorph, context.space_data
    if not shown or not space.overlay.show_overlays:
        return
    for obj in (settings.source, settings.target):
        if obj is None or obj.name not in shown or not obj.visible_get(viewport=space):
            continue
        world = transforms.apply(obj.matrix_world, shown[obj.name])
        _draw_line(np.concatenate([world, world[:1]]))


def _draw_line(points):
    new = bpy.app.version >= (4, 0, 0)
    shader = gpu.shader.from_builtin(
        "POLYLINE_UNIFORM_COLOR" if new else "3D_POLYLINE_UNIFORM_COLOR"
    )
    batch = batch_for_shader(shader, "LINE_STRIP", {"pos": points.astype(np.float32).tolist()})
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    gpu.state.blend_set("ALPHA")
    # What is behind the model shines through.
    for test, color, width in (("NONE", (*_COLOR[:3], 0.3), 2.0), ("LESS_EQUAL", _COLOR, 4.0)):
        gpu.state.depth_test_set(test)
        shader.uniform_float("lineWidth", width)
        shader.uniform_float("color", color)
        batch.draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


_classes = (
    POINTMORPH_OT_add_loop_feature,
    POINTMORPH_OT_remove_loop_feature,
    POINTMORPH_OT_move_loop_feature,
    POINTMORPH_OT_clear_loop,
    POINTMORPH_OT_show_cut,
    POINTMORPH_OT_propose_loop,
)


def register():
    global _handle
    for cls in _classes:
        bpy.utils.register_class(cls)
    if not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister():
    global _handle
    session.finish()
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    shown.clear()
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
