"""The morph object: a mesh of one vertex a pair, made in one piece or not at all, and its bakes.

Its basis is the source, its shape key "Morph" the target, and point attributes hold what else the
pairs have at both ends. So it needs nothing but itself for a bake, also in a file opened later.
"""

from contextlib import contextmanager

import bpy
import numpy as np
import pointmorph

from . import arrays, display, transforms

KEY = "Morph"


@contextmanager
def all_or_nothing():
    """Gives a function to call with every data-block made; removes them all after an error."""
    created = []
    try:
        yield created.append
    except BaseException:
        for item in created:
            if isinstance(item, bpy.types.Object):
                item.shape_key_clear()  # a data-block that isn't removed with the mesh
        bpy.data.batch_remove(created)
        raise


def is_result(obj):
    """Whether an object is a morph object."""
    return obj is not None and obj.type == "MESH" and "source_row" in obj.data.attributes


def morph_key(obj):
    """The shape key of a morph object that makes it the target."""
    keys = obj.data.shape_keys
    key = None if keys is None else keys.key_blocks.get(KEY)
    if key is None:
        raise pointmorph.CloudError(
            obj.name,
            f'a morph object with its shape key "{KEY}"',
            "none of that name",
            "Morph again, or give the key its name back.",
        )
    return key


def world_position(obj, source_row):
    """Where a morph object shows a row of the source at the present value of its key."""
    key = morph_key(obj)
    rows = np.flatnonzero(arrays.read_rows(obj.data, "source_row") == source_row)
    if not rows.size:
        raise pointmorph.CloudError(
            obj.name, f"point {source_row} of the source", "none", "Morph again."
        )
    ends = (obj.data.shape_keys.reference_key, key)
    start, end = (arrays.key_positions(side)[rows[0]] for side in ends)
    place = (1.0 - key.value) * start + key.value * end
    return transforms.move_positions(np.array(obj.matrix_world), place[None])[0]


def build(context, outcome, name, origin, source, target, source_matrix):
    """Makes the morph object in the active collection.

    Parameters
    ----------
    outcome : computation.Outcome
    name : str
    origin : (3,) array
        Where the frame of the morph lies in the world: the object's location.
    source, target : Object or None
        What was morphed, if it's still there.
    source_matrix : (4, 4) array
        From the source's own space to the morph's frame.
    """
    ends = {"source": outcome.source, "target": outcome.target}
    with all_or_nothing() as created:
        mesh = bpy.data.meshes.new(name)
        created(mesh)
        arrays.fill_mesh(mesh, outcome.source.positions)
        for side, end in ends.items():
            arrays.write_attribute(mesh, f"{side}_row", end.rows)
            arrays.write_attribute(mesh, f"{side}_normal", end.normals)
            arrays.write_attribute(mesh, f"{side}_color", end.colors)
            arrays.write_attribute(mesh, f"{side}_radius", end.radii)
        arrays.write_attribute(mesh, "landing", outcome.landing[outcome.source.rows])
        arrays.write_attribute(mesh, "target_landing", outcome.maps[1][outcome.target.rows])
        arrays.write_attribute(mesh, display.DISTORTION, outcome.distortion)
        obj = bpy.data.objects.new(name, mesh)
        created(obj)
        obj.location = origin
        obj.pointmorph.source = source
        obj.pointmorph.target = target
        obj.pointmorph.source_matrix = source_matrix[:3, :3].reshape(-1)
        obj.shape_key_add(name="Basis", from_mix=False)
        key = _new_key(obj, KEY)
        arrays.write_key(key, outcome.target.positions)
        obj.active_shape_key_index = 1
        display.add_points_modifier(obj, key, created)
        context.collection.objects.link(obj)
    return obj


def _new_key(obj, name):
    key = obj.shape_key_add(name=name, from_mix=False)
    key.value = 0.0  # Blender 5 begins with 1
    return key


# --- Baking ---------------------------------------------------------------------------------------


def bake_pairs(obj, steps, path):
    """Adds `steps` shape keys to the morph object itself, from the source to the target.

    `path` is the library's setting of that name.
    """
    end = arrays.key_positions(morph_key(obj))
    start = arrays.key_positions(obj.data.shape_keys.reference_key)
    normals = arrays.read_vectors(obj.data, "source_normal")
    _add_keys(obj, pointmorph.Motion(start, normals, end, path).at, steps, _target_name(obj))


def bake_source(obj, steps, path):
    """Adds `steps` shape keys to the mesh that the morph object `obj` was made from.

    Returns
    -------
    Object
        The source.

    Raises
    ------
    CloudError
        When the source is gone, can't hold shape keys, or isn't what was morphed any more.
    """
    source = obj.pointmorph.source
    if source is None:
        raise pointmorph.CloudError(
            obj.name, "its source in the file", "none", "Morph again, from a mesh that is there."
        )
    if source.type != "MESH":
        raise pointmorph.CloudError(
            source.name,
            "a mesh, to hold shape keys",
            f"an object of type {source.type}",
            "Bake on the pairs instead.",
        )
    if source.data.library is not None:
        raise pointmorph.CloudError(
            source.name,
            "a mesh that can be changed",
            "one that is linked from another file",
            "Make it local (Object > Relations > Make Local), or bake on the pairs instead.",
        )
    if source.mode == "EDIT":
        raise pointmorph.CloudError(
            source.name, "an object in Object Mode", "Edit Mode", "Leave Edit Mode (Tab)."
        )
    start = arrays.basis_positions(source.data)
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(obj.pointmorph.source_matrix, (3, 3))
    morph_key(obj)
    rows = arrays.read_rows(obj.data, "source_row")
    known = arrays.key_positions(obj.data.shape_keys.reference_key)
    if len(start) != rows.max() + 1 or not _same(
        transforms.move_positions(matrix, start)[rows], known
    ):
        raise pointmorph.CloudError(
            source.name,
            f'the mesh that "{obj.name}" was made from',
            "one that was changed since",
            "Morph again.",
        )
    landing, normals = np.empty_like(start), np.empty_like(start)
    landing[rows] = arrays.read_vectors(obj.data, "landing")
    normals[rows] = arrays.read_vectors(obj.data, "source_normal")
    motion = pointmorph.Motion(transforms.move_positions(matrix, start), normals, landing, path)
    back = np.linalg.inv(matrix)
    _add_keys(
        source,
        lambda t: transforms.move_positions(back, motion.at(t)),
        steps,
        _target_name(obj),
    )
    return source


def _same(a, b):
    """Whether positions are equal but for what another processor may round differently."""
    return np.abs(a - b).max() <= 1e-6 * np.abs(b).max()


def _target_name(obj):
    target = obj.pointmorph.target
    return KEY if target is None else target.name


def _add_keys(obj, positions_at, steps, name):
    """Shape keys at t = 1/steps, 2/steps, … 1; all or none. `positions_at(t)` gives them."""
    added = []
    try:
        if obj.data.shape_keys is None:
            added.append(obj.shape_key_add(name="Basis", from_mix=False))
        for step in range(1, steps + 1):
            last = step == steps
            t = step / steps
            key_name = name if last else f"{name} {100 * t:.3g} %"
            key = _new_key(obj, key_name)
            added.append(key)
            arrays.write_key(key, positions_at(t))
    except BaseException:
        for key in reversed(added):
            obj.shape_key_remove(key)
        raise
    obj.active_shape_key_index = len(obj.data.shape_keys.key_blocks) - 1
