"""What a run says about its result: each trouble once, with the places where it is."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pointmorph.morphs import quality
from pointmorph.morphs.verdicts import COVERED, FOLDED, GOOD_MESH, MOSTLY_RIGHT, grade_of
from pointmorph.shapes.clouds import FloatArray

_MOST_PLACES = 3


def _unseen(figure: str) -> str:
    return f"up to {quality.percent(GOOD_MESH[figure])} can't be seen"


_HINTS = {
    "Likely right": f"of the map; {quality.percent(MOSTLY_RIGHT)} or more is fine",
    "Covered": "of each model has a counterpart; 100 % is best",
    "Stretch": "times, where it is most; 1 is none",
    "Angle distortion": "1 is none",
    "Folded": "of the points turned over",
    "Collapsed": "of the points squeezed to a line",
    "Round-trip error": "of the size, from a point there and back",
    "Cracks": "of the points drift apart on the way; --resample fills gaps",
    "Feature error": "spacings, before features are made to meet",
    "Faces folded": f"of the area; {_unseen('folded')}",
    "Edges creased": f"of the edges; {_unseen('creased')}",
    "Target missed": f"of the size, where it is most; {_unseen('uncovered')}",
    "Off the target": f"of the size; {_unseen('off')}",
}


def figure_lines(report: Mapping[str, Any]) -> list[str]:
    """A table of the figures, with what they mean."""
    rows = []
    for name, value in quality.quality_summary(report):
        if name == "Feature error" and not report.get("features"):
            continue
        # Under the digits of shares; the unit is in the hint.
        shown = value if value.endswith("%") else value.removesuffix(" spacings") + "  "
        rows.append((name, shown))
    longest = max(len(shown) for _, shown in rows)
    return [
        f"{name:<18}{shown.rjust(longest)}  {_HINTS.get(name, '')}".rstrip() for name, shown in rows
    ]


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
        if folded > FOLDED and not mesh:
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

    @property
    def is_direction(self) -> bool:
        """Whether it is told by sides of the model, not by features."""
        return not self.words.startswith(_BY_FEATURES)


_BY_FEATURES = ('at "', 'near "', 'between "')
_OF_TARGET = "lost on the target"


def advice_lines(
    report: Mapping[str, Any],
    positions: Sequence[FloatArray] | None,
    names: Sequence[str],
    densify: str,
) -> list[str]:
    """What is wrong and what to do, a line for each kind of trouble, with the worst places.

    Parameters
    ----------
    report : mapping
        `Morph.report`, or the contents of a `report.json`. Places of older ones, that don't say
        where they are, have a line each.
    positions : sequence of (N, 3) array, or None
        Of the source and the target. Without them, no coordinates are given.
    names : sequence of str
        Of the source and the target.
    densify : str
        What gives the source more vertices; empty if it has got them since it was measured.
    """
    lines = []
    for kind, places in _by_kind(report).items():
        if kind == "uncovered" and not densify:
            continue
        head = _head(kind, names, densify)
        told = [place for place in places if head and place.get("where")]
        if told:
            lines.append(f"{head}: {_listed(told, positions, names)}")
        advice = (place.get("advice", "") for place in places if place not in told)
        lines += dict.fromkeys(text.rstrip(".") for text in advice if text)
    return lines


def listed_advice(report: Mapping[str, Any], lines: Sequence[str]) -> list[str]:
    """Lines of `advice_lines` below a heading that doesn't contradict the verdict."""
    if not lines:
        return []
    is_good = grade_of(report) == "good"
    what = "What could still be better" if is_good else "What would help"
    return [
        f"{what}{', the most important first' * (len(lines) > 1)}:",
        *(f"  - {x}" for x in lines),
    ]


def _listed(
    places: Sequence[Mapping[str, Any]],
    positions: Sequence[FloatArray] | None,
    names: Sequence[str],
) -> str:
    entries = _merged(_entries(places, positions, names))
    listed = ", ".join(
        entry.words + (f" ({entry.details})" if entry.details else "")
        for entry in entries[:_MOST_PLACES]
    )
    left = len(entries) - _MOST_PLACES
    return listed + (f", and {left} more place{'s' * (left > 1)}" if left > 0 else "")


def _head(kind: str, names: Sequence[str], densify: str) -> str:
    """What comes before the places; empty if these are described by their own advice."""
    source, target = names
    mark = "Mark features on both models where"
    one_lost = "If they should have one, mark features on both models."
    what = {
        "doubtful": f"{mark} the map may be wrong.",
        "lost": f"Some parts of {source} have no counterpart on {target}. {one_lost}",
        "folded": f"{mark} the surface folds or creases.",
        "stretched": f"{mark} {source} is stretched.",
        "squeezed": f"{mark} {source} is squeezed.",
        "uncovered": f"The faces of {source} don't reach all of {target}: give it more "
        f"vertices ({densify}), or mark features on both models.",
        "off": f"{mark} vertices lie off {target}.",
    }
    if kind == _OF_TARGET:
        return (
            f"Some parts of {target} have no counterpart on {source}. {one_lost} "
            f"Near these places of {source}"
        )
    return f"{what[kind]} On {source}" if kind in what else ""


def _by_kind(report: Mapping[str, Any]) -> dict[str, list[Mapping[str, Any]]]:
    """All bad places, the kinds in the order of their weight, in each the worst first."""
    found: dict[str, list[Mapping[str, Any]]] = {
        kind: []
        for kind in (
            *("mirrored", "doubtful", "lost", _OF_TARGET, "folded", "uncovered"),
            *("stretched", "squeezed", "off"),
        )
    }
    for place in report.get("doubtful") or []:
        found[_lost(place) if place.get("unreached") else "doubtful"].append(place)
    for place in [*((report.get("mesh") or {}).get("worst") or []), *(report.get("worst") or [])]:
        flaw = {"creased": "folded", "lost": _lost(place)}.get(place["flaw"], place["flaw"])
        found.setdefault(flaw, []).append(place)
    return {kind: places for kind, places in found.items() if places}


def _lost(place: Mapping[str, Any]) -> str:
    """The kind of a place without a counterpart, by the model that has it. Where an older report
    doesn't say that, the place's own advice does."""
    of_side = {"source": "lost", "target": _OF_TARGET}
    return of_side.get(place.get("side", ""), "lost on either")


def _entries(
    places: Sequence[Mapping[str, Any]],
    positions: Sequence[FloatArray] | None,
    names: Sequence[str],
) -> Iterator[_Entry]:
    """Where places are, in words, and with coordinates: of the source, but of what only the target
    has, there."""
    for place in places:
        entry = _Entry(place["where"].removesuffix(f" of {names[0]}"), "")
        if entry.is_direction:
            entry.words = entry.words.replace(", ", " ")
        details = []
        if positions is not None:
            is_lost = place.get("unreached") or place.get("flaw") == "lost"
            side = "target" if is_lost and place.get("side") == "target" else "source"
            on = positions[side == "target"]
            size = float(np.ptp(on, axis=0).max())
            at = ", ".join(_rounded(value, size) for value in on[place[side]].tolist())
            details.append(f"at {at} of {names[1]}" if side == "target" else f"at {at}")
        if "confidence" in place and not place.get("unreached"):
            details.append(f"{quality.percent(place['confidence'])} sure")
        if entry.words.startswith('at "'):
            details.append("check that this is the same place on both models")
        entry.details = "; ".join(details)
        yield entry


def _rounded(value: float, size: float) -> str:
    """A coordinate, to a thousandth of the model's size or better."""
    digits = 3 - math.ceil(math.log10(size)) if size > 0 else 3
    value = round(value, digits) + 0.0  # no -0
    return f"{value:.0f}" if digits <= 0 else f"{value:.{digits}f}".rstrip("0").rstrip(".")


def _merged(entries: Iterator[_Entry]) -> list[_Entry]:
    """Each description once; two sides that differ by the sign of an axis as one with ±."""
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
            if not (one.is_direction and entries[second].is_direction):
                continue
            for sign in re.finditer(r"[+-](?=[XYZ]\b)", one.words):
                start, end = one.words[: sign.start()], one.words[sign.end() :]
                other = "-" if sign[0] == "+" else "+"
                if entries[second].words == start + other + end:
                    return first, second, f"{start}±{end}"
    return None
