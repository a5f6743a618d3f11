"""Keys on the slider of a morph, from its first shape to its last."""

import pointmorph

from ..data import curves, nodes, versions
from . import morph_object, recipes

EASINGS = (
    ("LINEAR", "Linear", "Constant speed"),
    ("SINE", "Sinusoidal", "Start and end gently"),
    ("QUAD", "Quadratic", "Start and end more gently"),
    ("CUBIC", "Cubic", "Start and end slowly"),
    ("QUART", "Quartic", "Start and end slower still"),
    ("QUINT", "Quintic", "Start and end very slowly"),
    ("EXPO", "Exponential", "Nearly all of the change happens around the middle"),
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
            "End", f"a frame after the first, {start}", str(end), "Choose a later frame."
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
            obj.name, "a slider that can be keyed", "a locked action", "Unlock the action."
        )
    for point in curve.keyframe_points:
        if point.co[0] in (start, end):
            point.interpolation, point.easing = easing, "EASE_IN_OUT"
            point.handle_left_type = point.handle_right_type = "AUTO_CLAMPED"
    curve.update()
    recipes.note(obj, _KEYED, [start, end])


def hand_over(obj, mesh):
    """Gives what moves the slider of a morph object to the mesh that shows it from now on: its keys
    or its driver, and what *Key Morph* knows of them."""
    key, other = morph_object.t_key(obj), morph_object.t_key(mesh)
    path = key.path_from_id("value")
    let_go(obj)
    driver = _driver_of(key)
    curve = versions.curve_of(key.id_data, path)
    if driver is not None:
        data = other.id_data.animation_data_create()
        data.drivers.from_existing(src_driver=driver).data_path = other.path_from_id("value")
        key.driver_remove("value")
    if curve is not None:
        curves.copy_curve(curve, other, "value")
        versions.remove_curve(key.id_data, path)
    known = recipes.recipe_of(obj)
    if _KEYED in known:
        recipes.note(mesh, _KEYED, known[_KEYED])
        recipes.note(obj, _KEYED, [])
    for name in ("key_frames", "has_key_frames", "key_easing"):
        setattr(mesh.pointmorph, name, getattr(obj.pointmorph, name))


def follow(obj, mesh):
    """Makes the slider of a morph object follow that of the mesh that shows it."""
    curve = morph_object.t_key(obj).driver_add("value")
    curve.driver.type = "AVERAGE"
    nodes.drive(curve.driver, morph_object.t_key(mesh))


def let_go(obj):
    """Makes the slider of a morph object follow no mesh any more; returns whether it did."""
    key = morph_object.t_key(obj)
    curve = _driver_of(key)
    follows = curve is not None and nodes.is_of_key(curve.driver)
    if follows:
        key.driver_remove("value")
    return follows


def is_driven(obj):
    """Whether something else than keys moves the slider of an object."""
    return _driver_of(morph_object.t_key(obj)) is not None


def value_at(obj, frame):
    """What the keys make of the slider in a frame."""
    key = morph_object.t_key(obj)
    return versions.curve_of(key.id_data, key.path_from_id("value")).evaluate(frame)


def _driver_of(key):
    data = key.id_data.animation_data
    return None if data is None else data.drivers.find(key.path_from_id("value"))


def _remove(curve, frame):
    for point in reversed(curve.keyframe_points):
        if abs(point.co[0] - frame) < 1e-3:
            curve.keyframe_points.remove(point)
