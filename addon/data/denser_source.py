"""More vertices for a source whose faces are too large to show the shapes that it becomes."""

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
        Where the source's vertices are then.
    back : (M, 3) array
        Where the shape's points are on the source; None where nobody knows.
    """

    shape: object
    landing: np.ndarray
    back: np.ndarray | None


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
    """

    ends: np.ndarray
    triangles: np.ndarray
    parents: np.ndarray

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
    for number, stop in enumerate(stops):
        landing = made.extended(stop.landing)
        if coverage.missed_share(landing, source.triangles, stop.shape) <= _ENOUGH:
            continue

        def tell(stage, fraction, number=number):
            said = stage if len(stops) == 1 else f"{number + 1} of {len(stops)}: {stage}"
            return progress(said, fraction)

        start = None
        if stop.back is not None and _can_start(request.settings):
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
