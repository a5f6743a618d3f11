"""What operators ask before they begin, and how they say no."""

from itertools import pairwise

import pointmorph

from ..core import background_job, done_steps
from ..data import chains
from ..data.arrays import MORPHED_TYPES, type_name
from ..scene import (
    blended_textures,
    joined,
    left_copies,
    morph_object,
    object_looks,
    presentation,
    recipes,
    staleness,
)
from ..scene.joined import is_part
from ..scene.shape_reader import is_in
from . import shading

NO_RESULT = "Morph first, or make a morph object the active object"
SELECT = "Select two or more objects, the target last"

_PLACES = (
    (pointmorph.FeatureError, "FEATURES"),
    (pointmorph.TopologyError, "CUT"),
    (pointmorph.OptionError, "ADVANCED"),
    (pointmorph.CloudError, "OBJECTS"),
)


def fail(operator, error):
    """Tells the user about a PointmorphError. In scripts the operator raises RuntimeError then.

    The panel that the error is about shows it until the next attempt.
    """
    place = next((place for kind, place in _PLACES if isinstance(error, kind)), "MORPH")
    background_job.problem = ("CUT" if error.subject == "loop" else place, str(error))
    operator.report({"ERROR"}, str(error))
    return {"CANCELLED"}


def fail_unexpectedly(operator, error):
    """Tells the user about an error that no one thought of."""
    text = f"{type(error).__name__}: {error}".rstrip(": ")
    said = f"{operator.bl_label} failed. {text}. See the system console for details"
    background_job.problem = ("MORPH", said)
    operator.report({"ERROR"}, said)
    return {"CANCELLED"}


def note_done(operator):
    """Notes what an operator has done, with the options that it was given."""
    options = {}
    for known in operator.properties.bl_rna.properties:
        name = known.identifier
        if name == "rna_type" or not operator.properties.is_property_set(name):
            continue
        value = getattr(operator, name)
        if value != known.default:
            options[name] = value
    done_steps.note(type(operator).__name__.removeprefix("POINTMORPH_OT_"), options)


class Explained:
    """An operator that says why it is grayed out: what `reason(context)` returns, or None."""

    @classmethod
    def poll(cls, context):
        reason = cls.reason(context)
        if reason is not None:
            cls.poll_message_set(reason)
        return reason is None


def busy_reason():
    """Why nothing can be computed now; None when it can."""
    if background_job.current is None:
        return None
    return "A morph is being computed: wait, or press Esc to cancel"


def shapes_reason(context):
    """Why source and target can't be used as they were picked; None when they can."""
    settings = context.scene.pointmorph
    for side, obj in (("source", settings.source), ("target", settings.target)):
        if obj is None:
            return f"Choose a {side} first"
        if not is_in(context.scene, obj):
            return f'The {side} "{obj.name}" is no longer in the scene: choose another object'
    if settings.source == settings.target:
        return f'Source and target are both "{settings.source.name}": choose two objects'
    return None


def selected_shapes(context):
    """The selected objects in the order in which they are morphed, the active one last; empty
    where they are fewer than two, or others among them."""
    shapes = sorted(context.selected_objects, key=lambda obj: obj.name)
    if len(shapes) < 2 or any(obj.type not in MORPHED_TYPES for obj in shapes):
        return []
    active = context.view_layer.objects.active
    if active in shapes:
        shapes.remove(active)
        shapes.append(active)
    return shapes


def select_reason(context):
    """Why the selected objects can't be morphed; None where they can."""
    if selected_shapes(context):
        return None
    selected = sorted(context.selected_objects, key=lambda obj: obj.name)
    how = "Join Copies" if len(selected) == 1 else "Join Copies, with it alone selected,"
    for obj in selected:
        if obj.type == "EMPTY" and obj.instance_type == "COLLECTION":
            return (
                f'"{obj.name}" can\'t be morphed: it shows a collection. {how} makes a mesh of '
                "that; or make its objects real (Object > Apply > Make Instances Real)"
            )
        if joined.is_of_parts(obj):
            return (
                f'"{obj.name}" can\'t be morphed: it has no surface itself ({type_name(obj)}). '
                f"{how} makes a mesh of what is parented to it"
            )
        if obj.type not in MORPHED_TYPES:
            kind = type_name(obj)
            return f'"{obj.name}" can\'t be morphed: it has no surface ({kind})'
    return SELECT


def morph_remark(context):
    """What Morph does that those who have selected something may not expect, in words, or None."""
    if morphs_selected(context):
        count = len(selected_shapes(context))
        if count > 2:
            return (
                f"Morph goes through the {count} selected objects one after another. For parts of "
                "a model, press Join Copies first"
            )
        part = _part_of(context, context.selected_objects) if count else None
        if part is not None:
            return (
                f'"{part.name}" is parented to "{part.parent.name}" and doesn\'t morph with it. To '
                f'morph all of it, select "{part.parent.name}" alone and press Join Copies'
            )
    elif _selects_others(context):
        return "For the selected objects, press Use Selected: Morph takes those chosen above"
    return None


def _selects_others(context):
    """Whether other objects are selected than those that are picked, and could be in their place:
    Morph computes what is picked all the same."""
    selected, picked = selected_shapes(context), staleness.picked_shapes(context.scene)
    known = {shape and recipes.original_of(shape) for shape in picked} | set(picked)
    return any(obj not in known for obj in selected) and not any(
        morph_object.is_made(obj) for obj in selected
    )


_FEW = 2000
"""Objects of a scene that panels, which ask at every redraw, can look through."""


def are_parts(context):
    """Whether the selected objects may be parts of one model, or what these are parented to."""
    selected = context.selected_objects
    if len(selected) > 2 or any(
        obj.type == "ARMATURE" or joined.is_of_parts(obj) for obj in selected
    ):
        return True
    if any(obj.parent in selected for obj in selected):
        return True
    return len(selected) == 1 and _part_of(context, selected) is not None


def _part_of(context, objects):
    """An object with a surface that is parented to one of some objects and none of them, where that
    can be told quickly; or None."""
    others = context.scene.objects
    if len(others) > _FEW:
        return None
    return next((one for one in others if one.parent in objects and is_part(one, objects)), None)


def pick_selected(context):
    """Makes the selected objects source, target, and what lies in between."""
    settings = context.scene.pointmorph
    source, *via, target = selected_shapes(context)
    settings.source, settings.target = source, target
    settings.via.clear()
    for shape in via:
        settings.via.add().object = shape


def morphs_selected(context):
    """Whether nothing is picked, so that a morph is one of the selected objects."""
    return not any(staleness.picked_shapes(context.scene))


def morph_reason(context):
    """Why there can be no morph of what is picked, the shapes in between included, or selected
    where nothing is; None when there can."""
    shapes = staleness.picked_shapes(context.scene)
    if morphs_selected(context):
        shapes = selected_shapes(context)
        if not shapes:
            return select_reason(context)
    elif len(shapes) == 2 or shapes[0] is None or shapes[-1] is None:
        return shapes_reason(context)
    if None in shapes:
        return "Choose an object for the source, the target and every shape in between"
    for obj in shapes:
        if not is_in(context.scene, obj):
            return f'"{obj.name}" is no longer in the scene: choose another object'
    for obj, after in pairwise(shapes):
        if obj == after:
            return f'"{obj.name}" comes twice in a row: remove one of the two'
    if len(shapes) > chains.LONGEST:
        return (
            f"A chain can have {chains.LONGEST} shapes at most, but there are {len(shapes)}. If "
            "they are parts of a model, select those alone and make one mesh of them (Join Copies)"
        )
    return None


def present(operator, context, obj, outcome, again=False):
    """Shows a morph object of an outcome, a new one or one computed `again`, and tells the user
    what came of it."""
    forget_results()
    shown, said = presentation.present(context, obj, again)
    if outcome.drawn is not None and blended_textures.is_first(shown):
        _blend(operator, shown, outcome.drawn)
    shading.show_colors(context, shown)
    activate(context.view_layer.objects, shown)
    left_copies.note_morphs()
    for words in said:
        operator.report({"WARNING"}, words)
    say_made(operator, shown, outcome.report)


def _blend(operator, obj, drawn):
    """Blends the textures of a new mesh. A morph that can't have them is as good without."""
    try:
        blended_textures.blend(obj, drawn)
    except pointmorph.PointmorphError as error:
        operator.report({"WARNING"}, blended_textures.not_blended(obj, error))
        return
    for remark in drawn.remarks:
        operator.report({"INFO"}, remark)


def say_looks(operator, requests):
    """Tells the user where the colors of what was morphed come from."""
    shapes = [requests[0].source, *(request.target for request in requests)]
    told, remarks = object_looks.words(shapes)
    for remark in remarks:
        operator.report({"WARNING"}, remark)
    if told:
        operator.report({"INFO"}, told)


def say_made(operator, obj, report):
    """Tells the user what came of a morph."""
    for warning in report["warnings"]:
        operator.report({"WARNING"}, warning)
    made = f'"{obj.name}": {report["pairs"]:,} pairs in {report["seconds"]:.1f} s'
    operator.report({"INFO"}, made)


def active_result(context):
    """The morph object of points that is meant: the active one, or that of the active mesh,
    else the last one of source and target."""
    active = context.view_layer.objects.active
    if morph_object.is_result(active):
        return active
    if morph_object.is_made(active) and morph_object.is_result(active.pointmorph.made_from):
        return active.pointmorph.made_from
    return _last_result(context.scene)


_found = {}
"""By scene, source and target: how many objects there were, and the morph object's name or none."""


def _last_result(scene):
    """The last morph object of source and target. Panels ask at every redraw, and a scene may have
    thousands of objects."""
    settings = scene.pointmorph
    if settings.source is None or settings.target is None:
        return None
    key = scene.session_uid, settings.source.session_uid, settings.target.session_uid
    count, name = _found.get(key, (-1, ""))
    known = scene.objects.get(name) if name else None
    if count != len(scene.objects) or (name and not _is_of(known, settings)):
        results = [obj for obj in scene.objects if _is_of(obj, settings)]
        known = results[-1] if results else None
        _found[key] = len(scene.objects), known.name if results else ""
    return known


def forget_results(*_):
    """What was found before may not be so any more."""
    _found.clear()


def _is_of(obj, settings):
    """Whether this is a morph object of the picked source and target."""
    if obj is None or (obj.pointmorph.source, obj.pointmorph.target) != (
        settings.source,
        settings.target,
    ):
        return False
    return morph_object.is_result(obj)


def picked_result(context, fits=staleness.is_exactly_picked):
    """The morph object that *Morph* computes again: of the shapes that are picked, the active one
    or else the last; None where there is none.

    Parameters
    ----------
    fits : callable
        Of the scene and an object: which are meant, among those of these shapes and their copies.
    """
    objects = [context.view_layer.objects.active, *list(context.scene.objects)[::-1]]
    of_picked = [
        obj
        for obj in objects
        if _can_be_morphed_again(context.scene, obj) and fits(context.scene, obj)
    ]
    for obj in of_picked:
        points = obj.pointmorph.made_from
        if obj.pointmorph.keeps_faces and points in of_picked:
            return points
        if morph_object.is_result(obj):
            return obj
    return of_picked[0] if of_picked else None


def _can_be_morphed_again(scene, obj):
    if not morph_object.is_made(obj) or obj.pointmorph.is_preview:
        return False
    both = {obj, obj.pointmorph.made_from or obj} if obj.pointmorph.keeps_faces else {obj}
    if not all(map(morph_object.is_in_file, both)):
        return False
    if not staleness.is_picked(scene, obj):
        return False
    try:
        if morph_object.is_result(obj):
            morph_object.check_whole(obj)
        morph_object.t_key(morph_object.shown_of(obj))
    except pointmorph.CloudError:  # somebody took it apart
        return False
    return True


def result_reason(context):
    """Why there is no morph object that could be baked; None when there is one."""
    obj = active_result(context)
    if obj is None:
        return NO_RESULT
    if obj.pointmorph.is_preview:
        return "This is only a preview: wait for the full morph"
    return "Switch to Object Mode first" if obj.mode == "EDIT" else None


def activate(objects, obj):
    """Selects `obj` alone, unless it's in an excluded collection or the user is in another mode."""
    in_object_mode = objects.active is None or objects.active.mode == "OBJECT"
    if in_object_mode and objects.get(obj.name) == obj:
        for other in list(objects.selected):
            other.select_set(False)
        obj.select_set(True)
        objects.active = obj
