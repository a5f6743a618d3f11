"""What a .blend file says about a morph object, which may come from a stranger: taken for true only
where it has the form that the add-on gives it.

Each function takes text and returns what it says, to be read only, or None where it says nothing
usable.
"""

import math
from dataclasses import fields
from functools import lru_cache

import pointmorph
from pointmorph.storage.file_checks import parsed_json

from . import packing, quality_words
from .features import Choice
from .look_transfer import Options

_LARGEST_TEXTURE = 2**14
_MOST_FACES = 64
"""Triangles for each point of a shape."""


def recipe(text, legs):
    """What a morph object was made with.

    Parameters
    ----------
    text : str
    legs : int
        From how many shapes to the next it leads.
    """
    found = _recipe(text)
    if found is None:
        return None
    counts = {"shapes": legs + 1, "points": legs + 1, "boundaries": legs + 1, "resolved": legs}
    if any(len(found[key]) != count for key, count in counts.items() if key in found):
        return None
    return found


@lru_cache(maxsize=32)  # the panel asks at every redraw
def _recipe(text):
    found = _parsed(text)
    if not isinstance(found, dict) or not _fits(found, _RECIPE):
        return None
    if "shapes" in found and not found.keys() >= {"origin", "settings", "features", "loop"}:
        return None
    return found


@lru_cache(maxsize=32)
def report(text):
    """What the library said about a morph, as far as the panel shows it; None also for a report of
    an earlier version."""
    found = _parsed(text)
    if not isinstance(found, dict) or "quality" not in found:
        return None
    try:
        quality_words.verdict(found)
        pointmorph.quality_summary(found)
        pointmorph.feature_summary(found)
        mesh = found.get("mesh") or {"worst": [], "verdict": ""}
        places = [*found["worst"], *mesh["worst"]]
        usable = all(isinstance(place["advice"], str) for place in places)
        usable = usable and all(_is_row(place["source"]) for place in found["worst"])
        usable = usable and all(_are_numbers(place["position"], 3) for place in mesh["worst"])
        usable = usable and isinstance(mesh["verdict"], str) and _is_row(found.get("pairs", 0))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return None
    return found if usable else None


def faces(text, points):
    """The triangles of every shape of a morph object, in order; None for one that had none.

    Parameters
    ----------
    text : str
    points : sequence of int
        How many points each shape has.
    """
    packed = _parsed(text)
    if not isinstance(packed, list) or len(packed) != len(points):
        return None
    found = []
    for one, count in zip(packed, points, strict=True):
        if one is None:
            found.append(None)
            continue
        try:
            rows = packing.unpack(one, 3 * _MOST_FACES * count)
        except ValueError:
            return None
        if len(rows) % 3 or (len(rows) and not 0 <= rows.min() <= rows.max() < count):
            return None
        found.append(rows.reshape(-1, 3))
    return found


@lru_cache(maxsize=32)
def baked(text):
    """Of each shape key that was baked on a morph object: t, path, and whether it is staggered."""
    found = _parsed(text)
    if not isinstance(found, dict):
        return None
    usable = all(
        isinstance(row, list)
        and len(row) in (2, 3)
        and _is_number(row[0])
        and isinstance(row[1], str)
        for row in found.values()
    )
    return found if usable else None


@lru_cache(maxsize=32)
def noted(text):
    """Of the first and the last shape of a morph object, a few points: row and place of each."""
    found = _parsed(text)
    if not isinstance(found, list) or len(found) != 2:
        return None
    usable = all(isinstance(end, list) and end and all(map(_is_noted, end)) for end in found)
    return found if usable else None


def _is_noted(point):
    return _are_numbers(point, 4) and _is_row(point[0])


@lru_cache(maxsize=32)
def names(text):
    """A list of names."""
    found = _parsed(text)
    return found if _are_texts(found) else None


@lru_cache(maxsize=32)
def given_names(text):
    """The names that things got, by those that were wished for."""
    found = _parsed(text)
    return found if _by_name(_is_text)(found) else None


def _parsed(text):
    try:
        return parsed_json(text)
    except ValueError:
        return None


# --- The form of a recipe -------------------------------------------------------------------------


def _fits(table, form):
    """Whether what is there of these keys has the right form."""
    return all(is_right(table[key]) for key, is_right in form.items() if key in table)


def _is_number(value):
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) < 1e300 and math.isfinite(value)


def _is_row(value):
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**31


def _are_numbers(value, count):
    return isinstance(value, list) and len(value) == count and all(map(_is_number, value))


def _is_text(value):
    return isinstance(value, str)


def _is_text_or_none(value):
    return value is None or isinstance(value, str)


def _are(is_right):
    """Whether something is a list of such."""
    return lambda value: isinstance(value, list) and all(map(is_right, value))


def _by_name(is_right):
    """Whether something has such under each name."""
    return lambda value: isinstance(value, dict) and all(map(is_right, value.values()))


_are_texts = _are(_is_text)


def _is_setting(value):
    return value is None or isinstance(value, str | bool) or _is_number(value)


def _is_shape(value):
    form = {
        "name": _is_text,
        "count": _is_row,
        "data": _is_text,
        "shown": _is_text_or_none,
        "look": _is_text_or_none,
        "marks": _is_text,
        "masks": _is_text,
        "matrix": lambda matrix: _are_numbers(matrix, 16),
        "carried": lambda carried: isinstance(carried, bool),
        "pose": _is_text_or_none,
    }
    # Earlier versions had neither look nor masks; a source has no pose.
    needed = form.keys() - {"look", "masks", "pose"}
    return isinstance(value, dict) and value.keys() >= needed and _fits(value, form)


def _is_choice(value):
    """What `dataclasses.astuple` makes of a Choice, also of an earlier version's shorter one."""
    kinds = tuple(type(field.default) for field in fields(Choice))
    if not isinstance(value, list) or len(value) > len(kinds):
        return False
    return all(
        _is_number(one) if kind is float else isinstance(one, kind)
        for one, kind in zip(value, kinds, strict=False)
    )


def _is_feature(value):
    """A pair of rows, or what `dataclasses.asdict` makes of a Feature; the library checks more."""
    if isinstance(value, list):
        return len(value) == 2 and all(map(_is_row, value))
    known = {field.name for field in fields(pointmorph.Feature)}
    return isinstance(value, dict) and {"source", "target"} <= value.keys() <= known


def _is_option(value):
    return isinstance(value, str | bool)


def _is_transferred(value):
    form = {
        "names": _are_texts,
        "back": _are_texts,
        "words": _are_texts,
        "kinds": _by_name(_by_name(_are_texts)),
        "options": lambda one: _are(_is_option)(one) and 4 <= len(one) <= 8,
    }
    return isinstance(value, dict) and _fits(value, form) and bool({"kinds", "options"} & {*value})


def _is_texture(value):
    known = {field.name for field in fields(Options)}
    return value is None or (
        isinstance(value, dict)
        and value.keys() <= known
        and all(isinstance(one, bool | int) for one in value.values())
        and 1 <= value.get("size", 1) <= _LARGEST_TEXTURE
    )


_RECIPE = {
    "shapes": _are(_is_shape),
    "origin": lambda origin: _are_numbers(origin, 3),
    "settings": _by_name(_is_setting),
    "features": _by_name(_is_choice),
    "loop": _are_texts,
    "resolved": _are(_by_name(_is_feature)),
    "points": _are(_is_row),
    "boundaries": _are(lambda rows: rows is None or _are(_is_row)(rows)),
    "keys": lambda keys: _are_texts(keys) and len(keys) > 0,
    "keyed": _are(_is_number),
    "transferred": _is_transferred,
    "transferred_to_source": _is_transferred,
    "textures": _is_texture,
}
