"""Pictures of the stages that deform shapes onto each other."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.figure import Figure
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    INK,
    ORANGE,
    PALE,
    PATCHES,
    RED,
    YELLOW,
    along,
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
from stage_pictures.shapes import STANDING, Animals, rotation


@picture
def pose() -> Figure:
    animals = Animals()
    turn = rotation(0, 2.0) @ rotation(1, 0.9) @ rotation(2, 2.2)
    cloud = pointmorph.Cloud(animals.target @ turn)
    morph = pointmorph.morph(pointmorph.Cloud(animals.source), cloud)
    low, length = animals.source[:, 0].min(), np.ptp(animals.source[:, 0])
    source_share, target_share = (
        (places[:, 0] - low) / length for places in (animals.source, morph.target_to_source)
    )
    titles = ("source", "target, as it is given", "turned back, with the stripes as mapped")
    panels = figure(3, 300, titles)
    given = animals.target @ turn @ FRONT
    seen = animals.target @ FRONT
    surface(panels[0], animals.source @ FRONT, animals.source_triangles, source_share, along)
    surface(panels[1], given, animals.target_triangles, rgb(PALE))
    surface(panels[2], seen, animals.target_triangles, target_share, along)
    for axes, shown in zip(panels, (animals.source @ FRONT, given, seen), strict=True):
        fit(axes, shown)
    return page_of(panels)


@picture
def registration() -> Figure:
    animals = Animals(4)
    source, target = animals.clouds()
    morph = pointmorph.morph(source, target, animals.ends(*STANDING))
    titles = ("source", "bent onto the target", "target", "bent onto the source")
    panels = figure(4, 250, titles)
    shapes = (
        (animals.source, animals.source_triangles, BLUE),
        (morph.source_to_target, animals.source_triangles, BLUE),
        (animals.target, animals.target_triangles, ORANGE),
        (morph.target_to_source, animals.target_triangles, ORANGE),
    )
    for axes, (points, triangles, color) in zip(panels, shapes, strict=True):
        surface(axes, points @ FRONT, triangles, rgb(color) * 0.6 + 0.4, edges=0.25)
        fit(axes, points @ FRONT, 0.08)
    return page_of(panels)


@picture
def restarts() -> Figure:
    """Unmarked ends are paired where their distances to the marked ones agree."""
    animals = Animals()
    marked = animals.ends("head", "left fore", "right fore", "left hind", "right hind")
    tail = animals.ends("tail")["tail"]
    panels = figure(2, 360, ("source", "target"))
    shapes = (
        (animals.source, animals.source_triangles, BLUE),
        (animals.target, animals.target_triangles, ORANGE),
    )
    for side, (axes, (points, triangles, color)) in enumerate(zip(panels, shapes, strict=True)):
        ends = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
        graph = coo_matrix((lengths, tuple(ends.T)), shape=(len(points),) * 2).tocsr()
        _, before = dijkstra(graph, directed=False, indices=tail[side], return_predecessors=True)
        seen = points @ FRONT
        surface(axes, seen, triangles, rgb(color) * 0.35 + 0.65)
        for k, rows in enumerate(marked.values()):
            path = [rows[side]]
            while path[-1] != tail[side]:
                path.append(int(before[path[-1]]))
            curve(axes, seen[path], PATCHES[k + 1], 0.7)
            shown = visible(seen[path], seen, triangles)[:, None]
            curve(axes, np.where(shown, seen[path], np.nan), PATCHES[k + 1], 2.2)
            dots(axes, seen[[rows[side]]], PATCHES[k + 1], 8)
        dots(axes, seen[[tail[side]]], "white", 8, edgecolors=RED, linewidths=2)
        fit(axes, seen, 0.08)
    return page_of(panels)


@picture
def proposals() -> Figure:
    animals = Animals()
    found = pointmorph.propose_features(*animals.clouds())[:8]
    panels = figure(2, 360, ("source", "target"))
    shapes = (
        (animals.source, animals.source_triangles),
        (animals.target, animals.target_triangles),
    )
    for side, (axes, (points, triangles)) in enumerate(zip(panels, shapes, strict=True)):
        seen = points @ FRONT
        surface(axes, seen, triangles, rgb(PALE))
        rows = [(proposal.source, proposal.target)[side] for proposal in found]
        for k, shown in enumerate(visible(seen[rows], seen, triangles)):
            if shown:
                dots(axes, seen[[rows[k]]], PATCHES[k], 15)
                ink = INK if PATCHES[k] == YELLOW else "white"
                axes.annotate(
                    str(k + 1), seen[rows[k], :2], color=ink, ha="center", va="center_baseline",
                    fontsize=9, weight="bold", zorder=5,
                )  # fmt: skip
        fit(axes, seen, 0.1)
    return page_of(panels)
