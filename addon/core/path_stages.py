"""A way through space, kept as how far it lies off the straight one at a few times.

Between these times it is the polynomial through them and both ends. The times lie closer near the
ends (Chebyshev and Lobatto), so that the polynomial doesn't swing: what turns by 180° is met within
a ten-thousandth of its size.
"""

import numpy as np

COUNT = 5
TIMES = tuple(float(0.5 - 0.5 * np.cos(np.pi * k / (COUNT + 1))) for k in range(1, COUNT + 1))
NORMAL_TIMES = TIMES[1:4]
"""Fewer do for normals, which are made unit length again: ¼, ½, ¾."""
_PART = 8192  # rows


def shares(t, times=TIMES):
    """Of the deviations at `times`: what each counts at `t`, a number or an array. All are 0 at
    t = 0 and t = 1."""
    knots = (0.0, *times, 1.0)
    return [
        np.prod([(t - other) / (here - other) for other in knots if other != here], axis=0)
        for here in times
    ]


def local_times(t, delays, overlap, falloff):
    """(N,): t of points with these delays while that of the whole is t; see `pointmorph.options`,
    `stagger_overlap` and `stagger_falloff`."""
    if t <= 0.0 or t >= 1.0:
        return np.full(len(delays), float(t >= 1.0))
    takes = max(overlap, 0.01)
    done = np.clip((t - delays.astype(np.float64) * (1.0 - takes)) / takes, 0.0, 1.0)
    return done + falloff * (done * done * (3.0 - 2.0 * done) - done)


def put_deviation(place, start, end, t, out):
    """Writes into `out` how far places at t lie off the straight way from `start` to `end`.

    A part at a time: what is computed on the way stays near, and takes no memory of its own.
    """
    for begin in range(0, len(out), _PART):
        rows = slice(begin, begin + _PART)
        out[rows] = place[rows] - ((1.0 - t) * start[rows] + t * end[rows])


def deviations(at, start, end, times=TIMES):
    """(K, N, 3) float32: how far places lie off the straight way from `start` to `end`.

    Parameters
    ----------
    at : callable
        Gives (N, 3) places for a time.
    start, end : (N, 3) arrays
    """
    found = np.empty((len(times), *start.shape), np.float32)
    for number, t in enumerate(times):
        put_deviation(at(t), start, end, t, found[number])
    return found
