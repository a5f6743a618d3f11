"""Both ends of a morph's map, in the morph's frame: what is carried along it goes from one to the
other."""

from dataclasses import dataclass

import numpy as np
import pointmorph
import pointmorph.meshes

from ..core import transforms
from ..data import arrays
from . import applied, morph_object, morph_paths, recipes

_DEFORMING = {
    "ARMATURE",
    "CAST",
    "CURVE",
    "DISPLACE",
    "HOOK",
    "LAPLACIANDEFORM",
    "LATTICE",
    "MESH_DEFORM",
    "SHRINKWRAP",
    "SIMPLE_DEFORM",
    "SMOOTH",
    "CORRECTIVE_SMOOTH",
    "LAPLACIANSMOOTH",
    "SURFACE_DEFORM",
    "WARP",
    "WAVE",
}
"""Modifiers that leave a mesh its vertices, and that a scene can do without for a moment."""


@dataclass(frozen=True)
class Receiver:
    """A mesh that gets something from the target, and where the map takes it.

    Attributes
    ----------
    positions, landing : (N, 3) array
        Of its vertices: where they are, and where they land on the target.
    triangles, loops : (F, 3) array of int or None
        Their vertices, and their corners.
    corners, faces : (C,) array of int
        For each corner, its vertex and its face.
    own : (4, 4) array
        From the morph's frame to the mesh's own space.
    """

    positions: np.ndarray
    landing: np.ndarray
    triangles: np.ndarray | None
    loops: np.ndarray | None
    corners: np.ndarray
    faces: np.ndarray
    own: np.ndarray


@dataclass(frozen=True)
class Giver:
    """The target's vertices, and the vertices and corners of its triangles."""

    positions: np.ndarray
    triangles: np.ndarray | None
    loops: np.ndarray | None


def source_of(obj):
    """The source of a morph object, which is there and can be changed. Raises CloudError."""
    source = recipes.shapes_of(obj)[0]
    _check_changeable(obj, source, 0, "its source")
    return source


def target_of(obj):
    """The same of the target."""
    target = recipes.shapes_of(obj)[-1]
    _check_changeable(obj, target, -1, "its target")
    return target


def _check_changeable(obj, shape, number, what):
    if shape is None:
        raise recipes.gone_error(obj, number, what, "Undo the deletion, or morph again.")
    if shape.type != "MESH":
        raise pointmorph.CloudError(
            shape.name,
            "a mesh to transfer attributes to",
            f"an object of type {arrays.type_name(shape)}",
            "Convert it (Object > Convert > Mesh).",
        )
    if shape.library is not None or shape.data.library is not None:
        raise pointmorph.CloudError(
            shape.name,
            "an object of this file",
            "one that is linked from another",
            "Make it local (Object > Relations > Make Local).",
        )
    check_mode(shape)


def check_mode(obj):
    """Raises CloudError in Edit Mode, where an object's own data aren't what is edited."""
    if obj.mode == "EDIT":
        raise pointmorph.CloudError(
            obj.name, "an object in Object Mode", "Edit Mode", "Switch to Object Mode (Tab)."
        )


def read_receiver(obj, onto_source):
    """The mesh that shows the morph object `obj`, or its source.

    Raises
    ------
    CloudError
        When there is no source, or it has changed since.
    """
    matrix = morph_object.source_matrix_of(obj)
    if not onto_source:
        mesh = obj.data
        start = arrays.basis_positions(mesh)
        landing = arrays.key_positions(morph_object.last_key(obj))
        places = [transforms.move_positions(matrix, place) for place in (start, landing)]
        return _receiver(mesh, *places, np.linalg.inv(matrix))
    source = source_of(obj)
    pairs = obj if morph_object.is_result(obj) else obj.pointmorph.made_from
    if morph_object.is_result(pairs):
        _, places, _, own = morph_paths.source_ways(pairs)
        return _receiver(source.data, places[0], places[-1], own)
    shown = read_receiver(obj, False)
    start = transforms.move_positions(matrix, arrays.basis_positions(source.data))
    if start.shape != shown.positions.shape or not np.allclose(
        start, shown.positions, rtol=0.0, atol=1e-6 * np.abs(start).max()
    ):
        raise morph_paths.changed_since(source, obj)
    return _receiver(source.data, start, shown.landing, shown.own)


def _receiver(mesh, positions, landing, own):
    triangles = arrays.mesh_triangles(mesh)
    counts = arrays.corner_counts(mesh)
    return Receiver(
        positions,
        landing,
        triangles,
        None if triangles is None else arrays.triangle_loops(mesh),
        arrays.mesh_corners(mesh),
        np.repeat(np.arange(len(counts)), counts),
        own,
    )


def read_giver(obj, mesh):
    """The target of a morph object as it was morphed; `mesh` is what the viewport shows of it."""
    positions = places_of_target(obj)
    if positions is None:
        positions = transforms.move_positions(target_matrix(obj), arrays.vertex_positions(mesh))
    return giver_of(mesh, positions)


def places_of_target(obj):
    """(M, 3): where the target's points were when it was morphed, in the morph's frame, whatever
    its pose is now; None where the points of the morph, which know it, are gone or were moved."""
    pairs = obj if morph_object.is_result(obj) else obj.pointmorph.made_from
    if not morph_object.is_result(pairs) or applied.matrix_of(pairs) is not None:
        return None
    rows = morph_object.stage_rows(pairs)[-1]
    return arrays.by_row(rows, arrays.key_positions(morph_object.stage_keys(pairs)[-1]))


def read_unmodified_giver(context, matrix, target, shown):
    """The same with the vertices that the target's shape keys and vertex groups have: `shown` where
    these are as many, else those of the mesh as what deforms it leaves them.

    Parameters
    ----------
    matrix : (4, 4) array
        From the target's own space to the morph's frame.

    Raises
    ------
    CloudError
        When these lie elsewhere than what the viewport shows.
    """
    if len(target.data.vertices) == len(shown.positions):
        return shown
    positions = transforms.move_positions(matrix, _deformed(context, target))
    giver = giver_of(target.data, positions)
    _check_together(target, giver, shown)
    return giver


def _deformed(context, target):
    """(N, 3): vertices of a mesh in its pose, without the modifiers that change their number."""
    added = [m for m in target.modifiers if m.show_viewport and m.type not in _DEFORMING]
    if len(added) == sum(m.show_viewport for m in target.modifiers):
        return arrays.basis_positions(target.data)
    try:
        for modifier in added:
            modifier.show_viewport = False
        target.update_tag()
        mesh = target.evaluated_get(context.evaluated_depsgraph_get()).data
        if len(mesh.vertices) != len(target.data.vertices):
            return arrays.basis_positions(target.data)
        return arrays.vertex_positions(mesh).copy()
    finally:
        for modifier in added:
            modifier.show_viewport = True
        target.update_tag()
        context.view_layer.update()


def _check_together(target, giver, shown):
    """Shape keys and hair are found by where they are."""
    if giver.triangles is None or shown.triangles is None or not len(giver.triangles):
        return
    sides = giver.positions[giver.triangles] - giver.positions[np.roll(giver.triangles, 1, axis=1)]
    closest = pointmorph.meshes.ClosestPlaces(shown.positions, shown.triangles)
    triangles, shares = closest.of(giver.positions)
    places = np.einsum("nk,nkc->nc", shares, shown.positions[shown.triangles[triangles]])
    away = np.linalg.norm(places - giver.positions, axis=1)
    if np.median(away) > np.median(np.linalg.norm(sides, axis=2)):
        raise pointmorph.CloudError(
            target.name,
            "modifiers that add vertices without moving the mesh",
            "some that move it",
            "Turn off the modifiers that move it, morph again, and turn them back on after the "
            "transfer; or transfer without Shape Keys, Hair and Weights to Target.",
        )


def giver_of(mesh, positions):
    """A mesh whose vertices lie at `positions`, in the morph's frame."""
    triangles = arrays.mesh_triangles(mesh)
    return Giver(positions, triangles, None if triangles is None else arrays.triangle_loops(mesh))


def target_matrix(obj):
    """(4, 4): from the target's own space to the frame of a morph object.

    Raises
    ------
    CloudError
        When an earlier version made it.
    """
    recipe = recipes.recipe_of(obj)
    if not recipes.is_known(recipe):
        raise pointmorph.CloudError(
            obj.name,
            "a morph that stores where its target was",
            "one from an earlier version",
            "Recompute the morph first.",
        )
    return np.reshape(recipe["shapes"][-1]["matrix"], (4, 4))
