"""What shows a morph: the source's own faces where it has any, else discs or points; and the
objects that it stands for, hidden meanwhile.

The faces are an object of their own, with one slider: the value of its key drives that of the
points'. Points and discs are two looks of one object.
"""

import contextlib

import bpy
import pointmorph

from ..data import areas
from . import (
    as_shown,
    morph_builder,
    morph_object,
    morphing_mesh,
    placement,
    points_display,
    recipes,
    slider_keys,
    stagger,
    staleness,
)
from .shape_reader import is_in

MESH, POINTS, DISCS = "MESH", "POINTS", "DISCS"

_MANY = 200_000
"""Pairs above which discs are too slow to be shown unasked: 0.08 s a frame on one core in
Blender 4.2."""

OF_POINTS = " Points"
"""What follows the name of a morph object whose mesh has that name."""


def present(context, obj, again=False):
    """Shows a morph object as the scene's setting `show_as` says, or one that was computed `again`
    as it was shown before, and hides its shapes.

    Returns
    -------
    Object
        What shows it; it has the name that `obj` had.
    list of str
        Why it isn't shown by faces all the same, lacks something, or isn't alone in renders.
    """
    shown, said = obj, []
    if obj.pointmorph.keeps_faces:  # its points are gone
        set_visible(context, obj, True)
    elif morph_object.shown_of(obj) != obj or (again and not obj.hide_get()):
        shown = show_as(context, obj, kind_of(obj))
    else:
        kind = context.scene.pointmorph.show_as
        try:
            shown = show_as(context, obj, kind if has_faces(obj) or kind != MESH else _solid(obj))
        except pointmorph.PointmorphError as error:
            said.append(f"Shown without its faces. {error}")
            shown = show_as(context, obj, _solid(obj))
    show_shapes(context, obj, False)
    if shown != obj and (left := morphing_mesh.left_off(recipes.shapes_of(obj)[0])):
        said.append(f'"{shown.name}" has no {", ".join(left)}: no mesh can have it and morph')
    if not again:
        shapes = [shape for shape in recipes.shapes_of(obj) if shape is not None]
        said += as_shown.still_rendered(dict.fromkeys(map(recipes.original_of, shapes)))
    return shown, said


@contextlib.contextmanager
def or_as_before(context, obj, is_new):
    """After an error, what a morph object was made from is shown or hidden as it was, and one that
    is new is gone, with the mesh that shows it."""
    shapes = [shape for shape in recipes.shapes_of(obj) if shape is not None]
    before = [(shape, shape.hide_get(), shape.hide_render) for shape in shapes]
    try:
        yield
    except BaseException:
        for shape, hidden, not_rendered in before:
            with contextlib.suppress(RuntimeError):  # it isn't in this view layer
                shape.hide_set(hidden, view_layer=context.view_layer)
            if shape.is_editable:
                shape.hide_render = not_rendered
        for one in {morph_object.shown_of(obj), obj} if is_new else ():
            morph_builder.remove(one)
        points_display.remove_unused()
        raise


def _solid(obj):
    """What shows a morph object best that has no faces."""
    return DISCS if len(obj.data.vertices) <= _MANY else POINTS


def has_faces(obj):
    """Whether the source of a morph object has faces that could show it."""
    source = recipes.shapes_of(obj)[0]
    return source is not None and source.type == "MESH" and len(source.data.polygons) > 0


def kind_of(obj):
    """What a morph object of points is shown as now, or was before all of it was hidden."""
    mesh = morph_object.shown_of(obj)
    if mesh != obj and (obj.hide_get() or not mesh.hide_get()):
        return MESH
    return DISCS if points_display.shows_discs(obj) else POINTS


def seen_of(obj):
    """What shows a morph object of points now: the mesh that was made for it, or itself."""
    return morph_object.shown_of(obj) if kind_of(obj) == MESH else obj


def show_as(context, obj, kind):
    """Shows a morph object of points as such, as discs, or by the source's faces; returns what is
    seen.

    Raises
    ------
    CloudError
        See `morphing_mesh.make_mesh`.
    """
    if kind != MESH:
        points_display.show_discs(obj, kind == DISCS)
        return show_points(context, obj)
    if morph_object.shown_of(obj) == obj:
        return _add_mesh(context, obj)
    placement.settle(context, obj)
    mesh = morph_object.shown_of(obj)
    _show_instead(context, obj, mesh)
    return mesh


def show_points(context, obj):
    """Shows a morph object of points in place of the source's faces, as points or as discs."""
    placement.settle(context, obj)
    mesh = morph_object.shown_of(obj)
    if mesh != obj:
        _show_instead(context, mesh, obj)
        return obj
    if obj.is_editable:
        with contextlib.suppress(pointmorph.CloudError):  # somebody took its slider away
            slider_keys.let_go(obj)  # of a mesh that was deleted
    set_visible(context, obj, True)
    return obj


def _show_instead(context, before, after):
    """Hides an object and shows another, which is selected and active where that was: Blender
    deselects what it hides."""
    objects = context.view_layer.objects
    is_selected, is_active = before.select_get(), objects.active == before
    set_visible(context, after, True)
    set_visible(context, before, False)
    with contextlib.suppress(RuntimeError):  # it isn't in this view layer
        if is_selected:
            after.select_set(True, view_layer=context.view_layer)
        if is_active and before.mode == "OBJECT":
            objects.active = after


def hide(context, obj):
    """Hides a morph object of points and the mesh that shows it, as for frames in their place."""
    placement.settle(context, obj)
    for one in {obj, morph_object.shown_of(obj)}:
        set_visible(context, one, False)


def show_shapes(context, obj, visible):
    """Shows or hides the objects that a morph object was made from."""
    for shape in recipes.shapes_of(obj):
        if shape is not None:
            original = recipes.original_of(shape)
            if original != shape:
                set_visible(context, shape, False)
            set_visible(context, original, visible)


def shows_shapes(obj):
    """Whether one of the objects that a morph object was made from is to be seen."""
    shapes = [recipes.original_of(s) for s in recipes.shapes_of(obj) if s is not None]
    return any(not shape.hide_get() for shape in shapes)


def hidden_shapes(context):
    """The picked objects that can't be seen, in the viewport or in renders, and are in the scene:
    those of a morph that was deleted."""
    shapes = [shape for shape in staleness.picked_shapes(context.scene) if shape is not None]
    originals = [recipes.original_of(shape) for shape in shapes]
    return [
        shape
        for shape in originals
        if is_in(context.view_layer, shape)
        and (shape.hide_get() or (shape.hide_render and shape.is_editable))
    ]


def _add_mesh(context, obj):
    """Makes the source's faces show a morph object; they take its name, and it is hidden."""
    mesh = morphing_mesh.make_mesh(context, obj)
    name, of_mesh = obj.name, obj.data.name
    try:
        _put_in_place(context, obj, mesh)
    except BaseException:
        with contextlib.suppress(Exception):
            slider_keys.hand_over(mesh, obj)
        obj.pointmorph.mesh = None
        morph_builder.remove(mesh)
        obj.name, obj.data.name = name, of_mesh
        raise
    set_visible(context, mesh, True)
    set_visible(context, obj, False)
    return mesh


def _put_in_place(context, obj, mesh):
    """Puts a new mesh where its morph object lies, and gives it the name and the slider of that."""
    if mesh.parent is not None or len(mesh.constraints):
        context.view_layer.update()
    placement.put_mesh(mesh, obj)
    slider_keys.hand_over(obj, mesh)
    name = obj.name
    if not morph_object.stage_names(obj)[-1].endswith(OF_POINTS):
        name = name.removesuffix(OF_POINTS)  # of a mesh that was deleted
    obj.name = obj.data.name = f"{name}{OF_POINTS}"
    mesh.name = mesh.data.name = name
    obj.pointmorph.mesh = mesh
    slider_keys.follow(obj, mesh)
    stagger.follow(obj, mesh)


def set_visible(context, obj, visible):
    """Shows or hides an object, in this view layer and in renders."""
    with contextlib.suppress(RuntimeError):  # it isn't in this view layer
        obj.hide_set(not visible, view_layer=context.view_layer)
    if obj.is_editable:
        obj.hide_render = not visible
    if visible:
        _put_in_local_views(context, obj)


def _put_in_local_views(context, obj):
    """Shows an object where a local view shows what it belongs to: otherwise nobody would see it
    there."""
    for space in areas.local_views():
        with contextlib.suppress(RuntimeError):  # it isn't in this view layer
            if any(_is_in_local_view(one, space) for one in _belonging_to(context, obj)):
                obj.local_view_set(space, True)


def _belonging_to(context, obj):
    """What is active or picked, and all parts of the morphs that an object is a part of."""
    found = {context.view_layer.objects.active, *staleness.picked_shapes(context.scene)}
    for made in filter(morph_object.is_made, bpy.data.objects):
        shapes = [shape for shape in recipes.shapes_of(made) if shape is not None]
        originals = [recipes.original_of(shape) for shape in shapes]
        known = made.pointmorph
        parts = {made, known.mesh, known.made_from, *shapes, *originals}
        if obj in parts:
            found |= parts
    return found - {None}


def _is_in_local_view(obj, space):
    with contextlib.suppress(RuntimeError):  # it isn't in this view layer
        return obj.local_view_get(space)
    return False
