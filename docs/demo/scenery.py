"""Clouds as Blender objects that suit each other, displayed like solid surfaces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix
from pointmorph import Cloud
from pointmorph.meshes import Shape

from addon.data import versions

FloatArray = npt.NDArray[np.floating]

FEATURE_PREFIX = "pm."
OVERLAP = 1.3
"""Radius of the discs in radii of their points, large enough to leave no gaps."""


STEPS = 8
"""Number of shape keys for the rigid path."""


def staged(shape: Shape, turn: float, upright: bool) -> Shape:
    """The shape rotated to face -y and stand along z.

    Parameters
    ----------
    turn : float
        Degrees about the vertical.
    upright : bool
        Whether its y axis points up.
    """
    matrix = np.array(Matrix.Rotation(np.radians(turn), 3, "Z"))
    if upright:
        matrix = matrix @ np.array(Matrix.Rotation(np.radians(90.0), 3, "X"))
    normals = None if shape.normals is None else (shape.normals @ matrix.T).astype(np.float32)
    positions = (shape.positions @ matrix.T).astype(np.float32)
    return dataclasses.replace(shape, positions=positions, normals=normals)


def add_cloud(
    scene: bpy.types.Scene, cloud: Cloud, features: Mapping[str, int]
) -> bpy.types.Object:
    """Adds a mesh of vertices with normals, colors and one vertex group per feature."""
    mesh = bpy.data.meshes.new(cloud.name)
    mesh.vertices.add(len(cloud))
    mesh.vertices.foreach_set("co", cloud.positions.astype(np.float32).ravel())
    if cloud.normals is not None:
        _add_attribute(mesh, "normal", "FLOAT_VECTOR", "vector", cloud.normals)
    if cloud.colors is not None:
        _add_attribute(mesh, "Color", "FLOAT_COLOR", "color", cloud.colors)
        mesh.color_attributes.active_color_name = "Color"
    if cloud.radii is not None:
        _add_attribute(mesh, "radius", "FLOAT", "value", cloud.radii)
    holder = bpy.data.objects.new(cloud.name, mesh)
    scene.collection.objects.link(holder)
    for name, row in features.items():
        holder.vertex_groups.new(name=FEATURE_PREFIX + name).add([row], 1.0, "REPLACE")
    return holder


def _add_attribute(
    mesh: bpy.types.Mesh, name: str, kind: str, key: str, values: FloatArray
) -> None:
    attribute = mesh.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(key, np.ascontiguousarray(values, np.float32).ravel())


def placement(
    source: FloatArray, target: FloatArray, source_marks: FloatArray, target_marks: FloatArray
) -> FloatArray:
    """(4, 4): moves, scales and rotates the target to match the source and its features.

    Parameters
    ----------
    source, target : (N, 3) and (M, 3) arrays
        Points, evenly spaced over the shapes.
    source_marks, target_marks : (K, 3) arrays
        Matching features. With fewer than three, the target is not rotated.
    """
    turn = np.eye(3)
    if len(source_marks) >= 3:
        # Kabsch: the rotation that brings the features closest together.
        spread = (source_marks - source_marks.mean(axis=0)).T @ (
            target_marks - target_marks.mean(axis=0)
        )
        left, _, right = np.linalg.svd(spread)
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    turned = target @ turn.T
    scale = _size(source) / _size(turned)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * turn
    matrix[:3, 3] = _middle(source) - scale * _middle(turned)
    return matrix


def _size(points: FloatArray) -> float:
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _middle(points: FloatArray) -> FloatArray:
    return (points.min(axis=0) + points.max(axis=0)) / 2.0


def show_as_solid(morph: bpy.types.Object) -> None:
    """Displays the points of a morph object as overlapping discs, like one smooth surface."""
    modifier = morph.modifiers["Points"]
    versions.set_input(modifier, "Discs", True)
    versions.set_input(modifier, "Radius Scale", OVERLAP)


def go_to(scene: bpy.types.Scene, t: float, first: int, last: int) -> None:
    """Goes to the time, possibly between frames, at which travel_rigidly() reaches t."""
    share = 0.5 - np.sin(np.arcsin(1.0 - 2.0 * t) / 3.0)  # the inverse of 3x² - 2x³
    frame = first + (last - first) * float(share)
    scene.frame_set(int(frame), subframe=frame % 1.0)


def travel_rigidly(morph: bpy.types.Object, first: int, last: int) -> None:
    """Bakes the rigid path into shape keys and animates them one after another.

    The key *Morph* is muted and animated as well, because colors and normals follow its value.
    """
    bpy.ops.pointmorph.bake_shape_keys(kind="PAIRS", steps=STEPS, path="RIGID")
    morph_key, *steps = morph.data.shape_keys.key_blocks[1:]
    morph_key.mute = True
    for frame in range(first, last + 1):
        t = (frame - first) / (last - first)
        t = t * t * (3.0 - 2.0 * t)  # ease in and out
        morph_key.value = t
        morph_key.keyframe_insert("value", frame=frame)
        for number, key in enumerate(steps, 1):
            key.value = max(0.0, 1.0 - abs(STEPS * t - number))
            key.keyframe_insert("value", frame=frame)
