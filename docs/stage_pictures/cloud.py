"""Pictures of the stages on points."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from pointmorph.meshes import Shape
from scipy.spatial import cKDTree

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    PALE,
    PATCHES,
    along,
    dots,
    figure,
    fit,
    page_of,
    picture,
    rgb,
    surface,
    visible,
)
from stage_pictures.shapes import STANDING, Rows, animal, icosphere


@picture
def covariance() -> Figure:
    directions, triangles = icosphere(4)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    normals = pointmorph.morph(pointmorph.Cloud(points), pointmorph.Cloud(points)).frame(0).normals
    _, near = cKDTree(points).query(points, 17)
    offsets = points[near[:, 1:]] - points[near[:, 1:]].mean(axis=1, keepdims=True)
    eigenvalues = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", offsets, offsets))
    variation = eigenvalues[:, 0] / eigenvalues.sum(axis=1)
    left, right = panels = figure(
        2, 360, ("normals", "surface variation, from 0 (blue) to 0.15 (red)")
    )
    seen, seen_normals = points @ FRONT, normals @ FRONT
    surface(left, seen, triangles, rgb("#e3e7eb"))
    shown = np.flatnonzero(seen_normals[:, 2] > 0.05)[::2]
    needles = np.stack([seen, seen + 0.13 * seen_normals], axis=1)[shown][:, :, :2]
    left.add_collection(LineCollection(needles, colors=BLUE, linewidths=0.8))
    surface(right, seen, triangles, variation / 0.15, along)
    for axes in panels:
        fit(axes, seen, 0.1)
    return page_of(panels)


@picture
def lod() -> Figure:
    directions, triangles = icosphere(5)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))

    def clusters(rows: Rows) -> list[Rows]:
        if len(rows) <= 60:
            return [rows]
        offsets = points[rows] - points[rows].mean(axis=0)
        longest = np.linalg.eigh(offsets.T @ offsets)[1][:, 2]
        before = offsets @ longest < 0
        return clusters(rows[before]) + clusters(rows[~before])

    found = clusters(np.arange(len(points)))
    label = np.empty(len(points))
    for k, rows in enumerate(found):
        label[rows] = k % len(PATCHES)
    centroids = np.array([points[rows].mean(axis=0) for rows in found])
    panels = figure(2, 360, ("clusters of up to 60 points", "their centroids"))
    seen = points @ FRONT
    for k, color in enumerate(PATCHES):
        of_first = triangles[label[triangles[:, 0]] == k]
        surface(panels[0], seen, of_first, rgb(color))
    seen_centroids = centroids @ FRONT
    surface(panels[1], seen, triangles, rgb("#eef0f2"))
    shown = np.flatnonzero(visible(seen_centroids, seen, triangles))
    dots(panels[1], seen_centroids[shown], rgb(PATCHES[k % len(PATCHES)] for k in shown), 6)
    for axes in panels:
        fit(axes, seen)
    return page_of(panels)


@picture
def sampling() -> Figure:
    random = np.random.default_rng(1)
    candidates = np.column_stack([random.uniform(-1, 1, (2400, 2)), np.zeros(2400)])
    cloud, _ = pointmorph.meshes.sample(Shape("candidates", candidates), 600)
    panels = figure(2, 400, ("2400 random candidates", "600 of them"))
    for axes, points, color in zip(
        panels, (candidates, cloud.positions), (PALE, BLUE), strict=True
    ):
        dots(axes, points, color, 4.5, linewidths=0)
        fit(axes, candidates, 0.03)
    return page_of(panels)
