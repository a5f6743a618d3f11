"""The coarse morph in the scene, from when it's there until the whole replaces it."""

import bpy

from ..core import background_job
from . import morph_builder, morph_object, points_display


def show(context, outcome, name, provenance):
    """Makes an object of the coarse morph; returns its name."""
    obj = morph_builder.build(context, outcome, name, provenance)
    obj.pointmorph.is_preview = True
    obj.hide_select = True
    return obj.name


def remove(name):
    """Takes the object of that name away; returns the value of its key, 0 where there is none.

    By name, since undo moves objects in memory, or takes them away as well.
    """
    obj = bpy.data.objects.get(name)
    if obj is None or not obj.pointmorph.is_preview:
        return 0.0
    value = morph_object.morph_key(obj).value
    morph_builder.remove(obj)
    points_display.remove_unused()
    return value


def remove_left_over():
    """Takes away coarse morphs that undo brought back, or that a file was saved with."""
    if background_job.current is None:
        for name in [obj.name for obj in bpy.data.objects if obj.pointmorph.is_preview]:
            remove(name)
