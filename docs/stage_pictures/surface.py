"""Pictures of the stages on points as a surface."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.path import Path as Outline
from matplotlib.tri import Triangulation
from pointmorph.meshes import Shape
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from stage_pictures.drawing import (
    ABOVE,
    BLUE,
    FRONT,
    GREEN,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    RED,
    curve,
    dots,
    figure,
    fit,
    page_of,
    picture,
    rgb,
    surface,
    visible,
)
from stage_pictures.shapes import STANDING, Animals, Array, icosphere, rings, rotation, torus, unit


@picture
def boundary() -> Figure:
    random = np.random.default_rng(4)
    square = np.column_stack([random.uniform(-1.2, 1.2, (9000, 2)), np.zeros(9000)])
    even = pointmorph.meshes.sample(Shape("square", square), 1500)[0].positions
    angle = np.arctan2(even[:, 1], even[:, 0])
    points = even[np.hypot(even[:, 0], even[:, 1]) < 0.82 + 0.25 * np.cos(3 * angle - 0.6)]
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    cloud = pointmorph.Cloud(points, up)
    loop = np.asarray(pointmorph.morph(cloud, cloud, method="paper", domain="disk").source_boundary)
    flat = points[:, :2]
    triangles = Triangulation(*flat.T).triangles
    inside = Outline(flat[loop]).contains_points(flat[triangles].mean(axis=1))
    panels = figure(2, 400, ("Delaunay triangles, outside orange", "the boundary that is left"))
    for shown, color in ((inside, "#dbe7f3"), (~inside, "#f6c893")):
        panels[0].add_collection(
            PolyCollection(flat[triangles[shown]], facecolors=color, edgecolors="white", lw=0.6)
        )
    around = points[np.append(loop, loop[0])]
    curve(panels[1], around, RED, 2.0)
    for k in range(0, len(loop), 9):
        panels[1].annotate(
            "",
            around[k + 1, :2],
            around[k, :2],
            arrowprops={"arrowstyle": "-|>", "color": RED, "shrinkA": 0, "shrinkB": 0},
        )
    for axes in panels:
        dots(axes, points, INK, 2.2, linewidths=0)
        fit(axes, points, 0.03)
    return page_of(panels)


@picture
def features() -> Figure:
    animals = Animals()
    sides = (
        (animals.source_directions, animals.source, animals.source_triangles),
        (animals.target_directions, animals.target, animals.target_triangles),
    )
    belts, heads = [], []
    for directions, _, _ in sides:
        steps = np.floor(np.arctan2(directions[:, 1], directions[:, 2]) / (np.pi / 16))
        off = np.abs(directions[:, 0] + 0.05)
        belts.append(
            np.array([int(np.argmin(off + 9 * (steps != step))) for step in np.unique(steps)[:32]])
        )
        heads.append(np.flatnonzero(directions @ unit(np.array(STANDING["head"][0])) > 0.94))
    marks = {
        "tail": animals.ends("tail")["tail"],
        "belt": pointmorph.Feature(*belts, "curve", closed=True),
        "head": pointmorph.Feature(*heads, "region"),
    }
    image = pointmorph.morph(*animals.clouds(), marks).source_to_target[belts[0]]
    panels = figure(2, 360, ("source", "target, and where the source's belt goes"))
    for side, (axes, (_, points, triangles)) in enumerate(zip(panels, sides, strict=True)):
        seen = points @ FRONT
        in_head = np.zeros(len(points))
        in_head[heads[side]] = 1

        def paint(share: Array) -> Array:
            return np.where(share > 0.5, rgb(PURPLE) * 0.6 + 0.4, rgb(PALE))

        surface(axes, seen, triangles, in_head, paint)
        belt = seen[belts[side]]
        dots(axes, belt[visible(belt, seen, triangles)], GREEN, 6, zorder=2)
        if side == 1:
            line = image[np.append(np.arange(len(image)), 0)] @ FRONT
            curve(axes, np.where(visible(line, seen, triangles)[:, None], line, np.nan), BLUE, 2.0)
        dots(axes, seen[[marks["tail"][side]]], RED, 9)
        fit(axes, seen, 0.08)
    return page_of(panels)


@picture
def geodesics() -> Figure:
    """The first curve of a network, and the shortest path between its ends in a graph."""
    random = np.random.default_rng(5)
    u, v, w = random.uniform(0, 1, (3, 9000))
    tube = 0.4
    kept = w * (1 + tube) < 1 + tube * np.cos(2 * np.pi * v)
    a, b = 2 * np.pi * u[kept], 2 * np.pi * v[kept]
    r = 1 + tube * np.cos(b)
    points = np.column_stack([r * np.cos(a), r * np.sin(a), tube * np.sin(b)])

    def at(around: float, across: float) -> int:
        apart = np.abs(np.exp(1j * a) - np.exp(1j * around))
        return int(np.argmin(apart + np.abs(np.exp(1j * b) - np.exp(1j * across))))

    rows = {
        "start": at(3.6, 1.4),
        "end": at(5.4, 0.4),
        "far": at(1.5, 1.0),
        "farther": at(0.5, 2.5),
    }
    cloud = pointmorph.Cloud(points)
    found = pointmorph.trace_network(cloud, cloud, {name: (k, k) for name, k in rows.items()})
    straight = next(c for c in found.curves if {c.start, c.end} == {"start", "end"})
    distances, near = cKDTree(points).query(points, 17)
    ends = np.stack([np.repeat(near[:, 0], 16), near[:, 1:].ravel()])
    graph = coo_matrix((distances[:, 1:].ravel(), ends), shape=(len(points),) * 2).tocsr()
    _, before = dijkstra(graph, directed=False, indices=rows["start"], return_predecessors=True)
    way = [rows["end"]]
    while way[-1] != rows["start"]:
        way.append(int(before[way[-1]]))
    [axes] = panels = figure(1, 400)
    ring, triangles = torus(180, 72)
    surface(axes, ring @ ABOVE, triangles, rgb("#e6e9ed"))
    seen = points @ ABOVE
    dots(axes, seen[visible(seen, ring @ ABOVE, triangles)], "#9aa6b2", 1.8, linewidths=0)
    curve(axes, seen[way], ORANGE, 2.2)
    curve(axes, straight.source @ ABOVE, BLUE, 2.8)
    dots(axes, seen[[rows["start"], rows["end"]]], RED, 8)
    axes.set_xlim(-1.5, 1.5)
    axes.set_ylim(-1.2, 0.13)
    return page_of(panels)


@picture
def topology() -> Figure:
    sphere, sphere_triangles = icosphere(4)
    ring, ring_triangles = torus(96, 36)
    disk, disk_triangles = rings(24)
    x, y = disk.T
    bowl = np.stack([x, y, 0.7 * (x**2 + y**2)], axis=1)
    shapes = ((sphere, sphere_triangles), (ring, ring_triangles), (bowl, disk_triangles))
    words = []
    for points, _ in shapes:
        cloud = pointmorph.Cloud(points)
        report = pointmorph.morph(cloud, cloud).report
        words.append(report["topology"]["source"]["words"])
    panels = figure(3, 260, words)
    for axes, (points, triangles), color in zip(panels, shapes, (BLUE, ORANGE, GREEN), strict=True):
        seen = points @ rotation(0, -0.9)
        surface(axes, seen, triangles, rgb(color), back=True)
        fit(axes, seen, 0.12)
    curve(
        panels[2], (np.append(bowl[-144:], bowl[-144:-143], axis=0)) @ rotation(0, -0.9), RED, 2.5
    )
    return page_of(panels)


@picture
def pairing() -> Figure:
    disk, _ = rings(14)
    other, _ = rings(12)
    hill = np.column_stack([disk, 0.2 * np.exp(-3 * (disk**2).sum(axis=1))])
    plane = np.column_stack([other @ rotation(2, 0.1)[:2, :2], np.zeros(len(other))])
    clouds = [
        pointmorph.Cloud(p, boundary=np.arange(len(p) - 6 * n, len(p)))
        for p, n in ((hill, 14), (plane, 12))
    ]
    morph = pointmorph.morph(*clouds, method="paper", domain="disk")
    source, target = np.asarray(morph.source_domain), np.asarray(morph.target_domain)
    whole, close = panels = figure(2, 400, ("both clouds in the disk", "the middle of it"))
    lines = np.stack([source[morph.pairs[:, 0]], target[morph.pairs[:, 1]]], axis=1)
    for axes, size in ((whole, 3.2), (close, 8.0)):
        axes.add_collection(LineCollection(lines, colors=INK, linewidths=size / 4))
        dots(axes, source, BLUE, size)
        dots(axes, target, ORANGE, size)
    box = 0.36
    whole.add_patch(
        Rectangle((-box, -box), 2 * box, 2 * box, fill=False, color=RED, lw=1.5, zorder=5)
    )
    fit(whole, source, 0.02)
    close.add_patch(Rectangle((-box, -box), 2 * box, 2 * box, fill=False, color=RED, lw=2.5))
    close.set_xlim(-box, box)
    close.set_ylim(-box, box)
    return page_of(panels)
