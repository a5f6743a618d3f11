"""Generators that do a long work in steps, between which Blender goes on.

A step that yields words waits for something else, and these say for what.
"""

import time

_PAUSE = 0.01  # seconds


def finish(steps):
    """Takes all steps at once; returns what the generator returns."""
    while True:
        try:
            if next(steps) is not None:
                time.sleep(_PAUSE)
        except StopIteration as end:
            return end.value


def go_on(steps, seconds):
    """Takes steps for that long, or until one waits; returns what for, or None. Raises
    StopIteration with what the generator returns."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if (words := next(steps)) is not None:
            return words
    return None
