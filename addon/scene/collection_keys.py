"""Shape keys on one mesh, the template, for the meshes of a collection; on request with what these
have of their own."""

import itertools
import json
import re
from dataclasses import dataclass, field, replace

import numpy as np
import pointmorph

from ..core import remembered, transforms
from ..core.computation import Request
from ..core.features import Choice, match
from ..core.settings import settings_values
from ..data import arrays, chains, creation
from ..data.feature_list import feature_choices
from . import key_transfer, map_ends, morph_builder, morph_object, vertex_groups
from .shape_reader import present_steps, read_shape_steps, update

_MADE = "pointmorph_targets"
"""Property of the shape keys, and of the mesh for its vertex groups: the names that were given here
by those that were wished for, to be made anew in place."""
_LONGEST = creation.LONGEST_NAME - len(key_transfer.AT_END)


@dataclass(frozen=True)
class Wanted:
    """What is read of a collection.

    `in_place`: the targets are taken as if their origins lay on the template's; otherwise where
    they are. `keys` and `weights`: also the targets' own shape keys and vertex groups.
    """

    in_place: bool
    keys: bool = False
    weights: bool = False


@dataclass(frozen=True)
class Landed:
    """The template on a target.

    Attributes
    ----------
    places : (N, 3) array
        Where its vertices go, in its own space.
    keys : list of key_transfer.Key
        The target's, as they move the template.
    weights : list of (name, (N, 1) array)
        The target's vertex groups.
    """

    places: np.ndarray
    keys: list
    weights: list


@dataclass(frozen=True)
class Found:
    """What became of the meshes of a collection.

    Attributes
    ----------
    landed : dict of str to Landed
        By a mesh's name.
    problems : dict of str to PointmorphError
        By a mesh's name, why it can't be had.
    without : dict of str to PointmorphError
        By a mesh's name, why its own keys and weights can't be had.
    """

    landed: dict = field(default_factory=dict)
    problems: dict = field(default_factory=dict)
    without: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Given:
    """Names of what the template got: keys of the targets, and of what these have of their own."""

    targets: list = field(default_factory=list)
    keys: list = field(default_factory=list)
    groups: list = field(default_factory=list)


@dataclass(frozen=True)
class _Own:
    """What a target has of its own, in the morph's frame."""

    giver: map_ends.Giver
    keys: list
    weights: list


def targets_of(collection, template):
    """The meshes of a collection, by name, without the template and what the add-on has made."""
    found = [
        obj
        for obj in collection.all_objects
        if obj.type == "MESH" and obj.data != template.data and not morph_object.is_made(obj)
    ]
    return sorted(found, key=lambda obj: obj.name)


# --- Reading and computing ------------------------------------------------------------------------


def read_steps(context, template, targets, wanted):
    """A generator that yields often, and returns a function of a progress that computes `Found` in
    any thread.

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
    read, found = {}, Found()
    for target in targets:
        yield
        place = np.array(target.matrix_world.translation) if wanted.in_place else origin
        try:
            steps = _read_target_steps(context, target, place, wanted, found)
            shape, own = yield from present_steps(context, [target], steps)
            request = _request(context.scene.pointmorph, source, shape)
            read[target.name] = request, own
        except pointmorph.PointmorphError as error:
            found.problems[target.name] = error

    def work(progress):
        for number, (name, (request, own)) in enumerate(read.items()):

            def told(stage, fraction, number=number):
                return progress(stage, (number + fraction) / len(read))

            try:
                found.landed[name] = _landed(request, own, back, told)
            except pointmorph.Cancelled:
                raise
            except pointmorph.PointmorphError as error:
                found.problems[name] = error
        return found

    return work


def _read_target_steps(context, target, place, wanted, found):
    """Its form, and an `_Own` or None."""
    shape = yield from read_shape_steps(context, target, place, True)
    if not (wanted.keys or wanted.weights):
        return shape, None
    matrix = transforms.relative_to(target.matrix_world, place)
    shown = map_ends.Giver(shape.positions, shape.triangles, None)
    try:
        giver = map_ends.read_unmodified_giver(context, matrix, target, shown)
    except pointmorph.PointmorphError as error:
        found.without[target.name] = error
        return shape, None
    keys, weights = [], []
    if wanted.keys:
        groups = key_transfer.limiting_groups(target)
        limits = yield from arrays.vertex_group_steps(target.data, groups)
        keys = key_transfer.read(target, matrix, limits)
    if wanted.weights:
        weights = yield from vertex_groups.read_steps(target, target.data)
    return shape, _Own(giver, keys, weights)


def _landed(request, own, back, progress):
    """A `Landed`."""
    source = request.source
    landing = chains.compute_all([request], progress).landing
    places = transforms.move_positions(back, landing).astype(np.float32)
    if own is None:
        return Landed(places, [], [])
    giver = own.giver
    carrier = pointmorph.Carrier(
        source.positions, landing, giver.positions, source.triangles, giver.triangles
    )
    return Landed(
        places,
        [key_transfer.carried(key, carrier, back, True) for key in own.keys],
        [(name, carrier.values(values).astype(np.float32)) for name, values in own.weights],
    )


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


# --- Writing --------------------------------------------------------------------------------------


def write(template, found):
    """Puts the keys on the template, and what the targets have of their own: what was made here
    before anew, with its sliders, drivers and animation as they are; the rest under names that
    nothing else has.

    Returns
    -------
    Given

    Raises
    ------
    CloudError
        If the template has other vertices by now.
    """
    for name, landed in found.landed.items():
        if len(landed.places) != len(template.data.vertices):
            raise pointmorph.CloudError(
                template.name,
                f"the {len(landed.places):,} vertices that were morphed onto {name}",
                f"{len(template.data.vertices):,}",
                "Start again.",
            )
    if template.data.shape_keys is None:
        template.shape_key_add(name="Basis", from_mix=False)
    keys = template.data.shape_keys
    key_names, group_names = _Names(keys, keys.key_blocks), _Names(template.data, _fields(template))
    given = Given()
    for name, landed in found.landed.items():
        wished = key_names.of(name)
        key = keys.key_blocks.get(wished) or morph_builder.new_key(template, wished)
        arrays.write_key(key, landed.places)
        given.targets.append(key.name)
        for one in landed.keys:
            own_name = key_names.of(name, one.name)
            key_transfer.write(template, own_name, one, (keys.key_blocks[wished], 1))
            given.keys.append(own_name)
        for group, weights in landed.weights:
            own_name = group_names.of(name, group)
            vertex_groups.write(template, own_name, weights[:, 0])
            given.groups.append(own_name)
    key_names.keep()
    group_names.keep()
    template.data.update()
    return given


def _fields(template):
    """What a new vertex group can't be named as."""
    return {*template.vertex_groups.keys(), *template.data.attributes.keys()}


class _Names:
    """Names for what is made: those of before, or else such as nothing has.

    Parameters
    ----------
    owner : ID
        Remembers them.
    taken : container of str
    """

    def __init__(self, owner, taken):
        self._owner, self._taken = owner, taken
        kept = owner.get(_MADE)
        self._given = dict((remembered.given_names(kept) if isinstance(kept, str) else None) or {})

    def of(self, *whose):
        """That of a target, or of a target and of what it has under a name of its own."""
        wish = "\n".join(whose)
        known = self._given.get(wish)
        if known is None or known not in self._taken:
            self._given[wish] = self._free(_short(".".join(map(_plain, whose))))
        return self._given[wish]

    def _free(self, name):
        others = set(self._given.values())
        numbered = (f"{name}.{number:03d}" for number in itertools.count(1))
        for free in itertools.chain([name], numbered):
            ends = (free, free + key_transfer.AT_END)
            if free not in others and not any(end in self._taken for end in ends):
                return free
        raise AssertionError

    def keep(self):
        self._owner[_MADE] = json.dumps(self._given)


def _plain(name):
    """A driver's path has the name in quotes and brackets."""
    return re.sub(r'["\\\[\]]', "_", name)


def _short(name):
    """The end of a name that Blender would cut."""
    data = name.encode()
    return data[-_LONGEST:].decode(errors="ignore") if len(data) > _LONGEST else name
