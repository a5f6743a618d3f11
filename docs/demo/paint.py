"""Colors for models without any: one tone each, darker in hollows and lighter on ridges."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pointmorph
from mathutils.kdtree import KDTree
from pointmorph.meshes import Shape, face_edges, vertex_normals

FloatArray = npt.NDArray[np.float64]

# Linear red, green and blue of hollows, of the plain surface and of ridges.
TERRACOTTA = np.array([[0.05, 0.006, 0.004], [0.42, 0.055, 0.02], [0.74, 0.33, 0.17]])
SAND = np.array([[0.09, 0.03, 0.006], [0.58, 0.28, 0.06], [0.92, 0.72, 0.36]])

TINT = np.array([[0.15, 0.2, 0.45], [0.1, 0.5, 0.4], [0.05, 0.2, 0.5]])
"""What becomes of red, green and blue on the second patch."""
INK = 0.004
CURVE_WIDTH = 0.006
"""Half the width, as a share of the bounding box's diagonal."""

SMOOTHING = 0.012
"""Radius over which the curvature is averaged, as a share of the bounding box's diagonal."""


def painted(shape: Shape, tones: FloatArray) -> Shape:
    """The shape with colors: its own if it has any.

    Parameters
    ----------
    tones : (3, 3) array
        Linear red, green and blue of hollows, of the plain surface and of ridges.
    """
    if shape.colors is not None:
        return shape
    relief = np.zeros(len(shape.positions)) if shape.faces is None else _relief(shape)
    amount = np.abs(relief)[:, None]
    far = np.where(relief[:, None] < 0, tones[0], tones[2])
    colors = np.ones((len(relief), 4), np.float32)
    colors[:, :3] = tones[1] + amount * (far - tones[1])
    return dataclasses.replace(shape, colors=colors)


def show_patches(cloud: pointmorph.Cloud, loop: Mapping[str, int]) -> pointmorph.Cloud:
    """The cloud with the right patch of a cut tinted and the curve drawn."""
    cut = pointmorph.decompose(cloud, loop)
    colors = cloud.colors.copy()
    right = cut.sides < 0
    colors[right, :3] = colors[right, :3] @ TINT
    curve = KDTree(len(cut.curve))
    for row, place in enumerate(cut.curve):
        curve.insert(place, row)
    curve.balance()
    width = CURVE_WIDTH * np.linalg.norm(np.ptp(cloud.positions, axis=0))
    near = [curve.find(place)[2] < width for place in cloud.positions]
    colors[near, :3] = INK
    return pointmorph.Cloud(cloud.positions, cloud.normals, colors, cloud.radii, name=cloud.name)


def _relief(shape: Shape) -> FloatArray:
    """(N,) from -1 in hollows to 1 on ridges: the mean curvature, smoothed and compressed."""
    positions = shape.positions.astype(np.float64)
    curvature, area = _mean_curvature(positions, shape.faces)
    diagonal = np.linalg.norm(np.ptp(positions, axis=0))
    curvature = _diffused(curvature, area, positions, shape.faces, SMOOTHING * diagonal)
    # Shapes are mostly convex, so the median counts as plain.
    curvature -= _quantile(curvature, area, 0.5)
    return np.tanh(1.2 * curvature / max(_quantile(np.abs(curvature), area, 0.9), 1e-300))


def _quantile(values: FloatArray, area: FloatArray, share: float) -> float:
    """By area, so that a finely meshed ear doesn't count as much as a whole head."""
    order = np.argsort(values)
    return float(values[order[np.searchsorted(np.cumsum(area[order]), share * area.sum())]])


def _mean_curvature(
    positions: FloatArray, triangles: npt.NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """(N,) divergence of the normals, positive on ridges, and (N,) area around each vertex."""
    normals = vertex_normals(positions, triangles)
    corners = positions[triangles]
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(face_normals, axis=1)
    face_normals /= np.maximum(doubled, 1e-300)[:, None]
    integral = np.zeros(len(positions))
    area = np.zeros(len(positions))
    divergence = np.zeros(len(triangles))
    for k in range(3):
        opposite = corners[:, (k + 2) % 3] - corners[:, (k + 1) % 3]
        # the gradient of corner k's hat function, times twice the area
        divergence += np.einsum(
            "ij,ij->i", np.cross(face_normals, opposite), normals[triangles[:, k]]
        )
    for k in range(3):
        integral += np.bincount(triangles[:, k], divergence / 6.0, len(positions))
        area += np.bincount(triangles[:, k], doubled / 6.0, len(positions))
    return integral / np.maximum(area, 1e-300), area


def _diffused(
    values: FloatArray,
    area: FloatArray,
    positions: FloatArray,
    triangles: npt.NDArray[np.int64],
    radius: float,
) -> FloatArray:
    """Averages over about `radius` along the surface, whatever the lengths of edges."""
    edges = np.unique(np.sort(face_edges(triangles), axis=1), axis=0)
    a, b = edges.T
    lengths = np.linalg.norm(positions[a] - positions[b], axis=1)
    # Each step mixes neighbors closer than `step`; n steps reach √n times as far.
    steps = 16
    step = radius / np.sqrt(steps)
    near = 1.0 / (1.0 + (lengths / step) ** 2)
    total = (
        area
        + np.bincount(a, near * area[b], len(values))
        + np.bincount(b, near * area[a], len(values))
    )
    for _ in range(steps):
        mixed = area * values
        mixed += np.bincount(a, near * area[b] * values[b], len(values))
        mixed += np.bincount(b, near * area[a] * values[a], len(values))
        values = mixed / np.maximum(total, 1e-300)
    return values
