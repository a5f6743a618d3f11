"""What a morph that was deleted leaves: its points, where the mesh that showed them was deleted,
and copies of shapes as shown that no morph is made of any more. They are hidden, and nobody would
find them. They are removed, but for those that the user has changed, marked or used.

And what comes with a morph that is appended: Blender shows it all. It is hidden as it was."""

import bpy

from ..core import background_job
from ..data.feature_list import feature_names
from ..data.references import find, reference_to
from ..data.registration import Registration, on_other_states, stop_timer
from . import (
    as_shown,
    disc_faces,
    morph_builder,
    morph_object,
    points_display,
    recipes,
    staleness,
)

_LATER = 0.5  # seconds
_LISTS = (
    bpy.types.Collection,
    bpy.types.Scene,
    bpy.types.Screen,
    bpy.types.WindowManager,
    bpy.types.WorkSpace,
)
"""Types of what only lists or shows objects. A scene may still list one that was deleted."""

_made = None
"""By a reference to each morph object at the last look, one to the points that it shows, or None.
None before the first look in a file, and after undo and redo, which take away themselves what is
left."""


def remove_points(reference):
    """Removes the points that a reference is to if the mesh that showed them was deleted, and
    nothing else has or shows them."""
    obj = find(bpy.data.objects, reference)
    if obj is None or not _is_there(obj) or not morph_object.is_result(obj):
        return
    if not _is_hidden(obj) or _is_used(obj) or obj.pointmorph.baked or _is_keyed(obj):
        return
    morph_builder.remove(obj)


def _remove_deleted(references):
    """Removes morph objects that were deleted in the viewport, and are kept only by the pointers
    that they have to each other: they have the names that the next would get."""
    found = (find(bpy.data.objects, reference) for reference in references)
    gone = {obj for obj in found if obj is not None and not obj.users_collection}
    gone = {obj for obj in gone if obj.library is None and obj.data.users == 1}
    for obj, users in bpy.data.user_map(subset=gone).items() if gone else ():
        used = any(not isinstance(user, _LISTS) for user in users - gone)
        if not (used or obj.use_fake_user or obj.data.use_fake_user):
            morph_builder.remove(obj)


def _is_keyed(obj):
    data = obj.animation_data
    return data is not None and (data.action is not None or len(data.nla_tracks) > 0)


def remove_left():
    """Removes the copies of this file. The panels pick their originals in their place."""
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
    if not _is_hidden(copy) or not _is_there(original) or _is_used(copy):
        return False
    marked = set(feature_names(original)) if original.type == "MESH" else set()
    return set(feature_names(copy)) <= marked and _is_untouched(copy, original)


def _is_hidden(copy):
    """Whether an object is shown nowhere, in no view layer and in no render."""
    layers = [layer for scene in bpy.data.scenes for layer in scene.view_layers]
    there = [layer for layer in layers if layer.objects.get(copy.name) == copy]
    return copy.hide_render and all(copy.hide_get(view_layer=layer) for layer in there)


def _is_used(copy):
    """Whether something has it but collections, panels and morphs that were deleted."""
    if copy.children or copy.data.users > 1 or copy.use_fake_user or copy.data.use_fake_user:
        return True
    for user in bpy.data.user_map(subset=[copy])[copy] - {copy}:
        gone = isinstance(user, bpy.types.Object) and not user.users_collection
        if not gone and not isinstance(user, _LISTS):
            return True
    return False


def _is_untouched(copy, original):
    if copy.data.shape_keys is not None or copy.modifiers or copy.data.animation_data is not None:
        return False
    # A copy has its original's motions.
    return _motions(copy) <= _motions(original) and as_shown.is_as_made(copy)


def _motions(obj):
    data = obj.animation_data
    if data is None:
        return set()
    drivers = {(driver.data_path, driver.array_index) for driver in data.drivers}
    tracks = {("track", track.name) for track in data.nla_tracks}
    return drivers | tracks | ({data.action} if data.action is not None else set())


def _look():
    """Called by a timer, because what is deleted must not go while Blender looks at it."""
    global _made
    # While one is computed, its copies have no morph yet.
    if background_job.current is not None or bpy.app.is_job_running("RENDER"):
        return _LATER
    before, _made = _made, _morphs()
    gone = set() if before is None else before.keys() - _made.keys()
    if gone:
        for one in gone:
            remove_points(before[one])
        _remove_deleted(gone)
        points_display.remove_unused()
        _made = _morphs()
        remove_left()
    if before is not None:
        hide_appended(_made.keys() - before.keys())
    return None


def hide_appended(references):
    """Hides what morph objects that are new in the file stand for and what makes their discs, where
    it came with them: their points and shapes, if they aren't rendered."""
    for reference in references:
        mesh = find(bpy.data.objects, reference)
        points = mesh.pointmorph.made_from if mesh.pointmorph.keeps_faces else mesh
        if not morph_object.is_result(points) or reference_to(points) not in references:
            continue
        disc_faces.leave_scenes()
        hidden = [points, *recipes.shapes_of(points)]
        hidden += [recipes.original_of(shape) for shape in hidden[1:] if shape is not None]
        for one in hidden:
            if one is not None and one.hide_render and _is_there(one):
                _hide(one)


def _hide(obj):
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            if layer.objects.get(obj.name) == obj:
                obj.hide_set(True, view_layer=layer)


def note_morphs():
    """Has morph objects that were just made known before the next look: they may be deleted before
    anything else changes."""
    global _made
    _made = {**(_made or {}), **_morphs()}


def _morphs():
    found = [obj for obj in bpy.data.objects if morph_object.is_made(obj) and _is_there(obj)]
    points = ((obj, obj.pointmorph.made_from) for obj in found)
    return {reference_to(obj): None if one is None else reference_to(one) for obj, one in points}


def _note_changes(scene, depsgraph):
    if depsgraph.mode == "RENDER" or not depsgraph.id_type_updated("SCENE") or _is_playing():
        return
    _look_soon()


def _is_playing():
    windows = bpy.context.window_manager.windows if bpy.context.window_manager else ()
    return any(window.screen.is_animation_playing for window in windows)


def _look_soon():
    if not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=0.0)


def _forget(*_):
    global _made
    _made = None
    _look_soon()


def _stop():
    global _made
    stop_timer(_look)
    _made = None


registration = Registration(
    stop=_stop,
    handlers=(
        ("depsgraph_update_post", _note_changes),
        *on_other_states(_forget),
    ),
)
