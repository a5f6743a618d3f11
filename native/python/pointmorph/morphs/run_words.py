"""What a run says about its result: each trouble once, with the places where it is."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pointmorph.morphs import quality
from pointmorph.morphs.verdicts import COVERED, FOLDED, MOSTLY_RIGHT, grade_of
from pointmorph.shapes.clouds import FloatArray

_MOST_PLACES = 3

_HINTS = {
    "Likely right": "of the map; 80 % or more is fine",
    "Covered": "of each model has a counterpart; 100 % is best",
    "Stretch": "times, where it is most; 1 is none",
    "Angle distortion": "1 is none",
    "Folded": "of the points turned over",
    "Collapsed": "of the points squeezed to a line",
    "Round-trip error": "of the size, from a point there and back",
    "Cracks": "of the points drift apart on the way; --resample fills gaps",
    "Feature error": "before features are made to meet",
    "Faces folded": "of the area; up to 0.1 % can't be seen",
    "Edges creased": "of the edges; up to 0.2 % can't be seen",
    "Target missed": "of the size, where it is most; up to 0.7 % can't be seen",
    "Off the target": "of the size; up to 0.05 % can't be seen",
}


def figure_lines(report: Mapping[str, Any]) -> list[str]:
    """A table of the figures, with what they mean."""
    rows = [
        row
        for row in quality.quality_summary(report)
        if row[0] != "Feature error" or report.get("features")
    ]
    longest = max(len(value) for _, value in rows)
    lines = []
    for name, value in rows:
        hint = _HINTS.get(name, "")
        if not value.endswith("%"):
            value += "  "  # under the digits of shares
        lines.append(f"{name:<18}{value.rjust(longest)}  {hint}".rstrip())
    return lines


def verdict_line(report: Mapping[str, Any], names: Sequence[str]) -> str:
    """How good the result is, and why."""
    grade = grade_of(report)
    reasons = []
    if mesh := report.get("mesh"):
        reasons.append(mesh["verdict"].partition(": ")[2].rstrip("."))
    ways = report["quality"].values()
    if not mesh or mesh["grade"] == "good":
        folded = max(way["flipped"] for way in ways)
        covered = min(way["coverage"] for way in ways)
        if folded > FOLDED:
            reasons.append(f"{quality.percent(folded)} of the points are turned over")
        if covered < COVERED:
            reasons.append(f"{quality.percent(1 - covered)} of the points have no counterpart")
    if report.get("likely_right", 1.0) < MOSTLY_RIGHT and grade == "fair":
        reasons.append("parts of it may be matched wrongly")
    if not reasons:
        reasons.append(f"{names[0]} goes to {names[1]}" + (", but see below" * (grade != "good")))
    return f"{grade.capitalize()}: {'; '.join(reasons)}."


@dataclass
class _Entry:
    """One or several places that are described alike."""

    words: str
    details: str


def advice_lines(
    report: Mapping[str, Any], positions: FloatArray | None, names: Sequence[str], densify: str
) -> list[str]:
    """What is wrong and what to do, a line for each kind of trouble, with the worst places.

    Parameters
    ----------
    report : mapping
        `Morph.report`.
    positions : (N, 3) array or None
        Of the source. Without them, no coordinates are given.
    names : sequence of str
        Of the source and the target.
    densify : str
        What gives the source more vertices; empty if it has got them since it was measured.
    """
    lines = []
    for kind, places in _by_kind(report).items():
        if kind == "uncovered" and not densify:
            continue
        entries = _merged(_entries(places, positions, names[0]))
        if kind == "mirrored":
            lines.append(places[0]["advice"].rstrip("."))
            continue
        listed = ", ".join(
            entry.words + (f" ({entry.details})" if entry.details else "")
            for entry in entries[:_MOST_PLACES]
        )
        left = len(entries) - _MOST_PLACES
        more = f", and {left} more place{'s' * (left > 1)}" if left > 0 else ""
        lines.append(f"{_head(kind, names, densify)} On {names[0]}: {listed}{more}")
    return lines


def _head(kind: str, names: Sequence[str], densify: str) -> str:
    source, target = names
    return {
        "doubtful": "Mark features on both models where the map may be wrong.",
        "lost": "Some parts have no counterpart. If they should have one, mark features on both "
        "models.",
        "folded": "Mark features on both models where the surface folds or creases.",
        "stretched": f"Mark features on both models where {source} is stretched.",
        "squeezed": f"Mark features on both models where {source} is squeezed.",
        "uncovered": f"The faces of {source} don't reach all of {target}: give it more "
        f"vertices ({densify}), or mark features on both models.",
        "off": f"Mark features on both models where vertices lie off {target}.",
        "mirrored": "",
    }[kind]


def _by_kind(report: Mapping[str, Any]) -> dict[str, list[Mapping[str, Any]]]:
    """All bad places, the kinds in the order of their weight, in each the worst first."""
    found: dict[str, list[Mapping[str, Any]]] = {
        kind: []
        for kind in (
            *("mirrored", "doubtful", "lost", "folded", "uncovered"),
            *("stretched", "squeezed", "off"),
        )
    }
    for place in report.get("doubtful", []):
        found["lost" if place.get("unreached") else "doubtful"].append(place)
    for place in (report.get("mesh") or {}).get("worst", []):
        found["folded" if place["flaw"] == "creased" else place["flaw"]].append(place)
    for place in report["worst"]:
        found[place["flaw"]].append(place)
    return {kind: places for kind, places in found.items() if places}


def _entries(
    places: Sequence[Mapping[str, Any]], positions: FloatArray | None, source: str
) -> Iterator[_Entry]:
    """Where places are, in words, and with coordinates."""
    size = 0.0 if positions is None else float(np.ptp(positions, axis=0).max())
    for place in places:
        words = place.get("where", "").removesuffix(f" of {source}").replace(", ", " ")
        details = []
        if positions is not None:
            at = (_rounded(value, size) for value in positions[place["source"]].tolist())
            details.append(f"at {', '.join(at)}")
        if "confidence" in place and not place.get("unreached"):
            details.append(f"{quality.percent(place['confidence'])} sure")
        if words.startswith('at "'):
            details.append("check that this is the same place on both models")
        yield _Entry(words, "; ".join(details))


def _rounded(value: float, size: float) -> str:
    """A coordinate, to a thousandth of the model's size or better."""
    digits = 3 - math.ceil(math.log10(size)) if size > 0 else 3
    value = round(value, digits) + 0.0  # no -0
    return f"{value:.0f}" if digits <= 0 else f"{value:.{digits}f}".rstrip("0").rstrip(".")


def _merged(entries: Iterator[_Entry]) -> list[_Entry]:
    """Each description once; two that differ by the sign of an axis as one with ±."""
    result: list[_Entry] = []
    for entry in entries:
        if any(entry.words == other.words for other in result):
            continue
        result.append(entry)
    while (pair := _twins(result)) is not None:
        first, second, words = pair
        one = result[first]
        result[first] = _Entry(words, re.sub("^at ", "such as ", one.details))
        del result[second]
    return result


def _twins(entries: Sequence[_Entry]) -> tuple[int, int, str] | None:
    for first, one in enumerate(entries):
        for second in range(first + 1, len(entries)):
            for sign in re.finditer(r"[+-](?=[XYZ]\b)", one.words):
                start, end = one.words[: sign.start()], one.words[sign.end() :]
                other = "-" if sign[0] == "+" else "+"
                if entries[second].words == start + other + end:
                    return first, second, f"{start}±{end}"
    return None
