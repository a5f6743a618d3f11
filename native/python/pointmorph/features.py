"""What is marked on both shapes: points, curves and regions."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.errors import FeatureError

KINDS = ("point", "curve", "region")

Rows = Sequence[int] | npt.NDArray[np.integer[Any]]
Weights = Sequence[float] | npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Feature:
    """A place of the source and the place of the target that belongs to it.

    Parameters
    ----------
    source, target : int or sequence of int
        A point: its row. A curve: rows in order along it. A region: its rows, in any order. Both
        sides of a curve or region may have different numbers of rows.
    kind : str
        "point"; "curve", which goes onto the curve by share of the length, first row onto first
        row; or "region", whose points go into the region.
    source_weights, target_weights : sequence of float, optional
        Regions: how much each row belongs to it, 0 to 1. A value goes onto the same value.
    closed : bool
        Curves: the last row is followed by the first.
    weight : float
        How strongly a soft feature pulls, above 0. At 1 it mostly has its way.
    hard : bool, optional
        Whether it holds exactly; by default points do.

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
            if name not in ("source", "target") and getattr(self, name) is not field.default:
                given.append(f"{name}={getattr(self, name)!r}")
        return f"Feature({', '.join(given)})"

    def rows(self, side: int) -> list[int]:
        """The rows on the source (0) or the target (1)."""
        rows: Any = (self.source, self.target)[side]
        return [operator.index(row) for row in ([rows] if self.kind == "point" else rows)]

    def weights(self, side: int) -> list[float]:
        """The rows' weights there; none where all are 1."""
        weights = (self.source_weights, self.target_weights)[side]
        return [] if weights is None else [float(weight) for weight in weights]


def feature_of(name: str, value: Any) -> Feature:
    """A `Feature`, checked; a pair of rows is a point.

    Raises
    ------
    FeatureError
        Naming the feature and what is wrong with it. Whether rows fit the clouds is left to
        `pointmorph.morph`.
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
                "Give two whole numbers, 0 for the first point, or a pointmorph.Feature.",
            ) from error
        feature = Feature(source, target)
    if feature.kind not in KINDS:
        raise _wrong(
            name, "the kind point, curve or region", f"{feature.kind!r}", "Correct the kind."
        )
    weight = feature.weight
    if isinstance(weight, bool) or not isinstance(weight, int | float | np.number):
        raise _wrong(name, "a weight that is a number", f"{weight!r}", "Give 1 for instance.")
    if not (math.isfinite(weight) and weight > 0):
        raise _wrong(name, "a weight above 0", f"{weight!r}", "Give 1 for instance.")
    for key in ("closed", "hard"):
        flag = getattr(feature, key)
        if not isinstance(flag, bool | np.bool_ | None) or (key == "closed" and flag is None):
            raise _wrong(name, f"{key} true or false", f"{flag!r}", "Correct it.")
    for side, of in enumerate(("source", "target")):
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
            "Give whole numbers, 0 for the first point.",
        ) from error


def _check_weights(name: str, feature: Feature, side: int, of: str) -> None:
    given = (feature.source_weights, feature.target_weights)[side]
    try:
        feature.weights(side)
    except (TypeError, ValueError) as error:
        raise _wrong(
            name, f"weights of rows of the {of} from 0 to 1", f"{given!r}", "Give numbers."
        ) from error


def native_features(features: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """What the native library reads."""
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
    """A feature as FEATURES.json has it.

    A point is ``[source row, target row]`` or ``{"source": row, "target": row}``. A curve or region
    has its ``"kind"``, and lists of rows; a region's may be ``{"rows": [...], "weights": [...]}``.
    ``"weight"`` and ``"hard"`` go with any, ``"closed"`` with curves.

    Raises
    ------
    FeatureError
        For anything else.
    """
    if isinstance(value, list):
        if len(value) != 2:
            raise _wrong(name, "[source row, target row]", f"a list of {len(value)}", "Correct it.")
        return feature_of(name, Feature(value[0], value[1]))
    if not isinstance(value, dict):
        raise _wrong(
            name,
            '[source row, target row] or {"kind": …, "source": …, "target": …}',
            f"{value!r}",
            "Correct it.",
        )
    kind = value.get("kind", "point")
    if kind not in KINDS:
        raise _wrong(name, 'the "kind" point, curve or region', f"{kind!r}", "Correct it.")
    known = ["kind", "source", "target", "weight", "hard"] + ["closed"] * (kind == "curve")
    for key in value:
        if key not in known:
            raise _wrong(
                name,
                f"keys of a {kind}: {', '.join(known)}",
                f"{key!r}",
                "Correct or remove that key.",
            )
    fields: dict[str, Any] = {key: value[key] for key in known[3:] if key in value}
    if "hard" in fields and not isinstance(fields["hard"], bool):
        raise _wrong(name, "hard true or false", f"{fields['hard']!r}", "Correct it.")
    for side in ("source", "target"):
        if side not in value:
            raise _wrong(name, f'a "{side}"', "none", f"Say which points of the {side} it has.")
        marked = value[side]
        if kind == "region" and isinstance(marked, dict):
            marked, weights = _weighted(name, side, marked)
            fields[f"{side}_weights"] = weights
        if kind != "point" and not isinstance(marked, list):
            raise _wrong(name, f"a list of rows of the {side}", f"{marked!r}", "Correct it.")
        fields[side] = marked
    return feature_of(name, Feature(kind=kind, **fields))


def _weighted(name: str, side: str, marked: dict[str, Any]) -> tuple[Any, list[Any] | None]:
    """Rows and weights of one side of a region."""
    known = '"rows" and "weights" in its ' + side
    for key in marked:
        if key not in ("rows", "weights"):
            raise _wrong(name, known, f"{key!r}", "Correct or remove that key.")
    if "rows" not in marked:
        raise _wrong(name, known, "no rows", "Add them.")
    weights = marked.get("weights")
    if weights is not None and not isinstance(weights, list):
        raise _wrong(name, f"a list of weights in its {side}", f"{weights!r}", "Give one a row.")
    return marked["rows"], weights


def _wrong(name: str, expected: str, found: str, advice: str) -> FeatureError:
    if len(found) > 80:
        found = found[:77] + "…"
    return FeatureError(f'feature "{name}"', expected, found, advice)
