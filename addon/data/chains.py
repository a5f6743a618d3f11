"""Chains: morphs from shape to shape joined into one, each of whose points passes through all."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pointmorph

from ..core import path_stages
from ..core.computation import Earlier, End, Outcome, Way, compute, with_look
from . import coverage, surfaces

_TOO_MUCH = 0.2  # of the target that the source has no vertices for

LONGEST = 11
"""Shapes in a chain: Blender's shape keys have values up to 10."""


def compute_all(requests, progress, earlier=(), textures=None):
    """The outcome of one request, or of several as a chain. For the rest see `compute`.

    Parameters
    ----------
    earlier : sequence of computation.Earlier or denser_source.Start
        What each request may start from: the first that is about its shapes.
    textures : look_transfer.Options, optional
        How the target's look is drawn on the source's faces, if it is.
    """
    outcome = _computed(requests, progress, earlier)
    return outcome if textures is None else with_look(requests, outcome, textures, progress)


def _computed(requests, progress, earlier):
    if len(requests) == 1:
        return _judged(requests, compute(requests[0], progress, _start_of(requests[0], earlier)))
    outcomes = []
    starts = _starts_of_ways(requests, earlier)
    for number, (request, start) in enumerate(zip(requests, starts, strict=True)):

        def tell(stage, fraction, number=number):
            return progress(f"{number + 1} of {len(requests)}: {stage}", fraction)

        outcomes.append(compute(request, tell, start))
    return _judged(requests, join(requests, outcomes, progress))


def _start_of(request, earlier):
    return next((one for one in earlier if one.start_for(request)), None)


def _starts_of_ways(requests, earlier):
    """Where marks have changed on some ways, the others start from what was found as well."""
    starts = [_start_of(request, earlier) for request in requests]
    if not any(starts):
        return starts
    same = [replace(one, same_marks=True) for one in earlier if isinstance(one, Earlier)]
    pairs = zip(requests, starts, strict=True)
    return [_start_of(request, same) if start is None else start for request, start in pairs]


def earlier_ways(requests, outcome):
    """A `computation.Earlier` of each way of a chain, to start from the next time."""
    onward = [outcome.maps[0], *(there for there, _ in outcome.via_maps)]
    back = [*(there for _, there in outcome.via_maps), outcome.maps[1]]
    ways = zip(requests, onward, back, strict=True)
    return tuple(Earlier(request.without_looks(), maps) for request, *maps in ways)


def _judged(requests, outcome):
    """With a word on the shapes that the source's faces are too large for."""
    source = requests[0].source
    shares = {
        request.target.name: coverage.missed_share(places, source.triangles, request.target)
        for request, places in zip(requests, (*outcome.stops, outcome.landing), strict=True)
    }
    too_fine = {name: share for name, share in shares.items() if share > _TOO_MUCH}
    words = [
        f'"{source.name}" has too few vertices for {100 * share:.0f} % of the surface of '
        f'"{name}". For its own faces to become the target, click Subdivide Source.'
        for name, share in too_fine.items()
    ]
    report = {**outcome.report, "too_fine": too_fine}
    report["warnings"] = [*report["warnings"], *words]
    return replace(outcome, report=report)


def join(requests, outcomes, progress=None):
    """One outcome of several, each of which starts at the shape where the one before ends."""
    tables = [np.stack([o.source.rows, o.target.rows], axis=1) for o in outcomes]
    rows = join_pairs(tables)
    firsts = [_first(table) for table in (*(t[:, 0] for t in tables), tables[-1][:, 1])]
    ends = [o.source for o in outcomes] + [outcomes[-1].target]
    ends = [
        _pick(end, first[column], column)
        for end, first, column in zip(ends, firsts, rows.T, strict=True)
    ]

    # Where the source's points are at every shape: carried on by the points around.
    stops = [outcomes[0].landing]
    for number, (request, outcome) in enumerate(zip(requests[1:], outcomes[1:], strict=True)):
        if progress is not None and progress("transfer", number / len(requests)) is False:
            raise pointmorph.Cancelled("The chain was canceled.")
        stops.append(_carried(stops[-1], request, outcome.landing))

    # A pair is as bad as the worst of its ways.
    distortion = np.max(
        [
            _of_pairs(table, outcome.distortion, rows[:, number : number + 2])
            for number, (table, outcome) in enumerate(zip(tables, outcomes, strict=True))
        ],
        axis=0,
    )
    confidence = np.min(
        [
            _of_pairs(table, outcome.confidence, rows[:, number : number + 2])
            for number, (table, outcome) in enumerate(zip(tables, outcomes, strict=True))
        ],
        axis=0,
    )
    maps = outcomes[0].maps[0], outcomes[-1].maps[1]
    return Outcome(
        ends[0],
        ends[-1],
        stops[-1],
        distortion,
        _report(requests, outcomes, rows),
        maps,
        (*(o.faces[0] for o in outcomes), outcomes[-1].faces[1]),
        _ways(requests, outcomes, tables, rows, stops, progress),
        tuple(ends[1:-1]),
        tuple(stops[:-1]),
        tuple((onward.maps[0], before.maps[1]) for before, onward in pairwise(outcomes)),
        confidence=confidence,
    )


def _ways(requests, outcomes, tables, rows, stops, progress):
    """The way from each shape to the next; of the source's vertices as they are on these."""
    found = []
    for number, (request, outcome, table) in enumerate(
        zip(requests, outcomes, tables, strict=True)
    ):
        way = outcome.ways[0]
        if way is None:
            found.append(None)
            continue

        def of_pairs(values, table=table, wanted=rows[:, number : number + 2]):
            return np.stack([_of_pairs(table, each, wanted) for each in values])

        vertices = way.vertices
        if number > 0:
            path = request.settings.get("path", "auto")
            start, end = stops[number - 1 : number + 1]
            motion = pointmorph.Motion(
                start,
                _source_normals(outcomes[number].source, table, rows, number),
                end,
                path,
                progress,
                faces=requests[0].source.triangles,
            )
            vertices = path_stages.deviations(
                lambda t, motion=motion: motion.at(t, progress), start, end
            )
        found.append(Way(of_pairs(way.pairs), of_pairs(way.normals), vertices))
    return tuple(found)


def _source_normals(end, table, rows, number):
    """(N, 3): the normals of a shape where the source's vertices are on it."""
    of_shape = np.zeros((int(table[:, 0].max()) + 1, 3), np.float32)
    of_shape[table[:, 0]] = end.normals
    result = np.zeros((int(rows[:, 0].max()) + 1, 3), np.float32)
    result[rows[:, 0]] = of_shape[rows[:, number]]
    return result


def join_pairs(tables):
    """(M, n + 1): rows of all shapes, from n tables of pairs of neighboring shapes.

    Every pair of every table is in a row. Where a point has several partners on either side, they
    take turns, so that there are no more rows than that takes.
    """
    joined = tables[0]
    for table in tables[1:]:
        left, right = joined[:, -1], table[:, 0]
        by_left, by_right = np.argsort(left, kind="stable"), np.argsort(right, kind="stable")
        size = int(max(left.max(), right.max())) + 1
        counts = [np.bincount(side, minlength=size) for side in (left, right)]
        starts = [np.cumsum(count) - count for count in counts]
        many = np.where((counts[0] > 0) & (counts[1] > 0), np.maximum(*counts), 0)
        point = np.repeat(np.arange(size), many)
        turn = np.arange(len(point)) - np.repeat(np.cumsum(many) - many, many)
        first, second = (
            order[start[point] + turn % count[point]]
            for order, start, count in zip((by_left, by_right), starts, counts, strict=True)
        )
        joined = np.column_stack([joined[first], table[second, 1]])
    return joined


def _first(rows):
    """By point, a pair that has it."""
    found = np.zeros(int(rows.max()) + 1, np.int64)
    found[rows[::-1]] = np.arange(len(rows))[::-1]
    return found


def _pick(end, pairs, rows):
    return End(
        rows.astype(np.int32),
        end.positions[pairs],
        end.normals[pairs],
        end.colors[pairs],
        end.radii[pairs],
    )


def _of_pairs(table, values, wanted):
    """The values of the pairs `wanted`, which all are in the table."""
    width = int(table[:, 1].max()) + 1
    keys = table[:, 0].astype(np.int64) * width + table[:, 1]
    order = np.argsort(keys)
    found = np.searchsorted(keys[order], wanted[:, 0].astype(np.int64) * width + wanted[:, 1])
    return values[order[found]]


def _carried(places, request, images):
    """(N, 3): where `places` on a shape go, when its points go to `images` on the next. Large faces
    would take them straight through it: they end on its own faces where it has any."""
    shape, onto = request.source, request.target
    _, members, shares = surfaces.around(shape.positions, shape.triangles, places)
    ways = images - shape.positions
    carried = (places + surfaces.mean(ways, members, shares)).astype(np.float32)
    if shape.triangles is None or onto.triangles is None:
        return carried
    _, members, shares = surfaces.around(onto.positions, onto.triangles, carried)
    return surfaces.mean(onto.positions, members, shares)


def _report(requests, outcomes, rows):
    """The reports as one, in which names tell the ways apart."""
    names = [f"{r.source.name} to {r.target.name}" for r in requests]
    reports = dict(zip(names, (o.report for o in outcomes), strict=True))

    def gathered(part):
        return {
            f"{name}: {key}": value
            for name, report in reports.items()
            for key, value in report[part].items()
        }

    worst, doubtful = [], []
    for number, (name, report) in enumerate(reports.items()):
        source = dict(zip(rows[:, number].tolist(), rows[:, 0].tolist(), strict=True))
        for part, found in (("worst", worst), ("doubtful", doubtful)):
            found += [
                {**place, "source": source[place["source"]], "advice": f"{name}: {place['advice']}"}
                for place in report[part]
            ]
    worst.sort(key=lambda place: -place["distortion"])
    doubtful.sort(key=lambda place: place["confidence"])
    # What the source's faces look like, which are wrapped onto the second shape.
    mesh = outcomes[0].report.get("mesh")
    if mesh is not None:
        places = [{**place, "advice": f"{names[0]}: {place['advice']}"} for place in mesh["worst"]]
        mesh = {**mesh, "verdict": f"{names[0]}: {mesh['verdict']}", "worst": places}
    return {
        **({} if mesh is None else {"mesh": mesh}),
        "ways": reports,
        "pairs": len(rows),
        "seconds": sum(report["seconds"] for report in reports.values()),
        "warnings": [f"{name}: {w}" for name, r in reports.items() for w in r["warnings"]],
        "quality": gathered("quality"),
        "cracks": gathered("cracks"),
        "features": gathered("features"),
        "feature_residual": max(report["feature_residual"] for report in reports.values()),
        "worst": worst[:5],
        "likely_right": min(report["likely_right"] for report in reports.values()),
        "doubtful": doubtful[:5],
    }
