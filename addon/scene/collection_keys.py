"""Shape keys on one mesh, the template, for the meshes of a collection."""

import json
import re
from dataclasses import dataclass, replace

import numpy as np
import pointmorph

from ..core import remembered, transforms
from ..core.computation import Request
from ..core.features import Choice, match
from ..core.settings import settings_values
from ..data import arrays, chains
from ..data.feature_list import feature_choices
from . import morph_builder, morph_object
from .shape_reader import present_steps, read_shape_steps, update

_MADE = "pointmorph_targets"
"""Property of the shape keys: the names of those made here, which are made anew in place."""


@dataclass(frozen=True)
class Found:
    """What became of the meshes of a collection.

    Attributes
    ----------
    places : dict of str to (N, 3) array
        By a mesh's name, where the template's vertices go in the template's own space.
    problems : dict of str to PointmorphError
        By a mesh's name, why it can't be had.
    """

    places: dict
    problems: dict


def targets_of(collection, template):
    """The meshes of a collection, by name, without the template and what the add-on has made."""
    found = [
        obj
        for obj in collection.all_objects
        if obj.type == "MESH" and obj.data != template.data and not morph_object.is_made(obj)
    ]
    return sorted(found, key=lambda obj: obj.name)


def read_steps(context, template, targets, in_place):
    """A generator that yields often, and returns a function of a progress that computes `Found` in
    any thread.

    Parameters
    ----------
    in_place : bool
        The targets are taken as if their origins lay on the template's; otherwise where they are.

    Raises
    ------
    PointmorphError
        If the template can't be read. What is wrong with a target is said in `Found`.
    """
    update(context, template, *targets)
    origin = np.array(template.matrix_world.translation)
    own = read_shape_steps(context, template, origin, False)
    source = yield from present_steps(context, [template], own)
    back = np.linalg.inv(transforms.relative_to(template.matrix_world, origin))
    requests, problems = {}, {}
    for target in targets:
        yield
        place = np.array(target.matrix_world.translation) if in_place else origin
        try:
            steps = read_shape_steps(context, target, place, True)
            shape = yield from present_steps(context, [target], steps)
            requests[target.name] = _request(context.scene.pointmorph, source, shape)
        except pointmorph.PointmorphError as error:
            problems[target.name] = error

    def work(progress):
        places = {}
        for number, (name, request) in enumerate(requests.items()):

            def told(stage, fraction, number=number):
                return progress(stage, (number + fraction) / len(requests))

            try:
                landing = chains.compute_all([request], told).landing
                places[name] = transforms.move_positions(back, landing).astype(np.float32)
            except pointmorph.Cancelled:
                raise
            except pointmorph.PointmorphError as error:
                problems[name] = error
        return Found(places, problems)

    return work


def _request(settings, source, target):
    """With the panel's settings, and the features that both have."""
    choices = feature_choices(settings)
    for name in {*source.marks.weights} ^ {*target.marks.weights}:
        choices[name] = replace(choices.get(name, Choice()), use=False)
    features = match(source, target, choices)
    loop = [item.name for item in settings.loop]
    if not set(loop) <= set(features):
        loop = []
    values = settings_values(settings)
    return Request(source, target, features, loop, values).without_looks()


def write(template, found):
    """Puts the keys on the template: those that were made here before anew, with their sliders,
    drivers and animation as they are; others get names of their own.

    Returns
    -------
    list of str
        The names of the keys.

    Raises
    ------
    CloudError
        If the template has other vertices by now.
    """
    for name, places in found.places.items():
        if len(places) != len(template.data.vertices):
            raise pointmorph.CloudError(
                template.name,
                f"the {len(places):,} vertices that were morphed onto {name}",
                f"{len(template.data.vertices):,}",
                "Start again.",
            )
    if template.data.shape_keys is None:
        template.shape_key_add(name="Basis", from_mix=False)
    keys = template.data.shape_keys
    kept = keys.get(_MADE)
    made = set((remembered.names(kept) if isinstance(kept, str) else None) or [])
    names = []
    for name, places in found.places.items():
        # A driver's path has the name in quotes and brackets.
        plain = re.sub(r'["\\\[\]]', "_", name)
        known = keys.key_blocks.get(plain) if plain in made else None
        key = known or morph_builder.new_key(template, plain)
        arrays.write_key(key, places)
        names.append(key.name)
    keys[_MADE] = json.dumps(sorted(made | set(names)))
    template.data.update()
    return names
