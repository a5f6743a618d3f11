"""A computation in a thread of its own: started, watched, stopped. One at a time."""

import threading

import pointmorph


class Job:
    """Runs `compute(progress)` in a thread; `progress` is what `pointmorph.morph` calls."""

    def __init__(self, compute):
        self.stage = ""
        self.fraction = 0.0
        self._compute = compute
        self._cancelled = threading.Event()
        self._outcome = None
        self._error = None
        # Blender ends without waiting for it; unregister() stops it before.
        self._thread = threading.Thread(target=self._run, name="pointmorph", daemon=True)
        self._thread.start()

    def _run(self):
        try:
            self._outcome = self._compute(self._progress)
        except BaseException as error:  # handed to the main thread by result()
            self._error = error

    def _progress(self, stage, fraction):
        self.stage, self.fraction = stage, fraction
        return not self._cancelled.is_set()

    @property
    def done(self):
        return not self._thread.is_alive()

    @property
    def cancelled(self):
        """Whether the end was asked for; it comes a moment later."""
        return self._cancelled.is_set()

    def cancel(self):
        self._cancelled.set()

    def result(self):
        """Waits for what `compute` returned. Raises what that raised, or Cancelled."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        if self.cancelled:
            raise pointmorph.Cancelled("The morph was cancelled.")
        return self._outcome


current = None
"""The job that is running or waits to be taken over, or None."""

problem = None
"""(panel, text) of the last error, until the next attempt; None after a success."""

earlier = None
"""A computation.Earlier of the last morph that was made in a window, or None."""


def start(compute):
    global current, problem
    if current is not None:
        raise RuntimeError("a morph is being computed already")
    problem = None
    current = Job(compute)
    return current


def finish():
    """Forgets the job and returns it; stops it first when it is still running."""
    global current
    job, current = current, None
    if job is not None and not job.done:
        job.cancel()
        job._thread.join()
    return job
