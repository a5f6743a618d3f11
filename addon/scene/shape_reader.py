"""Objects of the scene as shapes that the library can compute on."""

import numpy as np
import pointmorph

from ..core import transforms
from ..core.computation import Shape
from ..core.features import PREFIX, Marks, is_doubled, meant
from ..core.stepping import finish
from ..data import arrays, masks
from ..data.feature_list import feature_groups
from ..data.materials import Pictures
from . import baked_colors, object_looks


def update(context, *objects):
    """Brings edits in Edit Mode, and transforms that a script has just set, up to date."""
    for obj in objects:
        if obj.mode == "EDIT":
            obj.update_from_editmode()
            obj.update_tag(refresh={"DATA"})
    context.view_layer.update()


def read_shape_steps(context, obj, origin, as_shown, with_relief=False, bakes=()):
    """A generator that yields often and returns an object in the frame with the world's axes and
    this origin; `update` must come before.

    Parameters
    ----------
    as_shown : bool
        With modifiers and shape keys, as in the viewport. A point cloud always is.
    with_relief, bakes
        See `read_own_steps`.
    """
    matrix = transforms.relative_to(obj.matrix_world, origin)
    shape = yield from read_own_steps(context, obj, as_shown, with_relief, bakes)
    transforms.check_invertible(obj.name, matrix)
    return shape.moved(matrix)


def read_own_steps(context, obj, as_shown, with_relief=False, bakes=()):
    """The same in the object's own space.

    Parameters
    ----------
    with_relief : bool
        With normals at faces' corners, and normal maps.
    bakes : collection of str
        Parts of surfaces that are baked where they can't be read otherwise: see `baked_colors`.
    """
    if obj.type not in arrays.SHAPE_TYPES:
        raise pointmorph.CloudError(
            obj.name,
            "a mesh or a point cloud",
            f"an object of type {arrays.type_name(obj)}",
            "Convert it (Object > Convert > Mesh), or choose another object.",
        )
    evaluated = evaluated_of(obj, context.evaluated_depsgraph_get())
    if obj.type == "POINTCLOUD":
        return _read_cloud(obj, evaluated.data)
    chosen = {}
    if not as_shown:  # the source's alone
        masks.check_masks(obj)
        chosen = masks.mask_groups(obj)
    changes = as_shown and not is_plain(obj)
    pictures = Pictures()
    if bakes:
        yield
        pictures = yield from baked_colors.needed_steps(context, obj, changes, bakes)
        yield
    if changes:
        depsgraph = context.evaluated_depsgraph_get()
        evaluated = obj.evaluated_get(depsgraph)
        # Lives until the scene is evaluated again, so this is one step.
        mesh = evaluated.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
        try:
            if not len(mesh.vertices):
                raise nothing_shown(obj, depsgraph)
            return finish(
                _read_mesh(obj, mesh, arrays.vertex_positions(mesh), with_relief, pictures, chosen)
            )
        finally:
            evaluated.to_mesh_clear()
    check_keys(obj)
    positions = arrays.basis_positions(obj.data)
    shape = yield from _read_mesh(obj, obj.data, positions, with_relief, pictures, chosen)
    if len(obj.data.vertices) != len(shape.positions):
        raise _changed(obj)
    return shape


def evaluated_of(obj, depsgraph):
    """What the viewport shows of an object. Raises CloudError where it is disabled."""
    evaluated = obj.evaluated_get(depsgraph)
    if not evaluated.is_evaluated:
        raise disabled(obj)
    return evaluated


def disabled(obj):
    """The error that an object isn't shown in the viewport."""
    return pointmorph.CloudError(
        obj.name,
        "an object that is enabled in this view layer",
        "one that is disabled in viewports, or in a disabled collection",
        "Enable it in the Outliner. Hiding it with the eye icon is fine.",
    )


_OF_NODES = {
    "POINTCLOUD": ("points", 'Add the node "Points to Vertices"'),
    "CURVES": ("curves", 'Add the node "Curve to Mesh" with a profile'),
    "CURVE": ("curves", 'Add the node "Curve to Mesh" with a profile'),
    "VOLUME": ("a volume", 'Add the node "Volume to Mesh"'),
}
"""What geometry nodes show besides a mesh, by the type of the object: in words, and what makes a
mesh of it."""


def nothing_shown(obj, depsgraph):
    """The error that the viewport shows no mesh of an object; what it shows instead is named."""
    shown = {
        instance.object.type
        for instance in depsgraph.object_instances
        if instance.is_instance and instance.parent and instance.parent.original == obj
    }
    found, advice = "none", "Check its modifiers."
    if shown:
        words = next((words for kind, words in _OF_NODES.items() if kind in shown), None)
        words = words or ("instances", 'Add the node "Realize Instances"')
        found, advice = words[0], f"{words[1]} at the end of its Geometry Nodes."
    return pointmorph.CloudError(obj.name, "a mesh in the viewport", found, advice)


def _changed(obj):
    return pointmorph.CloudError(
        obj.name, "a mesh that doesn't change", "changes while it was being read", "Try again."
    )


def present_steps(context, objects, steps):
    """The steps of a generator that reads objects, and what it returns. Those that aren't in the
    scene, as after their removal, are there while it reads, which then is a single step.
    """
    absent = [obj for obj in dict.fromkeys(objects) if not is_in(context.scene, obj)]
    if not absent:
        return (yield from steps)
    # What is only for the moment in the scene must not be there when Blender goes on.
    collection = context.scene.collection
    for obj in absent:
        collection.objects.link(obj)
    try:
        return finish(steps)
    finally:
        for obj in absent:
            collection.objects.unlink(obj)


def is_in(scene, obj):
    """Whether an object is in a scene."""
    # Only objects of other files share a name.
    return scene.objects.get(obj.name) == obj or any(other == obj for other in scene.objects)


def is_plain(obj):
    """Whether the viewport shows a mesh as it is, for all that one can tell without looking."""
    by_parent = obj.parent is not None and obj.parent_type != "OBJECT"
    return not (obj.modifiers or obj.data.shape_keys or obj.mode == "EDIT" or by_parent)


def check_keys(obj):
    """Raises CloudError where a script has given the mesh other vertices than its shape keys."""
    keys, count = obj.data.shape_keys, len(obj.data.vertices)
    wrong = [key for key in keys.key_blocks if len(key.data) != count] if keys else []
    if wrong:
        raise pointmorph.CloudError(
            obj.name,
            f"shape keys for its {count} vertices",
            f'{len(wrong[0].data)} in "{wrong[0].name}"',
            "Enter and leave Edit Mode, or remove these shape keys.",
        )


def _read_mesh(obj, mesh, positions, with_relief, pictures, chosen):
    """A generator that yields often and returns a Shape."""
    if any(len(uvs) != len(mesh.loops) for uvs in pictures.uvs.values()):
        raise _changed(obj)  # while another Blender baked
    groups = feature_groups(obj)
    yield
    triangles = arrays.mesh_triangles(mesh)
    yield
    # Without faces Blender makes normals up.
    normals = _own_normals(mesh) if triangles is None else arrays.mesh_normals(mesh)
    yield
    skin = object_looks.read_skin(obj, mesh, with_relief, pictures)
    yield
    colors, radii = object_looks.vertex_colors(mesh, skin), _radii(mesh)
    yield
    edges = arrays.mesh_edges(mesh)
    yield
    marks, kept = yield from masks.read_steps(mesh, groups, chosen)
    if mesh != obj.data:
        marks = yield from _meant_steps(obj, marks, edges)
    return Shape(
        name=obj.name,
        positions=positions,
        normals=normals,
        colors=colors,
        radii=radii,
        triangles=triangles,
        marks=Marks("vertex group", marks, edges),
        skin=skin,
        **{kind: masks.mask(len(positions), *found) for kind, found in kept.items()},
    )


def _meant_steps(obj, marks, edges):
    """The features of a mesh that modifiers have changed, without what they have doubled; a
    generator that yields often and returns them."""
    doubled = {name for name, found in marks.items() if is_doubled(found)}
    groups = {index: name for index, name in feature_groups(obj).items() if name in doubled}
    if not groups:
        return marks
    own_edges = arrays.mesh_edges(obj.data)
    marked = yield from arrays.vertex_group_steps(obj.data, groups)
    return marks | {name: meant(own, own_edges, marks[name], edges) for name, own in marked.items()}


def _read_cloud(obj, cloud):
    weights = {}
    for attribute in cloud.attributes:
        if attribute.name.startswith(PREFIX) and arrays.point_attribute(
            cloud, attribute.name, "FLOAT", "INT", "INT8", "BOOLEAN"
        ):
            values = arrays.read_attribute(attribute)
            rows = np.flatnonzero(values)
            weights[attribute.name[len(PREFIX) :]] = (rows, values[rows])
    return Shape(
        name=obj.name,
        positions=arrays.cloud_positions(cloud),
        normals=_own_normals(cloud),
        colors=arrays.cloud_colors(cloud),
        radii=_radii(cloud),
        triangles=None,
        marks=Marks("point attribute", weights),
    )


def _own_normals(geometry):
    attribute = arrays.point_attribute(geometry, "Normal", "FLOAT_VECTOR")
    return None if attribute is None else arrays.read_attribute(attribute)


def _radii(geometry):
    attribute = arrays.point_attribute(geometry, "radius", "FLOAT")
    return None if attribute is None else arrays.read_attribute(attribute)
