"""How good a morph is, in a word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

GRADES = ("good", "fair", "poor")

MOSTLY_RIGHT = 0.8
"""share of a map that is likely right, below which it is doubted"""
FOLDED, COVERED = 0.02, 0.95
"""shares of points: more that are turned over, or fewer that have a counterpart, show"""


def grade_of(report: Mapping[str, Any]) -> str:
    """How good a morph looks: "good", "fair" or "poor".

    If the source has faces, their grade (see `MeshQuality.grade`), as it is them that people see.
    Else "poor" if more than 2 % of the points are folded over, or more than 5 % left out. What
    can't be seen at the ends makes "fair" of "good": less than 0.8 that is likely right, or bad
    places.

    Parameters
    ----------
    report : mapping
        `Morph.report`, or the contents of a `report.json`.
    """
    ways = report["quality"].values()
    doubted = report.get("likely_right", 1.0) < MOSTLY_RIGHT
    has_gaps = any(way["flipped"] > FOLDED or way["coverage"] < COVERED for way in ways)
    if mesh := report.get("mesh"):
        at_least = "fair" if doubted or has_gaps else "good"
        return max(str(mesh["grade"]), at_least, key=GRADES.index)
    if has_gaps:
        return "poor"
    return "fair" if doubted or report["worst"] or report.get("doubtful") else "good"
