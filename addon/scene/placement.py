"""Where a morph lies in the world: the matrix of its frame, which its points have, and what that
makes of the mesh that shows it."""

import numpy as np
from mathutils import Matrix

from ..core import transforms
from ..data import arrays, versions
from . import applied, morph_object, recipes

_TRANSFORMS = ("location", "rotation", "scale", "delta_")
_CLOSE = {"rtol": 1e-6, "atol": 1e-6}


def frame_of(mesh):
    """(4, 4): the frame of the morph that a mesh with the source's faces shows where it lies."""
    return matrix_of(mesh) @ np.linalg.inv(morph_object.source_matrix_of(mesh))


def frame_seen(obj):
    """(4, 4): the frame of a morph object where it is seen, which its hidden points needn't have:
    the user moves the mesh that shows them."""
    mesh = morph_object.shown_of(obj)
    return matrix_of(obj) if mesh == obj or not obj.hide_get() else frame_of(mesh)


def settle(context, obj):
    """Puts the points of a morph object, if they are hidden, where the mesh lies that shows them;
    or the mesh, if that alone is hidden, where the points lie."""
    mesh = morph_object.shown_of(obj)
    give_back(*{obj, mesh})
    if mesh == obj:
        return
    if mesh.parent is not None or len(mesh.constraints):
        context.view_layer.update()
    if obj.hide_get():
        put(obj, frame_of(mesh))
    elif mesh.hide_get():
        put_mesh(mesh, obj)


def give_back(*objects):
    """Gives morph objects the transforms that were applied to them: they look the same, but their
    points are where they were made.

    Returns
    -------
    list of str
        Which points would lose them if they were computed again, in words: something else than the
        user moves them, or they would have to be sheared. Meshes keep them: see `keep`.
    """
    kept = []
    for obj in objects:
        matrix, users = applied.matrix_of(obj), morph_object.users_of(obj)
        if matrix is None or not obj.data.is_editable:
            continue
        if not all(map(is_free, users)):
            words = f'something else than you moves "{obj.name}"'
        elif any(_is_sheared(np.array(user.matrix_basis) @ matrix) for user in users):
            words = f'with its own, they shear "{obj.name}"'
        else:
            _give_back(obj, users, matrix)
            continue
        if not obj.pointmorph.keeps_faces:
            kept.append(words)
    return kept


def keep(mesh):
    """Has a mesh with the source's faces know what was applied to it and couldn't be given back:
    its points have it from now on. Returns all of it, (4, 4)."""
    matrix = morph_object.kept_matrix_of(mesh)
    added = applied.matrix_of(mesh)
    if added is not None:
        matrix = added @ matrix
        for user in morph_object.users_of(mesh):
            user.pointmorph.applied = matrix.reshape(-1)
    return matrix


def _is_sheared(matrix):
    """Whether a (4, 4) matrix is more than a place, a rotation and a scale."""
    axes = matrix[:3, :3] / np.maximum(np.linalg.norm(matrix[:3, :3], axis=0), 1e-30)
    return np.abs(axes.T @ axes - np.eye(3)).max() > 1e-3


def _give_back(obj, users, matrix):
    back = np.linalg.inv(matrix)
    for key in obj.data.shape_keys.key_blocks:
        arrays.write_key(key, transforms.move_positions(back, arrays.key_positions(key)))
    arrays.move_vertices(obj.data, arrays.key_positions(obj.data.shape_keys.reference_key))
    for user in users:
        put(user, matrix_of(user) @ matrix)
        for child in user.children:
            if child.parent_type == "OBJECT":  # it stays, as when Blender applies
                moved = back @ np.array(child.matrix_parent_inverse)
                child.matrix_parent_inverse = Matrix(moved.tolist())
        user.update_tag()


def shift(positions, origin, positions_now, origin_now):
    """(4, 4): from the old origin to the new one where points have stayed in the world, else None.

    Parameters
    ----------
    positions, positions_now : (N, 3) arrays
        As seen from the origins.
    origin, origin_now : (3,) arrays
    """
    way = np.asarray(origin_now, np.float64) - origin
    if len(positions) != len(positions_now) or not way.any():
        return None
    off = np.abs(positions_now - positions + way).max()
    if off > 1e-5 * max(np.abs(origin).max(), np.abs(origin_now).max(), np.abs(positions).max()):
        return None
    matrix = np.eye(4)
    matrix[:3, 3] = way
    return matrix


def put_mesh(mesh, obj):
    """Puts a mesh where the points of the morph object lie that it shows."""
    put(mesh, matrix_of(obj) @ morph_object.source_matrix_of(mesh))


def matrix_of(obj):
    """(4, 4): where an object lies, also one that is new or hidden, as far as Blender knows."""
    alone = obj.parent is None and not len(obj.constraints)
    return np.array(obj.matrix_basis if alone else obj.matrix_world)


def put(obj, matrix):
    """Gives an object a matrix in the world, unless it has it or something else moves it."""
    if not np.allclose(matrix_of(obj), matrix, **_CLOSE) and is_free(obj):
        obj.matrix_world = Matrix(matrix.tolist())


def is_free(obj):
    """Whether nothing but the user decides where an object lies."""
    if len(obj.constraints) or not obj.is_editable:
        return False
    data = obj.animation_data
    if data is None:
        return True
    curves = [*versions.curves_of(obj), *data.drivers]
    return not (
        any(curve.data_path.startswith(_TRANSFORMS) for curve in curves) or len(data.nla_tracks)
    )


def follow_source(mesh, known, places):
    """Puts a mesh with the source's faces where the morph lies, now that its source was moved,
    turned or scaled. Where the user moved it, it stays.

    Parameters
    ----------
    known : tuple of (3,) array or None, and (4, 4) array
        What `placed_by` said of the mesh before; it says what they are now.
    places : tuple of (N, 3) arrays
        Of the mesh's vertices in its own space, before and now.
    """
    origin, source_matrix = placed_by(mesh)
    if origin is None or known[0] is None:
        return
    matrices = known[1], source_matrix
    seen = [transforms.apply(*one) for one in zip(matrices, places, strict=True)]
    moved = shift(seen[0], known[0], seen[1], origin)
    if moved is not None:
        put(mesh, matrix_of(mesh) @ np.linalg.inv(known[1]) @ moved @ source_matrix)
        return
    before, after = home(*known), home(origin, source_matrix)
    if np.array_equal(before, after) or np.allclose(matrix_of(mesh), after, **_CLOSE):
        return
    if mesh.parent is not None:  # which may have moved with it
        if np.allclose(matrix_of(mesh), before, **_CLOSE):
            put(mesh, after)
        return
    frame = matrix_of(mesh) @ np.linalg.inv(known[1])
    if np.allclose(frame[:3, 3], known[0], **_CLOSE):
        frame[:3, 3] = origin
    put(mesh, frame @ source_matrix)


def placed_by(obj):
    """The origin of the frame, or None, and the source's matrix by which a morph was made."""
    origin = recipes.recipe_of(obj).get("origin")
    return None if origin is None else np.array(origin), morph_object.source_matrix_of(obj)


def home(origin, source_matrix):
    """(4, 4): the matrix of a mesh that lies where its source did."""
    matrix = np.array(source_matrix)
    matrix[:3, 3] += origin
    return matrix
