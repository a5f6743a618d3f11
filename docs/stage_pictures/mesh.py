"""Pictures of the stages on faces."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pointmorph
import pointmorph.meshes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    GREEN,
    INK,
    ORANGE,
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

Mask = npt.NDArray[np.bool_]


@picture
def wrapping() -> Figure:
    source_directions, source_triangles = icosphere(3)
    target_directions, target_triangles = icosphere(5)
    source = animal(source_directions, STANDING, (1.0, 0.5, 0.5))
    target = animal(target_directions, WALKING, (1.1, 0.6, 0.55))
    features = {
        limb: (end_of(limb, source_directions), end_of(limb, target_directions))
        for limb in ("head", "tail", "left fore", "right fore")
    }
    morph = pointmorph.morph(
        pointmorph.Cloud(source, faces=source_triangles),
        pointmorph.Cloud(target, faces=target_triangles),
        features,
    )
    titles = ("a mesh", "the surface to wrap it onto", "wrapped")
    panels = figure(3, 290, titles)
    blue = rgb(BLUE) * 0.6 + 0.4
    surface(panels[0], source @ FRONT, source_triangles, blue, edges=0.4)
    surface(panels[1], target @ FRONT, target_triangles, rgb(ORANGE) * 0.8 + 0.2)
    wrapped = np.asarray(morph.wrapped(1.0))
    surface(panels[2], wrapped @ FRONT, source_triangles, blue, edges=0.4)
    for axes, points in zip(panels, (source, target, target), strict=True):
        fit(axes, points @ FRONT, 0.08)
    return page_of(panels)


@picture
def closest_point() -> Figure:
    """Places in the plane that cuts an animal in two, and where they are nearest to its mesh."""
    directions, triangles = icosphere(2)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5)) @ rotation(2, -0.12)
    random = np.random.default_rng(6)
    places = random.uniform((-2.0, -1.1, -1.7), (2.0, -0.7, 1.6), (170, 3))
    found, shares = pointmorph.meshes.ClosestPlaces(points, triangles).of(places)
    nearest = (points[triangles[found]] * shares[:, :, None]).sum(axis=1)
    corners = (shares > 1e-9).sum(axis=1)
    side = rotation(0, -np.pi / 2 + 0.001)
    [axes] = panels = figure(
        1, 430, ("nearest points: within a face (blue), on an edge (green), a corner (orange)",)
    )
    seen = points @ side
    surface(axes, seen, triangles, rgb("#e3e7eb"), edges=0.5)
    for number, color in ((3, BLUE), (2, GREEN), (1, ORANGE)):
        some = corners == number
        lines = np.stack([places[some], nearest[some]], axis=1) @ side
        axes.add_collection(LineCollection(lines[:, :, :2], colors=color, linewidths=1.1))
        dots(axes, lines[:, 0], "white", 3.4, edgecolors=color, linewidths=1.0)
        dots(axes, lines[:, 1], color, 4.4, linewidths=0)
    fit(axes, np.concatenate([seen, places @ side]), 0.02)
    return page_of(panels)


def vase() -> tuple[Array, list[list[int]]]:
    """A bowl of quads, some of them turned over, with a seam; a star beside it, and a ball."""
    around, up = 24, 8
    angle = 2 * np.pi * np.arange(around + 1) / around
    height = np.linspace(0, 1, up)
    radius = 0.45 + 0.35 * np.sin(2.2 * height)
    wall = np.stack(
        [np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)),
         np.repeat(1.1 * height[:, None], around + 1, axis=1)], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    wall[np.arange(up) * (around + 1) + around] = wall[np.arange(up) * (around + 1)]  # the seam
    faces = []
    random = np.random.default_rng(1)
    for i in range(up - 1):
        for j in range(around):
            a = i * (around + 1) + j
            quad = [a, a + 1, a + around + 2, a + around + 1]
            faces.append(quad[::-1] if random.uniform() < 0.12 else quad)
    turn = np.pi * np.arange(10) / 5 + 0.3
    reach = np.where(np.arange(10) % 2, 0.26, 0.6)
    star = np.column_stack(
        [reach * np.cos(turn) + 1.55, 0 * turn - 0.5, reach * np.sin(turn) + 0.6]
    )
    faces.append((len(wall) + np.arange(10)).tolist()[::-1])
    ball, triangles = icosphere(1)
    faces += (len(wall) + 10 + triangles).tolist()
    return np.concatenate([wall, star, 0.42 * ball + (-1.45, -0.3, 0.55)]), faces


@picture
def mesh() -> Figure:
    points, faces = vase()
    places, triangles, parts, borders = stages().mesh(points, faces)
    look = rotation(0, -1.05)
    panels = figure(
        2,
        300,
        (
            "faces as they are given, their backs orange",
            "one surface of triangles: parts, and borders in red",
        ),
    )
    seen = points @ look
    polygons = sorted(faces, key=lambda face: seen[face, 2].mean())
    colors = []
    for face in polygons:
        a, b = seen[face[1]] - seen[face[0]], seen[face[2]] - seen[face[1]]
        inside = np.cross(a, b)[2] < 0
        colors.append(rgb(ORANGE) * 0.8 + 0.2 if inside else rgb(BLUE) * 0.5 + 0.5)
    panels[0].add_collection(
        PolyCollection(
            [seen[face, :2] for face in polygons], facecolors=colors, edgecolors=INK, lw=0.6
        )
    )
    seen_places = np.asarray(places) @ look
    hues = np.array([rgb(c) * 0.5 + 0.5 for c in (BLUE, GREEN, "#8a67b0")])
    colors = hues[np.asarray(parts)[np.asarray(triangles)[:, 0]]]
    surface(panels[1], seen_places, np.asarray(triangles), colors, edges=0.6, back=True)
    for border in borders:
        curve(panels[1], seen_places[[*border, border[0]]], RED, 2.2)
    for axes in panels:
        fit(axes, seen, 0.04)
    return page_of(panels)


def can() -> tuple[Array, Rows]:
    """A cap: a can upside down, many vertices on its bottom, few on its wall."""
    around = 40
    angle = 2 * np.pi * np.arange(around) / around
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [(1.0, 1.9), (1.0, 0.0), (0.45, 0.0), (0.18, 0.0), (0.06, 0.0)]
    points = np.concatenate([np.column_stack([r * circle, np.full(around, z)]) for r, z in rings])
    j = np.arange(around)
    k = (j + 1) % around
    faces = []
    for i in range(len(rings) - 1):
        a, b, c, d = i * around + j, i * around + k, (i + 1) * around + k, (i + 1) * around + j
        faces += [np.stack([a, d, c], axis=1), np.stack([a, c, b], axis=1)]
    last = (len(rings) - 1) * around
    faces.append(np.stack([last + j, np.full(around, len(points)), last + k], axis=1))
    points = np.concatenate([points, [[0.0, 0.0, 0.0]]])
    return points * (1, 1, -0.7), np.concatenate(faces)[:, ::-1]


@picture
def mesh_samples() -> Figure:
    points, triangles = can()
    places, normals, border = stages().mesh_samples(points, triangles.tolist(), 1400)
    look = rotation(2, 0.3) @ rotation(0, -0.85)
    panels = figure(
        2, 400, ("a mesh and its vertices", "samples of its faces; along the border red")
    )
    seen, drawn = points @ look, np.asarray(places) @ look
    for axes in panels:
        surface(
            axes,
            seen,
            triangles,
            rgb("#e3e7eb"),
            edges=0.5 if axes is panels[0] else 0.0,
            back=True,
        )
        fit(axes, seen, 0.05)
    faced = np.flatnonzero((np.asarray(normals) @ look)[:, 2] > -0.05)
    dots(panels[0], seen[(normals_of_can(points) @ look)[:, 2] > -0.1], BLUE, 4.5, linewidths=0)
    dots(panels[1], drawn[faced], BLUE, 3.2, linewidths=0)
    dots(panels[1], drawn[[k for k in border if k in set(faced)]], RED, 4.2, linewidths=0)
    return page_of(panels)


def normals_of_can(points: Array) -> Array:
    flat = points[:, 2:] > -0.01
    return np.where(flat, np.array([0.0, 0.0, 1.0]), unit(points * (1, 1, 0) + (0, 0, 1e-9)))


def in_front(points: Array, triangles: Rows, some: Mask | None = None) -> Array:
    """The vertices of a coarse mesh (of these) that face the front, and that nothing hides."""
    normals = pointmorph.meshes.vertex_normals(points, triangles)
    shown = (normals @ FRONT)[:, 2] > 0.12
    if some is not None:
        shown &= some
    shown[shown] = visible(points[shown] @ FRONT, points @ FRONT, triangles)
    return points[shown]


@picture
def subdivision() -> Figure:
    directions, triangles = icosphere(2)
    points = animal(directions, STANDING, (1.0, 0.5, 0.5))
    places, finer = (
        np.asarray(rows) for rows in stages().subdivided(points, triangles.tolist(), 0.12)
    )
    panels = figure(
        2, 380, (f"{len(triangles)} triangles", f"{len(finer)}: no edge is longer than 0.12 √area")
    )
    blue = rgb(BLUE) * 0.45 + 0.55
    surface(panels[0], points @ FRONT, triangles, blue, edges=0.6)
    surface(panels[1], places @ FRONT, finer, blue, edges=0.6)
    dots(panels[0], in_front(points, triangles) @ FRONT, INK, 3.6, linewidths=0)
    old = np.arange(len(places)) < len(points)
    dots(panels[1], in_front(places, finer, old) @ FRONT, INK, 3.6, linewidths=0)
    dots(panels[1], in_front(places, finer, ~old) @ FRONT, RED, 3.2, linewidths=0)
    for axes in panels:
        fit(axes, points @ FRONT)
    return page_of(panels)


@picture
def vertex_images() -> Figure:
    animals = Animals()
    directions, triangles = icosphere(2)
    vertices = animal(directions, STANDING, (1.0, 0.5, 0.5))
    normals = pointmorph.meshes.vertex_normals(vertices, triangles)
    samples, sample_normals, _ = (
        np.asarray(rows) for rows in stages().mesh_samples(vertices, triangles.tolist(), 1500)
    )
    ends = {
        limb: (
            int(np.argmin(np.linalg.norm(samples - vertices[end_of(limb, directions)], axis=1))),
            rows[1],
        )
        for limb, rows in animals.ends(*STANDING).items()
    }
    morph = pointmorph.morph(
        pointmorph.Cloud(samples, sample_normals), pointmorph.Cloud(animals.target), ends
    )
    images = np.asarray(morph.source_to_target, float)
    spacing = float(np.median(cKDTree(samples).query(samples, 2)[0][:, 1]))
    carried = stages().vertex_images(vertices, normals, samples, sample_normals, images, spacing)
    titles = (
        "a mesh, and samples of it",
        "where a map takes the samples",
        "the vertices, carried along",
    )
    panels = figure(3, 290, titles)
    blue = rgb(BLUE) * 0.45 + 0.55
    target = animals.target @ FRONT
    surface(panels[0], vertices @ FRONT, triangles, blue, edges=0.5)
    surface(panels[1], target, animals.target_triangles, rgb(ORANGE) * 0.35 + 0.65)
    surface(panels[2], carried @ FRONT, triangles, blue, edges=0.5)
    for axes, places, seen, rows in (
        (panels[0], samples, vertices @ FRONT, triangles),
        (panels[1], images, target, animals.target_triangles),
    ):
        shown = visible(places @ FRONT, seen, rows)
        if axes is panels[0]:
            shown &= (sample_normals @ FRONT)[:, 2] > 0
        dots(axes, (places @ FRONT)[shown], RED, 2.4, linewidths=0)
    dots(panels[2], in_front(carried, triangles) @ FRONT, INK, 3.4, linewidths=0)
    for axes, points in zip(panels, (vertices, animals.target, animals.target), strict=True):
        fit(axes, points @ FRONT, 0.08)
    return page_of(panels)
