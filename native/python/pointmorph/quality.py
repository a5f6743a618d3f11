"""How good a morph is, and that in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class PointQuality:
    """What a map does at each of the N points of the cloud that it starts from."""

    stretch: npt.NDArray[np.float64]
    """(N, 2), the larger and the smaller singular value of the Jacobian, both surfaces scaled to
    unit area; 1 and 1 where only the size differs, or where it couldn't be measured"""
    measured: npt.NDArray[np.bool_]
    """(N,), False where too few neighbours lie on the same sheet, or all on a line"""
    flipped: npt.NDArray[np.bool_]
    """(N,), where the image shows its back"""
    reached: npt.NDArray[np.bool_]
    """(N,), where some point of the other cloud lands within two spacings"""
    round_trip: npt.NDArray[np.float64]
    """(N,), distance of a point to where it ends up there and back, in √area of its own surface"""
    distortion: npt.NDArray[np.float64]
    """(N,), one number for all of it: 0 is perfect, over 1 is bad, 2 or more where folded"""

    @property
    def area_ratio(self) -> npt.NDArray[np.float64]:
        """(N,): how much larger the surface is around the image, both surfaces at unit area."""
        return self.stretch[:, 0] * self.stretch[:, 1]


@dataclass(frozen=True)
class MapFigures:
    """A map in figures. Shares, 0 to 1, are those of the points."""

    dirichlet: float
    """mean squared stretch; 1 or more for a map that is one to one"""
    stretch_p99: float
    """99th percentile of the stretch; 1 is none"""
    conformal_median: float
    """median of (s1/s2 + s2/s1)/2; 1 where angles are kept"""
    flipped: float
    """share that shows its back"""
    collapsed: float
    """share that is squeezed to a line"""
    round_trip_mean: float
    """in √area"""
    round_trip_p99: float
    """in √area"""
    coverage: float
    """share of the other cloud's points within two spacings of an image"""


@dataclass(frozen=True)
class Place:
    """Where many bad points lie together."""

    source: int
    """row of the source"""
    target: int
    """row of the target, where that point lands"""
    flaw: str
    """mirrored, folded, lost (doesn't come back, or isn't reached), stretched or squeezed"""
    distortion: float
    """mean over the point and its neighbours"""
    share: float
    """the bad points' share of the surface, 0 to 1"""
    advice: str
    """what is wrong there and what would help, in words"""


@dataclass(frozen=True)
class FeatureResidual:
    """How well the maps keep one feature; the worse of both ways."""

    name: str
    kind: str
    """point, curve or region"""
    hard: bool
    weight: float
    residual: float
    """in spacings: how far a point lands from its partner, a curve's marked points (root mean
    square) from the same share of the other's length, a region's points outside of the partner"""
    inside: float
    """share of a region's points that land in the partner; 1 for points and curves"""


@dataclass(frozen=True)
class Quality:
    """How good a morph is: by point, in figures, and where it is worst."""

    source: PointQuality
    """of the map from the source to the target"""
    target: PointQuality
    """of the map back"""
    source_to_target: MapFigures
    target_to_source: MapFigures
    worst: tuple[Place, ...]
    """at most five, far apart, the worst first; empty where the map is good"""
    features: tuple[FeatureResidual, ...]
    """one for each feature"""


def quality_summary(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What `Morph.report` says about quality, to show: names and values, the worse of both ways.

    Covered, folded, collapsed: shares of the points. Stretch: its 99th percentile. Angles: median
    conformal distortion, 1 where kept. Round trip: mean, of √area. Torn: the largest of `cracks`.
    Features: before they were put onto each other exactly.

    Works on a report that was read from `report.json` just as well.
    """
    both = report["quality"].values()

    def worst(figure: str) -> float:
        return max(float(way[figure]) for way in both)

    return [
        ("Covered", _percent(min(way["coverage"] for way in both))),
        ("Stretch", f"{worst('stretch_p99'):.2f}"),
        ("Angles", f"{worst('conformal_median'):.2f}"),
        ("Folded", _percent(worst("flipped"))),
        ("Collapsed", _percent(worst("collapsed"))),
        ("Round trip", f"{_percent(worst('round_trip_mean'))} off"),
        ("Torn", _percent(max(report["cracks"].values()))),
        ("Features", f"{report['feature_residual']:.2g} spacings off"),
    ]


def feature_summary(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How well the maps keep each feature that isn't a hard point, to show: names and values.

    Works on a report that was read from `report.json` just as well.
    """
    rows = []
    for name, kept in report.get("features", {}).items():
        if kept["kind"] == "point" and kept["hard"]:
            continue
        value = f"{kept['residual']:.2g} spacings off"
        if kept["kind"] == "region":
            value = f"{_percent(kept['inside'])} inside, {value}"
        rows.append((f"{name} ({kept['kind']})", value))
    return rows


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %" if share < 0.1 else f"{100 * share:.1f} %"
