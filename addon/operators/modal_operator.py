"""Operators that compute in a thread while Blender stays usable."""

import contextlib
import traceback

import bpy
import pointmorph

from ..core import background_job
from ..core.stepping import finish, go_on
from ..data import areas
from ..data.references import find, reference_to
from ..data.registration import Registration
from .polls import fail, fail_unexpectedly, note_done

_TURN = 0.04  # seconds of work at a time
_REST = 0.01  # seconds at least between two turns


class Computing:
    """What an operator needs that computes in a thread while Blender stays usable.

    It has `_begin(context)`, which reads the scene and returns what to call with a progress, and
    `_finish(context, outcome)`, which changes the scene. Where reading takes long, it has
    `_begin_steps(context)` instead, a generator that yields often and returns the same.
    `place` names the panel of its button, which shows the progress meanwhile.
    """

    place = "MORPH"
    _in_window = False

    def invoke(self, context, event):
        if bpy.app.background:
            return self.execute(context)
        self._in_window = True
        self._scene = reference_to(context.scene)
        self._view_layer = context.view_layer.name
        self._workspaces = set()
        self._steps = self._begin_steps(context)
        background_job.start(self.place)
        window_manager = context.window_manager
        self._said = None
        self._timer = window_manager.event_timer_add(_REST, window=context.window)
        window_manager.modal_handler_add(self)
        self._show_progress(context)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC" and event.value == "PRESS":
            background_job.current.cancel()
            self._show_progress(context)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            with self._where_it_began(context):
                if not background_job.current.begun and not background_job.current.cancelled:
                    self._read_on()
                elif background_job.current.begun and not background_job.current.done:
                    self._meanwhile(context)
                else:
                    return self._finish_noted(context, self._end(context).result())
        except pointmorph.Cancelled:
            self.cancel(context)
            self.report({"INFO"}, self.stopped)
            return {"CANCELLED"}
        except pointmorph.PointmorphError as error:
            self.cancel(context)
            return fail(self, self._told(error))
        except ReferenceError:
            self.cancel(context)
            self.report({"WARNING"}, "Something was deleted in the meantime: start again")
            return {"CANCELLED"}
        except Exception as error:  # whatever it is, Blender must not stay busy
            self.cancel(context)
            traceback.print_exc()
            return fail_unexpectedly(self, error)
        self._show_progress(context)
        return {"PASS_THROUGH"}

    @contextlib.contextmanager
    def _where_it_began(self, context):
        """The context's scene is the one where the operator was started."""
        scene = find(bpy.data.scenes, self._scene)
        if scene is None:
            raise pointmorph.CloudError(
                "scene",
                "the scene in which the morph was started",
                "none",
                "Undo its deletion, or start again.",
            )
        if scene == context.scene:
            yield
            return
        layer = scene.view_layers.get(self._view_layer) or scene.view_layers[0]
        with context.temp_override(scene=scene, view_layer=layer):
            yield

    def _begin_steps(self, context):
        yield
        return self._begin(context)

    def _read_on(self):
        """Reads the scene a moment longer, and begins to compute when all is read."""
        try:
            background_job.current.waits_for = go_on(self._steps, _TURN)
        except StopIteration as done:
            background_job.current.begin(done.value)

    def cancel(self, context):
        """Called by Blender when the window or the file is closed."""
        if background_job.current is not None:
            self._end(context)

    def _finish_noted(self, context, outcome):
        """`_finish`, and a note of it for the command that does it again."""
        result = self._finish(context, outcome)
        if result == {"FINISHED"}:
            note_done(self)
        return result

    def _meanwhile(self, context):
        """Called now and then while it computes."""

    def _told(self, error):
        """A PointmorphError in the words that the user gets."""
        return error

    def _leave(self, context):
        """Called at the end, however it came, before `_finish`."""

    def execute(self, context):
        background_job.problem = None
        try:
            # A function of Python's, so that Ctrl-C works.
            compute = finish(self._begin_steps(context))
            return self._finish_noted(context, compute(lambda stage, fraction: True))
        except pointmorph.PointmorphError as error:
            return fail(self, self._told(error))
        except Exception as error:
            traceback.print_exc()
            return fail_unexpectedly(self, error)

    def _show_progress(self, context):
        text = progress_text()
        if text != self._said:  # to draw anew takes time
            self._said = text
            self._workspaces.add(context.workspace.name)
            context.workspace.status_text_set(text + "   Esc: Cancel")
            areas.redraw_sidebars()

    def _end(self, context):
        job = background_job.finish()
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)
        for name in self._workspaces:
            if (workspace := bpy.data.workspaces.get(name)) is not None:
                workspace.status_text_set(None)
        self._leave(context)
        areas.redraw_sidebars()
        return job


def progress_text():
    """What the running job is at."""
    job = background_job.current
    if job.cancelled:
        return "Canceling"
    if not job.begun:
        return job.waits_for or "Reading the scene"
    return f"{pointmorph.stage_label(job.stage) or 'Starting'} {100 * job.fraction:.0f}%"


registration = Registration(stop=background_job.finish)
