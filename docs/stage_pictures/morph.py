"""Pictures of the stages that put the others together."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    INK,
    ORANGE,
    RED,
    along,
    dots,
    figure,
    fit,
    page_of,
    picture,
    rgb,
    share_of,
    surface,
    visible,
)
from stage_pictures.shapes import STANDING, Animals, Pull, animal, icosphere, rotation


@picture
def morph() -> Figure:
    animals = Animals()
    marks = animals.ends(*STANDING)
    clouds = (
        pointmorph.Cloud(animals.source, faces=animals.source_triangles),
        pointmorph.Cloud(animals.target, faces=animals.target_triangles),
    )
    found = pointmorph.morph(*clouds, marks)
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 460, rows=2)
    top, *rest = panels[:5]
    top.set_position((0.0, 0.36, 1.0, 0.64))
    for axes in rest:
        axes.remove()
    source = animals.source @ FRONT
    target = animals.target @ FRONT + (4.2, 0.0, 0.0)
    surface(top, source, animals.source_triangles, rgb(BLUE) * 0.45 + 0.55)
    surface(top, target, animals.target_triangles, rgb(ORANGE) * 0.45 + 0.55)
    shown = visible(source, source, animals.source_triangles)[found.pairs[:, 0]]
    shown &= visible(target, target, animals.target_triangles)[found.pairs[:, 1]]
    some = found.pairs[shown][:: max(1, shown.sum() // 60)]
    lines = np.stack([source[some[:, 0]], target[some[:, 1]]], axis=1)[:, :, :2]
    colors = along(share_of(animals.source[:, 0])[some[:, 0]])
    top.add_collection(LineCollection(lines, colors=colors, linewidths=0.8, zorder=3))
    for seen, side in ((source, 0), (target, 1)):
        rows = [pair[side] for pair in marks.values()]
        dots(top, seen[rows], RED, 7)
    fit(top, np.concatenate([source, target]), 0.03)
    every = np.concatenate([animals.source, animals.target]) @ FRONT
    for k, (axes, t) in enumerate(zip(panels[5:], times, strict=True)):
        axes.set_position((0.2 * k, 0.0, 0.2, 0.3))
        color = ((1 - t) * rgb(BLUE) + t * rgb(ORANGE)) * 0.45 + 0.55
        surface(axes, np.asarray(found.wrapped(t)) @ FRONT, animals.source_triangles, color)
        fit(axes, every, 0.04)
        axes.set_title(f"t = {t:g}", color=INK, fontsize=10, pad=2)
    return page_of(panels)


EARED: dict[str, Pull] = {
    "left ear": ((0.0, 0.75, 0.8), (0.0, 0.25, 0.7), 0.03),
    "right ear": ((0.0, -0.75, 0.8), (0.0, -0.25, 0.7), 0.03),
    "nose": ((1.0, 0.0, -0.15), (0.55, 0.0, -0.1), 0.04),
}


@picture
def denser_mesh() -> Figure:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    )
    directions, triangles = icosphere(5)
    target = animal(directions, EARED, (1.0, 0.95, 0.9))
    found = pointmorph.morph(
        pointmorph.Cloud(corners, faces=faces), pointmorph.Cloud(target, faces=triangles)
    )
    denser = found.denser(tolerance=0.01)
    pieces = np.asarray(denser.faces)
    look = rotation(2, -1.0) @ rotation(0, -1.2)
    titles = (
        "a mesh of 6 faces",
        "what it is to become",
        "its faces alone, wrapped",
        f"with {len(pieces)} faces",
        "wrapped",
    )
    panels = figure(5, 230, titles)
    halves = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    blue = rgb(BLUE) * 0.45 + 0.55
    surface(panels[0], corners @ look, halves, blue, edges=0.6)
    surface(panels[1], target @ look, triangles, rgb(ORANGE) * 0.8 + 0.2)
    surface(panels[2], np.asarray(found.wrapped(1.0)) @ look, halves, blue, edges=0.6, back=True)
    surface(panels[3], np.asarray(denser.positions) @ look, pieces, blue, edges=0.3)
    surface(panels[4], np.asarray(denser.wrapped) @ look, pieces, blue, edges=0.3)
    for axes, points in zip(panels, (corners, target, target, corners, target), strict=True):
        fit(axes, points @ look, 0.1)
    return page_of(panels)
