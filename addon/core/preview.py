"""A first, coarse morph of large shapes, to look at while the whole is computed."""

from dataclasses import replace

import numpy as np
import pointmorph

from . import computation
from .features import Marks

LARGE = 15_000
"""Points of one shape from which on a preview is worth its time."""
_POINTS = 3000  # of each shape, about
# Of the whole, as measured; what other domains do besides gets a quarter of the rest.
_PARTS = {
    **dict.fromkeys(("cloud", "neighborhoods", "covariance", "topology"), (0.0, 0.02)),
    "coarse shapes": (0.02, 0.08),
    "pose": (0.08, 0.9),
    "registration": (0.8, 0.85),
    "quality": (0.85, 0.9),
    "motion": (0.9, 1.0),
}


def is_worth_it(request):
    """Whether the morph takes so long that there is something to wait for."""
    shapes = (request.source, request.target)
    return max(len(shape.positions) for shape in shapes) >= LARGE


def compute(request, progress):
    """The outcome of the thinned request, or None where nothing came of it."""
    try:
        return computation.compute(thin(request), as_one_stage(progress))
    except pointmorph.PointmorphError:
        return None  # the whole is computed all the same, and says what is wrong


def as_one_stage(progress):
    """A progress for all stages of a preview, which are a single one to the user. It never goes
    back, and moves with every stage."""
    reached, now, part = 0.0, None, (0.0, 0.0)

    def tell(stage, fraction):
        nonlocal reached, now, part
        if stage != now:
            now, part = stage, _PARTS.get(stage, (reached, reached + 0.25 * (1.0 - reached)))
        start, end = part
        reached = max(reached, start + (end - start) * fraction)
        return progress("preview", reached)

    return tell


def thin(request):
    """The same request with few points: about 3000 of each shape, evenly spread.

    Marked points stay, and as much of the marked curves and regions as their share is.
    """
    kept = [
        _keep(shape.positions, _points_of(request.features, side))
        for side, shape in enumerate((request.source, request.target))
    ]
    shapes = [
        _reduced(shape, rows)
        for shape, rows in zip((request.source, request.target), kept, strict=True)
    ]
    features = {}
    for name, feature in request.features.items():
        found = _moved(feature, shapes, kept)
        if found is not None:
            features[name] = found
    loop = [name for name in request.loop if name in features]
    return replace(request, source=shapes[0], target=shapes[1], features=features, loop=loop)


def _points_of(features, side):
    """Rows of the features that are points."""
    return [
        feature.rows(side)[0] if isinstance(feature, pointmorph.Feature) else feature[side]
        for feature in features.values()
        if not isinstance(feature, pointmorph.Feature) or feature.kind == "point"
    ]


def _keep(positions, always):
    """Ascending rows: one a cell of a grid that is about as fine as there are points wanted."""
    always = np.unique(np.asarray(always, np.int64))
    if len(positions) <= _POINTS:
        return np.arange(len(positions))
    positions = positions.astype(np.float64)
    low = positions.min(axis=0)
    extent = max(float(np.ptp(positions, axis=0).max()), 1e-30)
    # A surface fills about as many cells as the square of their number along it.
    rows = np.empty(0, np.int64)
    for cells in (24, 32, 44, 60, 84, 120, 240, 1000):
        grid = np.floor((positions - low) / extent * cells).astype(np.int64)
        _, rows = np.unique(grid @ (1, cells + 1, (cells + 1) ** 2), return_index=True)
        if len(rows) >= _POINTS * 0.7:
            break
    return np.unique(np.concatenate([rows, always]))


def _reduced(shape, rows):
    """The shape with these points alone; faces go, and with them what they say of the boundary."""

    def of(values):
        return None if values is None else values[rows]

    return replace(
        shape,
        positions=shape.positions[rows],
        normals=of(shape.normals),
        colors=of(shape.colors),
        radii=None,  # sized for a denser cloud
        triangles=None,
        rigid=None,
        fixed=None,
        marks=Marks(shape.marks.kind),
    )


def _moved(feature, shapes, kept):
    """A feature on the reduced shapes, or None where too little of it is left."""
    if not isinstance(feature, pointmorph.Feature):
        return tuple(
            int(np.searchsorted(rows, row)) for rows, row in zip(kept, feature, strict=True)
        )
    sides, weights = [], []
    for side, rows in enumerate(kept):
        marked = np.asarray(feature.rows(side))
        place = np.searchsorted(rows, marked)
        held = np.flatnonzero(rows[np.minimum(place, len(rows) - 1)] == marked)
        sides.append([int(row) for row in place[held]])
        given = (feature.source_weights, feature.target_weights)[side]
        weights.append(None if given is None else [given[k] for k in held])
    if feature.kind == "point":
        return replace(feature, source=sides[0][0], target=sides[1][0])
    least = 2 if feature.kind == "curve" else 1
    if min(len(side) for side in sides) < least + feature.closed:
        return None
    return replace(
        feature,
        source=sides[0],
        target=sides[1],
        source_weights=weights[0],
        target_weights=weights[1],
    )
