"""The quality of a morph in one line, and what its figures mean."""

import re

FIGURES = {
    "Covered": "Share of the points of either shape that a point of the other maps to. 100 % "
    "is best",
    "Stretch": "How much the map stretches at its worst one percent of points. 1 means no stretch",
    "Angle distortion": "How much angles change at half of the points. 1 means no change",
    "Folded": "Share of the points where the map turns the surface over. 0 % is best",
    "Collapsed": "Share of the points that are squeezed to a line. 0 % is best",
    "Round-trip error": "How far a point ends from where it was, there and back, as a share of the "
    "shape's size. 0 % is best",
    "Cracks": "Share of the surface where gaps open on the way, which baked frames fill with new "
    "points",
    "Feature error": "How far features are from each other before they are made to meet, in "
    "point spacings",
    "Faces folded": "Share of the area of the source's faces that lie against the target. 0 % is "
    "best, and up to 0.02 % isn't visible",
    "Edges creased": "Share of the edges that bend by more than 90° at the end. Up to 0.12 % "
    "isn't visible",
    "Target missed": "How far the target is from the source's faces at its worst one percent, as a "
    "share of its size. Up to 0.5 % isn't visible",
    "Off the target": "How far the source's vertices lie off the target on average, as a share of "
    "its size. Up to 0.01 % isn't visible",
}
"""What the figures of `pointmorph.quality_summary` mean, by name."""

OF_FEATURES = (
    "How far this feature ends from its counterpart, in point spacings, and of a "
    "region how much of it is inside the other"
)
GRADES = ("good", "fair", "poor")
_SIDES = (("L", "R"), ("left", "right"), ("Left", "Right"))
_PLACE = re.compile(r'(At|Near) "[^"]*"|Between "[^"]*" and "[^"]*"|.{2,40}? of (?=\S)')


def verdict(report):
    """How good a morph is.

    Parameters
    ----------
    report : dict
        See `pointmorph.Morph.report`.

    Returns
    -------
    str
        One of GRADES.
    str
        The same in a line.
    """
    mesh = report.get("mesh") or {"grade": "good", "worst": []}
    grade = max(_grade_of_map(report), mesh["grade"], key=GRADES.index)
    count = len(report["worst"]) + len(mesh["worst"])
    if not count:
        said = "no bad places" if grade == "good" else "see the figures"
    else:
        said = "1 place to look at" if count == 1 else f"{count} places to look at"
    return grade, f"{grade.capitalize()}: {said}"


def _grade_of_map(report):
    ways = report["quality"].values()
    if max(way["flipped"] for way in ways) > 0.02 or min(way["coverage"] for way in ways) < 0.95:
        return "poor"
    return "fair" if report["worst"] else "good"


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
