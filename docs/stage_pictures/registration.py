"""Pictures of the stages that deform shapes onto each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    INK,
    ORANGE,
    PALE,
    PATCHES,
    RED,
    TEAL,
    YELLOW,
    along,
    curve,
    dots,
    figure,
    fit,
    numbered,
    page_of,
    picture,
    rgb,
    share_of,
    surface,
    visible,
)
from stage_pictures.inner import stages
from stage_pictures.shapes import (
    STANDING,
    WALKING,
    Animals,
    Array,
    Rows,
    animal,
    end_of,
    icosphere,
    rotation,
    unit,
)


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
        normals = pointmorph.meshes.vertex_normals(points, triangles)
        graph = stages().surface_graph(points, normals, 16)
        seen = points @ FRONT
        surface(axes, seen, triangles, rgb(color) * 0.35 + 0.65)
        for k, rows in enumerate(marked.values()):
            path = stages().shortest_path(graph, rows[side], tail[side])
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


def of_unit_area(points: Array) -> Array:
    return points / np.sqrt(stages().estimated_area(points))


def edges_of(graph: Any) -> Rows:
    """The edges of a graph, in one direction."""
    starts = np.repeat(np.arange(len(graph.offsets) - 1), np.diff(graph.offsets))
    edges = np.column_stack([starts, graph.neighbors])
    return edges[edges[:, 0] < edges[:, 1]]


def lines_between(axes: Axes, seen: Array, edges: Rows, color: str, width: float) -> None:
    lines = seen[edges][:, :, :2]
    axes.add_collection(LineCollection(lines, colors=color, linewidths=width, zorder=2))


@picture
def anchored_start() -> Figure:
    animals = Animals()
    ends = animals.ends(*STANDING)
    source, target = of_unit_area(animals.source), of_unit_area(animals.target)
    shapes = [
        stages().CoarseShape(
            points, pointmorph.meshes.vertex_normals(points, triangles),
            [rows[side] for rows in ends.values()], 3000, [250, 1000],
        )
        for side, (points, triangles) in enumerate(
            ((source, animals.source_triangles), (target, animals.target_triangles))
        )
    ]  # fmt: skip
    start, _ = stages().anchored_start(*shapes, [(k, k) for k in range(len(ends))])
    coarse = np.asarray(shapes[0].positions)
    share = (coarse[:, 0] - source[:, 0].min()) / np.ptp(source[:, 0])
    titles = ("source, with anchors", "target, with the same", "where the source's points start")
    panels = figure(3, 290, titles)
    surface(panels[0], source @ FRONT, animals.source_triangles, share_of(source[:, 0]), along)
    surface(panels[1], target @ FRONT, animals.target_triangles, rgb(PALE) * 0.6 + 0.4)
    outline(panels[2], target @ FRONT, animals.target_triangles)
    dots(panels[2], np.asarray(start) @ FRONT, along(share), 2.6, linewidths=0)
    for side, (axes, points) in enumerate(zip(panels, (source, target), strict=False)):
        for rows in ends.values():
            dots(axes, (points @ FRONT)[[rows[side]]], "white", 8, edgecolors=INK, linewidths=1.5)
    for axes, points in zip(panels, (source, target, target), strict=True):
        fit(axes, points @ FRONT, 0.08)
    return page_of(panels)


def outline(axes: Axes, seen: Array, triangles: Rows) -> None:
    """A shape as a pale, flat area."""
    corners = seen[triangles][:, :, :2]
    axes.add_collection(PolyCollection(corners, facecolors="#e9ecf0", edgecolors="#e9ecf0"))


@picture
def coarse_shape() -> Figure:
    animals = Animals()
    points, triangles = animals.source, animals.source_triangles
    normals = pointmorph.meshes.vertex_normals(points, triangles)
    shape = stages().CoarseShape(points, normals, [], 1500, [60, 250])
    coarse = np.asarray(shape.positions) @ FRONT
    seen = points @ FRONT
    facing = (normals @ FRONT)[:, 2] > 0
    titles = (
        f"a cloud of {len(points)} points",
        f"{len(coarse)} stand for them, joined along the surface",
        "nodes among these, at two levels",
    )
    panels = figure(3, 290, titles)
    for axes in panels:
        surface(axes, seen, triangles, rgb("#f2f4f6"))
        fit(axes, seen, 0.06)
    dots(panels[0], seen[facing & visible(seen, seen, triangles)], BLUE, 1.2, linewidths=0)
    shown = visible(coarse, seen, triangles) & facing[np.asarray(shape.cloud_rows)]
    edges = edges_of(shape.graph)
    lines_between(panels[1], coarse, edges[shown[edges].all(axis=1)], "#8fb0d2", 0.6)
    dots(panels[1], coarse[shown], BLUE, 2.4, linewidths=0)
    for level, (color, size, width) in enumerate(((ORANGE, 7.0, 1.6), (BLUE, 3.2, 0.6))):
        nodes = np.asarray(shape.nodes(level))
        ends = edges_of(shape.node_graph(level))
        kept = shown[nodes]
        lines_between(panels[2], coarse[nodes], ends[kept[ends].all(axis=1)], color, width)
        dots(panels[2], coarse[nodes[kept]], color, size, zorder=4 - level)
    return page_of(panels)


def head(eyes: float, apart: float, stretch: Array, hat: bool) -> tuple[list[Array], list[Rows]]:
    """A ball with two eyes before it, and perhaps something above it."""
    ball, triangles = icosphere(4)
    eye, eye_triangles = icosphere(3)
    places = [ball * stretch]
    for side in (-1, 1):
        places.append(eyes * eye + (side * apart, -stretch[1] - 0.7 * eyes, 0.35))
    faces = [triangles, eye_triangles, eye_triangles]
    if hat:
        places.append(0.24 * eye * (1.4, 1.4, 0.6) + (0.1, 0, stretch[2] + 0.25))
        faces.append(eye_triangles)
    return places, faces


@picture
def components() -> Figure:
    source, source_faces = head(0.2, 0.4, np.array([1.0, 0.9, 1.0]), False)
    target, target_faces = head(0.3, 0.5, np.array([0.9, 0.8, 1.2]), True)
    clouds = [pointmorph.Cloud(np.concatenate(parts)) for parts in (source, target)]
    morph = pointmorph.morph(*clouds)
    label = np.repeat(np.arange(len(source)), [len(part) for part in source])
    partner = np.zeros(len(clouds[1].positions), int)
    partner[morph.pairs[:, 1]] = morph.pairs[:, 0]
    hues = np.array([rgb(PALE), rgb(BLUE) * 0.8 + 0.2, rgb(ORANGE) * 0.8 + 0.2])
    colors_of = (label, label[partner])
    titles = ("source: three components", "target: four, colored as their partners in the source")
    panels = figure(2, 360, titles)
    look = rotation(2, -0.35) @ rotation(0, -1.3)
    for axes, parts, faces, of in zip(
        panels, (source, target), (source_faces, target_faces), colors_of, strict=True
    ):
        offsets = np.cumsum([0, *(len(part) for part in parts[:-1])])
        triangles = np.concatenate([f + k for f, k in zip(faces, offsets, strict=True)])
        seen = np.concatenate(parts) @ look
        surface(axes, seen, triangles, hues[of[triangles[:, 0]]])
        fit(axes, seen, 0.04)
    return page_of(panels)


def bent_animal() -> tuple[Array, Rows, Array, Any, Any]:
    """An animal, its triangles and normals, its coarse shape, and that drawn by its ends."""
    directions, triangles = icosphere(5)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    normals = np.asarray(pointmorph.meshes.vertex_normals(points, triangles))
    limbs = ("head", "tail", "left fore", "left hind", "right fore", "right hind")
    rows = [end_of(limb, directions) for limb in limbs]
    moves = np.array([[-0.5, -0.5, 0.75], [0.55, 0.5, 0.5], [0.75, 0, 0.5], *[[0.0, 0, 0]] * 3])
    shape = stages().CoarseShape(points, normals, rows, 1500, [120, 250])
    drawn = stages().drawn(shape, 0, list(range(6)), points[rows] + moves)
    return points, triangles, normals, shape, drawn


@picture
def deformation() -> Figure:
    points, triangles, normals, shape, drawn = bent_animal()
    after = np.asarray(stages().prolonged(shape, drawn, points, normals))
    coarse, moved = np.asarray(shape.positions), np.asarray(drawn.positions)
    nodes, edges = np.asarray(shape.nodes(0)), edges_of(shape.node_graph(0))
    panels = figure(2, 380, ("a cloud, its nodes, and three ends that are drawn", "the same, bent"))
    for axes, places, rows in zip(panels, (points, after), (coarse, moved), strict=True):
        seen, seen_rows = places @ FRONT, rows @ FRONT
        surface(axes, seen, triangles, rgb(BLUE) * 0.35 + 0.65)
        kept = visible(seen_rows[nodes], seen, triangles)
        lines_between(axes, seen_rows[nodes], edges[kept[edges].all(axis=1)], "#6f93b8", 0.7)
        dots(axes, seen_rows[nodes[kept]], BLUE, 4.5, linewidths=0.5)
        dots(axes, seen_rows[3:6], INK, 7)
    for k in range(3):
        ends = np.stack([coarse[k], moved[k]]) @ FRONT
        panels[0].annotate(
            "", ends[1, :2], ends[0, :2],
            arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 2, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        dots(panels[1], moved[[k]] @ FRONT, RED, 7)
    both = np.concatenate([points, after]) @ FRONT
    for axes in panels:
        fit(axes, both, 0.04)
    return page_of(panels)


@picture
def prolongation() -> Figure:
    points, _, normals, shape, drawn = bent_animal()
    after = np.asarray(stages().prolonged(shape, drawn, points, normals))
    coarse, moved = np.asarray(shape.positions), np.asarray(drawn.positions)
    share = share_of(points[:, 0])
    titles = ("points of a cloud, coarse ones dark", "images of the coarse ones", "of all points")
    panels = figure(3, 290, titles)
    facing = np.flatnonzero((normals @ FRONT)[:, 2] > 0)
    of_coarse = along(share[np.asarray(shape.cloud_rows)])
    shown = np.isin(shape.cloud_rows, facing)
    for axes, all_points, some in (
        (panels[0], points, coarse), (panels[1], None, moved), (panels[2], after, None)
    ):  # fmt: skip
        if all_points is not None:
            dots(axes, (all_points @ FRONT)[facing], along(share[facing]), 1.6, linewidths=0)
        if some is not None:
            color = INK if axes is panels[0] else of_coarse[shown]
            dots(axes, (some @ FRONT)[shown], color, 2.8, linewidths=0)
        fit(axes, (points if axes is panels[0] else after) @ FRONT, 0.06)
    return page_of(panels)


HORNED = {**WALKING, "horn": ((0.25, 0.0, 1.0), (0.0, 0.0, 0.6), 0.02)}


@picture
def extremities() -> Figure:
    animals = Animals()
    target = animal(animals.target_directions, HORNED, (1.1, 0.6, 0.55))
    shapes = ((animals.source, animals.source_triangles), (target, animals.target_triangles))
    morph = pointmorph.morph(
        *(pointmorph.Cloud(p) for p, _ in shapes), animals.ends("head", "tail")
    )
    scale = [1 / np.sqrt(stages().estimated_area(points)) for points, _ in shapes]
    coarse, found, images = [], [], []
    for (points, triangles), image, size, other in zip(
        shapes, (morph.source_to_target, morph.target_to_source), scale, scale[::-1], strict=True
    ):
        normals = pointmorph.meshes.vertex_normals(points, triangles)
        shape = stages().CoarseShape(points * size, normals, [], 3000, [250, 1000])
        coarse.append(shape)
        found.append(stages().coarse_extremities(shape))
        images.append(np.asarray(image)[np.asarray(shape.cloud_rows)] * other)
    pairs = stages().paired_extremities(
        coarse[0], images[0], found[0], coarse[1], images[1], found[1]
    )
    panels = figure(2, 360, ("source", "target: its horn has no counterpart"))
    for side, (axes, (points, triangles)) in enumerate(zip(panels, shapes, strict=True)):
        seen = points @ FRONT
        surface(axes, seen, triangles, rgb((BLUE, ORANGE)[side]) * 0.35 + 0.65)
        rows = [np.asarray(coarse[side].cloud_rows)[row] for row, _ in found[side]]
        number = {pair[side]: k for k, pair in enumerate(pairs)}
        for k, row in enumerate(rows):
            if k in number:
                numbered(axes, seen[row], str(number[k] + 1), PATCHES[number[k] % 10])
            else:
                dots(axes, seen[[row]], "white", 11, edgecolors=INK, linewidths=1.5)
        fit(axes, seen, 0.1)
    return page_of(panels)


@picture
def live_map() -> Figure:
    """A mark on the flank that is dragged."""
    animals = Animals()
    flank = [
        int(np.argmax(directions @ unit(np.array([0.0, -1.0, 0.25]))))
        for directions in (animals.source_directions, animals.target_directions)
    ]
    to = int(np.argmax(animals.target_directions @ unit(np.array([0.62, -1.0, 0.35]))))
    marks = {**animals.ends(*STANDING), "flank": (flank[0], flank[1])}
    morph = pointmorph.morph(*animals.clouds(), marks)
    dragged = {**marks, "flank": (flank[0], to)}
    after = pointmorph.LiveMorph.of(morph).updated(dragged)
    titles = ("source, with a mark", "target, with the map", "the map, after the mark was dragged")
    panels = figure(3, 290, titles)
    seen = animals.source @ FRONT
    surface(panels[0], seen, animals.source_triangles, animals.source, checked)
    dots(panels[0], seen[[flank[0]]], RED, 9)
    target = animals.target @ FRONT
    for axes, found, row in ((panels[1], morph, flank[1]), (panels[2], after, to)):
        back = np.asarray(found.target_to_source)
        surface(axes, target, animals.target_triangles, back, checked)
        dots(axes, target[[row]], RED, 9)
    panels[2].annotate(
        "", target[to, :2], target[flank[1], :2],
        arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 2, "shrinkA": 0, "shrinkB": 4},
    )  # fmt: skip
    for axes, points in zip(panels, (seen, target, target), strict=True):
        fit(axes, points, 0.08)
    return page_of(panels)


def checked(places: Array) -> Array:
    odd = (np.floor(places[:, 0] * 6) + np.floor(places[:, 2] * 6)) % 2
    return np.where(odd[:, None] > 0, rgb(BLUE) * 0.8 + 0.2, rgb(BLUE) * 0.25 + 0.75)


@picture
def misfit() -> Figure:
    animals = Animals()
    right = animals.ends(*STANDING)
    wrong = dict(right)
    wrong["head"], wrong["tail"] = (
        (right["head"][0], right["tail"][1]), (right["tail"][0], right["head"][1])
    )  # fmt: skip
    found = [pointmorph.morph(*animals.clouds(), marks) for marks in (right, wrong)]
    facts = [next(s for s in m.report["starts"] if s["taken"]) for m in found]
    words = [
        f"{name}: energy {s['energy']:.3f}, {100 * s['torn']:.2g} % torn"
        for name, s in zip(("right marks", "head and tail exchanged"), facts, strict=True)
    ]
    panels = figure(2, 380, words)
    triangles = animals.source_triangles
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]]
    at_rest = np.linalg.norm(np.diff(animals.source[edges], axis=2), axis=-1).max(axis=(1, 2))
    for axes, morph in zip(panels, found, strict=True):
        images = np.asarray(morph.source_to_target)
        stretch = np.linalg.norm(np.diff(images[edges], axis=2), axis=-1).max(axis=(1, 2)) / at_rest
        red = np.clip(np.floor(4 * np.log2(np.maximum(stretch, 1))) / 8, 0, 1)[:, None]
        colors = (1 - red) * rgb("#e3e7eb") + red * rgb(RED)
        surface(axes, images @ FRONT, triangles, colors, back=True)
        fit(axes, animals.target @ FRONT, 0.08)
    return page_of(panels)


@picture
def product_space() -> Figure:
    """Two legs that are apart on the source and close together on the target."""
    down = np.linspace(0, 0.6, 14)
    source = np.concatenate([np.column_stack([0 * down + x, 0 * down, down]) for x in (-0.6, 0.6)])
    target = np.concatenate(
        [np.column_stack([0 * down + x, 0 * down, down]) for x in (-0.07, 0.07)]
    )
    off = 0.09 * np.sin(np.arange(28) * 2.1)[:, None] * (1, 0, 0.25)
    source_images, target_images = target + off, source - off
    nowhere = np.zeros_like(source)
    alone = stages().product_pairs(source_images, nowhere, target, nowhere)
    both = stages().product_pairs(source_images, source, target, target_images)
    titles = (
        "source: two legs",
        "images, paired by place on the target",
        "paired by places on both",
    )
    panels = figure(3, 310, titles)
    leg = np.repeat([0, 1], 14)
    colors = np.array([rgb(BLUE), rgb(TEAL)])[leg]
    flat = [rows[:, [0, 2]] for rows in (source, source_images, target)]
    dots(panels[0], flat[0], colors, 6)
    for axes, pairs in ((panels[1], alone), (panels[2], both)):
        for s, t in pairs:
            wrong = leg[s] != leg[t]
            curve(
                axes,
                np.stack([flat[1][s], flat[2][t]]),
                RED if wrong else INK,
                1.6 if wrong else 1.0,
            )
        dots(axes, flat[2], ORANGE, 6)
        dots(axes, flat[1], colors, 6)
        axes.set_xlim(-0.33, 0.33)
        axes.set_ylim(-0.04, 0.64)
    panels[0].set_xlim(-0.75, 0.75)
    panels[0].set_ylim(-0.08, 0.68)
    return page_of(panels)


@picture
def refinement() -> Figure:
    animals = Animals()
    morph = pointmorph.morph(*animals.clouds())
    to_source, to_target = (
        np.asarray(rows) for rows in (morph.target_to_source, morph.source_to_target)
    )
    titles = ("source", "its stripes on the target", "target", "its stripes on the source")
    panels = figure(4, 250, titles)

    def share(rows: Array, of: Array, axis: int) -> Array:
        return (rows[:, axis] - of[:, axis].min()) / np.ptp(of[:, axis])

    sides = (
        (animals.source, animals.source_triangles), (animals.target, animals.target_triangles)
    )  # fmt: skip
    for axes, (points, triangles), shares in zip(
        panels,
        (*sides, *sides[::-1]),
        (
            share(animals.source, animals.source, 0), share(to_source, animals.source, 0),
            share(animals.target, animals.target, 2), share(to_target, animals.target, 2),
        ),
        strict=True,
    ):  # fmt: skip
        surface(axes, points @ FRONT, triangles, shares, along)
        fit(axes, points @ FRONT, 0.06)
    return page_of(panels)


@picture
def thin_plate() -> Figure:
    animals = Animals()
    marks = animals.ends(*STANDING)
    source, target = np.array(list(marks.values())).T
    from_places, to_places = animals.source[source], animals.target[target]
    images = np.asarray(stages().thin_plate(from_places, to_places, animals.source))
    steps = np.linspace(0, 1, 60)
    low, high = animals.source.min(axis=0) - 0.15, animals.source.max(axis=0) + 0.15
    panels = figure(
        2, 400, ("source, with marks, and where they go", "a thin plate takes all points along")
    )
    every = [animals.source @ FRONT, animals.target @ FRONT]
    for axes, places in ((panels[0], animals.source), (panels[1], images)):
        for k in np.linspace(0, 1, 15):
            for line in (
                np.column_stack([k + 0 * steps, steps]),
                np.column_stack([steps, k + 0 * steps]),
            ):
                grid = (
                    np.column_stack([line[:, 0], 0.5 + 0 * steps, line[:, 1]]) * (high - low) + low
                )
                if axes is panels[1]:
                    grid = np.asarray(stages().thin_plate(from_places, to_places, grid))
                every.append(grid @ FRONT)
                axes.plot(*every[-1][:, :2].T, color="#b9c2cc", lw=0.8, zorder=0)
        surface(axes, places @ FRONT, animals.source_triangles, rgb(BLUE) * 0.5 + 0.5)
    for s, t in zip(from_places @ FRONT, to_places @ FRONT, strict=True):
        panels[0].annotate(
            "", t[:2], s[:2],
            arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.5, "shrinkA": 0, "shrinkB": 4},
        )  # fmt: skip
    dots(panels[0], from_places @ FRONT, BLUE, 8)
    for axes in panels:
        dots(axes, to_places @ FRONT, ORANGE, 8)
        fit(axes, np.concatenate(every), 0.02)
    return page_of(panels)
