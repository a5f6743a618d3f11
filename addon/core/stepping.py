"""Generators that do a long work in steps, between which Blender goes on."""

import time


def finish(steps):
    """Takes all steps at once; returns what the generator returns."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def go_on(steps, seconds):
    """Takes steps for that long. Raises StopIteration with what the generator returns."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        next(steps)
