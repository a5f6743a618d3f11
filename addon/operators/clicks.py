"""Features by two clicks in Object Mode: one on the source, one on the target."""

import bpy

from ..data import areas
from ..data.feature_list import feature_names, sync_features
from ..data.registration import Registration
from ..scene import marked_points
from ..scene.feature_marks import mark, next_name, unmarkable
from ..view import click_targets, markers
from .polls import Explained, shapes_reason

running = False
"""Whether the operator waits for clicks."""


def asked_for(settings, name=""):
    """What a click marks: the feature's name, and on which objects it's missing.

    It's `name`, else the first feature of the list that is marked on one object only, else a new
    one.
    """
    objects = (settings.source, settings.target)
    if not name:
        partly = [f.marked_name for f in settings.features if f.on_source != f.on_target]
        name = partly[0] if partly else next_name(settings, objects)
    return name, [obj for obj in objects if name not in feature_names(obj)]


class POINTMORPH_OT_click_features(Explained, bpy.types.Operator):
    """Mark features by clicking a place on one object, then the same place on the other.
    Ctrl Z undoes a click, Esc or right-click finishes"""

    bl_idname = "pointmorph.click_features"
    bl_label = "Mark by Clicking"
    # Each click is an undo step of its own.
    bl_options = {"REGISTER"}

    name: bpy.props.StringProperty(
        name="Name",
        description="Feature to mark or move. If empty, features marked on only one object are "
        "completed first, and then new ones are added",
        options={"SKIP_SAVE"},
    )

    @staticmethod
    def reason(context):
        reason = shapes_reason(context) or unmarkable(context)
        if reason is None and running:
            reason = "Already waiting for clicks: press Esc to finish"
        return reason

    def invoke(self, context, event):
        global running
        running = True
        settings = context.scene.pointmorph
        sync_features(context.scene)
        for obj in (settings.source, settings.target):
            if context.view_layer.objects.get(obj.name) == obj:
                obj.hide_set(False)  # a morph hides them
        settings.show_markers = True
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("CROSSHAIR")
        self._say(context)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        self.report({"ERROR"}, "Clicking needs a window: in scripts, use add_feature")
        return {"CANCELLED"}

    def modal(self, context, event):
        try:
            return self._handle(context, event)
        except BaseException:
            self.cancel(context)
            raise

    def _handle(self, context, event):
        if event.type in {"ESC", "RIGHTMOUSE", "RET"} and event.value == "PRESS":
            self.cancel(context)
            return {"FINISHED"}
        if shapes_reason(context) or unmarkable(context):
            self.cancel(context)  # objects went, or the mode changed
            return {"CANCELLED"}
        where = click_targets.viewport_at(context.window, event.mouse_x, event.mouse_y)
        if event.type == "MOUSEMOVE":
            self._follow(context, where)
        elif (
            event.type == "LEFTMOUSE"
            and event.value == "PRESS"
            and not click_targets.navigates(event, where)
        ):
            self._click(context, where)
            return {"RUNNING_MODAL"}
        elif event.type in {"Z", "Y"}:
            self._say(context)
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Also called by Blender when the window or the file is closed."""
        global running
        running = False
        markers.hint, markers.hover = "", None
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        areas.redraw_viewports()

    def _follow(self, context, where):
        """Shows which vertex a click would take."""
        hit = None if where is None else click_targets.pick(context, *where)
        before = markers.hover
        if hit is None:
            markers.hover = None
        else:
            depsgraph = context.evaluated_depsgraph_get()
            markers.hover = tuple(marked_points.place_of(*hit, depsgraph))
        self._say(context)
        if markers.hover != before:
            areas.redraw_viewports()

    def _click(self, context, where):
        settings = context.scene.pointmorph
        hit = click_targets.pick(context, *where)
        if hit is None:
            where = f'"{settings.source.name}" or "{settings.target.name}"'
            self.report({"INFO"}, f"Click on {where}")
            return
        obj, row = hit
        name, _ = asked_for(settings, self.name)
        for other, known in marked_points.marks_of(obj, wait=True).items():
            if other != name and known is not None and known.count == 1 and known.row == row:
                there = f'"{other}" is already there: click another vertex'
                self.report({"WARNING"}, there)
                return
        mark(obj, name, [row])
        sync_features(context.scene)
        settings.active_feature = settings.features.find(name)
        settings.features[name].confidence = -1.0
        bpy.ops.ed.undo_push(message=f'Mark "{name}" on {obj.name}')
        self._say(context)
        areas.redraw_viewports()

    def _say(self, context):
        """What to click next, in the viewports and in the status bar."""
        settings = context.scene.pointmorph
        name, missing = asked_for(settings, self.name)
        on = missing[0] if missing else settings.source
        if len(missing) == 1:
            text = f'"{name}": click the same place on {on.name}'
        elif missing:
            either = f"{settings.source.name} or {settings.target.name}"
            text = f'New feature "{name}": click a place on {either}'
        else:
            text = f'"{name}": click where it belongs'
        if text != markers.hint:
            markers.hint = text
            areas.redraw_viewports()
        context.workspace.status_text_set(f"{text}     Ctrl Z: Undo     Esc: Finish")


registration = Registration(
    classes=(POINTMORPH_OT_click_features,),
)
