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
from pointmorph import _pointmorph
from pointmorph.meshes import Shape
from scipy.spatial import Delaunay, cKDTree

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
    Animals,
    Array,
    icosphere,
    rings,
    rotation,
    torus,
    unit,
)


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
    """The shortest path in a graph, and the curve that is straightened from it."""
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

    ends = at(3.6, 1.4), at(5.4, 0.4)
    normals = np.column_stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])
    graph = stages().surface_graph(points, normals, 16)
    way = stages().shortest_path(graph, *ends)
    straight = np.asarray(stages().geodesic(points, normals, way))
    [axes] = panels = figure(1, 400)
    ring, triangles = torus(180, 72)
    surface(axes, ring @ ABOVE, triangles, rgb("#e6e9ed"))
    seen = points @ ABOVE
    dots(axes, seen[visible(seen, ring @ ABOVE, triangles)], "#9aa6b2", 1.8, linewidths=0)
    curve(axes, seen[way], ORANGE, 2.2)
    curve(axes, straight @ ABOVE, BLUE, 2.8)
    dots(axes, seen[list(ends)], RED, 8)
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
    morph = pointmorph.morph(*clouds, method="paper", domain="disk", solve="full")
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


@picture
def surface_graph() -> Figure:
    """A strip that is folded, from the side."""
    way = np.linspace(-1, 1, 301)
    bend = np.clip(way, -0.2, 0.2)
    angle = bend / 0.2 * np.pi / 2
    rest = way - bend
    x = 0.06 * np.cos(angle) - 0.7 * np.abs(rest)
    z = 0.06 * np.sin(angle) + 0.1 * np.sin(5 * np.abs(rest))
    random = np.random.default_rng(3)
    rows = np.unique(np.arange(2, 299, 4) + random.integers(-1, 2, 75))
    line = np.column_stack([x, 0 * x, z])
    tangent = np.gradient(line, axis=0)
    outward = unit(np.column_stack([tangent[:, 2], 0 * x, -tangent[:, 0]]))
    points, normals = line[rows], outward[rows]
    graph = stages().surface_graph(points, normals, 16)
    starts = np.repeat(np.arange(len(points)), np.diff(graph.offsets))
    kept = np.column_stack([starts, graph.neighbors])
    near = _pointmorph.nearest_neighbors(points, 16)
    joined = np.column_stack([np.repeat(np.arange(len(points)), 16), near.ravel()])
    path = stages().shortest_path(graph, 0, len(points) - 1)
    titles = (
        "16 nearest neighbors; those across the gap red",
        "the graph along the surface, and a shortest path",
    )
    panels = figure(2, 200, titles)
    flat = points[:, [0, 2]]
    opposed = (normals[joined[:, 0]] * normals[joined[:, 1]]).sum(axis=1) < -0.1
    for axes, edges, color in (
        (panels[0], joined[~opposed], "#9aa6b2"),
        (panels[0], joined[opposed], RED),
        (panels[1], kept, "#9aa6b2"),
    ):
        axes.add_collection(LineCollection(flat[edges], colors=color, linewidths=0.7))
    curve(panels[1], flat[path], BLUE, 2.4)
    for axes in panels:
        dots(axes, flat, INK, 3.2, linewidths=0)
        fit(axes, flat, 0.05)
    dots(panels[1], flat[[0, -1]], ORANGE, 7)
    return page_of(panels)


@picture
def graph_extremities() -> Figure:
    animals = Animals()
    points, triangles = animals.source, animals.source_triangles
    graph = stages().surface_graph(points, pointmorph.meshes.vertex_normals(points, triangles), 16)
    unit_length = float(np.sqrt(stages().estimated_area(points)))
    found = stages().graph_extremities(graph, unit_length)
    spread = pointmorph.meshes.sample(Shape("animal", points, faces=triangles), 30)[0].positions
    rows = np.unique(cKDTree(points).query(spread)[1])
    height = np.mean([stages().distances(graph, row) for row in rows], axis=0)
    titles = ("mean distance along the surface, and its maxima", "from behind")
    panels = figure(2, 360, titles)
    behind = rotation(2, 2.4) @ rotation(0, -1.2)
    for axes, look in zip(panels, (FRONT, behind), strict=True):
        seen = points @ look
        surface(axes, seen, triangles, share_of(height), along)
        for k, (row, _) in enumerate(found):
            if visible(seen[[row]], seen, triangles)[0]:
                numbered(axes, seen[row], str(k + 1), INK)
        fit(axes, seen, 0.1)
    return page_of(panels)


@picture
def extremity_pairing() -> Figure:
    """Distances along the surface from what is marked tell which of the rest belong together."""
    animals = Animals()
    marked = animals.ends("head", "right fore", "left hind")
    panels = figure(
        3, 300, ("source: three are marked (red)", "target", "distances from the marks")
    )
    shapes = (
        (animals.source, animals.source_triangles, BLUE),
        (animals.target, animals.target_triangles, ORANGE),
    )
    found = []
    for side, (points, triangles, _) in enumerate(shapes):
        graph = stages().surface_graph(
            points, pointmorph.meshes.vertex_normals(points, triangles), 16
        )
        unit_length = float(np.sqrt(stages().estimated_area(points)))
        rows = [pair[side] for pair in marked.values()]
        found.append(stages().unmarked_extremities(graph, unit_length, rows))
    pairs = stages().paired_unmarked(*found)
    for side, (axes, (points, triangles, color)) in enumerate(zip(panels, shapes, strict=False)):
        seen = points @ FRONT
        surface(axes, seen, triangles, rgb(color) * 0.35 + 0.65)
        for pair in marked.values():
            dots(axes, seen[[pair[side]]], RED, 8)
        for k, pair in enumerate(pairs):
            numbered(axes, seen[pair[side]], str(k + 1), (GREEN, PURPLE, YELLOW)[k % 3])
        fit(axes, seen, 0.1)
    chart = panels[2]
    chart.set_axis_on()
    chart.set_aspect("auto")
    chart.set_position((0.73, 0.14, 0.25, 0.74))
    for k, (s, t) in enumerate(pairs):
        for side, (row, color) in enumerate(((s, BLUE), (t, ORANGE))):
            signature = found[side].distances[found[side].rows.index(row)]
            at = 4 * k + np.arange(len(signature)) + (0.4 * side - 0.2)
            chart.bar(at, signature, 0.38, color=color)
    chart.set_xticks(
        [4 * k + 1 for k in range(len(pairs))], [str(k + 1) for k in range(len(pairs))]
    )
    chart.set_yticks([0, 0.5, 1, 1.5])
    for side in ("top", "right"):
        chart.spines[side].set_visible(False)
    return page_of(panels)


@picture
def free_loops() -> Figure:
    """Triangles with two holes, and which edges belong to which loop."""
    random = np.random.default_rng(7)
    square = np.column_stack(
        [random.uniform(-1.5, 1.5, (3000, 1)), random.uniform(-1, 1, (3000, 1))]
    )
    square = np.column_stack([square, np.zeros(3000)])
    points = pointmorph.meshes.sample(Shape("square", square), 150)[0].positions
    hole = np.linalg.norm(points[:, :2] - (-0.62, 0.1), axis=1) > 0.42
    points = points[hole]
    triangles = np.asarray(Delaunay(points[:, :2]).simplices)
    corners = points[triangles]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    kept = sides.max(axis=1) < 0.42
    middle = corners.mean(axis=1)[:, :2]
    gap = np.argsort(np.linalg.norm(middle - (0.75, -0.1), axis=1))
    gap = gap[kept[gap]][0]
    shared = [(triangles == v).any(axis=1) for v in triangles[gap]]
    across = np.flatnonzero(shared[0] & shared[1] & kept)
    filled = kept.copy()
    filled[across] = False
    edges = {tuple(sorted((int(t[i]), int(t[i - 1])))) for t in triangles[kept] for i in range(3)}
    simplices = [sorted(map(int, t)) for t in triangles[filled]]
    edge = tuple(sorted(int(v) for v in triangles[gap][:2]))
    simplices += [list(e) for e in edges if e != edge]
    count, wide, neighbors, sums = stages().free_loops(len(points), simplices)
    words = f"{count} loops that bound nothing, {wide} of them wide"
    panels = figure(2, 330, (words, "a loop around a hole has one of its colored edges"))
    flat = points[:, :2]
    for axes in panels:
        axes.add_collection(
            PolyCollection(
                flat[triangles[filled]], facecolors="#dbe7f3", edgecolors="#9aa6b2", lw=0.7
            )
        )
        dots(axes, flat, INK, 3.4, linewidths=0)
        fit(axes, flat, 0.03)
    at = 0
    for k, others in enumerate(neighbors):
        for other in others:
            for loop in sums[at]:
                curve(panels[1], flat[[k, other]], (RED, ORANGE)[loop % 2], 2.6)
            at += 1
    return page_of(panels)


@picture
def local_triangles() -> Figure:
    random = np.random.default_rng(5)
    square = np.column_stack([random.uniform(-1.15, 1.15, (8000, 2)), np.zeros(8000)])
    even = pointmorph.meshes.sample(Shape("square", square), 560)[0].positions
    even = even[np.linalg.norm(even[:, :2] - (0.35, 0.2), axis=1) > 0.3]
    x, y = even[:, 0], even[:, 1]
    points = np.column_stack([x, y, 0.3 * np.sin(2 * x) + 0.25 * np.cos(2.5 * y)])
    normals = unit(
        np.column_stack([-0.6 * np.cos(2 * x), 0.625 * np.sin(2.5 * y), np.ones(len(x))])
    )
    triangles = np.asarray(stages().local_triangles(points, normals, 2.0))
    look = rotation(2, 0.3) @ rotation(0, -0.6)
    seen = points @ look
    panels = figure(
        2,
        360,
        (
            "the triangles around one point, in its tangent plane",
            "all triangles: the hole stays open",
        ),
    )
    one = int(np.argmin(np.linalg.norm(even[:, :2] - (-0.4, -0.1), axis=1)))
    star = triangles[(triangles == one).any(axis=1)]
    for axes, some, color in ((panels[0], star, ORANGE), (panels[1], triangles, BLUE)):
        axes.add_collection(
            PolyCollection(
                seen[some][:, :, :2], facecolors=rgb(color) * 0.35 + 0.65, edgecolors=color, lw=0.8
            )
        )
        dots(axes, seen, INK, 3.2, linewidths=0)
        fit(axes, seen, 0.03)
    dots(panels[0], seen, INK, 6.5, linewidths=0)
    dots(panels[0], seen[[one]], RED, 10)
    close = seen[star].reshape(-1, 3)
    fit(panels[0], close, 0.6)
    return page_of(panels)


def thin_sheet(noise: float) -> tuple[Array, Array]:
    """Points of a thin part that is bent around its edge, the same all along y, and normals."""
    s = np.linspace(-1, 1, 45)
    turn = np.clip(s, -0.12, 0.12) / 0.12 * np.pi / 2
    rest = np.abs(s) - np.minimum(np.abs(s), 0.12)
    x, z = 0.08 * np.cos(turn) - rest, 0.08 * np.sin(turn) + 0.12 * np.sin(3 * rest)
    line = np.column_stack([x, 0 * x, z])
    tangent = np.gradient(line, axis=0)
    across = unit(np.column_stack([tangent[:, 2], 0 * x, -tangent[:, 0]]))
    y = np.arange(-9, 10) * 0.045
    random = np.random.default_rng(1)
    points = (line[:, None] + np.stack([0 * y, y, 0 * y], axis=1)).reshape(-1, 3)
    normals = np.repeat(across, len(y), axis=0)
    points = points + normals * random.normal(0, noise, (len(points), 1))
    return points + random.uniform(-0.01, 0.01, points.shape) * (1, 1, 0), normals


@picture
def mls() -> Figure:
    """A thin part in section."""
    points, normals = thin_sheet(0.007)
    fine, directions = thin_sheet(0.0)
    row, share = slice(9, None, 19), np.tile((0.25, 0.75), 44)[:, None]
    before, after = (np.repeat(fine[row][k : k + 44], 2, axis=0) for k in (0, 1))
    places = (1 - share) * before + share * after
    ways = np.repeat(directions[row][:44], 2, axis=0)
    shift = 0.03 * np.sin(np.arange(len(places)) * 1.1)[:, None]
    given = places + ways * shift
    panels = figure(
        2,
        220,
        (
            "points of a thin part in section (gray), and places near it",
            "projected onto the surface that the points stand for",
        ),
    )
    feet = np.asarray(stages().mls(points, normals, given, ways, 0.045, 3))
    near = np.abs(points[:, 1]) < 0.03
    for axes, rows, color in ((panels[0], given, ORANGE), (panels[1], feet, BLUE)):
        dots(axes, points[near][:, [0, 2]], "#9aa6b2", 7.5, linewidths=0)
        dots(axes, rows[:, [0, 2]], color, 4.0, linewidths=0)
        axes.set_xlim(-0.93, 0.13)
        axes.set_ylim(-0.16, 0.29)
    lines = np.stack([given, feet], axis=1)[:, :, [0, 2]]
    panels[1].add_collection(LineCollection(lines, colors=ORANGE, linewidths=0.7))
    return page_of(panels)


@picture
def projection() -> Figure:
    """An open patch in section."""
    angle = np.linspace(-1.1, 1.1, 15)
    y = np.arange(-6, 7) * 0.15
    section = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    points = (section[:, None] + np.stack([0 * y, y, 0 * y], axis=1)).reshape(-1, 3)
    normals = np.repeat(section, len(y), axis=0)
    at = np.linspace(-1.25, 1.25, 56)
    off = 1 + 0.06 * np.sin(np.arange(56) * 2.3)
    images = np.column_stack([off * np.sin(at), 0 * at, off * np.cos(at)])
    anchors = cKDTree(points).query(images)[1]
    onto = np.asarray(stages().projected(images, anchors, points, normals))
    [axes] = panels = figure(1, 340)
    circle = np.linspace(-1.1, 1.1, 300)
    curve(axes, np.column_stack([np.sin(circle), np.cos(circle)]), PALE, 6.0)
    lines = np.stack([images, onto], axis=1)[:, :, [0, 2]]
    axes.add_collection(LineCollection(lines, colors=ORANGE, linewidths=1.2, zorder=3))
    dots(axes, section[:, [0, 2]], INK, 7)
    dots(axes, images[:, [0, 2]], ORANGE, 4.6, linewidths=0)
    dots(axes, onto[:, [0, 2]], BLUE, 4.6, linewidths=0)
    fit(axes, images[:, [0, 2]], 0.04)
    return page_of(panels)


@picture
def transfer() -> Figure:
    """A fine net on one patch, by the pairs and smoothly, on another with fewer points."""
    disk, triangles = rings(10)
    other, _ = rings(7)
    turned = other @ rotation(2, 0.13)[:2, :2]
    heights = [0.5 * np.cos(2.2 * p[:, 0]) * np.cos(1.6 * p[:, 1]) for p in (disk, turned)]
    source, target = (np.column_stack([p, h]) for p, h in zip((disk, turned), heights, strict=True))
    clouds = [
        pointmorph.Cloud(p, boundary=np.arange(len(p) - 6 * n, len(p)))
        for p, n in ((source, 10), (target, 7))
    ]
    morph = pointmorph.morph(*clouds, method="paper", domain="disk", solve="full")
    partner = np.zeros(len(source), int)
    partner[morph.pairs[:, 0]] = morph.pairs[:, 1]
    titles = ("source", "its points at their partners in pairs", "where transfer takes them")
    panels = figure(3, 200, titles)
    look = rotation(2, 0.4) @ rotation(0, -0.8)
    for axes, points in zip(
        panels, (source, target[partner], np.asarray(morph.source_to_target)), strict=True
    ):
        seen = (points @ look)[triangles]
        order = np.argsort(seen[:, :, 2].mean(axis=1))
        axes.add_collection(
            PolyCollection(seen[order][:, :, :2], facecolors="#dbe7f3", edgecolors=BLUE, lw=0.9)
        )
        fit(axes, source @ look, 0.03)
    return page_of(panels)
