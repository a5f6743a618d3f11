"""A mark that is dragged, and the whole morph that is computed once it is let go."""

import bpy

from ..core import background_job, live_follower
from ..data.references import find, reference_to
from ..scene import live_preview, marked_points
from ..view import markers
from .polls import picked_result

_STARTS = 4  # pixels that make a click a drag
_LOOK = 0.2  # seconds between two looks at whether a morph is there


class Drag:
    """A mark that is held by the mouse. Nothing is marked until it is let go.

    `pending` is the LivePreview of a mark that was dragged before, or None.
    """

    def __init__(self, context, obj, name, at, pending=None):
        settings = context.scene.pointmorph
        self.name, self.of = name, obj.name
        self.at = at
        self.row = None
        self.is_moving = False
        known = marked_points.marks_of(obj, wait=True).get(name)
        self._start = None if known is None else known.row
        self._side = 0 if obj == settings.source else 1
        self._hidden = None
        self._job = background_job.current
        result = picked_result(context)
        self.preview = live_preview.begin(bpy.data.objects, context.scene, result, name, pending)
        self.result = None if self.preview is None else reference_to(result)

    @property
    def follows(self):
        """Whether a morph follows."""
        return self.preview is not None

    @property
    def goes_elsewhere(self):
        """Whether it is held over another vertex than it was marked at."""
        return self.row is not None and self.row != self._start

    @property
    def is_overtaken(self):
        """Whether a computation began or ended meanwhile: what is shown is of another map now."""
        job = background_job.current
        if job is self._job:
            return False
        return job is not None or not self._job.cancelled

    def begins_at(self, context, x, y):
        """Whether the mouse has gone far enough to mean it."""
        if not self.is_moving and max(abs(x - self.at[0]), abs(y - self.at[1])) >= _STARTS:
            self.is_moving = True
            source = context.scene.pointmorph.source
            # It lies where the morph does.
            if self.follows and self._side == 1 and not source.hide_get():
                source.hide_set(True)
                self._hidden = reference_to(source)
        return self.is_moving

    def is_own(self, obj, row):
        """Whether this is the vertex that the mark is at."""
        return obj.name == self.of and row == self._start

    def move(self, row):
        if row == self.row:
            return
        self.row = row
        markers.dragged = self.of, self.name, row
        if self.follows:
            self.preview.ask(self.name, self._side, row)

    def show(self):
        """Whether there was something new to show."""
        return self.follows and self.preview.show(bpy.data.objects)

    def end(self, keeps):
        """Has what is shown stay, or go back to what it was."""
        markers.dragged = None
        hidden, self._hidden = self._hidden, None
        try:
            if self.follows and not keeps:
                self.preview.put_back(bpy.data.objects)
        finally:
            source = None if hidden is None else find(bpy.data.objects, hidden)
            layer = bpy.context.view_layer
            if source is not None and layer.objects.get(source.name) == source:
                source.hide_set(False)


class WholeUpdate:
    """The whole morph that is to be computed after a drag, as soon as nothing else is. What is
    shown meanwhile goes back if nothing comes of it."""

    def __init__(self):
        self.preview = None  # LivePreview
        self._result = None  # reference to the morph object of pairs
        self._is_due = False
        self._job = self._earlier = None

    @property
    def is_open(self):
        return self._is_due or self._job is not None

    def want(self, result, preview):
        """Has it computed, when `go_on` is called."""
        self._result, self.preview, self._is_due = result, preview, True

    def interrupt(self):
        """Cancels it until it is gone on with: what it computes is about to change again."""
        if self._job is not None and background_job.current is self._job:
            self._job.cancel()
            self._is_due = True

    def go_on(self):
        """Starts what is due, and puts back what has failed. Called now and then.

        Returns
        -------
        str or None
            Why it can't be computed.
        """
        self.settle()
        if not self._is_due or self._job is not None or background_job.current is not None:
            return None
        self._is_due = False
        obj = find(bpy.data.objects, self._result)
        if obj is None or not bpy.ops.pointmorph.recompute.poll():
            self.give_up()
            return "The morph wasn't updated: recompute it"
        live_follower.lend()
        self._earlier = background_job.earlier
        bpy.ops.pointmorph.recompute("INVOKE_DEFAULT", name=obj.name)
        self._job = background_job.current
        if self._job is None:
            self.give_up()
        return None

    def leave(self):
        """Has what is due begin now or not at all, and looks after it without being called."""
        self.go_on()
        if self._job is None:
            self.give_up()
        elif not bpy.app.timers.is_registered(self._look):
            bpy.app.timers.register(self._look)

    def give_up(self):
        """Shows what was shown before; what runs already runs on."""
        preview, self.preview = self.preview, None
        self._is_due, self._job = False, None
        if preview is not None:
            preview.put_back(bpy.data.objects)

    def settle(self):
        """Takes note of a computation that has ended."""
        if self._job is None or background_job.current is self._job:
            return
        if background_job.earlier is not self._earlier:  # it is there
            self._job = self.preview = None
            self._is_due = False
        elif self._is_due:  # canceled, to be started again
            self._job = None
        else:
            self.give_up()

    def _look(self):
        """A timer."""
        self.settle()
        return None if self._job is None else _LOOK
