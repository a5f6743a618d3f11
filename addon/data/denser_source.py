"""More vertices for a source whose faces are too large to show the shapes that it becomes."""

import contextlib
from dataclasses import dataclass, replace

import numpy as np
import pointmorph

from . import coverage

MOST = 50_000
"""Vertices, about."""
_ENOUGH = 0.05  # of a shape may be missed


@dataclass(frozen=True)
class Stop:
    """A shape that the source becomes.

    Attributes
    ----------
    shape : computation.Shape
    landing : (N, 3) array
        Where the source's vertices are then; None where nobody knows.
    back : (M, 3) array
        Where the shape's points are on the source; None where nobody knows.
    """

    shape: object
    landing: np.ndarray
    back: np.ndarray | None


@dataclass(frozen=True)
class Start:
    """A map that was found for a finer source to the shape after it, in the place of a
    `computation.Earlier`: another one would want the vertices elsewhere.

    Attributes
    ----------
    positions, targets : (N, 3) array, (M, 3) array
        Of the source and the target.
    maps : (N, 3) array, (M, 3) array
        Where its vertices are on the target, and where the target's points are on it.
    """

    positions: np.ndarray
    targets: np.ndarray
    maps: tuple

    def live_for(self, request):
        return None

    def start_for(self, request):
        """The maps, if a request is about these shapes."""
        same = are_same(request.source.positions, self.positions)
        same = same and are_same(request.target.positions, self.targets)
        return self.maps if same and _can_start(request.settings) else None


def are_same(places, others):
    """Whether points lie where others do, but for rounding."""
    if places.shape != others.shape:
        return False
    return bool(np.abs(places - others).max() <= 1e-4 * np.ptp(others, axis=0).max())


_starting = (None, None)


@contextlib.contextmanager
def starting(made, start):
    """Whoever begins to compute a morph object again in here has it start from a Start.

    Parameters
    ----------
    made : int
        See `references.reference_to`.
    start : Start or None
    """
    global _starting
    _starting = made, start
    try:
        yield
    finally:
        _starting = None, None


def start_of(made):
    """The Start for a morph object that begins to be computed again; None where it has none."""
    return _starting[1] if _starting[0] == made else None


@dataclass(frozen=True)
class Finer:
    """A mesh's triangles, some of them cut. The mesh's own vertices come first, in order.

    Attributes
    ----------
    ends : (K, 2) array of int
        Of each further vertex, the two before it that it is halfway between.
    triangles : (F, 3) array of int
    parents : (F,) array of int
        The row of the mesh's triangle that each is a piece of.
    start : Start or None
        What a morph of it starts from.
    """

    ends: np.ndarray
    triangles: np.ndarray
    parents: np.ndarray
    start: "Start | None" = None

    def extended(self, values):
        """(N + K, C) from (N, C): values of all vertices from those of the mesh's own."""
        result = list(values)
        for a, b in self.ends.tolist():
            result.append(0.5 * (result[a] + result[b]))
        return np.array(result, values.dtype)


def compute(request, stops, progress):
    """Cuts the source of a computation.Request where the library's meshes are denser.

    Parameters
    ----------
    request : computation.Request
        From the source to the first shape after it.
    stops : sequence of Stop
        In order. The map to each is found again from where it led: the start knows what the marks
        of a chain's shapes say, which lead from each to the next.
    progress : callable
        As that of `pointmorph.morph`.

    Returns
    -------
    Finer
    """
    source = request.source
    made = Finer(np.empty((0, 2), np.int64), source.triangles, np.arange(len(source.triangles)))
    on_first = stops[0].landing
    for number, stop in enumerate(stops):
        landing = None if stop.landing is None else made.extended(stop.landing)
        if (
            landing is not None
            and coverage.missed_share(landing, source.triangles, stop.shape) <= _ENOUGH
        ):
            continue

        def tell(stage, fraction, number=number):
            said = stage if len(stops) == 1 else f"{number + 1} of {len(stops)}: {stage}"
            return progress(said, fraction)

        start = None
        if landing is not None and stop.back is not None and _can_start(request.settings):
            start = (landing, stop.back)
        morph = pointmorph.morph(
            source.cloud(),
            stop.shape.cloud(),
            request.features if number == 0 else {},
            loop=request.loop if number == 0 else [],
            start=start,
            progress=tell,
            **request.settings,
        )
        denser = morph.denser("source", most_vertices=MOST, progress=tell)
        made = Finer(
            np.concatenate([made.ends, denser.ends]), denser.faces, made.parents[denser.parents]
        )
        source = _finer_shape(source, denser)
        if number == 0:
            on_first = denser.wrapped
        elif on_first is not None:
            on_first = denser.extended(on_first)
    first = stops[0]
    if len(made.ends) and on_first is not None and first.back is not None:
        # The other ways of a chain start at other shapes, which are as they were.
        start = Start(source.positions, first.shape.positions, (on_first, first.back))
        made = replace(made, start=start)
    return made


def _can_start(settings):
    """Whether the library can start from a map."""
    return (settings.get("method", "auto"), settings.get("domain", "auto")) == ("auto", "auto")


def _finer_shape(shape, denser):
    def of(values):
        return None if values is None else denser.extended(values)

    return replace(
        shape,
        positions=denser.positions.astype(np.float32),
        normals=None,
        colors=None,
        radii=None,
        skin=None,
        triangles=denser.faces,
        rigid=of(shape.rigid),
        fixed=of(shape.fixed),
    )
