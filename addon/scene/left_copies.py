"""Copies of shapes as shown that no morph is made of any more: they are hidden, and nobody would
find them. They are removed once a morph is deleted, but for those with marks of their own."""

import bpy

from ..core import background_job
from ..data.feature_list import feature_names
from ..data.registration import Registration, stop_timer
from . import morph_builder, morph_object, recipes, staleness

_counts = {}
"""By scene, how many objects it had."""


def remove_left():
    """Removes those of this file. The panels pick their originals in their place."""
    made = [obj for obj in bpy.data.objects if _is_there(obj) and morph_object.is_made(obj)]
    used = {shape for obj in made for shape in recipes.pointers_of(obj)}
    for copy in list(bpy.data.objects):
        if copy not in used and _is_left(copy):
            for scene in bpy.data.scenes:
                if scene.library is None:
                    staleness.pick_instead(scene.pointmorph, copy, copy.pointmorph.shown_from)
            morph_builder.remove(copy)


def _is_there(obj):
    return obj.library is None and bool(obj.users_collection)


def _is_left(copy):
    original = copy.pointmorph.shown_from
    if original is None or copy.type != "MESH" or not _is_there(copy) or morph_object.is_made(copy):
        return False
    if copy.children or copy.data.users > 1 or not copy.hide_render:
        return False
    marked = set(feature_names(original)) if original.type == "MESH" else set()
    return _is_there(original) and set(feature_names(copy)) <= marked


def _look():
    """Called by a timer, because what is deleted must not go while Blender looks at it."""
    if background_job.current is None:  # whose copies have no morph yet
        remove_left()


def _note_deletions(scene, depsgraph):
    count, before = len(scene.objects), _counts.get(scene.session_uid, 0)
    _counts[scene.session_uid] = count
    if count < before and not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=0.0)


def _stop():
    stop_timer(_look)
    _counts.clear()


registration = Registration(
    stop=_stop,
    handlers=(("depsgraph_update_post", _note_deletions),),
)
