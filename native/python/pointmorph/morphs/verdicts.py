"""How good a morph is, in a word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

GRADES = ("good", "fair", "poor")

MOSTLY_RIGHT = 0.8
"""share of a map that is likely right, below which it is doubted"""
FOLDED, COVERED = 0.02, 0.95
"""shares of points: more that are turned over, or fewer that have a counterpart, show"""
GOOD_MESH = {"folded": 0.001, "creased": 0.002, "uncovered": 0.007, "off": 0.0005}
"""what can't be seen, in the figures of `MeshQuality`: up to these its grade is good"""
FAIR_MESH = {"folded": 0.005, "creased": 0.01, "uncovered": 0.02, "off": 0.003}
"""the same for fair"""


def grade_of(report: Mapping[str, Any]) -> str:
    """How good a morph looks: "good", "fair" or "poor".

    If the source has faces, it is how they look (`MeshQuality.grade`), as it is them that people
    see; but at most "fair" if the match is in doubt (less than `MOSTLY_RIGHT` of it is likely
    right) or has gaps (fewer points than `COVERED` have a counterpart).

    Else "poor" if the match has gaps, of which there are also some if more points than `FOLDED` are
    turned over, "fair" if it is in doubt or has bad places.

    Parameters
    ----------
    report : mapping
        `Morph.report`, or the contents of a `report.json`.
    """
    ways = report["quality"].values()
    doubted = report.get("likely_right", 1.0) < MOSTLY_RIGHT
    has_gaps = any(way["coverage"] < COVERED for way in ways)
    if mesh := report.get("mesh"):  # which has folds of its own, by area
        at_least = "fair" if doubted or has_gaps else "good"
        return max(str(mesh["grade"]), at_least, key=GRADES.index)
    if has_gaps or any(way["flipped"] > FOLDED for way in ways):
        return "poor"
    return "fair" if doubted or report["worst"] or report.get("doubtful") else "good"
