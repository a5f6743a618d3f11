"""The quality of a morph in one line, and what its figures mean."""

import re
from dataclasses import dataclass

from pointmorph.morphs.quality import percent
from pointmorph.morphs.verdicts import COVERED, FOLDED, GOOD_MESH, MOSTLY_RIGHT, grade_of


def _unseen(figure):
    return f"up to {percent(GOOD_MESH[figure])} isn't visible"


FIGURES = {
    "Likely right": "Share of the points that are likely mapped to where they belong. Below "
    f"{percent(MOSTLY_RIGHT)}, more features are needed",
    "Covered": "Share of the points of each shape that points of the other map to. 100 % is best",
    "Stretch": "How much the map stretches the worst one percent of points. 1 means no stretch",
    "Angle distortion": "How much angles change at the median point. 1 means no change",
    "Folded": "Share of the points where the map turns the surface over. 0 % is best",
    "Collapsed": "Share of the points that are squeezed to a line. 0 % is best",
    "Round-trip error": "How far a point is from its start after being mapped there and back, "
    "as a share of the shape's size. 0 % is best",
    "Cracks": "Share of the surface where gaps open during the morph, which baked frames fill "
    "with new points",
    "Feature error": "How far features are from each other before they are made to meet, in "
    "point spacings",
    "Faces folded": "Share of the area of the source's faces that are folded over on the "
    f"target. 0 % is best, and {_unseen('folded')}",
    "Edges creased": "Share of the edges that bend by more than 90° at the end, but not at "
    f"first, and where the target has no bend. {_unseen('creased').capitalize()}",
    "Target missed": "How far the worst one percent of the target is from the source's faces, "
    f"as a share of its size. {_unseen('uncovered').capitalize()}",
    "Off the target": "How far the source's vertices lie off the target on average, as a share of "
    f"its size. {_unseen('off').capitalize()}",
}
"""What the figures of `pointmorph.quality_summary` mean, by name."""

_FROM_EARLIER = (
    "This map was computed from an earlier one, as after Subdivide Source, and no others were "
    "looked for. For that alone it is less, such as 90 % instead of 95 %"
)


def meaning(name, report):
    """What a figure of a report means."""
    if name == "Likely right" and _is_from_earlier(report):
        return f"{FIGURES[name]}. {_FROM_EARLIER}"
    return FIGURES[name]


def _is_from_earlier(report):
    """Whether a map, or one of a chain's, was computed from an earlier one, which only domain auto
    can."""
    return any(
        way["options"]["domain"] == "auto"
        and any(start["start"] == "earlier map" for start in way["starts"])
        for way in (report, *report.get("ways", {}).values())
        if "starts" in way and "options" in way
    )


OF_FEATURES = (
    "How far this feature ends from its counterpart, in point spacings. For a region, also how "
    "much of it is inside the other"
)
_SIDES = (("L", "R"), ("left", "right"), ("Left", "Right"))
_MESH_VERDICT = re.compile(r"(?:(?P<way>.*): )?(?:Good|Fair|Poor): (?P<reasons>.*?)\.?", re.DOTALL)
_PLACE = re.compile(r'(At|Near) "[^"]*"|Between "[^"]*" and "[^"]*"|.{2,40}? of (?=\S)')


@dataclass(frozen=True)
class Verdict:
    """How good a morph is.

    Attributes
    ----------
    grade : str
        Of `pointmorph.morphs.verdicts.grade_of`.
    line : str
        The same in a line.
    reasons : tuple of str
        Why, a line each.
    """

    grade: str
    line: str
    reasons: tuple


def verdict(report):
    """The Verdict on a morph, from `pointmorph.Morph.report`."""
    mesh = report.get("mesh") or {"grade": "good", "worst": []}
    grade, said = grade_of(report), _said_of_map(report)
    doubtful = report.get("doubtful", [])
    places = _counted(len(report["worst"]) + len(mesh["worst"]) + len(doubtful))
    if grade == "good":
        line = f"{places} could be better" if places else "no bad places"
    else:
        line = f"{places} to look at" if places else "see below"
    if "verdict" in mesh:
        said += _said_of_mesh(mesh)
    return Verdict(grade, f"{grade.capitalize()}: {line}", tuple(said))


def _counted(places):
    return "1 place" if places == 1 else f"{places} places" if places else ""


def _said_of_map(report):
    ways = report["quality"].values()
    flipped, covered = max(way["flipped"] for way in ways), min(way["coverage"] for way in ways)
    found = []
    if flipped > FOLDED and not report.get("mesh"):
        found.append(f"Match: {percent(flipped)} of the points are folded over")
    if covered < COVERED:
        found.append(f"Match: {percent(1.0 - covered)} of the points are left out")
    right, from_earlier = report.get("likely_right", 1.0), _is_from_earlier(report)
    if right < MOSTLY_RIGHT:
        less = ", less for being computed from an earlier map" if from_earlier else ""
        found.append(f"Match: only {percent(right)} is likely right{less}")
    doubtful = report.get("doubtful", [])
    if doubtful:
        found.append(f"Match: {_counted(len(doubtful))} more likely wrong than right")
    if report["worst"]:
        found.append(f"Match: {_counted(len(report['worst']))} with strong distortion")
    return found


def _said_of_mesh(mesh):
    """What the library's verdict on the source's faces says, without a grade of its own."""
    found = _MESH_VERDICT.fullmatch(mesh["verdict"])
    if found is None:
        return []
    way = f" ({found['way']})" if found["way"] else ""
    reasons = found["reasons"].split("; ")
    if mesh["worst"]:
        places = _counted(len(mesh["worst"]))
        if mesh["grade"] == "good":
            reasons[-1] += f", but for {places}"
        else:
            reasons.append(f"{places} with faults")
    return [f"Faces{way}: {text.replace('the faces of', 'those of', 1)}" for text in reasons]


def place_name(advice):
    """Where it is that an advice is about: its first words."""
    found = _PLACE.match(advice)
    if found is None:
        return "Place"
    return re.sub(" of $", "", found[0])


def missing_marks(names):
    """Of features that have a side, those whose other side isn't marked: (there, missing)."""
    known, found = set(names), []
    for name in names:
        for side, other in (*_SIDES, *(pair[::-1] for pair in _SIDES)):
            if name.endswith(side) and len(name) > len(side):
                rest = name.removesuffix(side)
                if rest[-1] in "._- " and rest + other not in known:
                    found.append((name, rest + other))
    return found


def with_present_names(text, names):
    """A text in which objects that were renamed have their present names.

    Parameters
    ----------
    names : dict of str to str
        The present names by the former.
    """
    changed = {old: new for old, new in names.items() if old != new}
    if not changed:
        return text
    longest_first = sorted(changed, key=len, reverse=True)
    # What is quoted is a feature.
    words = "|".join(re.escape(name) for name in longest_first)
    return re.sub(rf'(?<![\w"])({words})(?![\w"])', lambda found: changed[found[0]], text)
