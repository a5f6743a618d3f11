"""What is picked in the panel, read as *Morph* takes it, without a morph being made."""

import contextlib
from dataclasses import replace

import numpy as np
import pointmorph

from ..core.computation import Request
from ..core.features import match
from ..core.settings import settings_values
from ..core.stepping import finish
from ..data import arrays, creation, surfaces
from ..data.feature_list import feature_choices
from . import as_shown, marked_points, morph_builder
from .shape_reader import read_shape_steps, update

_ADDING = {"ARRAY", "MIRROR", "MULTIRES", "SOLIDIFY", "SUBSURF"}
"""Modifiers that add vertices after the mesh's own."""
_NEAR = 0.02  # of the diagonal


def read_request(context):
    """The scene's source and target, features and settings, as the library takes them.

    The source is its mesh without modifiers, because that's what shape keys are put on, or as the
    viewport shows it where these would change the target; the target is what the viewport shows.

    Raises
    ------
    PointmorphError
        In words for the user, with the object's name.
    """
    settings = context.scene.pointmorph
    update(context, settings.source, settings.target)
    origin = np.array(settings.source.matrix_world.translation)
    source, target = (
        _read(context, obj, origin, number > 0)
        for number, obj in enumerate((settings.source, settings.target))
    )
    return Request(
        source,
        target,
        features=match(source, target, feature_choices(settings)),
        loop=[feature.name for feature in settings.loop],
        settings=settings_values(settings),
    )


def _read(context, obj, origin, is_target):
    names = set()  # of copies, which nobody knows
    try:
        with _out_of_edit_mode(context, obj) as there:
            names.add(there.name)
            with _taken(context, there, is_target) as taken:
                names.add(taken.name)
                as_is = is_target and taken == there
                shape = finish(read_shape_steps(context, taken, origin, as_is))
    except pointmorph.PointmorphError as error:
        if error.subject not in names:
            raise
        raise type(error)(obj.name, error.expected, error.found, error.advice) from error
    return replace(shape, name=obj.name)


@contextlib.contextmanager
def _out_of_edit_mode(context, obj):
    """The object, or for the moment a copy, where it is edited: there, modifiers may be off, and
    shape keys show something else. `update` must come before."""
    if obj.mode != "EDIT" or obj.type != "MESH":
        yield obj
        return
    copy = creation.copied(obj)
    copy.data = obj.data.copy()  # it would be in Edit Mode as well
    try:
        context.scene.collection.objects.link(copy)
        update(context, copy)
        yield copy
    finally:
        morph_builder.remove(copy)
        context.view_layer.update()


@contextlib.contextmanager
def _taken(context, obj, is_target):
    """The object that would be morphed: itself, or for the moment a copy as shown."""
    changed = not is_target and not obj.pointmorph.keep_modifiers
    if obj.type not in arrays.MADE_TYPES and not (changed and as_shown.changed_by(context, obj)):
        yield obj
        return
    copy = as_shown.copy_as_shown(context, obj, hides=False)
    try:
        update(context, copy)
        yield copy
    finally:
        morph_builder.remove(copy)
        context.view_layer.update()


def own_rows(obj, shape):
    """(M,) int: of each point of a shape that was read, the vertex of the object where it can be
    marked, or -1.

    Raises
    ------
    FeatureError
        Where modifiers make other vertices.
    """
    own, shown = marked_points.size_of(obj), len(shape.positions)
    if own == shown:
        return np.arange(own)
    kinds = {modifier.type for modifier in obj.modifiers if modifier.show_viewport}
    if shown < own or kinds.isdisjoint(_ADDING) or not as_shown.keeps_vertices(kinds - _ADDING):
        raise pointmorph.FeatureError(
            obj.name,
            f"the {own} vertices of the mesh",
            f"{shown} with modifiers",
            "Apply or disable the modifiers that add or remove vertices.",
        )
    return _nearest(shape.positions, own)


def _nearest(positions, own):
    """By row, the nearest of the first ones, if it is near."""
    near = _NEAR * float(np.linalg.norm(np.ptp(positions, axis=0)))
    rows, away = surfaces.nearest(positions[:own], positions[own:])
    return np.concatenate([np.arange(own), np.where(away <= near, rows, -1)])
