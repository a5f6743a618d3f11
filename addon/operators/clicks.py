"""Features by two clicks in Object Mode: one on the source, one on the target. A mark that is there
is dragged, and the morph follows."""

import contextlib

import bpy

from ..core import background_job, live_follower
from ..data import areas
from ..data.feature_list import feature_names, sync_features
from ..data.registration import Registration
from ..scene import marked_points
from ..scene.feature_marks import mark, next_name, unmarkable
from ..view import click_targets, markers
from .dragging import Drag, WholeUpdate
from .polls import Explained, shapes_reason

_STEP = 0.02  # seconds between two looks at what has been found

running = False
"""Whether the operator waits for clicks."""
_waiting = None  # the operator itself


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
        global running, _waiting
        running, _waiting = True, self
        self._drag = self._timer = None
        self._update = WholeUpdate()
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
        if self._drag is not None:
            return self._handle_drag(context, event)
        if event.type in {"ESC", "RIGHTMOUSE", "RET"} and event.value == "PRESS":
            self._update.leave()
            self._update = WholeUpdate()
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
        elif event.type == "TIMER" and self._timer is not None:
            self._go_on(context)
        elif event.type in {"Z", "Y"}:
            self._say(context)
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Also called by Blender when the window or the file is closed."""
        global running, _waiting
        running, _waiting = False, None
        drag, self._drag = self._drag, None
        with contextlib.ExitStack() as last:  # all of it, whatever fails
            last.callback(areas.redraw_viewports)
            last.callback(_clear_words, context)
            last.callback(live_follower.stop)
            last.callback(self._watch, context)
            last.callback(self._update.give_up)
            if drag is not None:
                last.callback(drag.end, keeps=False)

    def _watch(self, context):
        """Has a timer as long as there is something to look at."""
        wanted = self._drag is not None or self._update.is_open
        if wanted and self._timer is None:
            self._timer = context.window_manager.event_timer_add(_STEP, window=context.window)
        elif not wanted and self._timer is not None:
            timer, self._timer = self._timer, None
            context.window_manager.event_timer_remove(timer)

    def _go_on(self, context):
        """Has the morph computed that is due."""
        why = self._update.go_on()
        if why is not None:
            self.report({"WARNING"}, why)
        self._watch(context)

    def _take_hold(self, context, event, where):
        """Whether there is a mark under the mouse."""
        found = None if self.name else markers.mark_at(context, *where)
        if found is None:
            return False
        obj, name = found
        settings = context.scene.pointmorph
        settings.active_feature = settings.features.find(name)
        at = (event.mouse_x, event.mouse_y)
        self._drag = Drag(context, obj, name, at, self._update.preview)
        self._watch(context)
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
        elif drag.is_overtaken and not drag.is_moving and drag.of in bpy.data.objects:
            self._update.settle()
            obj = bpy.data.objects[drag.of]
            self._drag = Drag(context, obj, drag.name, drag.at, self._update.preview)
        elif drag.is_overtaken:
            self._let_go(context, keeps=False)
            self.report({"INFO"}, "Another morph was computed: drag the mark again")
            self._say(context)
        elif event.type == "MOUSEMOVE" and drag.begins_at(context, event.mouse_x, event.mouse_y):
            self._update.interrupt()
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
        if obj is None or not drag.goes_elsewhere:
            self._let_go(context, keeps=False)
            if obj is not None and not drag.is_moving:
                self._complete(context, drag)
            self._say(context)
            return
        if _other_at(obj, drag.row, drag.name) is not None:
            self.report({"WARNING"}, "Another feature is there already: drag it to another vertex")
            self._let_go(context, keeps=False)
            return
        self._let_go(context, keeps=True)
        kept = drag.preview.after(self._update.preview) if drag.follows else self._update.preview
        if kept is not None:
            kept.lift(bpy.data.objects)  # it is no part of what undo comes back to
        mark(obj, drag.name, [drag.row])
        sync_features(context.scene)
        context.scene.pointmorph.features[drag.name].confidence = -1.0
        bpy.ops.ed.undo_push(message=f'Move "{drag.name}" on {obj.name}')
        if kept is not None:
            kept.lower(bpy.data.objects)
        if drag.follows:
            self._update.want(drag.result, kept)
        self._go_on(context)
        self._say(context)

    def _complete(self, context, drag):
        """A click that didn't move a mark is one like any other, if a feature waits for its second
        place and another vertex lies there."""
        where = click_targets.viewport_at(context.window, *drag.at)
        hit = None if where is None else click_targets.pick(context, *where)
        _, missing = asked_for(context.scene.pointmorph, self.name)
        if hit is not None and missing == [hit[0]] and not drag.is_own(*hit):
            self._click(context, where)

    def _let_go(self, context, keeps):
        drag, self._drag = self._drag, None
        try:
            drag.end(keeps)
        finally:
            self._watch(context)
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
        other = _other_at(obj, row, name)
        if other is not None:
            self.report({"WARNING"}, f'"{other}" is already there: click another vertex')
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


def _other_at(obj, row, name):
    """The feature other than `name` that is this vertex alone, or None."""
    for other, known in marked_points.marks_of(obj, wait=True).items():
        if other != name and known is not None and known.count == 1 and known.row == row:
            return other
    return None


def _clear_words(context):
    markers.hint, markers.hover, markers.dragged = "", None, None
    if context.window is not None:
        context.window.cursor_modal_restore()
    if context.workspace is not None:
        context.workspace.status_text_set(None)


def _forget(*_):
    """Nothing of another file is to be followed."""
    live_follower.stop()
    background_job.forget()


def _stop():
    """Ends what is going on, before the add-on goes."""
    try:
        if _waiting is not None:
            _waiting.cancel(bpy.context)
    finally:
        live_follower.end()


registration = Registration(
    classes=(POINTMORPH_OT_click_features,),
    handlers=(("load_post", _forget),),
    stop=_stop,
)
