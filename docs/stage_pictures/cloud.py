"""Pictures of the stages on points."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from pointmorph import _pointmorph
from pointmorph.meshes import Shape

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    INK,
    ORANGE,
    PALE,
    PATCHES,
    PURPLE,
    RED,
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
from stage_pictures.inner import stages
from stage_pictures.shapes import (
    STANDING,
    Animals,
    animal,
    end_of,
    icosphere,
    rotation,
    unit,
)


@picture
def covariance() -> Figure:
    directions, triangles = icosphere(4)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    normals, variation = stages().covariance(points)
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
    cluster, centroids = stages().lod(points, 60)
    label = np.asarray(cluster) % len(PATCHES)
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


@picture
def cloud() -> Figure:
    directions, triangles = icosphere(5)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    seen = points @ FRONT
    shown = visible(seen, seen, triangles)
    rows = np.random.default_rng(2).permutation(len(points))
    given = 40 * points[rows] + (1200.0, -700.0, 90.0)
    order = stages().spatial_order(given)
    ready = stages().normalized(given[order])
    titles = (
        "given: any place, any size, any order (the color is the row)",
        "ready: in the unit ball, and near in space is near in memory",
    )
    left, right = panels = figure(2, 400, titles)
    colors = along(np.arange(len(points)) / len(points), 24)
    at = np.argsort(given[shown[rows]] @ FRONT[:, 2])
    dots(left, (given[shown[rows]] @ FRONT)[at], colors[shown[rows]][at], 3.0, linewidths=0)
    drawn = shown[rows][order]
    at = np.argsort(ready[drawn] @ FRONT[:, 2])
    dots(right, (ready[drawn] @ FRONT)[at], colors[drawn][at], 3.0, linewidths=0)
    fit(left, given @ FRONT, 0.12)
    right.add_patch(Circle((0, 0), 1, fill=False, color=INK, lw=1.2))
    dots(right, np.zeros((1, 2)), INK, 5, zorder=5)
    fit(right, np.array([[-1.0, -1.0], [1.0, 1.0]]), 0.02)
    return page_of(panels)


@picture
def neighborhoods() -> Figure:
    random = np.random.default_rng(8)
    dense = np.column_stack([random.uniform(-1, 1, (9000, 2)), np.zeros(9000)])
    dense = dense[random.uniform(0, 1, 9000) < 0.04 + 0.96 * ((dense[:, 0] + 1) / 2) ** 3]
    points = pointmorph.meshes.sample(Shape("candidates", dense), 900)[0].positions
    near, radius = _pointmorph.nearest_neighbors(points, 16), 0.16
    within = stages().radius_neighbors(points, radius)
    places = np.array([[-0.6, 0.35, 0.0], [0.1, -0.35, 0.0], [0.72, 0.3, 0.0]])
    middles = [int(np.argmin(np.linalg.norm(points - place, axis=1))) for place in places]
    counts = [len(within[k]) for k in middles]
    titles = ("the 16 nearest", "all within a radius: {}, {} and {}".format(*counts))
    panels = figure(2, 400, titles)
    for axes, lists in zip(panels, (near, within), strict=True):
        dots(axes, points, PALE, 4.2, linewidths=0)
        for k, color in zip(middles, (BLUE, ORANGE, PURPLE), strict=True):
            around = points[np.asarray(lists[k], int)]
            lines = np.stack([np.broadcast_to(points[k], around.shape), around], axis=1)
            axes.add_collection(LineCollection(lines[:, :, :2], colors=color, linewidths=0.9))
            dots(axes, around, color, 4.8, linewidths=0)
            dots(axes, points[[k]], RED, 7)
            reach = np.linalg.norm(around - points[k], axis=1).max() if lists is near else radius
            circle = Circle(points[k, :2], reach, fill=False, color=color, lw=1.2)
            axes.add_patch(circle)
        fit(axes, dense, 0.03)
    return page_of(panels)


@picture
def similarity() -> Figure:
    animals = Animals()
    turn = rotation(1, 0.5) @ rotation(2, 0.9)
    target = 0.62 * animals.target @ turn + (0.9, 1.9, 1.1)
    marks = animals.ends(*STANDING)
    source_rows, target_rows = np.array(list(marks.values())).T
    moved = stages().moved(target[target_rows], animals.source[source_rows], target)
    titles = ("source and target, as they are given", "the target, moved to the source")
    panels = figure(2, 360, titles)
    for axes, other in zip(panels, (target, moved), strict=True):
        both = np.concatenate([animals.source, other]) @ FRONT
        count = len(animals.source)
        triangles = np.concatenate([animals.source_triangles, animals.target_triangles + count])
        colors = np.where(
            np.arange(len(triangles))[:, None] < len(animals.source_triangles),
            rgb(BLUE),
            rgb(ORANGE),
        )
        surface(axes, both, triangles, 0.5 * colors + 0.5)
        ends = np.stack([both[source_rows], both[count + target_rows]], axis=1)
        axes.add_collection(LineCollection(ends[:, :, :2], colors=INK, linewidths=1.2, zorder=3))
        dots(axes, ends[:, 0], BLUE, 8)
        dots(axes, ends[:, 1], ORANGE, 8)
        fit(axes, both, 0.08)
    return page_of(panels)


@picture
def subset() -> Figure:
    directions, triangles = icosphere(6)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    random = np.random.default_rng(4)
    taken = random.uniform(0, 1, len(points)) < 0.06 + 0.6 * (directions[:, 0] > 0.1)
    rows = np.flatnonzero(taken)
    ends = np.array(
        [
            np.argmin(np.linalg.norm(points[rows] - points[end_of(limb, directions)], axis=1))
            for limb in STANDING
        ]
    )
    normals = unit(directions)
    chosen = np.asarray(stages().subset(points[rows], normals[rows], ends, 700))
    titles = (f"{len(rows)} points, uneven", f"{len(chosen)} of them, even, marked ones first")
    panels = figure(2, 360, titles)
    seen = points @ FRONT
    cloud_seen = seen[rows]
    shown = visible(cloud_seen, seen, triangles)
    for axes, some, size in zip(panels, (np.arange(len(rows)), chosen), (1.4, 4.0), strict=True):
        surface(axes, seen, triangles, rgb("#eef0f2"))
        dots(axes, cloud_seen[some[shown[some]]], BLUE, size, linewidths=0)
        dots(axes, cloud_seen[ends[shown[ends]]], RED, 6)
        fit(axes, seen)
    return page_of(panels)
