"""Which point of an object a feature means, and which features both objects have.

A feature is marked by a vertex group (on a point cloud: a point attribute) of the same name on
both objects. A prefix tells such groups from bone weights.
"""

from dataclasses import dataclass, field

import numpy as np
import pointmorph

PREFIX = "pm."


@dataclass(frozen=True)
class Marks:
    """The features that are marked on one object.

    Attributes
    ----------
    kind : str
        What they are there: "vertex group" or "point attribute".
    weights : dict of str to (rows, weights)
        By feature, without the prefix: the points in the group, and their weights.
    """

    kind: str
    weights: dict = field(default_factory=dict)


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


def match(source, target):
    """Rows of the features that two shapes have in common.

    Parameters
    ----------
    source, target : Shape
        With `name`, `positions` and `marks`.

    Returns
    -------
    dict of str to (int, int)
        As `pointmorph.morph` takes it.

    Raises
    ------
    FeatureError
        For a feature on one of them only, an empty group, and two features on one point.
    """
    for one, other in ((source, target), (target, source)):
        for name in one.marks.weights:
            if name not in other.marks.weights:
                raise pointmorph.FeatureError(
                    other.name,
                    f'a {other.marks.kind} "{PREFIX}{name}" like that of "{one.name}"',
                    "none of that name",
                    f'Mark "{name}" on "{other.name}" too, or remove the feature.',
                )
    target_rows = _rows(target)
    return {name: (row, target_rows[name]) for name, row in _rows(source).items()}


def _rows(shape):
    """By feature, the row it means on one shape."""
    rows = {}
    taken = {}
    for name, (members, weights) in shape.marks.weights.items():
        group = f'{shape.marks.kind} "{PREFIX}{name}"'
        if not np.isfinite(weights).all() or not (weights > 0).any():
            raise pointmorph.FeatureError(
                shape.name,
                f"a point with a weight above 0 in the {group}",
                "none",
                f'Mark "{name}" on a vertex of "{shape.name}", or remove the feature.',
            )
        row = feature_row(shape.positions, members[weights > 0], weights[weights > 0])
        if row in taken:
            raise pointmorph.FeatureError(
                shape.name,
                f'a point of its own for each of the features "{taken[row]}" and "{name}"',
                f"point {row} for both",
                f'Move "{name}" to another vertex of "{shape.name}", or remove it.',
            )
        taken[row] = name
        rows[name] = row
    return rows
