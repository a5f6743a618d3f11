"""What isn't a morph any more because the user made it a plain mesh, or a curve or points (Object >
Convert)."""

import contextlib

import bpy
import pointmorph

from ..data.arrays import SHAPE_TYPES
from . import as_shown, morph_object, path_display, slider_keys


def forget_changed(depsgraph):
    """Makes the objects that were converted just now objects like any other; whether there were."""
    # Blender calls this at every step of a drag, maybe of thousands of objects.
    changed = [one.id.original for one in depsgraph.updates if one.is_updated_geometry]
    found = [obj for obj in changed if isinstance(obj, bpy.types.Object) and _is_converted(obj)]
    for obj in found:
        _forget(obj)
    return bool(found)


def _is_converted(obj):
    if obj.mode == "EDIT" or not obj.is_editable:
        return False
    knows = obj.pointmorph.keeps_faces or obj.pointmorph.recipe or obj.pointmorph.source is not None
    return bool(knows) and not morph_object.is_made(obj)


def _forget(obj):
    points = obj.pointmorph.made_from
    if morph_object.is_result(points) and points.is_editable and points.pointmorph.mesh == obj:
        _let_go(points, obj)
    as_shown.forget_morph(obj)
    _remove_drivers(obj, lambda curve: not _is_there(obj, curve.data_path))
    if obj.type in SHAPE_TYPES and obj.data.users == 1 and obj.data.is_editable:
        path_display.write(obj.data, (), ())
        attribute = obj.data.attributes.get(morph_object.ROW)
        if attribute is not None:
            obj.data.attributes.remove(attribute)


def _let_go(points, mesh):
    """Makes points go by themselves that followed the mesh."""
    points.pointmorph.mesh = None
    with contextlib.suppress(pointmorph.CloudError):  # somebody took its slider away
        slider_keys.let_go(points)
    _remove_drivers(points, lambda curve: _follows(curve.driver, mesh))


def _remove_drivers(obj, is_meant):
    """Of modifiers."""
    data = obj.animation_data
    for curve in [] if data is None else list(data.drivers):
        if curve.data_path.startswith("modifiers[") and is_meant(curve):
            data.drivers.remove(curve)


def _follows(driver, obj):
    return any(target.id == obj for one in driver.variables for target in one.targets)


def _is_there(obj, path):
    try:
        obj.path_resolve(path)
    except ValueError:
        return False
    return True
