"""What a morph object remembers of how it was made.

The recipe is kept as JSON, because it must survive whatever happens to the objects that it is
about: the settings, what the features were, and of every shape a fingerprint of its own data.
"""

import json
from dataclasses import asdict, astuple, fields

import bpy
import pointmorph

from ..core import remembered, transforms
from ..core.features import PREFIX, Choice
from ..core.quality_words import with_present_names
from ..core.settings import by_hand, scene_options
from ..data import arrays, masks
from ..data.feature_list import feature_groups, set_loop
from . import object_looks

# Modifiers that move with something else than the object itself.
_MOVING = {
    "ARMATURE",
    "BUILD",
    "CAST",
    "CLOTH",
    "CURVE",
    "DYNAMIC_PAINT",
    "FLUID",
    "HOOK",
    "LATTICE",
    "MESH_CACHE",
    "MESH_DEFORM",
    "MESH_SEQUENCE_CACHE",
    "OCEAN",
    "SHRINKWRAP",
    "SOFT_BODY",
    "SURFACE_DEFORM",
    "WAVE",
}
TRANSFERRED = "transferred"
# What a recipe says about the object itself.
_OWN = ("keys", TRANSFERRED, "transferred_to_source", "keyed", "textures")


# --- What the shapes are now ----------------------------------------------------------------------


def shapes_of(obj):
    """The objects that a morph object was made from, in order; None for what is gone."""
    return [shape if is_there(shape) else None for shape in pointers_of(obj)]


def pointers_of(obj):
    """The same, with what was deleted in the viewport: it is kept by the pointer to it."""
    data = obj.pointmorph
    return [data.source, *(item.object for item in data.via), data.target]


def original_of(obj):
    """The object that a copy was made of, and shows, or the object itself."""
    original = obj.pointmorph.shown_from
    return original if original is not None and original.users_collection else obj


def gone_words(obj):
    """What has become of each object that isn't there and a morph object was made from, by the name
    that it had then."""
    known = recipe_of(obj).get("shapes", ())
    return {
        before["name"]: f'"{before["name"]}" no longer exists'
        if shape is None
        else f'"{shape.name}" is in no collection: it was deleted, or only came along when the '
        "morph was appended"
        for before, shape in zip(known, pointers_of(obj), strict=False)
        if not is_there(shape)
    }


def gone_error(obj, number, what, advice):
    """The error that a shape of a morph object isn't there; `advice` is for one that is in this
    file no more."""
    shape = pointers_of(obj)[number]
    found = "none" if shape is None else f'"{shape.name}" in no collection'
    if shape is not None:
        advice = "Undo its deletion, or drag it into a collection (Blender File in the Outliner)."
    return pointmorph.CloudError(obj.name, f"{what} in this file", found, advice)


def is_there(obj):
    """Whether an object, or None, is in a scene or a collection."""
    if obj is None:
        return False
    # Panels ask at every redraw. The last way is slow, and needed only for equal names.
    return bpy.context.scene.objects.get(obj.name) == obj or bool(obj.users_collection)


def is_moving(obj):
    """Whether an object's form changes from frame to frame, so that only its rest form tells
    whether it was edited."""
    data = obj.data
    animated = (obj, data, getattr(data, "shape_keys", None))
    if any(item is not None and item.animation_data is not None for item in animated):
        return True
    return any(modifier.type in _MOVING for modifier in obj.modifiers)


def _is_carried(obj):
    """Whether an object's place changes from frame to frame."""
    while obj is not None:
        if obj.animation_data is not None or len(obj.constraints):
            return True
        obj = obj.parent
    return False


def _digest_by_name(found):
    return arrays.digest(
        *(part for name in sorted(found) for part in (name.encode(), *found[name]))
    )


def fingerprint_steps(obj, origin, as_shown):
    """What can be compared of a shape: a dict of a few short strings and numbers. A generator that
    yields often and returns it, because vertex groups take long.

    Parameters
    ----------
    origin : (3,) array
        Of the morph's frame.
    as_shown : bool
        As in `reading.read_shape_steps`. What the viewport shows of an object whose form moves by
        itself isn't looked at.
    """
    data = obj.data
    shown = look = None
    if as_shown and not is_moving(obj):
        evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        if evaluated.is_evaluated and type(evaluated.data) is type(data):
            shown = arrays.digest(arrays.positions_of(evaluated.data))
    if obj.type == "MESH":
        positions = arrays.basis_positions(data)
        color = arrays.active_colors(data)
        yield
        parts = [positions, arrays.mesh_edges(data)]
        yield
        parts.append(arrays.mesh_corners(data))
        groups, chosen = feature_groups(obj), {} if as_shown else masks.mask_groups(obj)
        yield
        marks, kept = yield from masks.read_steps(data, groups, chosen)
        look = yield from object_looks.described_steps(obj)
    else:
        positions = arrays.cloud_positions(data)
        color, kept = None, {}
        parts = [positions, *(arrays.read_attribute(a) for a in _of_points(data))]
        marks = {
            a.name: (arrays.read_attribute(a),)
            for a in data.attributes
            if a.name.startswith(PREFIX)
            and arrays.point_attribute(data, a.name, "FLOAT", "INT", "INT8", "BOOLEAN")
        }
    if color is not None:
        parts.append(arrays.read_attribute(color))
    radius = arrays.point_attribute(data, "radius", "FLOAT")
    if radius is not None:
        parts.append(arrays.read_attribute(radius))
    return {
        "name": obj.name,
        "count": len(positions),
        "data": arrays.digest(*parts),
        "shown": shown,
        "look": None if look is None else arrays.digest(*look),
        "marks": _digest_by_name(marks),
        "masks": _digest_by_name(kept),
        "matrix": transforms.relative_to(obj.matrix_world, origin).reshape(-1).tolist(),
        "carried": _is_carried(obj),
    }


def _of_points(cloud):
    """What a morph takes from a point cloud besides positions and features."""
    kinds = ("FLOAT_COLOR", "BYTE_COLOR", "FLOAT_VECTOR")
    found = (arrays.point_attribute(cloud, a.name, *kinds) for a in cloud.attributes)
    return [a for a in found if a is not None and a.name != "position"]


def prints_of_steps(shapes, origin):
    """`fingerprint_steps` of all shapes of a morph, in order; a list."""
    prints = []
    for number, shape in enumerate(shapes):
        prints.append((yield from fingerprint_steps(shape, origin, number > 0)))
        yield
    return prints


# --- The recipe -----------------------------------------------------------------------------------


def take_down_steps(shapes, requests, origin, choices):
    """The recipe of a morph that is about to be computed; a generator that yields often.

    Parameters
    ----------
    shapes : sequence of Object
    requests : sequence of Request
        One from each shape to the next.
    origin : (3,) array
    choices : dict of str to Choice
        See `properties.feature_choices`.
    """
    return {
        "shapes": (yield from prints_of_steps(shapes, origin)),
        "origin": [float(x) for x in origin],
        "settings": requests[0].settings,
        "features": plain_choices(choices),
        "loop": list(requests[0].loop),
        "resolved": [
            {name: _plain_feature(feature) for name, feature in request.features.items()}
            for request in requests
        ],
    }


def plain_choices(choices):
    return {name: list(astuple(choice)) for name, choice in choices.items()}


def _plain_feature(feature):
    if isinstance(feature, pointmorph.Feature):
        return asdict(feature)
    return [int(row) for row in feature]


def feature_of(plain):
    """The feature that a recipe has in this form."""
    return pointmorph.Feature(**plain) if isinstance(plain, dict) else tuple(plain)


def remember(obj, recipe, outcome):
    """Writes the recipe, and what only the computation knew, onto the morph object."""
    kept = recipe_of(obj)
    recipe = {
        **recipe,
        **{key: kept[key] for key in _OWN if key in kept},
        "points": [int(end.rows.max()) + 1 for end in outcome.ends],
    }
    obj.pointmorph.recipe = json.dumps(recipe)
    obj.pointmorph.report = json.dumps(outcome.report)
    obj.pointmorph.faces = json.dumps(outcome.faces)
    obj.pointmorph.too_fine = next(iter(outcome.report["too_fine"]), "")


def faces_of(obj):
    """The triangles of every shape of a morph object, in order; None where it had none, or an
    earlier version made it. Raises CloudError where the file has something else in their place."""
    if not obj.pointmorph.faces:
        return [None] * (len(obj.pointmorph.via) + 2)
    found = remembered.faces(obj.pointmorph.faces, recipe_of(obj).get("points", []))
    if found is None:
        raise pointmorph.CloudError(
            obj.name, "the faces it was made from", "damaged data in the file", "Morph again."
        )
    return found


def share_recipe(copy, obj):
    """Makes one object remember what another does, but for what it has of its own."""
    own = {key: value for key, value in recipe_of(copy).items() if key in _OWN}
    common = {key: value for key, value in recipe_of(obj).items() if key not in _OWN}
    copy.pointmorph.recipe = json.dumps({**common, **own})
    copy.pointmorph.report = obj.pointmorph.report


def note(obj, name, value):
    """Adds something to the recipe of an object."""
    obj.pointmorph.recipe = json.dumps({**recipe_of(obj), name: value})


def recipe_of(obj):
    """The recipe of a morph object; empty for one of an earlier version, or where the file holds
    something else in its place."""
    return remembered.recipe(obj.pointmorph.recipe, len(obj.pointmorph.via) + 1) or {}


def names_transferred(obj):
    """Names of what was transferred to an object from its target."""
    return recipe_of(obj).get(TRANSFERRED, {}).get("names", ())


def settings_of(obj):
    """The library's settings that a morph object was made with, as far as it knows them."""
    return recipe_of(obj).get("settings", {})


def is_known(recipe):
    """Whether a recipe has what it takes."""
    return "shapes" in recipe


def put_settings(settings, recipe):
    """Puts what a morph object was made with into the panel."""
    values = recipe["settings"]
    for option in scene_options():
        if option.name in values:
            setattr(settings, option.name, values[option.name])
        elif option.default is None:
            setattr(settings, by_hand(option), False)
    for item in settings.features:
        if item.marked_name in recipe["features"]:
            kept = recipe["features"][item.marked_name]
            for field, value in zip(fields(Choice), kept, strict=False):
                setattr(item, field.name, value)
    set_loop(settings, recipe["loop"])


def report_of(obj):
    """What a morph object remembers of `Morph.report`; None when it's of an earlier version."""
    return remembered.report(obj.pointmorph.report)


def present_words(obj, text):
    """A text of a morph object's report, with the present names of its shapes."""
    known = recipe_of(obj).get("shapes", ())
    shapes = shapes_of(obj)
    names = {
        before["name"]: shape.name
        for before, shape in zip(known, shapes, strict=False)
        if shape is not None
    }
    return with_present_names(text, names)
