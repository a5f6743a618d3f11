"""What shows a morph: the source's own faces where it has any, else points; and the objects that it
stands for, hidden meanwhile.

Both are objects of their own with one slider: the value of the mesh's key drives that of the
points'.
"""

import contextlib

import pointmorph

from ..data import nodes
from . import morph_object, morphing_mesh, recipes, stagger

MESH, POINTS = "MESH", "POINTS"


def present(context, obj):
    """Shows a new morph object as the scene's setting `show_as` says, and hides its shapes.

    Returns
    -------
    Object
        What shows it; it has the name that `obj` had.
    list of str
        Why there are points all the same, in words.
    """
    shown, said = obj, []
    if context.scene.pointmorph.show_as == MESH and has_faces(obj):
        try:
            shown = _add_mesh(context, obj)
        except pointmorph.PointmorphError as error:
            said.append(str(error))
    show_shapes(context, obj, False)
    return shown, said


def has_faces(obj):
    """Whether the source of a morph object has faces that could show it."""
    source = recipes.shapes_of(obj)[0]
    return source is not None and source.type == "MESH" and len(source.data.polygons) > 0


def kind_of(obj):
    """What a morph object of points is shown as now."""
    mesh = morph_object.shown_of(obj)
    return POINTS if mesh == obj or mesh.hide_get() else MESH


def show_as(context, obj, kind):
    """Shows a morph object of points as such, or by the source's faces; returns what is seen.

    Raises
    ------
    CloudError
        See `morphing_mesh.make_mesh`.
    """
    if kind == MESH and morph_object.shown_of(obj) == obj:
        return _add_mesh(context, obj)
    mesh = morph_object.shown_of(obj)
    if mesh == obj:
        return obj
    seen, other = (mesh, obj) if kind == MESH else (obj, mesh)
    _set_visible(context, seen, True)
    _set_visible(context, other, False)
    return seen


def hide(context, obj):
    """Hides a morph object of points and the mesh that shows it, as for frames in their place."""
    for one in {obj, morph_object.shown_of(obj)}:
        _set_visible(context, one, False)


def show_shapes(context, obj, visible):
    """Shows or hides the objects that a morph object was made from."""
    for shape in recipes.shapes_of(obj):
        if shape is not None:
            _set_visible(context, shape, visible)


def shows_shapes(obj):
    """Whether one of the objects that a morph object was made from is to be seen."""
    return any(not s.hide_get() for s in recipes.shapes_of(obj) if s is not None)


def _add_mesh(context, obj):
    """Makes the source's faces show a morph object; they take its name, and it is hidden."""
    name = obj.name
    mesh = morphing_mesh.make_mesh(context, obj)
    obj.name = obj.data.name = f"{name} Points"
    mesh.name = mesh.data.name = name
    obj.pointmorph.mesh = mesh
    curve = obj.data.shape_keys.driver_add(morph_object.t_key(obj).path_from_id("value"))
    curve.driver.type = "AVERAGE"
    nodes.drive(curve.driver, morph_object.t_key(mesh))
    stagger.follow(obj, mesh)
    _set_visible(context, mesh, True)
    _set_visible(context, obj, False)
    return mesh


def _set_visible(context, obj, visible):
    with contextlib.suppress(RuntimeError):  # it isn't in this view layer
        obj.hide_set(not visible, view_layer=context.view_layer)
    if obj.is_editable:
        obj.hide_render = not visible
