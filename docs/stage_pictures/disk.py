"""Pictures of the stages on the unit disk."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.interpolate import LinearNDInterpolator

from stage_pictures.drawing import (
    ABOVE,
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PATCHES,
    PURPLE,
    RED,
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
from stage_pictures.inner import stages
from stage_pictures.shapes import STANDING, Array, animal, end_of, icosphere, rings, rotation, torus


@picture
def parameterization() -> Figure:
    disk, triangles = rings(34)
    x, y = disk.T

    def face(nose: float) -> Array:
        height = 0.9 * np.sqrt(np.maximum(1.02 - x**2 - y**2, 0))
        height += nose * np.exp(-((x / 0.16) ** 2 + ((y + 0.05) / 0.24) ** 2))
        height -= 0.16 * np.exp(-(((np.abs(x) - 0.38) / 0.16) ** 2 + ((y - 0.25) / 0.12) ** 2))
        return np.stack([0.85 * x, 1.1 * y, height], axis=1)

    points = face(0.55)
    rim = np.arange(len(points) - 6 * 34, len(points))
    clouds = [pointmorph.Cloud(p, boundary=rim) for p in (points, face(0.3))]
    paper = {"method": "paper", "domain": "disk", "solve": "full"}
    morph = pointmorph.morph(*clouds, {"nose": (0, 0)}, **paper)
    images = np.asarray(morph.source_domain)

    def checks(place: Array) -> Array:
        colors = along(np.hypot(*place.T), 5)
        odd = np.floor(place * 7).sum(axis=1) % 2
        return colors + 0.6 * odd[:, None] * (1 - colors)

    panels = figure(2, 380, ("an open patch", "in the unit disk"))
    seen = points @ rotation(1, -0.5) @ rotation(0, -0.15)
    surface(panels[0], seen, triangles, images, checks)
    flat = np.column_stack([images, np.zeros(len(images))])
    surface(panels[1], flat, triangles, images, checks)
    circle = Circle((0, 0), 1, fill=False, color=INK, lw=1.5)
    panels[1].add_patch(circle)
    for axes, shown in zip(panels, (seen, flat), strict=True):
        fit(axes, shown)
    return page_of(panels)


@picture
def alignment() -> Figure:
    """The same two disks, before and after."""
    disk, _ = rings(22)
    x, y = disk.T
    hill = np.stack([x, y, 0.8 * np.exp(-3 * (x**2 + y**2))], axis=1)
    ridge = np.stack([x, y, 0.5 * np.exp(-4 * (x - 0.3) ** 2)], axis=1)
    rim = np.arange(len(disk) - 6 * 22, len(disk))
    clouds = [pointmorph.Cloud(p, boundary=rim) for p in (hill, ridge)]

    def at(a: float, b: float) -> int:
        return int(np.argmin(np.hypot(x - a, y - b)))

    pairs = (((-0.4, 0.3), (-0.15, 0.45)), ((0.4, 0.25), (0.55, 0.05)), ((0.0, -0.4), (0.1, -0.25)))
    features = {str(k): (at(*s), at(*t)) for k, (s, t) in enumerate(pairs)}
    paper = {"method": "paper", "domain": "disk", "solve": "full"}
    before = pointmorph.morph(*clouds, **paper)
    after = pointmorph.morph(*clouds, features, influence=5.0, **paper)
    panels = figure(2, 400, ("before", "after"))
    steps = np.linspace(-0.99, 0.99, 120)
    for axes, morph in zip(panels, (before, after), strict=True):
        for domain, color in ((morph.source_domain, BLUE), (morph.target_domain, ORANGE)):
            onto = LinearNDInterpolator(disk, domain)
            for at_line in np.linspace(-0.9, 0.9, 13):
                line = np.column_stack([np.full(120, at_line), steps])
                for places in (line, line[:, ::-1]):
                    curve(axes, onto(places), color, 0.9)
        axes.add_patch(Circle((0, 0), 1, fill=False, color=INK, lw=1.5))
        for s, t in features.values():
            ends = np.array([morph.source_domain[s], morph.target_domain[t]])
            curve(axes, ends, INK, 1.6)
            dots(axes, ends[:1], BLUE, 9)
            dots(axes, ends[1:], ORANGE, 6)
        fit(axes, disk, 0.02)
    return page_of(panels)


def two_sides(side: Array) -> Array:
    return np.where(side > 0, rgb(BLUE), rgb(ORANGE)) * 0.75 + 0.25


@picture
def decomposition() -> Figure:
    directions, triangles = icosphere(5)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    marks = ("head", "left fore", "left hind", "tail", "right hind", "right fore")
    loop = {limb: end_of(limb, directions) for limb in marks}
    cut = pointmorph.decompose(pointmorph.Cloud(points), loop)
    panels = figure(2, 360, ("from above", "from below"))
    for axes, tilt in zip(panels, (-0.75, -2.4), strict=True):
        look = rotation(2, -0.6) @ rotation(0, tilt)
        seen = points @ look
        surface(axes, seen, triangles, cut.sides.astype(float), two_sides)
        line = cut.curve @ look
        shown = visible(line, seen, triangles)
        around = np.arange(len(line) + 1) % len(line)
        curve(axes, np.where(shown[:, None], line, np.nan)[around], INK, 2.0)
        dots(axes, line[[row for row in cut.corners.values() if shown[row]]], RED, 7)
        fit(axes, seen)
    return page_of(panels)


@picture
def network() -> Figure:
    around, across = 180, 72
    source, triangles = torus(around, across)
    target, _ = torus(around, across, 0.3, 0.35)
    features = {
        f"{i}.{j}": (45 * i * across + 36 * j + 6 * i,) * 2 for i in range(4) for j in range(2)
    }
    clouds = pointmorph.Cloud(source), pointmorph.Cloud(target)
    found = pointmorph.trace_network(*clouds, features)
    panels = figure(2, 330, ("source", "target: the same patches"))
    for side, (axes, points) in enumerate(zip(panels, (source, target), strict=True)):
        labels = (found.source, found.target)[side]
        seen = points @ ABOVE
        for patch in range(len(found.patches)):
            of_patch = triangles[np.median(labels[triangles], axis=1) == patch]
            surface(axes, seen, of_patch, rgb(PATCHES[patch % len(PATCHES)]) * 0.7 + 0.3)
        for line in found.curves:
            places = (line.source, line.target)[side] @ ABOVE
            shown = visible(places, seen, triangles)[:, None]
            curve(axes, np.where(shown, places, np.nan), INK, 2.0)
        rows = np.array([pair[side] for pair in features.values()])
        dots(axes, seen[rows[visible(seen[rows], seen, triangles)]], RED, 6.5)
        fit(axes, seen)
    return page_of(panels)


@picture
def homology() -> Figure:
    """A ring's edges with their bits, and three loops with the sums of theirs."""
    around, across = 90, 36
    points, triangles = torus(around, across)
    round_tube = 2 * np.pi * np.arange(across) / across
    outward = np.stack([points[:, 0], points[:, 1], 0 * points[:, 2]], axis=1) / np.linalg.norm(
        points[:, :2], axis=1, keepdims=True
    )
    normals = outward * np.tile(np.cos(round_tube), around)[:, None]
    normals[:, 2] = np.tile(np.sin(round_tube), around)
    graph = stages().surface_graph(points, normals, 8)
    starts = np.repeat(np.arange(len(points)), np.diff(graph.offsets))
    ends = np.asarray(graph.neighbors)
    bits, rank = stages().loop_classes(graph)
    bits = np.asarray(bits)
    assert rank == 2
    seen = points @ rotation(0, -0.95)
    panels = figure(2, 380, ("edges with their bits; all others have 00", "sums along three loops"))
    for axes in panels:
        surface(axes, seen, triangles, rgb("#e6e9ed"))
        fit(axes, seen, 0.04)
    shown = visible(seen, seen, triangles)
    kept = (starts < ends) & shown[starts] & shown[ends]
    for value, color in ((1, BLUE), (2, ORANGE), (3, PURPLE)):
        some = kept & (bits == value)
        lines = np.stack([seen[starts[some]], seen[ends[some]]], axis=1)[:, :, :2]
        panels[0].add_collection(LineCollection(lines, colors=color, linewidths=2.0))
        if some.any():
            middles = lines.mean(axis=1)
            named(
                panels[0],
                f"{value:02b}",
                middles[np.argsort(middles[:, 0])[len(middles) // 2]],
                color,
            )
    bits_of = {(a, b): value for a, b, value in zip(starts, ends, bits, strict=True)}
    for loop, color in zip(ring_loops(around, across), (RED, BLUE, GREEN), strict=True):
        total = 0
        for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
            total ^= bits_of[a, b]
        line = seen[[*loop, loop[0]]]
        drawn = np.where(visible(line, seen, triangles)[:, None], line, np.nan)
        curve(panels[1], line, color, 0.7)
        curve(panels[1], drawn, color, 2.4)
        named(panels[1], f"{total:02b}", drawn[np.nanargmin(drawn[:, 1])], color)
    return page_of(panels)


def named(axes: Axes, text: str, at: Array, color: str) -> None:
    axes.annotate(
        text, at[:2], (0, -6), textcoords="offset points", color=color, ha="center", va="top",
        fontsize=13, weight="bold", zorder=6,
    )  # fmt: skip


def ring_loops(around: int, across: int) -> tuple[list[int], ...]:
    """Rows of a torus along three loops: around the tube, around the hole, and around neither."""
    low, high, left, right = 3, 9, 62, 74
    sides = [(i, low) for i in range(left, right)] + [(right, j) for j in range(low, high)]
    sides += [(i, high) for i in range(right, left, -1)]
    sides += [(left, j) for j in range(high, low, -1)]
    return (
        [12 * across + j for j in range(across)],
        [i * across + 12 for i in range(around)],
        [i * across + j for i, j in sides],
    )
