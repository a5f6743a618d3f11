"""Features: points, curves and regions marked on both shapes."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import FeatureError
from pointmorph.shapes.clouds import SIDES, FloatArray

KINDS = ("point", "curve", "region")

Rows = Sequence[int] | npt.NDArray[np.integer[Any]]
Weights = Sequence[float] | npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Feature:
    """A place on the source and the matching place on the target.

    Parameters
    ----------
    source, target : int or sequence of int
        Point: its row. Curve: rows in order along it. Region: rows in any order. The two sides of
        a curve or region may differ in the number of rows.
    kind : str
        "point", "curve" (mapped onto the other curve by share of its length, first row onto first
        row) or "region" (whose points go into the other region).
    source_weights, target_weights : sequence of float, optional
        Regions: how much each row belongs to it, 0 to 1. Equal weights are mapped onto each other.
    closed : bool
        Curves: whether the last row is connected to the first.
    weight : float
        How strongly a soft feature pulls, above 0. At 1 it mostly prevails.
    hard : bool, optional
        Whether it is met exactly. By default, points are.

    Examples
    --------
    >>> from pointmorph import Feature
    >>> Feature(17, 403)
    Feature(source=17, target=403)
    >>> Feature([3, 4, 5], [7, 9], "curve", weight=2.0)
    Feature(source=[3, 4, 5], target=[7, 9], kind='curve', weight=2.0)
    """

    source: int | Rows
    target: int | Rows
    kind: str = "point"
    source_weights: Weights | None = None
    target_weights: Weights | None = None
    closed: bool = False
    weight: float = 1.0
    hard: bool | None = None

    def __repr__(self) -> str:
        given = [f"source={self.source}", f"target={self.target}"]
        for name, field in self.__dataclass_fields__.items():
            if name not in SIDES and getattr(self, name) is not field.default:
                given.append(f"{name}={getattr(self, name)!r}")
        return f"Feature({', '.join(given)})"

    def rows(self, side: int) -> list[int]:
        """The rows on the source (0) or the target (1)."""
        rows: Any = (self.source, self.target)[side]
        return [operator.index(row) for row in ([rows] if self.kind == "point" else rows)]

    def weights(self, side: int) -> list[float]:
        """The weights of the rows on that side; empty if all are 1."""
        weights = (self.source_weights, self.target_weights)[side]
        return [] if weights is None else [float(weight) for weight in weights]


def feature_of(name: str, value: Any) -> Feature:
    """A checked `Feature`. A pair of rows makes a point.

    Raises
    ------
    FeatureError
        Naming the feature and what is wrong with it. `pointmorph.morph` checks whether the rows
        exist.
    """
    if isinstance(value, Feature):
        feature = value
    else:
        try:
            source, target = value
        except (TypeError, ValueError) as error:
            raise _wrong(
                name,
                "a row of the source and a row of the target",
                f"{value!r}",
                "Pass two rows, counted from 0, or a pointmorph.Feature.",
            ) from error
        feature = Feature(source, target)
    if feature.kind not in KINDS:
        raise _wrong(
            name, "the kind point, curve or region", f"{feature.kind!r}", "Choose one of them."
        )
    weight = feature.weight
    if isinstance(weight, bool) or not isinstance(weight, int | float | np.number):
        raise _wrong(name, "a number as weight", f"{weight!r}", "Try 1.")
    if not (math.isfinite(weight) and weight > 0):
        raise _wrong(name, "a weight above 0", f"{weight!r}", "Try 1.")
    for key in ("closed", "hard"):
        flag = getattr(feature, key)
        if not isinstance(flag, bool | np.bool_ | None) or (key == "closed" and flag is None):
            raise _wrong(name, f"{key} to be true or false", f"{flag!r}", "Correct the value.")
    for side, of in enumerate(SIDES):
        _check_rows(name, feature, side, of)
        _check_weights(name, feature, side, of)
    return feature


def _check_rows(name: str, feature: Feature, side: int, of: str) -> None:
    given: Any = (feature.source, feature.target)[side]
    try:
        for row in [given] if feature.kind == "point" else list(given):
            if isinstance(row, bool | np.bool_) or not -1 <= operator.index(row) < 2**31:
                raise ValueError
    except (TypeError, ValueError, OverflowError) as error:
        raise _wrong(
            name,
            f"a row of the {of}" if feature.kind == "point" else f"rows of the {of}",
            f"{given!r}",
            "Pass whole numbers, counted from 0.",
        ) from error


def _check_weights(name: str, feature: Feature, side: int, of: str) -> None:
    given = (feature.source_weights, feature.target_weights)[side]
    try:
        feature.weights(side)
    except (TypeError, ValueError) as error:
        raise _wrong(
            name, f"weights of the {of} from 0 to 1", f"{given!r}", "Pass numbers."
        ) from error


def native_features(features: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """The features as the native library takes them."""
    result = []
    for name, value in (features or {}).items():
        feature = feature_of(str(name), value)
        sides = [{"rows": feature.rows(side), "weights": feature.weights(side)} for side in (0, 1)]
        result.append(
            {
                "name": str(name),
                "kind": feature.kind,
                "source": sides[0],
                "target": sides[1],
                "closed": bool(feature.closed),
                "hard": feature.kind == "point" if feature.hard is None else bool(feature.hard),
                "weight": float(feature.weight),
            }
        )
    return result


def feature_from_json(name: str, value: Any) -> Feature:
    """A feature from a features file.

    A point is ``[source row, target row]`` or ``{"source": row, "target": row}``. A curve or region
    has a ``"kind"`` and lists of rows; a region may have ``{"rows": [...], "weights": [...]}``
    instead. ``"weight"`` and ``"hard"`` go with all kinds, ``"closed"`` with curves.

    Raises
    ------
    FeatureError
        If the value is anything else.
    """
    if isinstance(value, list):
        if len(value) != 2:
            raise _wrong(
                name, "[source row, target row]", f"a list of {len(value)}", "Correct the list."
            )
        return feature_of(name, Feature(value[0], value[1]))
    if not isinstance(value, dict):
        raise _wrong(
            name,
            '[source row, target row] or {"kind": …, "source": …, "target": …}',
            f"{value!r}",
            "Correct the value.",
        )
    kind = value.get("kind", "point")
    if kind not in KINDS:
        raise _wrong(name, 'the "kind" point, curve or region', f"{kind!r}", "Choose one of them.")
    known = ["kind", "source", "target", "weight", "hard"] + ["closed"] * (kind == "curve")
    for key in value:
        if key not in known:
            raise _wrong(
                name,
                f"the keys of a {kind}: {', '.join(known)}",
                f"{key!r}",
                "Correct or remove the key.",
            )
    fields: dict[str, Any] = {key: value[key] for key in known[3:] if key in value}
    if "hard" in fields and not isinstance(fields["hard"], bool):
        raise _wrong(name, "hard to be true or false", f"{fields['hard']!r}", "Correct the value.")
    for side in SIDES:
        if side not in value:
            raise _wrong(name, f'a "{side}"', "none", f"Add its rows of the {side}.")
        marked = value[side]
        if kind == "region" and isinstance(marked, dict):
            marked, weights = _weighted(name, side, marked)
            fields[f"{side}_weights"] = weights
        if kind != "point" and not isinstance(marked, list):
            raise _wrong(name, f"a list of rows of the {side}", f"{marked!r}", "Correct the value.")
        fields[side] = marked
    return feature_of(name, Feature(kind=kind, **fields))


def weights_from_json(name: str, value: Any, side: str, count: int) -> FloatArray | None:
    """The weight of each vertex of a model, from the entry `name` of a features file.

    The entry has a list of rows, or ``{"rows": [...], "weights": [...]}``, as ``"source"`` or as
    ``"target"``, or as both.

    Parameters
    ----------
    name : str
        rigid or fixed.
    value
        The entry.
    side : str
        source or target.
    count : int
        Vertices of that model.

    Returns
    -------
    (N,) array
        0 for vertices that aren't listed; None if the entry has nothing for this side.

    Raises
    ------
    FeatureError
        If the entry is anything else.
    """
    if not isinstance(value, dict) or not value.keys() <= {"source", "target"}:
        raise _wrong(name, 'rows as "source" or "target"', f"{value!r}", "Correct the entry.")
    if side not in value:
        return None
    rows, weights = value[side], None
    if isinstance(rows, dict):
        rows, weights = _weighted(name, side, rows)
    region = feature_of(name, Feature(rows, [0], "region", weights))
    chosen = region.rows(0)
    for row in chosen:
        if not 0 <= row < count:
            raise _wrong(name, f"rows of the {side}, 0 to {count - 1}", f"{row}", "Correct it.")
    amounts = region.weights(0) or [1.0] * len(chosen)
    if len(amounts) != len(chosen):
        raise _wrong(name, f"{len(chosen)} weights", f"{len(amounts)}", "Give one weight per row.")
    result = np.zeros(count)
    result[chosen] = amounts
    return result


def _weighted(name: str, side: str, marked: dict[str, Any]) -> tuple[Any, list[Any] | None]:
    """The rows and weights of one side of a region."""
    known = '"rows" and "weights" in its ' + side
    for key in marked:
        if key not in ("rows", "weights"):
            raise _wrong(name, known, f"{key!r}", "Correct or remove the key.")
    if "rows" not in marked:
        raise _wrong(name, known, "no rows", "Add the rows.")
    weights = marked.get("weights")
    if weights is not None and not isinstance(weights, list):
        raise _wrong(
            name, f"a list of weights in its {side}", f"{weights!r}", "Give one weight per row."
        )
    return marked["rows"], weights


def _wrong(name: str, expected: str, found: str, advice: str) -> FeatureError:
    if len(found) > 80:
        found = found[:77] + "…"
    return FeatureError(f'feature "{name}"', expected, found, advice)
