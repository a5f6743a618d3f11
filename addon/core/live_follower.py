"""A map that follows a feature while it is dragged: the newest places first, in a thread."""

import threading
import time
from dataclasses import dataclass

import numpy as np
import pointmorph

from . import background_job


@dataclass(frozen=True)
class Answer:
    """What the features change.

    Attributes
    ----------
    shifts : (N, 3) array
        How far they take the source's points from where the map has them.
    """

    shifts: np.ndarray


class LiveFollower:
    """Answers the newest request, in a thread of its own; what came before it is left out.

    The thread doesn't stand back as a `background_job` does: a hand waits for it.

    Parameters
    ----------
    earlier : computation.Earlier
        What the map was made from.
    live : pointmorph.LiveMorph, optional
        One of the same clouds and settings; else it is made first, in the thread.
    """

    def __init__(self, earlier, live=None):
        self.earlier = earlier
        self.live = live
        self.updates = []  # (time of the answer, seconds that it took)
        self.problem = None
        self._before = None
        self._wanted = None
        self._answer = None
        self._asker = 0  # counts those who asked and have been forgotten
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="pointmorph live", daemon=True)
        self._thread.start()

    def ask(self, features):
        """Has `answer` tell what these features change, as soon as it's known."""
        with self._changed:
            self._wanted = features
            self._changed.notify()

    def answer(self):
        """The newest Answer that wasn't taken yet, or None."""
        with self._changed:
            answer, self._answer = self._answer, None
            return answer

    def forget(self):
        """What was asked for before is of no interest any more, nor is its answer."""
        with self._changed:
            self._wanted = self._answer = None
            self._asker += 1

    @property
    def waits(self):
        """Whether it has been asked for something that it hasn't answered."""
        with self._changed:
            return self._wanted is not None or self._answer is not None

    def stop(self):
        """Has the thread end, a moment later."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    @property
    def runs(self):
        return self._thread.is_alive()

    def join(self):
        """Waits for its end."""
        self._thread.join()

    def _go_on(self, stage, fraction):
        return not self._ended

    def _run(self):
        try:
            self._prepare()
            while True:
                with self._changed:
                    while self._wanted is None and not self._ended:
                        self._changed.wait()
                    wanted, asker = self._wanted, self._asker
                if self._ended:
                    return
                self._follow(wanted, asker)
        except pointmorph.Cancelled:
            return
        except Exception as error:  # the mark still goes where it is dragged
            with self._changed:
                self.problem, self._wanted = error, None

    def _prepare(self):
        request = self.earlier.request
        if self.live is None:
            self.live = pointmorph.LiveMorph(
                request.source.cloud(),
                request.target.cloud(),
                request.features,
                self.earlier.maps,
                progress=self._go_on,
                **request.settings,
            )
        self._before = self.live.source_to_target(request.features, self._go_on)

    def _follow(self, wanted, asker):
        start = time.perf_counter()
        try:
            places = self.live.source_to_target(wanted, self._go_on)
        except pointmorph.FeatureError:  # two features in one place, on the way past it
            answer = None
        else:
            answer = Answer(places - self._before)
        with self._changed:
            if answer is not None and asker == self._asker:
                self._answer = answer
                end = time.perf_counter()
                self.updates.append((end, end - start))
            if self._wanted is wanted:
                self._wanted = None


current = None
"""That of the last morph that was made in a window, from the first drag of a mark on; or None."""
_ending = []  # those whose threads may still be at work


def follow(earlier):
    """The follower of this map, made where there is none; None where it can't be followed."""
    global current
    if current is not None and current.earlier is not earlier:
        stop()
    if current is None and earlier is not None and earlier.can_be_bent:
        current = LiveFollower(earlier, earlier.live)
    return current


def lend():
    """Lets the next computation use what was made to follow, if it has followed anything."""
    if current is not None and current.live is not None and current.updates:
        current.earlier.live = current.live


def stop():
    """Has the follower end; what it took to make it is kept with its map."""
    global current
    if current is not None:
        current.stop()
        lend()
        _ending[:] = [follower for follower in _ending if follower.runs] + [current]
    current = None


def end():
    """Ends the follower, waits for its thread, and keeps nothing."""
    stop()
    while _ending:
        _ending.pop().join()
    if background_job.earlier is not None:
        background_job.earlier.live = None
