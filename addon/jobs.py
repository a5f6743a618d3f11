"""Operators that compute in a thread while Blender stays usable."""

import bpy
import pointmorph

from . import session
from .checks import fail


class Computing:
    """What an operator needs that computes in a thread while Blender stays usable.

    It has `_begin(context)`, which reads the scene and returns what to call with a progress, and
    `_finish(context, outcome)`, which changes the scene.
    """

    _in_window = False

    def invoke(self, context, event):
        if bpy.app.background:
            return self.execute(context)
        try:
            self._in_window = True
            compute = self._begin(context)
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        session.start(compute)
        window_manager = context.window_manager
        self._timer = window_manager.event_timer_add(0.05, window=context.window)
        window_manager.modal_handler_add(self)
        self._show_progress(context)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            session.current.cancel()
            self._show_progress(context)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not session.current.done:
            self._meanwhile(context)
            self._show_progress(context)
            return {"PASS_THROUGH"}
        job = self._end(context)
        try:
            outcome = job.result()
            return self._finish(context, outcome)
        except pointmorph.Cancelled:
            self.report({"INFO"}, self.stopped)
            return {"CANCELLED"}
        except pointmorph.PointmorphError as error:
            return fail(self, error)

    def cancel(self, context):
        """Called by Blender when the window or the file is closed."""
        self._end(context)

    def _meanwhile(self, context):
        """Called now and then while it computes."""

    def _leave(self, context):
        """Called at the end, however it came, before `_finish`."""

    def execute(self, context):
        session.problem = None
        try:
            # A function of Python's, so that Ctrl-C works.
            return self._finish(context, self._begin(context)(lambda stage, fraction: True))
        except pointmorph.PointmorphError as error:
            return fail(self, error)

    def _show_progress(self, context):
        context.workspace.status_text_set(progress_text() + "   Esc: stop")
        redraw_sidebars(context)

    def _end(self, context):
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        job = session.finish()
        self._leave(context)
        redraw_sidebars(context)
        return job


def progress_text():
    """What the running job is at."""
    job = session.current
    if job.cancelled:
        return "Stopping"
    return f"{job.stage.replace('_', ' ').capitalize() or 'Starting'} {100 * job.fraction:.0f} %"


def redraw_sidebars(context):
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()
