"""What the user does: morph, look at the quality."""

import json
import queue

import bpy
import numpy as np

from . import display, preview, previewing, recipes, result, session, transforms
from .checks import activate, active_result, busy_reason, possible, say_made, shapes_reason
from .computation import Earlier, compute
from .jobs import Computing
from .marking import say_what_was_found
from .properties import feature_choices, sync_features
from .reading import read_request_steps


class POINTMORPH_OT_morph(Computing, bpy.types.Operator):
    """Compute the morph from source to target. In a window Blender stays usable; Esc stops it"""

    bl_idname = "pointmorph.morph"
    bl_label = "Morph"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return possible(cls, busy_reason() or shapes_reason(context))

    stopped = "The morph was stopped"
    _value = 0.0  # of the key when the result comes
    _shown = ""  # name of the coarse morph's object

    def _begin_steps(self, context):
        request = self._request = yield from self._read(context)
        # A script gets the same whatever was done before it.
        earlier = session.earlier if self._in_window else None
        self._first_look = queue.SimpleQueue()
        with_preview = self._in_window and preview.is_worth_it(request)

        def work(progress):
            if with_preview:
                self._first_look.put(preview.compute(request, progress))
            return compute(request, progress, earlier)

        return work

    def _meanwhile(self, context):
        """Shows the coarse morph when it's there."""
        if self._first_look.empty():
            return
        outcome = self._first_look.get()
        if outcome is not None:
            self._shown = previewing.show(context, outcome, *self._made_of(context))

    def _leave(self, context):
        self._value = previewing.remove(self._shown)

    def _made_of(self, context):
        """What `result.build` needs besides the outcome."""
        source_name, target_name = self._names
        objects = context.scene.objects
        ends = objects.get(source_name), objects.get(target_name)
        return f"{source_name} to {target_name}", self._origin, *ends, self._source_matrix

    def _read(self, context):
        """The request. What _finish needs is kept by name: objects move in memory on undo."""
        sync_features(context.scene)
        request = yield from read_request_steps(context)
        say_what_was_found(context.scene, request)
        source = context.scene.pointmorph.source
        self._origin = np.array(source.matrix_world.translation)
        self._source_matrix = transforms.relative_to(source.matrix_world, self._origin)
        self._names = request.source.name, request.target.name
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
            session.earlier = Earlier(self._request, outcome.maps)
        obj = result.build(context, outcome, *self._made_of(context))
        result.morph_key(obj).value = self._value
        activate(context.view_layer.objects, obj)
        recipes.remember(obj, self._recipe, outcome)
        say_made(self, obj, outcome.report)
        return {"FINISHED"}


# --- Quality -----------------------------------------------------------------------------------


def report_of(obj):
    """What a morph object remembers of `Morph.report`; None when it's of an earlier version."""
    try:
        report = json.loads(obj.pointmorph.report)
    except ValueError:
        return None
    return report if "quality" in report else None


class POINTMORPH_OT_show_distortion(bpy.types.Operator):
    """Colour the points by how bad the map is: blue good, yellow bad, red folded; or undo that"""

    bl_idname = "pointmorph.show_distortion"
    bl_label = "Show Distortion"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        obj = active_result(context)
        if obj is None:
            cls.poll_message_set("Morph first, or make a morph object the active object")
            return False
        if not display.can_show_distortion(obj):
            cls.poll_message_set("This morph was made without it, or lost its points: morph again")
            return False
        return True

    def execute(self, context):
        obj = active_result(context)
        show = not display.shows_distortion(obj)
        display.show_distortion(obj, show)
        self._shade(context, obj.pointmorph, show)
        return {"FINISHED"}

    @staticmethod
    def _shade(context, remembered, show):
        """Solid shading knows one colour for all points: material preview meanwhile."""
        space = context.space_data
        if space is None or space.type != "VIEW_3D":
            return
        if show:
            plain = space.shading.type in {"WIREFRAME", "SOLID"}
            remembered.shading_before = space.shading.type if plain else ""
            if plain:
                space.shading.type = "MATERIAL"
        elif remembered.shading_before and space.shading.type == "MATERIAL":
            space.shading.type = remembered.shading_before


class POINTMORPH_OT_go_to_place(bpy.types.Operator):
    """Put the 3D cursor where the morph is bad"""

    bl_idname = "pointmorph.go_to_place"
    bl_label = "Go to the Place"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(
        name="Place", description="0 for the worst", default=0, min=0, max=4
    )

    @classmethod
    def poll(cls, context):
        obj = active_result(context)
        if obj is None:
            cls.poll_message_set("Morph first, or make a morph object the active object")
            return False
        report = report_of(obj)
        if report is None or not report["worst"]:
            cls.poll_message_set("This morph has no bad places")
            return False
        return True

    def execute(self, context):
        obj = active_result(context)
        places = report_of(obj)["worst"]
        place = places[min(self.index, len(places) - 1)]
        context.scene.cursor.location = result.world_position(obj, place["source"])
        self.report({"INFO"}, place["advice"])
        return {"FINISHED"}


_classes = (
    POINTMORPH_OT_morph,
    POINTMORPH_OT_show_distortion,
    POINTMORPH_OT_go_to_place,
)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    session.finish()
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
