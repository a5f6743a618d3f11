"""Keys on the slider of a morph, from its first shape to its last."""

import pointmorph

from ..data import versions
from . import morph_object, recipes

EASINGS = (
    ("LINEAR", "Linear", "At the same speed all the way"),
    ("SINE", "Sinusoidal", "Start and end gently"),
    ("QUAD", "Quadratic", "Start and end more gently"),
    ("CUBIC", "Cubic", "Start and end slowly"),
    ("QUART", "Quartic", "Start and end slower still"),
    ("QUINT", "Quintic", "Start and end very slowly"),
    ("EXPO", "Exponential", "Do nearly all of it halfway"),
    ("CIRC", "Circular", "Like Exponential, with softer ends"),
    ("BEZIER", "Bezier", "A curve with handles, to be shaped in the Graph Editor"),
)
"""Blender's interpolations that stay between both ends; they ease in and out."""

_KEYED = "keyed"  # in the recipe


def put(obj, start, end, easing):
    """Keys the slider of an object from its first value to its last, in place of the keys that were
    put there before.

    Parameters
    ----------
    obj : Object
        What shows a morph.
    start, end : int
        Frames.
    easing : str
        One of EASINGS.

    Raises
    ------
    PointmorphError
    """
    if end <= start:
        raise pointmorph.OptionError(
            "end", f"a frame after the first, {start}", str(end), "Choose a later frame."
        )
    key = morph_object.t_key(obj)
    path = key.path_from_id("value")
    curve = versions.curve_of(key.id_data, path)
    if curve is not None:
        for frame in recipes.recipe_of(obj).get(_KEYED, []):
            _remove(curve, frame)
    shown = key.value
    for frame, value in ((start, 0.0), (end, 1.0 + len(obj.pointmorph.via))):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    curve = versions.curve_of(key.id_data, path)
    if curve is None:
        key.value = shown
        raise pointmorph.CloudError(
            obj.name, "a slider that takes keys", "one whose action is locked", "Unlock the action."
        )
    for point in curve.keyframe_points:
        if point.co[0] in (start, end):
            point.interpolation, point.easing = easing, "EASE_IN_OUT"
            point.handle_left_type = point.handle_right_type = "AUTO_CLAMPED"
    curve.update()
    recipes.note(obj, _KEYED, [start, end])


def is_driven(obj):
    """Whether something else than keys moves the slider of an object."""
    key = morph_object.t_key(obj)
    data = key.id_data.animation_data
    return data is not None and data.drivers.find(key.path_from_id("value")) is not None


def value_at(obj, frame):
    """What the keys make of the slider in a frame."""
    key = morph_object.t_key(obj)
    return versions.curve_of(key.id_data, key.path_from_id("value")).evaluate(frame)


def _remove(curve, frame):
    for point in reversed(curve.keyframe_points):
        if abs(point.co[0] - frame) < 1e-3:
            curve.keyframe_points.remove(point)
