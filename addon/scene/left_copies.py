"""What a morph that was deleted leaves: its points, where the mesh that showed them was deleted,
and copies of shapes as shown that no morph is made of any more. They are hidden, and nobody would
find them. They are removed, but for those that the user has changed, marked or used.

And what comes with a morph that is appended: Blender shows it all. It is hidden as it was."""

import bpy
import pointmorph

from ..core import background_job
from ..data import nodes, versions
from ..data.feature_list import feature_names
from ..data.references import reference_to
from ..data.registration import Registration, stop_timer
from . import (
    as_shown,
    converted,
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
None before the first look in a file."""
_is_other_state = False
"""Whether undo or redo was there after the last look. It may have brought back what was removed: an
undo step is from right after a deletion, before anything looks at what is left."""
_has_lost = False
"""Whether a morph was deleted since this file was opened."""
_hidden = set()
"""References to objects that were hidden because they came with a morph that was appended. Blender
has no undo step of that: undo shows them again. Without those that the user has shown since."""


def _remove(gone, points):
    """Removes morph objects that were deleted in the viewport, and are kept only by the pointers
    that they have to each other: they have the names that the next would get. And the points that
    they showed, which nothing else has or shows.

    Parameters
    ----------
    gone, points : set of references
        The points may be gone as well, or None.
    """
    objects = {reference_to(obj): obj for obj in bpy.data.objects}
    gone = {objects[one] for one in gone if one in objects}
    gone = {obj for obj in gone if not (obj.users_collection or obj.library or obj.data.users > 1)}
    points = {objects[one] for one in points if one in objects}
    points = {obj for obj in points if _is_there(obj) and _are_left(obj)}
    if not gone | points:
        return
    users = bpy.data.user_map(subset=gone | points)
    removed = {obj for obj in points if not _is_used(obj, users)}
    for obj in gone:
        used = any(not isinstance(user, _LISTS) for user in users[obj] - gone - removed)
        if not (used or obj.use_fake_user or obj.data.use_fake_user):
            removed.add(obj)
    morph_builder.remove(*removed)


def _are_left(points):
    """Whether points whose mesh was deleted are hidden, and the user put nothing on them."""
    if not morph_object.is_result(points) or points.pointmorph.baked or not _is_hidden(points):
        return False
    try:
        made = {key.name for key in morph_object.stage_keys(points)}
    except pointmorph.CloudError:
        return False
    made |= {morph_object.KEY}
    keys = points.data.shape_keys
    return (
        made.issuperset(keys.key_blocks.keys())
        and all(nodes.is_own(modifier) for modifier in points.modifiers)
        and all(slot.material is None for slot in points.material_slots)
        and not any(_is_keyed(block) for block in (points, points.data, keys))
    )


def _is_keyed(block):
    """Whether it has keys; an action without them may be left from a slider that was handed on."""
    data = block.animation_data
    return data is not None and bool(versions.curves_of(block) or data.nla_tracks)


def remove_left():
    """Removes the copies of this file. The panels pick their originals in their place."""
    made = [obj for obj in bpy.data.objects if _is_there(obj) and morph_object.is_made(obj)]
    used = {shape for obj in made for shape in recipes.pointers_of(obj)}
    copies = [obj for obj in bpy.data.objects if obj not in used and _is_left(obj)]
    users = bpy.data.user_map(subset=copies) if copies else {}
    copies = [copy for copy in copies if not _is_used(copy, users)]
    for copy in copies:
        for scene in bpy.data.scenes:
            if scene.library is None:
                staleness.pick_instead(scene.pointmorph, copy, copy.pointmorph.shown_from)
    morph_builder.remove(*copies)


def _is_there(obj):
    return obj.library is None and bool(obj.users_collection)


def _is_left(copy):
    original = copy.pointmorph.shown_from
    if original is None or copy.type != "MESH" or not _is_there(copy) or morph_object.is_made(copy):
        return False
    if not _is_hidden(copy) or not _is_there(original):
        return False
    marked = set(feature_names(original)) if original.type == "MESH" else set()
    return set(feature_names(copy)) <= marked and _is_untouched(copy, original)


def _is_hidden(copy):
    """Whether an object is shown nowhere, in no view layer and in no render."""
    layers = [layer for scene in bpy.data.scenes for layer in scene.view_layers]
    there = [layer for layer in layers if layer.objects.get(copy.name) == copy]
    return copy.hide_render and all(copy.hide_get(view_layer=layer) for layer in there)


def _is_used(obj, users):
    """Whether something has it but collections, panels and morphs that were deleted. `users` are
    from `bpy.data.user_map`."""
    if obj.children or obj.data.users > 1 or obj.use_fake_user or obj.data.use_fake_user:
        return True
    return any(not (isinstance(user, _LISTS) or _is_gone(user)) for user in users[obj] - {obj})


def _is_gone(user):
    is_object = isinstance(user, bpy.types.Object)
    return is_object and not user.users_collection and not user.use_fake_user


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
    global _made, _is_other_state, _has_lost
    # While one is computed, its copies have no morph yet.
    if background_job.current is not None or bpy.app.is_job_running("RENDER"):
        return _LATER
    again, _is_other_state = _is_other_state, False
    before, _made = _morphs(also_deleted=True) if again else _made, _morphs()
    gone = set() if before is None else before.keys() - _made.keys()
    if gone or (again and _has_lost):
        _remove(gone, {before[one] for one in gone})
        points_display.remove_unused()
        remove_left()
        _made, _has_lost = _morphs(), True
    _keep_hidden(again)
    if before is not None:
        hide_appended(_made.keys() - before.keys(), before)
    return None


def _keep_hidden(again):
    """Hides what undo or redo, if they were there, have shown `again`; else takes note of what the
    user has shown."""
    for obj in [obj for obj in bpy.data.objects if _hidden and reference_to(obj) in _hidden]:
        if not _is_hidden(obj):
            if again and obj.hide_render:
                _hide(obj)
            else:
                _hidden.discard(reference_to(obj))
    if again and _hidden:
        disc_faces.leave_scenes()


def hide_appended(references, before):
    """Hides the points and shapes that an appended morph brought along, unless they are rendered,
    and takes its disc makers out of the scenes.

    Parameters
    ----------
    references : set
        To morph objects that are new in the file: appended or duplicated.
    before : iterable of references
        To those that were there before. What they have was not appended.
    """
    objects = {reference_to(obj): obj for obj in bpy.data.objects}
    appended = {_points_of(objects[one]) for one in references if one in objects}
    appended = {obj for obj in appended if obj is not None and reference_to(obj) in references}
    if not appended:
        return
    known = {_points_of(objects[one]) for one in before if one in objects} - {None}
    known = {one for points in known for one in _hidden_with(points)}
    for obj in {one for points in appended for one in _hidden_with(points)} - known:
        if obj.hide_render and _is_there(obj):
            _hide(obj)
            _hidden.add(reference_to(obj))
    disc_faces.leave_scenes()


def _points_of(obj):
    """The points of a morph object, or None."""
    points = obj.pointmorph.made_from if obj.pointmorph.keeps_faces else obj
    return points if morph_object.is_result(points) else None


def _hidden_with(points):
    """Objects that may be hidden: points, the mesh that shows them, and what they were made of."""
    shapes = [shape for shape in recipes.shapes_of(points) if shape is not None]
    originals = [recipes.original_of(shape) for shape in shapes]
    return {points, points.pointmorph.mesh, *shapes, *originals} - {None}


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


def _morphs(also_deleted=False):
    found = [obj for obj in bpy.data.objects if obj.library is None and morph_object.is_made(obj)]
    found = [obj for obj in found if also_deleted or obj.users_collection]
    points = ((obj, obj.pointmorph.made_from) for obj in found)
    return {reference_to(obj): None if one is None else reference_to(one) for obj, one in points}


def _note_changes(scene, depsgraph):
    if depsgraph.mode == "RENDER" or _is_playing():
        return
    if converted.forget_changed(depsgraph) or depsgraph.id_type_updated("SCENE"):
        _look_soon()


def _is_playing():
    windows = bpy.context.window_manager.windows if bpy.context.window_manager else ()
    return any(window.screen.is_animation_playing for window in windows)


def _look_soon():
    # bpy 4.5 doesn't end after a file was opened while a timer that isn't persistent waited.
    if not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=0.0, persistent=True)


def _forget(*_):
    _clear()
    _look_soon()


def _note_other_state(*_):
    global _is_other_state
    _is_other_state = True
    _look_soon()


def _clear():
    global _made, _is_other_state, _has_lost
    _made, _is_other_state, _has_lost = None, False, False
    _hidden.clear()


def _stop():
    stop_timer(_look)
    _clear()


registration = Registration(
    start=_look_soon,
    stop=_stop,
    handlers=(
        ("depsgraph_update_post", _note_changes),
        ("load_post", _forget),
        ("undo_post", _note_other_state),
        ("redo_post", _note_other_state),
    ),
)
