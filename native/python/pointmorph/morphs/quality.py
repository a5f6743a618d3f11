"""The quality of a morph, in figures and in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class PointQuality:
    """What a map does at each of the N points that it maps."""

    stretch: npt.NDArray[np.float64]
    """(N, 2), the larger and the smaller singular value of the Jacobian, with both surfaces scaled
    to unit area; 1 and 1 where nothing is stretched, or where it couldn't be measured"""
    measured: npt.NDArray[np.bool_]
    """(N,), False where too few neighbors lie on the same side of the surface, or all on a line"""
    flipped: npt.NDArray[np.bool_]
    """(N,), where the map turns the surface over"""
    reached: npt.NDArray[np.bool_]
    """(N,), where the other map takes some point to within two spacings"""
    round_trip: npt.NDArray[np.float64]
    """(N,), distance between a point and its image under both maps, there and back, in √area of its
    own surface"""
    distortion: npt.NDArray[np.float64]
    """(N,), all of the above in one number: 0 is perfect, over 1 is bad, 2 or more is folded"""

    @property
    def area_ratio(self) -> npt.NDArray[np.float64]:
        """(N,): by how much the map enlarges areas, with both surfaces scaled to unit area."""
        return self.stretch[:, 0] * self.stretch[:, 1]


@dataclass(frozen=True)
class MapFigures:
    """A map in figures. Shares are of its points, 0 to 1."""

    dirichlet: float
    """mean squared stretch; at least 1 for a one-to-one map"""
    stretch_p99: float
    """99th percentile of the stretch; 1 means none"""
    conformal_median: float
    """median of (s1/s2 + s2/s1)/2; 1 if angles are preserved"""
    flipped: float
    """share where the map turns the surface over"""
    collapsed: float
    """share squeezed to a line"""
    round_trip_mean: float
    """in √area"""
    round_trip_p99: float
    """in √area"""
    coverage: float
    """share of the other cloud's points that lie within two spacings of an image"""


@dataclass(frozen=True)
class Place:
    """A place where many points are badly mapped."""

    source: int
    """row of the source"""
    target: int
    """row of the target: the image of that point"""
    flaw: str
    """mirrored, folded, lost (does not map back, or is not reached), stretched or squeezed"""
    distortion: float
    """mean over the point and its neighbors"""
    share: float
    """share of the surface that is bad there, 0 to 1"""
    advice: str
    """what is wrong there, and what would help"""
    where: str = ""
    """where it is, such as "toward +X of Fox"; empty if everywhere"""
    side: str = ""
    """which model the bad points are of, "source" or "target"; empty in older files"""


@dataclass(frozen=True)
class FeatureResidual:
    """How well the maps meet a feature, by the worse of both directions."""

    name: str
    kind: str
    """point, curve or region"""
    hard: bool
    weight: float
    residual: float
    """in spacings. Point: distance from its image to its partner. Curve: root mean square over its
    points, from the image to the same share of the other curve. Region: mean distance of its
    images outside of the other region"""
    inside: float
    """share of a region that is mapped into the other region; 1 for points and curves"""


@dataclass(frozen=True)
class Quality:
    """The quality of a morph: per point, in figures, and where it is worst."""

    source: PointQuality
    """of the map from the source to the target"""
    target: PointQuality
    """of the map back"""
    source_to_target: MapFigures
    target_to_source: MapFigures
    worst: tuple[Place, ...]
    """at most five places, far apart, worst first; empty if the map is good"""
    features: tuple[FeatureResidual, ...]
    """one for each feature"""


@dataclass(frozen=True)
class MeshPlace:
    """A place where the wrapped mesh has faults of one kind."""

    flaw: str
    """folded, creased, uncovered or off"""
    source: int
    """row of the source: the vertex there; if uncovered, the nearest one"""
    target: int
    """row of the target nearest to the place"""
    position: tuple[float, float, float]
    """on the wrapped mesh; if uncovered, on the target"""
    share: float
    """how much lies here. folded: of the area; creased: of the edges; uncovered: of the target's
    area; off: of the vertices; 0 to 1"""
    distance: float
    """uncovered and off: the largest, in √area of the target; else 0"""
    advice: str
    """what is wrong there, and what would help"""
    where: str = ""
    """where it is, such as "toward +X of Fox"; empty if everywhere"""


@dataclass(frozen=True)
class MeshQuality:
    """How good the source's faces look on the target; figures are 0 if perfect."""

    folded: float
    """share of the area: faces that lie against the target and bend by over 120° to a neighbor, but
    not at rest"""
    creased: float
    """share of the edges that bend by over 90°, but not at rest, and not along a bend of the
    target"""
    uncovered: float
    """99th percentile of the distance from the target to the faces, in √area of the target"""
    off: float
    """mean distance from the vertices to the target, in √area of the target"""
    grade: str
    """good, fair or poor, by the worst figure: see `GOOD_MESH` and `FAIR_MESH` in
    `pointmorph.morphs.verdicts`"""
    verdict: str
    """the same in words"""
    worst: tuple[MeshPlace, ...]
    """at most five places, far apart, worst first; empty if the mesh is good everywhere"""


def quality_summary(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The quality in a report, to show: names and values, the worse of both directions.

    Likely right: see `Confidence.right`. Covered, folded, collapsed: shares of the points. Stretch:
    its 99th percentile. Angle distortion: the median conformal distortion, 1 if angles are
    preserved. Round-trip error: the mean, of √area. Cracks: the largest share. Feature error:
    before features are met exactly. If the source has faces, also the figures of `MeshQuality`,
    whose share of folded faces stands in the place of that of folded points: where a mesh has few
    vertices, many of these may be turned over, and hardly a face.

    Parameters
    ----------
    report : mapping
        `Morph.report`, or the contents of a `report.json`.

    Returns
    -------
    list of (str, str)
    """
    both = report["quality"].values()

    def worst(figure: str) -> float:
        return max(float(way[figure]) for way in both)

    rows = []
    if "likely_right" in report:
        rows.append(("Likely right", percent(report["likely_right"])))
    rows += [
        ("Covered", percent(min(way["coverage"] for way in both))),
        ("Stretch", f"{worst('stretch_p99'):.2f}"),
        ("Angle distortion", f"{worst('conformal_median'):.2f}"),
        *([] if report.get("mesh") else [("Folded", percent(worst("flipped")))]),
        ("Collapsed", percent(worst("collapsed"))),
        ("Round-trip error", percent(worst("round_trip_mean"))),
        ("Cracks", percent(max(report["cracks"].values()))),
        ("Feature error", f"{report['feature_residual']:.2g} spacings"),
    ]
    if mesh := report.get("mesh"):
        rows += [
            ("Faces folded", percent(mesh["folded"])),
            ("Edges creased", percent(mesh["creased"])),
            ("Target missed", percent(mesh["uncovered"])),
            ("Off the target", percent(mesh["off"])),
        ]
    return rows


def feature_summary(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How well each feature but hard points is met, to show: names and values.

    Parameters
    ----------
    report : mapping
        `Morph.report`, or the contents of a `report.json`.

    Returns
    -------
    list of (str, str)
    """
    rows = []
    for name, kept in report.get("features", {}).items():
        if kept["kind"] == "point" and kept["hard"]:
            continue
        value = f"{kept['residual']:.2g} spacings off"
        if kept["kind"] == "region":
            value = f"{percent(kept['inside'])} inside, {value}"
        rows.append((f"{name} ({kept['kind']})", value))
    return rows


def percent(share: float) -> str:
    """To two digits, as in all sentences: "0.034 %", "42 %"; 100 % only if it is all."""
    percents = 100 * share
    if 0 < percents < 0.01:
        return "under 0.01 %"
    if 99.5 <= percents < 100 - 1e-7:
        if percents > 99.99:
            return "over 99.99 %"
        return f"{percents:.1f} %" if percents < 99.95 else f"{percents:.2f} %"
    return f"{percents:.2g} %" if percents < 9.95 else f"{percents:.0f} %"
