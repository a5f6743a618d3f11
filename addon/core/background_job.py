"""A computation in a thread of its own: started, watched, stopped. One at a time."""

import os
import sys
import threading

import pointmorph

from . import computation

# More, of 19: about half a turn beside the window's thread. At 10 a morph of 7,000 pairs took ten
# times as long where other programs kept the cores busy.
_NICENESS = 3


class Job:
    """Runs `compute(progress)` in a thread; `progress` is what `pointmorph.morph` calls.

    Until `begin` it waits for the scene to be read. `place` names the panel of its button.
    """

    def __init__(self, place=""):
        self.place = place
        self.waits_for = None  # in words, while the scene is being read
        self.stage = ""
        self.fraction = 0.0
        self._compute = None
        self._thread = None
        self._cancelled = threading.Event()
        self._outcome = None
        self._error = None

    def begin(self, compute):
        self._compute = compute
        # Blender ends without waiting for it; unregister() stops it before.
        self._thread = threading.Thread(target=self._run, name="pointmorph", daemon=True)
        self._thread.start()

    def _run(self):
        _stand_back()
        try:
            self._outcome = self._compute(self._progress)
        except BaseException as error:  # handed to the main thread by result()
            self._error = error

    def _progress(self, stage, fraction):
        self.stage, self.fraction = stage, fraction
        return not self._cancelled.is_set()

    @property
    def begun(self):
        return self._thread is not None

    @property
    def done(self):
        return self.begun and not self._thread.is_alive()

    @property
    def cancelled(self):
        """Whether the end was asked for; it comes a moment later."""
        return self._cancelled.is_set()

    def cancel(self):
        self._cancelled.set()

    def result(self):
        """Waits for what `compute` returned. Raises what that raised, or Cancelled."""
        if self.begun:
            self._thread.join()
        if self._error is not None:
            raise self._error
        if self.cancelled:
            raise pointmorph.Cancelled("The morph was canceled.")
        return self._outcome


def _stand_back():
    """Lets the window go before this thread, and those it starts, where all cores are busy."""
    if sys.platform == "linux":  # elsewhere priority is a whole process's
        thread = threading.get_native_id()
        now = os.getpriority(os.PRIO_PROCESS, thread)
        os.setpriority(os.PRIO_PROCESS, thread, min(now + _NICENESS, 19))


current = None
"""The job that is running or waits to be taken over, or None."""
problem = None
"""(panel, text) of the last error, until the next attempt; None after a success."""
earlier = None
"""A computation.Earlier of the last morph that was made in a window, or None."""
earlier_ways = ()
"""A computation.Earlier of each way of the last chain that was made in a window; may be empty."""


def starts(count):
    """What a morph over so many ways from shape to shape may start from."""
    if count > 1:
        return earlier_ways
    return () if earlier is None else (earlier,)


def remember_ways(ways):
    """Keeps what was found of a chain for the next time; see `chains.earlier_ways`."""
    global earlier_ways
    earlier_ways = ways


def forget():
    """Nothing starts from what was found before."""
    global earlier, earlier_ways
    earlier, earlier_ways = None, ()


def remember(request, outcome):
    """Keeps what was found for the next time."""
    global earlier
    if earlier is None:
        earlier = computation.Earlier(request, outcome.maps, outcome.landing)
    else:
        earlier = earlier.followed_by(request, outcome)


def start(place=""):
    """A job that has yet to `begin`; see `Job`."""
    global current, problem
    if current is not None:
        raise RuntimeError("a morph is already being computed")
    problem = None
    current = Job(place)
    return current


def finish():
    """Forgets the job and returns it; stops it first when it is still running."""
    global current
    job, current = current, None
    if job is not None and not job.done:
        job.cancel()
        if job.begun:
            job._thread.join()
    return job


def overtake():
    """Stops a job for which the scene is still being read: undo has changed it meanwhile."""
    if current is not None and not current.begun:
        current.cancel()
