"""Whether a morph object is what it would be if it were computed now."""

import bpy
import numpy as np

from ..core.settings import changed_settings, name_label, settings_values
from ..core.stepping import finish
from ..data.feature_list import feature_choices
from . import applied, lost_keys, morph_object, recipes

CURRENT, STALE, ORPHAN, UNKNOWN = "CURRENT", "STALE", "ORPHAN", "UNKNOWN"


def picked_shapes(scene):
    """The objects that the panel has picked, in order."""
    settings = scene.pointmorph
    return [settings.source, *(item.object for item in settings.via), settings.target]


def pick_instead(settings, shape, other):
    """Has the panel pick another object wherever it has picked one."""
    for owner, name in (
        (settings, "source"),
        *((item, "object") for item in settings.via),
        (settings, "target"),
    ):
        if getattr(owner, name) == shape:
            setattr(owner, name, other)


def is_picked(scene, obj):
    """Whether the panel is about this morph object: the same shapes are picked there, or copies of
    them that show the same."""
    shapes, picked = recipes.shapes_of(obj), picked_shapes(scene)
    if None in shapes or None in picked or len(shapes) != len(picked):
        return False
    return all(_is_same(*pair) for pair in zip(shapes, picked, strict=True))


def is_exactly_picked(scene, obj):
    """Whether those are picked themselves, not what they are copies of, or a copy of them."""
    return picked_shapes(scene) == recipes.shapes_of(obj)


def _is_same(shape, picked):
    return shape == picked or recipes.original_of(shape) in (picked, recipes.original_of(picked))


def state(obj, prints=None):
    """Whether a morph object is what it would be if it were computed now.

    Parameters
    ----------
    prints : list, optional
        What `fingerprints` said a moment ago.

    Returns
    -------
    str
        CURRENT, STALE, ORPHAN, UNKNOWN; "" for any other object.
    list of str
        What has changed, in words.
    """
    if not morph_object.is_made(obj):
        return "", []
    recipe = recipes.recipe_of(obj)
    if not recipes.is_known(recipe):
        if obj.pointmorph.recipe:
            return UNKNOWN, ["what it was made with can't be read"]
        return UNKNOWN, ["made by an earlier version, which stored no settings"]
    shapes = recipes.shapes_of(obj)
    if None in shapes:
        return ORPHAN, [*recipes.gone_words(obj).values(), *lost_keys.words(obj)]
    prints = fingerprints(obj) if prints is None else prints
    reasons = []
    if morph_object.is_edited(obj):
        reasons.append(f'"{obj.name}" has other vertices than it was made with')
    reasons += lost_keys.words(obj)
    if applied.matrix_of(obj) is not None:
        reasons.append(f'transforms were applied to "{obj.name}"')
    # From a source that is carried away, all others seem to move.
    source_is_carried = recipe["shapes"][0]["carried"] or prints[0]["carried"]
    for known, now in zip(recipe["shapes"], prints, strict=True):
        reasons += _differences(known, now, obj.pointmorph.follows, source_is_carried)
    scene = bpy.context.scene
    if is_picked(scene, obj):
        reasons += _other_settings(recipe, scene.pointmorph)
    return (STALE if reasons else CURRENT), reasons


def fingerprints(obj):
    """Those of the shapes of a morph object as they are now; None where one is gone."""
    return finish(fingerprints_steps(obj))


def fingerprints_steps(obj):
    """The same as a generator that yields often. Nothing may change meanwhile."""
    shapes = recipes.shapes_of(obj)
    if None in shapes:
        return None
    # Seen from the source: where all went along together, nothing has changed.
    origin = np.array(shapes[0].matrix_world.translation)
    return (yield from recipes.prints_of_steps(shapes, origin))


def _differences(known, now, follows, source_is_carried):
    """What has become of a shape, in words."""
    name = now["name"]
    if known["count"] != now["count"]:
        return [f'"{name}" has {now["count"]:,} points instead of {known["count"]:,}']
    both_shown = None not in (known["shown"], now["shown"])
    found = []
    if known["data"] != now["data"]:
        found.append(f'"{name}" was edited')
    elif both_shown and known["shown"] != now["shown"] and not follows:
        found.append(f'"{name}" looks different: its modifiers or shape keys have changed')
    if None not in (known.get("look"), now["look"]) and known["look"] != now["look"]:
        found.append(f'the look of "{name}" has changed: its materials, images or UV maps')
    if known["marks"] != now["marks"]:
        found.append(f'features on "{name}" have changed')
    if known.get("masks", now["masks"]) != now["masks"]:
        found.append(f'the masks of "{name}" have changed')
    if not (known["carried"] or now["carried"] or source_is_carried or follows):
        before, after = np.array(known["matrix"]), np.array(now["matrix"])
        if np.abs(before - after).max() > 1e-5 * max(np.abs(before).max(), 1e-30):
            found.append(f'"{name}" was moved, rotated or scaled')
    return found


def _other_settings(recipe, settings):
    names = changed_settings(recipe["settings"], settings_values(settings))
    found = [f'the setting "{name_label(name)}" was changed' for name in names]
    choices = recipes.plain_choices(feature_choices(settings))
    for name, choice in choices.items():
        if name in recipe["features"] and recipe["features"][name] != choice:
            found.append(f'the options of feature "{name}" were changed')
    if recipe["loop"] != [item.name for item in settings.loop]:
        found.append("the loop was changed")
    return found
