"""Points of its own for a mesh that shows a morph as well: a duplicate, or one more that was made
from the same points."""

from ..data import creation
from . import (
    morph_object,
    placement,
    points_display,
    presentation,
    slider_keys,
    stagger,
)


def of_active(context, obj):
    """The morph object of points by which the active object can be shown: `obj`, or where the
    active one is a mesh beside the one that shows it, a copy of it for that mesh alone.

    Raises
    ------
    CloudError
        When either has lost its slider.
    """
    mesh = context.view_layer.objects.active
    if not (morph_object.is_beside(mesh, obj) and mesh.is_editable):
        return obj
    for one in (obj, mesh):
        morph_object.t_key(one)  # raises where there is none, before anything is made
    copy = creation.copied(obj)
    # Alt D shares the slider, and so the points.
    if mesh.data != morph_object.shown_of(obj).data:
        copy.data = obj.data.copy()
        _drive_by(copy, obj.data.shape_keys, copy.data.shape_keys)
        slider_keys.let_go(copy)
        slider_keys.follow(copy, mesh)
    copy.name = f"{mesh.name}{presentation.OF_POINTS}"
    creation.link(context, copy)
    points_display.show(copy, None)
    copy.pointmorph.mesh = mesh
    mesh.pointmorph.made_from = copy
    stagger.follow(copy, mesh)
    placement.put(copy, placement.frame_of(mesh))
    presentation.set_visible(context, copy, False)
    return copy


def _drive_by(copy, keys, own):
    """Has the drivers of a copy read its own shape keys."""
    for block in (copy, own):
        data = block.animation_data
        for curve in [] if data is None else data.drivers:
            for variable in curve.driver.variables:
                for target in variable.targets:
                    if target.id == keys:
                        target.id = own
