"""What a feature means, and which features both objects have.

A feature is marked by a vertex group (on a point cloud: a point attribute) of the same name on
both objects. A prefix tells such groups from bone weights. One vertex is a point; several that
edges join to a path are a curve; any other several are a region with their weights.
"""

from dataclasses import dataclass, field

import numpy as np
import pointmorph

PREFIX = "pm."
_FULL = 0.999


@dataclass(frozen=True)
class Marks:
    """The features that are marked on one object.

    Attributes
    ----------
    kind : str
        What they are there: "vertex group" or "point attribute".
    weights : dict of str to (rows, weights)
        By feature, without the prefix: the points in the group, and their weights.
    edges : (E, 2) array
        Of the object; none where it's a cloud.
    """

    kind: str
    weights: dict = field(default_factory=dict)
    edges: np.ndarray = field(default_factory=lambda: np.empty((0, 2), np.int64))


@dataclass(frozen=True)
class Choice:
    """What the user wants a feature to be.

    Attributes
    ----------
    kind : str
        "AUTO" (told from the vertices), "POINT", "CURVE" or "REGION".
    hold : str
        "AUTO" (points of full weight exactly, all else softly), "EXACT" or "SOFT".
    weight : float
        How strongly it pulls when it's soft.
    use : bool
        Whether it's a feature at all; what is marked stays.
    """

    kind: str = "AUTO"
    hold: str = "AUTO"
    weight: float = 1.0
    use: bool = True


@dataclass(frozen=True)
class Chain:
    """Points in order along a curve."""

    rows: np.ndarray
    closed: bool


def feature_row(positions, rows, weights):
    """The point that a group means: the one of highest weight.

    Among several of the same weight it's the one nearest to the weighted centroid of the group.

    Parameters
    ----------
    positions : (N, 3) array
    rows, weights : (K,) arrays
        Points in the group; at least one weight is above 0.
    """
    members = positions[rows].astype(np.float64)
    centroid = np.average(members, axis=0, weights=weights)
    best = np.flatnonzero(weights == weights.max())
    distances = np.linalg.norm(members[best] - centroid, axis=1)
    return int(rows[best[np.argmin(distances)]])


def match(source, target, choices=None):
    """The features that two shapes have in common.

    Parameters
    ----------
    source, target : Shape
        With `name`, `positions` and `marks`.
    choices : dict of str to Choice, optional
        For features that aren't to be what they are by themselves.

    Returns
    -------
    dict of str to (int, int) or pointmorph.Feature
        As `pointmorph.morph` takes it; a pair for a point that holds exactly.

    Raises
    ------
    FeatureError
        For a feature on one of them only, an empty group, what isn't of one kind on both, a curve
        whose order nothing tells, and two features on one point.
    """
    choices = choices or {}
    for one, other in ((source, target), (target, source)):
        for name in one.marks.weights:
            if name not in other.marks.weights and choices.get(name, Choice()).use:
                raise pointmorph.FeatureError(
                    other.name,
                    f'a {other.marks.kind} "{PREFIX}{name}" like the one on "{one.name}"',
                    "none of that name",
                    f'Mark "{name}" on "{other.name}" as well, or remove the feature.',
                )
    found = {
        name: _feature(name, (source, target), choices.get(name, Choice()))
        for name in source.marks.weights
        if choices.get(name, Choice()).use
    }
    for side, shape in enumerate((source, target)):
        taken = {}
        for name, feature in found.items():
            row = feature.rows(side)[0]
            if feature.kind == "point" and row in taken:
                raise pointmorph.FeatureError(
                    shape.name,
                    f'different points for the features "{taken[row]}" and "{name}"',
                    f"point {row} for both",
                    f'Move "{name}" to another vertex of "{shape.name}", or remove it.',
                )
            if feature.kind == "point":
                taken[row] = name
    plain = ("point", True)
    return {
        name: (f.source, f.target) if (f.kind, f.hard) == plain else f for name, f in found.items()
    }


def _feature(name, shapes, choice):
    """One feature of both shapes."""
    groups = [_members(shape, name) for shape in shapes]
    chains = [
        _chain_of(*group, shape.marks.edges) for shape, group in zip(shapes, groups, strict=True)
    ]
    kind = choice.kind
    if kind == "AUTO":
        kind = _kind(name, shapes, groups, chains)
    if kind == "POINT":
        rows, weights = zip(
            *(
                (feature_row(shape.positions, *group), float(group[1].max()))
                for shape, group in zip(shapes, groups, strict=True)
            ),
            strict=True,
        )
        # A weight below 1 is how strongly a point pulls.
        weight = min(1.0, *weights)
        weight = 1.0 if weight > _FULL else _decimal(weight)
        hard = choice.hold == "EXACT" or (choice.hold == "AUTO" and weight == 1.0)
        return pointmorph.Feature(*rows, "point", weight=choice.weight * weight, hard=hard)
    hard = choice.hold == "EXACT"
    if kind == "REGION":
        (s, ws), (t, wt) = groups
        weights = [
            None if (w == 1.0).all() else np.minimum(w, 1.0).astype(float).tolist()
            for w in (ws, wt)
        ]
        return pointmorph.Feature(
            s.tolist(), t.tolist(), "region", *weights, weight=choice.weight, hard=hard
        )
    chains = [
        known or _by_weight(name, shape, *group)
        for known, shape, group in zip(chains, shapes, groups, strict=True)
    ]
    if chains[0].closed != chains[1].closed:
        open_one, closed_one = (
            shapes[side].name for side in np.argsort([c.closed for c in chains])
        )
        raise pointmorph.FeatureError(
            f'feature "{name}"',
            "a curve that is closed on both objects or open on both",
            f'an open one on "{open_one}" and a closed one on "{closed_one}"',
            "Close the open curve, remove a vertex from the closed one, or set Kind to Region.",
        )
    sides = [
        (_normalised(shape.positions), each.rows, dict(zip(*group, strict=True)))
        for shape, each, group in zip(shapes, chains, groups, strict=True)
    ]
    ordered = _same_start(*sides, chains[0].closed)
    return pointmorph.Feature(
        *(rows.tolist() for rows in ordered),
        "curve",
        closed=chains[0].closed,
        weight=choice.weight,
        hard=hard,
    )


def description(feature):
    """What a feature is, in a few words: "soft closed curve, 12 to 20"."""
    if not isinstance(feature, pointmorph.Feature):
        return "point"
    hard = feature.kind == "point" if feature.hard is None else feature.hard
    words = ["hard" if hard else "soft", "closed" if feature.closed else "", feature.kind]
    text = " ".join(word for word in words if word)
    if feature.kind != "point":
        text += f", {len(feature.rows(0))} to {len(feature.rows(1))}"
    return text


def _decimal(weight):
    """The number that the user sees in Blender, which keeps float32."""
    return float(str(np.float32(weight)))


def _members(shape, name):
    """Rows and weights of the points in a group."""
    rows, weights = shape.marks.weights[name]
    group = f'{shape.marks.kind} "{PREFIX}{name}"'
    if not np.isfinite(weights).all() or not (weights > 0).any():
        raise pointmorph.FeatureError(
            shape.name,
            f"a point with a weight above 0 in the {group}",
            "none",
            f'Mark "{name}" on a vertex of "{shape.name}", or remove the feature. Modifiers that '
            "make a new mesh, such as Remesh, lose marks: turn them off, or apply them first.",
        )
    return rows[weights > 0], weights[weights > 0]


def _kind(name, shapes, groups, chains):
    single = [len(rows) == 1 for rows, _ in groups]
    if any(single):
        # A modifier that subdivides spreads a vertex over its surroundings.
        if all((weights == weights.max()).sum() == 1 for _, weights in groups):
            return "POINT"
        one, several = (shapes[k] for k in (single.index(True), single.index(False)))
        count = len(groups[single.index(False)][0])
        raise pointmorph.FeatureError(
            f'feature "{name}"',
            "a single point on both objects, or several on both (a curve or a region)",
            f'one on "{one.name}" and {count} on "{several.name}"',
            "Mark both objects alike, or set Kind to Point, which uses the highest weight.",
        )
    whole = [
        known is not None and len(known.rows) == len(rows)
        for known, (rows, _) in zip(chains, groups, strict=True)
    ]
    return "CURVE" if all(chains) and any(whole) else "REGION"


def is_doubled(marks):
    """Whether modifiers may have doubled or spread one mark: no vertex of it is the heaviest.

    Parameters
    ----------
    marks : (rows, weights)
    """
    _, weights = marks
    return len(weights) > 1 and int((weights == weights.max()).sum()) > 1


def meant(own, own_edges, shown, edges):
    """What a feature is on an object as modifiers show it: Mirror doubles a point or a path, which
    is one all the same, that of the object's own vertices.

    Parameters
    ----------
    own, shown : (rows, weights)
        Of the feature: on the object itself, and with modifiers.
    own_edges, edges : (E, 2) arrays
        The same of edges. The object's own vertices come before those that modifiers add.

    Returns
    -------
    (rows, weights)
    """
    rows, weights = shown
    own_rows = own[0][own[1] > 0]
    if len(own_rows) == 1 and len(rows) > 1:
        best = [int(weights.argmax())]
        return rows[best], own[1][own[1] > 0]
    is_path = len(own_rows) > 1 and _chain_of(own_rows, own[1][own[1] > 0], own_edges) is not None
    if not is_path or _chain_of(*shown, edges) is not None:
        return shown
    full = weights > _FULL
    for members, shares in (shown, (rows[full], weights[full])):
        part = _joined_to_first(members, edges)
        if chain(members[part], edges) is not None:
            return members[part], shares[part]
    return shown


def _joined_to_first(rows, edges):
    """(K,) array of bool: which of some points edges among them join to the first in the object."""
    number = {int(row): k for k, row in enumerate(rows)}
    beside = [[] for _ in rows]
    for a, b in edges[np.isin(edges, rows).all(axis=1)].tolist():
        beside[number[a]].append(number[b])
        beside[number[b]].append(number[a])
    found = np.zeros(len(rows), bool)
    ahead = [int(np.argmin(rows))] if len(rows) else []
    while ahead:
        one = ahead.pop()
        if not found[one]:
            found[one] = True
            ahead += beside[one]
    return found


def _chain_of(rows, weights, edges):
    """The group as a path, or else those of full weight: a modifier that subdivides spreads a path
    over its surroundings."""
    return chain(rows, edges) or chain(rows[weights > _FULL], edges)


def chain(rows, edges):
    """The points of a group as a path along edges, or None where they are none.

    Parameters
    ----------
    rows : (K,) array
    edges : (E, 2) array

    Returns
    -------
    Chain or None
        From one end to the other, or round a closed path.
    """
    if len(rows) < 2 or not len(edges):
        return None
    inside = np.zeros(max(int(edges.max()), int(rows.max())) + 1, bool)
    inside[rows] = True
    beside = {int(row): [] for row in rows}
    for a, b in edges[inside[edges].all(axis=1)].tolist():
        beside[a].append(b)
        beside[b].append(a)
    degrees = sorted(len(others) for others in beside.values())
    closed = degrees[0] == 2 and degrees[-1] == 2
    if not closed and not (degrees[:3] in ([1, 1], [1, 1, 2]) and degrees[-1] <= 2):
        return None
    start = min(row for row, others in beside.items() if len(others) == degrees[0])
    path, before = [start], None
    while len(path) <= len(rows):
        onwards = [row for row in beside[path[-1]] if row != before]
        if not onwards or (len(path) > 2 and onwards[0] == start):
            break
        before = path[-1]
        path.append(min(onwards))
    return Chain(np.array(path), closed) if len(path) == len(rows) else None


def _by_weight(name, shape, rows, weights):
    """A curve without edges: the heaviest point comes first."""
    order = np.argsort(-weights, kind="stable")
    if len(rows) < 2 or (np.diff(weights[order]) >= 0).any():
        raise pointmorph.FeatureError(
            f'feature "{name}"',
            f'points of "{shape.name}" joined by edges, or with weights that decrease along it',
            f"{len(rows)} points that are neither",
            "Select a path of edges (Ctrl-click in Edit Mode), give each point a "
            "different weight, or set Kind to Region.",
        )
    return Chain(rows[order], False)


def _normalised(positions):
    """Around the origin, of extent 1: as the object lies, wherever and however large."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    return (positions - (low + high) / 2) / max(float((high - low).max()), 1e-30)


def _same_start(source, target, closed):
    """Both curves from the start, and in the sense, that belong together.

    A curve begins at its heaviest point (an open one: end), and a closed one goes on to the heavier
    of the next two, where weights tell that on both objects. What they leave open is taken so that
    points at the same share of the length lie near each other as the objects lie.

    Parameters
    ----------
    source, target : (positions, rows, weights by row)
    """
    (here, first, started, turned), (there, second, other_started, other_turned) = (
        (positions, *_as_told(rows, weights, closed))
        for positions, rows, weights in (source, target)
    )
    if started and other_started:
        candidates = [second]
        if not (turned and other_turned):
            candidates.append(_other_sense(second, closed))
    elif closed:
        rolled = [np.roll(second, -k) for k in range(len(second))]
        candidates = rolled + [_other_sense(rows, closed) for rows in rolled]
    else:
        candidates = [second, _other_sense(second, closed)]
    wanted = _at_shares(here[first], closed)
    apart = [float(((_at_shares(there[rows], closed) - wanted) ** 2).sum()) for rows in candidates]
    return first, candidates[int(np.argmin(apart))]


def _as_told(rows, weights, closed):
    """Rows in the order that the weights tell; whether they tell the start, and the sense."""
    values = np.array([weights[row] for row in rows])
    if not closed:
        told = bool(values[0] != values[-1])
        return (rows[::-1] if values[-1] > values[0] else rows), told, told
    heaviest = np.flatnonzero(values == values.max())
    if len(heaviest) > 1:
        return rows, False, False
    rows, values = np.roll(rows, -heaviest[0]), np.roll(values, -heaviest[0])
    if values[-1] > values[1]:
        rows = _other_sense(rows, closed)
    return rows, True, bool(values[-1] != values[1])


def _other_sense(rows, closed):
    """Reversed; a closed curve keeps its first point."""
    return np.concatenate([rows[:1], rows[:0:-1]]) if closed else rows[::-1]


def _at_shares(places, closed):
    """(17, 3): places at even shares of the length."""
    if closed:
        places = np.concatenate([places, places[:1]])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    shares = np.linspace(0.0, along[-1], 17)
    return np.stack([np.interp(shares, along, places[:, k]) for k in range(3)], axis=-1)
