"""Features by two clicks in Object Mode: one on the source, one on the target. A mark that is there
is dragged, and the morph follows."""

import bpy

from ..core import background_job, live_follower
from ..data import areas
from ..data.feature_list import feature_names, sync_features
from ..data.registration import Registration
from ..scene import live_preview, marked_points
from ..scene.feature_marks import mark, next_name, unmarkable
from ..view import click_targets, markers
from .polls import Explained, picked_result, shapes_reason

_STEP = 0.02  # seconds between two looks at what has been found
_STARTS = 4  # pixels that make a click a drag

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


class _Drag:
    """A mark that is held by the mouse. Nothing is marked until it is let go."""

    def __init__(self, context, obj, name, at):
        settings = context.scene.pointmorph
        self.name, self.of = name, obj.name
        self.row = None
        self.is_moving = False
        self._at = at
        self._side = 0 if obj == settings.source else 1
        self._hidden = None
        self._preview = None
        result = picked_result(context)
        follower = live_preview.follower_of(context.scene, result)
        if live_preview.can_follow(follower, name):
            self._preview = live_preview.LivePreview(result, follower)

    @property
    def follows(self):
        """Whether a morph follows."""
        return self._preview is not None

    def begins_at(self, context, x, y):
        """Whether the mouse has gone far enough to mean it."""
        if not self.is_moving and max(abs(x - self._at[0]), abs(y - self._at[1])) >= _STARTS:
            self.is_moving = True
            source = context.scene.pointmorph.source
            # It lies where the morph does.
            if self.follows and self._side == 1 and not source.hide_get():
                source.hide_set(True)
                self._hidden = source.name
        return self.is_moving

    def move(self, row):
        if row == self.row:
            return
        self.row = row
        markers.dragged = self.of, self.name, row
        if self.follows:
            self._preview.ask(self.name, self._side, row)

    def show(self):
        """Whether there was something new to show."""
        return self.follows and self._preview.show(bpy.data.objects)

    def end(self, keeps):
        """Has what is shown stay, or go back to what it was."""
        markers.dragged = None
        source = bpy.data.objects.get(self._hidden) if self._hidden else None
        if source is not None:
            source.hide_set(False)
        if self.follows and not keeps:
            self._preview.put_back(bpy.data.objects)


class POINTMORPH_OT_click_features(Explained, bpy.types.Operator):
    """Mark features by clicking a place on one object, then the same place on the other. Drag a
    mark to move it: the morph follows. Ctrl Z undoes a click, Esc or right-click finishes"""

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
        self._drag = self._timer = None
        settings = context.scene.pointmorph
        sync_features(context.scene)
        for obj in (settings.source, settings.target):
            if context.view_layer.objects.get(obj.name) == obj:
                obj.hide_set(False)  # a morph hides them
        settings.show_markers = True
        context.window_manager.modal_handler_add(self)
        context.window.cursor_modal_set("CROSSHAIR")
        # Begins to prepare, so that the first drag is followed.
        live_preview.follower_of(context.scene, picked_result(context))
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
        if self._drag is not None:
            return self._handle_drag(context, event)
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
            if not self._take_hold(context, event, where):
                self._click(context, where)
            return {"RUNNING_MODAL"}
        elif event.type in {"Z", "Y"}:
            self._say(context)
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Also called by Blender when the window or the file is closed."""
        global running
        running = False
        self._let_go(context, keeps=False)
        live_follower.stop()
        markers.hint, markers.hover = "", None
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        areas.redraw_viewports()

    def _take_hold(self, context, event, where):
        """Whether there is a mark under the mouse."""
        found = None if self.name else markers.mark_at(context, *where)
        if found is None:
            return False
        job = background_job.current
        if job is not None and job.place == "RESULT":
            job.cancel()  # it computes what is about to change again
        obj, name = found
        settings = context.scene.pointmorph
        settings.active_feature = settings.features.find(name)
        self._drag = _Drag(context, obj, name, (event.mouse_x, event.mouse_y))
        self._timer = context.window_manager.event_timer_add(_STEP, window=context.window)
        markers.hover = None
        areas.redraw_viewports()
        return True

    def _handle_drag(self, context, event):
        drag = self._drag
        if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            self._let_go(context, keeps=False)
            self._say(context)
        elif shapes_reason(context) or unmarkable(context):
            self.cancel(context)
            return {"CANCELLED"}
        elif event.type == "MOUSEMOVE" and drag.begins_at(context, event.mouse_x, event.mouse_y):
            where = click_targets.viewport_at(context.window, event.mouse_x, event.mouse_y)
            hit = None if where is None else click_targets.pick(context, *where)
            if hit is not None and hit[0].name == drag.of:
                drag.move(hit[1])
            self._say(context)
            areas.redraw_viewports()
        elif event.type == "TIMER":
            if drag.show():
                areas.redraw_viewports()
            return {"PASS_THROUGH"}
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._drop(context)
        return {"RUNNING_MODAL"}

    def _drop(self, context):
        """Marks the place where the mouse is let go, and has the whole morph computed."""
        drag = self._drag
        obj = bpy.data.objects.get(drag.of)
        others = marked_points.marks_of(obj, wait=True).items()
        if drag.row is not None and any(
            other != drag.name and known is not None and known.count == 1 and known.row == drag.row
            for other, known in others
        ):
            self.report({"WARNING"}, "Another feature is there already: drag it to another vertex")
            self._let_go(context, keeps=False)
            return
        follows = drag.follows
        self._let_go(context, keeps=True)
        if drag.row is None:
            return
        mark(obj, drag.name, [drag.row])
        sync_features(context.scene)
        context.scene.pointmorph.features[drag.name].confidence = -1.0
        bpy.ops.ed.undo_push(message=f'Move "{drag.name}" on {obj.name}')
        if follows and bpy.ops.pointmorph.recompute.poll():
            live_follower.lend()
            bpy.ops.pointmorph.recompute("INVOKE_DEFAULT")
        self._say(context)

    def _let_go(self, context, keeps):
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        if self._drag is not None:
            self._drag.end(keeps)
            areas.redraw_viewports()
        self._drag = self._timer = None

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
        if self._drag is not None:
            text = f'"{self._drag.name}": drag it where it belongs'
            markers.hint = text
            context.workspace.status_text_set(f"{text}     Esc: Back")
            return
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
    stop=live_follower.stop,
)
