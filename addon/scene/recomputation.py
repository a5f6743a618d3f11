"""How a morph object is computed again in place: from the objects that it was made from or, when
one is gone, from what it holds itself. Chains are computed in this way from the first."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pointmorph

from ..core import transforms
from ..core.computation import Request, Shape
from ..core.features import Choice, Marks, match
from ..core.settings import settings_values
from ..core.stepping import finish
from ..data import arrays
from ..data.feature_list import feature_choices
from . import (
    as_shown,
    baked_colors,
    morph_builder,
    morph_object,
    placement,
    recipes,
    staleness,
)
from .shape_reader import present_steps, read_shape_steps, update


@dataclass(frozen=True)
class Chosen:
    """What was chosen for a morph: the Choice of every feature by its name, the names of the loop's
    features, and the library's settings."""

    features: dict
    loop: list
    settings: dict


def chosen_in(settings):
    """What the panel has chosen; `settings` are the scene's."""
    loop = [item.name for item in settings.loop]
    return Chosen(feature_choices(settings), loop, settings_values(settings))


@dataclass(frozen=True)
class Plan:
    """What it takes to make a morph object again; `remarks` are what is to be said, in words."""

    requests: list
    recipe: dict
    origin: np.ndarray
    source_matrix: np.ndarray
    missing: list
    remarks: Sequence = ()

    def provenance(self, shapes):
        return morph_builder.Provenance(shapes, self.origin, self.source_matrix)


def plan_steps(context, obj, textures=None):
    """How to compute a morph object again: with the panel's settings when the panel is about it,
    else with its own; from the objects it was made from or, when one is gone, from what it holds.
    A generator that yields often and returns a Plan.

    Parameters
    ----------
    textures : look_transfer.Options or None
        How the target's look will be drawn: its normals and roughness are read if they are wanted.

    Raises
    ------
    PointmorphError
    """
    _check_changeable(obj)
    recipe = recipes.recipe_of(obj)
    shapes = recipes.shapes_of(obj)
    settings = context.scene.pointmorph
    missing = [
        known["name"]
        for known, shape in zip(recipe.get("shapes", ()), shapes, strict=False)
        if shape is None
    ]
    if not recipes.is_known(recipe) and None in shapes:
        raise pointmorph.CloudError(
            obj.name,
            "the objects it was made from",
            "one that no longer exists, and no copy, because an earlier version made this",
            "Choose two objects and morph again.",
        )
    if not recipes.is_known(recipe) or staleness.is_picked(context.scene, obj):
        chosen = chosen_in(settings)
    else:
        choices = {name: Choice(*parts) for name, parts in recipe["features"].items()}
        chosen = Chosen(choices, recipe["loop"], recipe["settings"])
    if missing:
        return _plan_from_itself(obj, recipe, chosen.settings, chosen.loop, missing)
    update(context, *shapes)
    rigs, remarks = _poses(context, obj, shapes, recipe)
    steps = plan_of_steps(context, shapes, chosen, textures)
    if not rigs:
        return replace((yield from steps), remarks=remarks)
    # What is only for the moment at rest must not be so when Blender goes on.
    with as_shown.at_rest(context, rigs):
        return replace(finish(steps), remarks=remarks)


def _poses(context, obj, shapes, recipe):
    """Of a morph whose rig poses it now: the armatures that pose targets which were morphed at
    rest, and of which targets another pose is taken than was morphed, in words."""
    source, rigs, remarks = shapes[0], set(), []
    if source.pointmorph.keep_modifiers or not morph_object.shown_of(obj).pointmorph.keeps_faces:
        return rigs, remarks  # Morph said so, or nothing poses it
    for number, shape in enumerate(shapes[1:], 1):
        words = as_shown.posed_twice(context, source, shape)
        if words is None:
            continue
        known = recipe["shapes"][number] if recipes.is_known(recipe) else {}
        if "pose" in known and known["pose"] is None:
            rigs |= as_shown.posing(shape)
        elif known.get("pose") != as_shown.pose_of(context, shape):  # or an earlier version's
            remarks.append(f"{words}, and recompute")
    return rigs, remarks


def plan_of_steps(context, shapes, chosen, textures=None):
    """How to compute the morph from each of these objects to the next; see `plan_steps`."""
    steps = _read_plan_steps(context, shapes, chosen, textures)
    return (yield from present_steps(context, shapes, steps))


def _read_plan_steps(context, shapes, chosen, textures):
    update(context, *shapes)
    origin = np.array(shapes[0].matrix_world.translation)
    read = []
    for number, shape in enumerate(shapes):
        yield
        drawn = textures if number == len(shapes) - 1 else None
        relief = drawn is not None and drawn.normal
        bakes = baked_colors.parts_for(drawn)
        steps = read_shape_steps(context, shape, origin, number > 0, relief, bakes)
        read.append((yield from steps))
    requests = []
    for source, target in pairwise(read):
        yield
        features = match(source, target, chosen.features)
        requests.append(Request(source, target, features, chosen.loop, chosen.settings))
    made = yield from recipes.take_down_steps(shapes, requests, origin, chosen.features)
    for known, target in zip(made["shapes"][1:], shapes[1:], strict=True):
        known["pose"] = as_shown.pose_of(context, target)
    source_matrix = transforms.relative_to(shapes[0].matrix_world, origin)
    return Plan(requests, made, origin, source_matrix, [])


def _plan_from_itself(obj, recipe, values, loop, missing):
    """From the points that the pairs hold, which are all there are of an object that is gone."""
    if not morph_object.is_result(obj):
        raise pointmorph.CloudError(
            obj.name,
            "the objects it was made from",
            f'no "{missing[0]}"',
            "Undo the deletion, or morph other objects. The existing result stays usable.",
        )
    stages = zip(
        morph_object.stages(obj),
        morph_object.stage_keys(obj),
        morph_object.stage_rows(obj),
        strict=True,
    )
    faces = recipes.faces_of(obj)
    # Earlier versions kept the boundary in place of the faces.
    boundaries = recipe.get("boundaries", [None] * len(faces))
    read = [
        Shape(
            known["name"],
            **morph_object.read_stage(obj, *stage),
            triangles=triangles,
            marks=Marks("none"),
            boundary=boundary,
        )
        for known, stage, triangles, boundary in zip(
            recipe["shapes"], stages, faces, boundaries, strict=True
        )
    ]
    requests = [
        Request(
            source,
            target,
            {name: recipes.feature_of(plain) for name, plain in features.items()},
            loop,
            values,
        )
        for (source, target), features in zip(pairwise(read), recipe["resolved"], strict=True)
    ]
    made = {**recipe, "settings": values, "loop": loop}
    return Plan(
        requests, made, np.array(recipe["origin"]), morph_object.source_matrix_of(obj), missing
    )


def _check_changeable(obj):
    for item in (obj, obj.data):
        if item.library is not None:
            raise pointmorph.CloudError(
                obj.name,
                "a morph object in this file",
                f"one linked from {item.library.filepath}",
                "Make it local with all that it has (Object > Relations > Make Local > All).",
            )
    if obj.mode != "OBJECT":
        raise pointmorph.CloudError(
            obj.name,
            "a morph object in Object Mode",
            "another mode",
            "Switch to Object Mode (Tab).",
        )
    if morph_object.is_result(obj):
        morph_object.check_whole(obj)
    else:
        morph_object.t_key(obj)


def apply(obj, plan, outcome):
    """Puts what was computed again into a morph object of pairs and all that share its points.

    Returns
    -------
    list of str
        What couldn't follow, in words.
    """
    before = recipes.recipe_of(obj).get("origin")
    shift = _shift_of_source(obj, plan)
    lost = morph_builder.rebuild(obj, outcome, plan.recipe["settings"])
    shapes = recipes.pointers_of(obj)
    for user in morph_object.users_of(obj):
        morph_builder.link(user, shapes, plan.source_matrix)
        recipes.remember(user, plan.recipe, outcome)
        # Left where it was made, it goes along with its source.
        at_home = before is None or np.allclose(user.location, before, rtol=1e-6, atol=1e-6)
        if shift is not None:
            placement.put(user, placement.matrix_of(user) @ shift)
        elif at_home and user.parent is None:
            user.location = plan.origin
    return lost


def _shift_of_source(obj, plan):
    """(4, 4): to where the origin of the source went in the morph's frame, if nothing of it moved
    but that: its transforms were applied, or it was given another origin. Else None."""
    origin = recipes.recipe_of(obj).get("origin")
    if origin is None or not plan.requests:
        return None
    known = arrays.key_positions(morph_object.stage_keys(obj)[0])
    rows = arrays.read_rows(obj.data, "source_row")
    return placement.shift(
        arrays.by_row(rows, known), origin, plan.requests[0].source.positions, plan.origin
    )
