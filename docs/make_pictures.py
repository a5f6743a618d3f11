"""Draws the pictures of the stage pages from made shapes, each in docs/images.

python docs/make_pictures.py            all of them, in about a minute
python docs/make_pictures.py pose lod   these
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pointmorph
import pointmorph.meshes
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.tri import Triangulation
from PIL import Image
from pointmorph.meshes import Shape
from scipy.interpolate import LinearNDInterpolator
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

IMAGES = Path(__file__).resolve().parent / "images"
WIDTH = 900  # pixels
SHARPNESS = 2  # pixels that are drawn for one that is kept, in each direction
LARGEST = 60_000  # bytes

# One palette for all pictures. The source is blue, the target orange, what is marked red.
PAPER, INK, PALE = "#ffffff", "#2b3440", "#c9d0d8"
BLUE, ORANGE, RED = "#3f7fbf", "#e38b2c", "#c8372d"
GREEN, PURPLE, YELLOW, TEAL = "#5b9b4c", "#8a67b0", "#e8c547", "#36a3a3"
PATCHES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, TEAL, "#b5651d", "#d98cb3", "#8c9aa8", "#9bbf4d")
ALONG = (BLUE, TEAL, GREEN, YELLOW, ORANGE, RED)  # colors that say which place is meant

LIGHT = np.array([-0.35, 0.45, 0.82])

PICTURES: dict[str, Callable[[], Figure]] = {}


def picture(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """Adds a function to the pictures, under its name: the stem of a stage."""
    PICTURES[draw.__name__] = draw
    return draw


# --- Shapes


def unit(rows: Array) -> Array:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def icosphere(levels: int) -> tuple[Array, Rows]:
    """Directions and triangles: an icosahedron whose triangles are cut in four."""
    g = (1 + 5**0.5) / 2
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = unit(np.array(corners, float))
    faces = "0b5 051 017 07a 0ab 159 5b4 ba2 a76 718 394 342 326 368 389 495 24b 62a 867 981"
    triangles = np.array([[int(c, 16) for c in face] for face in faces.split()])
    for _ in range(levels):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        ends, which = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        ab, bc, ca = (len(points) + which.reshape(-1, 3)).T
        points = np.concatenate([points, unit(points[ends].sum(axis=1))])
        a, b, c = triangles.T
        triangles = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )
    return points, triangles


Pull = tuple[tuple[float, float, float], tuple[float, float, float], float]

# Where a rounded body is pulled out, by how much, and how wide the pull is.
STANDING: dict[str, Pull] = {
    "left fore": ((0.7, 0.5, -0.6), (0.05, 0.1, -0.85), 0.05),
    "right fore": ((0.7, -0.5, -0.6), (0.05, -0.1, -0.85), 0.05),
    "left hind": ((-0.7, 0.5, -0.6), (-0.05, 0.1, -0.85), 0.05),
    "right hind": ((-0.7, -0.5, -0.6), (-0.05, -0.1, -0.85), 0.05),
    "head": ((0.95, 0.0, 0.55), (0.65, 0.0, 0.6), 0.07),
    "tail": ((-1.0, 0.0, 0.35), (-0.75, 0.0, 0.35), 0.025),
}
# The same animal: one fore leg lifted, head lowered, tail up.
WALKING: dict[str, Pull] = {
    **STANDING,
    "left fore": ((0.7, 0.5, -0.6), (0.7, 0.1, -0.45), 0.05),
    "left hind": ((-0.7, 0.5, -0.6), (-0.4, 0.1, -0.7), 0.05),
    "head": ((0.95, 0.0, 0.55), (0.95, 0.0, 0.1), 0.07),
    "tail": ((-1.0, 0.0, 0.35), (-0.3, 0.0, 0.8), 0.025),
}


def animal(directions: Array, pulls: dict[str, Pull], body: Sequence[float]) -> Array:
    places = directions * np.array(body)
    for axis, by, width in pulls.values():
        near = np.exp((directions @ unit(np.array(axis)) - 1) / width)
        places = places + near[:, None] * np.array(by)
    return places


def end_of(limb: str, directions: Array) -> int:
    return int(np.argmax(directions @ unit(np.array(STANDING[limb][0]))))


class Animals:
    """An animal and the same one in another pose, of other proportions and with other points."""

    def __init__(self, levels: int = 5) -> None:
        self.source_directions, self.source_triangles = icosphere(levels)
        turned, self.target_triangles = icosphere(levels)
        self.target_directions = turned @ rotation(2, 0.4) @ rotation(0, 0.5)
        self.source = animal(self.source_directions, STANDING, (1.0, 0.5, 0.5))
        self.target = animal(self.target_directions, WALKING, (1.1, 0.6, 0.55))

    def clouds(self) -> tuple[pointmorph.Cloud, pointmorph.Cloud]:
        return pointmorph.Cloud(self.source), pointmorph.Cloud(self.target)

    def ends(self, *limbs: str) -> dict[str, tuple[int, int]]:
        return {
            limb: (end_of(limb, self.source_directions), end_of(limb, self.target_directions))
            for limb in limbs
        }


def torus(around: int, across: int, bump: float = 0.0, tube: float = 0.4) -> tuple[Array, Rows]:
    """Points of a ring and its triangles; row i · across + j is at the i-th and j-th angle."""
    a, b = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    u, v = 2 * np.pi * a / around, 2 * np.pi * b / across
    thick = tube * (1 + bump * np.cos(3 * u))
    r = 1 + thick * np.cos(v)
    points = np.stack([r * np.cos(u), r * np.sin(u), thick * np.sin(v)], axis=-1).reshape(-1, 3)

    def row(i: Rows, j: Rows) -> Rows:
        return (i % around) * across + j % across

    a, b = a.ravel(), b.ravel()
    first = np.stack([row(a, b), row(a + 1, b), row(a + 1, b + 1)], axis=1)
    second = np.stack([row(a, b), row(a + 1, b + 1), row(a, b + 1)], axis=1)
    return points, np.concatenate([first, second])


def rings(count: int) -> tuple[Array, Rows]:
    """Even points of the unit disk on `count` rings, and triangles between them."""
    rows = [np.zeros((1, 2))]
    for k in range(1, count + 1):
        angle = 2 * np.pi * np.arange(6 * k) / (6 * k)
        rows.append(k / count * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    points = np.concatenate(rows)
    return points, np.asarray(Triangulation(*points.T).triangles, dtype=np.int64)


def rotation(axis: int, angle: float) -> Array:
    """Rows times this are turned about an axis."""
    matrix = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = np.sin(angle), -np.sin(angle)
    return matrix


# --- Drawing

FRONT = rotation(2, -0.55) @ rotation(0, -1.2)  # from the right and a little above
ABOVE = rotation(0, -0.75)


def rgb(colors: str | Iterable[str]) -> Array:
    one = isinstance(colors, str)
    result = np.array([to_rgb(c) for c in ([colors] if one else colors)])
    return result[0] if one else result


def along(share: Array, bands: int = 12) -> Array:
    """Colors of places from 0 to 1, in bands, every other one lighter."""
    band = np.clip(np.floor(share.ravel() * bands), 0, bands - 1)
    stops = rgb(ALONG)
    at = (band + 0.5) / bands * (len(stops) - 1)
    low = np.floor(at).astype(int)
    color = stops[low] + (at - low)[:, None] * (stops[np.minimum(low + 1, 5)] - stops[low])
    return color + (band % 2 * 0.3)[:, None] * (1 - color)


def share_of(values: Array) -> Array:
    return (values - values.min()) / np.ptp(values)


def figure(columns: int, height: int, titles: Sequence[str] = (), rows: int = 1) -> list[Axes]:
    """Empty panels beside each other, `height` pixels in all."""
    page = Figure(figsize=(WIDTH / 100, height / 100), dpi=100 * SHARPNESS, facecolor=PAPER)
    top = 1 - (24 / height if titles else 0.0)
    panels = []
    for k in range(rows * columns):
        i, j = divmod(k, columns)
        box = (j / columns, top * (1 - (i + 1) / rows), 1 / columns, top / rows)
        axes = page.add_axes(box)
        axes.set_aspect("equal")
        axes.set_axis_off()
        panels.append(axes)
    for j, title in enumerate(titles):
        page.text(
            (j + 0.5) / columns,
            1 - 6 / height,
            title,
            ha="center",
            va="top",
            color=INK,
            fontsize=10,
        )
    return panels


def page_of(panels: Sequence[Axes]) -> Figure:
    page = panels[0].figure
    assert isinstance(page, Figure)
    return page


def fit(axes: Axes, places: Array, margin: float = 0.05) -> None:
    """Shows all of these places, seen from the front."""
    low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    room = margin * (high - low).max()
    axes.set_xlim(low[0] - room, high[0] + room)
    axes.set_ylim(low[1] - room, high[1] + room)


Paint = Callable[[Array], Array]  # from values at places to colors


def split(corners: Array, values: Array, paint: Paint) -> tuple[Array, Array, Rows]:
    """Triangles cut in four, three times, where colors meet; and which one each comes from."""
    parents = np.arange(len(corners))
    for _ in range(3):
        colors = paint(values.reshape(-1, values.shape[2])).reshape(*values.shape[:2], 3)
        meet = (np.ptp(colors, axis=1) > 1e-9).any(axis=1)
        parts = []
        for rows in (corners, values):
            a, b, c = rows[meet].transpose(1, 0, 2)
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            four = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
            parts.append(np.concatenate([rows[~meet], *(np.stack(t, axis=1) for t in four)]))
        corners, values = parts
        parents = np.concatenate([parents[~meet], *[parents[meet]] * 4])
    return corners, values, parents


def surface(
    axes: Axes,
    seen: Array,
    triangles: Rows,
    color: Array,
    paint: Paint | None = None,
    *,
    edges: float = 0.0,
    back: bool = False,
) -> None:
    """A shaded surface, far triangles first. `color` is one, or, with `paint`, values of points."""
    corners = seen[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    shown = np.flatnonzero((normals[:, 2] > 0) | back)
    corners, normals = corners[shown], normals[shown]
    if paint is None:
        base = np.broadcast_to(color, (len(corners), 3))
    else:
        values = color.reshape(len(seen), -1)[triangles[shown]]
        corners, values, parents = split(corners, values, paint)
        base, normals = paint(values.mean(axis=1)), normals[parents]
    lit = normals @ unit(LIGHT)
    light = np.clip(0.55 + 0.5 * (np.abs(lit) if back else lit), 0.25, 1.0)[:, None]
    faces = np.clip(base * light + 0.12 * np.maximum(lit, 0)[:, None] ** 8, 0, 1)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    axes.add_collection(
        PolyCollection(
            corners[order][:, :, :2],
            facecolors=faces[order],
            edgecolors=(0.55 if edges else 1.0) * faces[order],
            linewidths=edges or 0.3,
        )
    )


def curve(axes: Axes, seen: Array, color: str = INK, width: float = 1.6) -> None:
    axes.plot(*seen[:, :2].T, color=color, lw=width, solid_capstyle="round", zorder=3)


def dots(axes: Axes, seen: Array, color: str | Array, size: float = 5.0, **more: object) -> None:
    """Discs with a thin rim; `size` in points."""
    style: dict[str, object] = {"edgecolors": "white", "linewidths": 0.7, "zorder": 4, **more}
    axes.scatter(*seen[:, :2].T, s=size**2, c=[color] if isinstance(color, str) else color, **style)


def visible(places: Array, seen: Array, triangles: Rows) -> npt.NDArray[np.bool_]:
    """Which places of a surface no other part of it hides."""
    middles = seen[triangles].mean(axis=1)
    near = cKDTree(middles[:, :2]).query_ball_point(places[:, :2], 0.04)
    depth = 0.12
    return np.array(
        [middles[n, 2].max(initial=-9) < z + depth for n, z in zip(near, places[:, 2], strict=True)]
    )


def save(page: Figure, path: Path) -> None:
    """With as many colors as a small file allows."""
    canvas = FigureCanvasAgg(page)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    image = image.resize(
        (image.width // SHARPNESS, image.height // SHARPNESS), Image.Resampling.LANCZOS
    )
    # So that colors of small marks are among those that are chosen.
    with_marks = image.copy()
    for k, color in enumerate(dict.fromkeys((PAPER, INK, RED, *PATCHES, *ALONG))):
        with_marks.paste(color, (40 * k, 0, 40 * k + 40, 40))
    for colors in (256, 192, 128, 96, 64, 48, 32):
        palette = with_marks.quantize(colors)
        few = image.quantize(palette=palette, dither=Image.Dither.NONE)
        entries = np.array(few.getpalette(), np.uint8).reshape(-1, 3)
        entries[entries.min(axis=1) > 248] = 255  # the paper stays white
        few.putpalette(entries.tobytes())
        few.save(path, optimize=True)
        if path.stat().st_size <= LARGEST:
            return
    raise SystemExit(f"{path.name} has {path.stat().st_size} bytes, more than {LARGEST}")


# --- The pictures


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
def spherical_parameterization() -> Figure:
    animals = Animals()
    morph = pointmorph.morph(
        *animals.clouds(), animals.ends(*STANDING), method="paper", domain="sphere"
    )
    share = share_of(animals.source[:, 0])
    sphere = np.asarray(morph.source_domain)
    panels = figure(2, 360, ("a closed shape", "on the unit sphere"))
    turn = np.linalg.svd(sphere.T @ animals.source)
    to_shape = turn[0] @ turn[2]
    for axes, points in zip(panels, (animals.source, sphere @ to_shape), strict=True):
        surface(axes, points @ FRONT, animals.source_triangles, share, along)
        fit(axes, points @ FRONT)
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


@picture
def path() -> Figure:
    animals = Animals()
    source, target = animals.clouds()
    morph = pointmorph.morph(source, target, animals.ends(*STANDING))
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 190, [f"t = {t:g}" for t in times])
    colors = along(share_of(animals.source[morph.pairs[:, 0], 0]))
    every = np.concatenate([morph.frame(t).positions @ FRONT for t in (0.0, 1.0)])
    for axes, t in zip(panels, times, strict=True):
        frame = morph.frame(t)
        seen, normals = frame.positions @ FRONT, frame.normals @ FRONT
        shown = np.flatnonzero(normals[:, 2] > 0)
        shown = shown[np.argsort(seen[shown, 2])]
        light = np.clip(0.5 + 0.5 * (normals[shown] @ unit(LIGHT)), 0.3, 1)[:, None]
        dots(axes, seen[shown], colors[shown] * light, 1.8, linewidths=0)
        fit(axes, every)
    return page_of(panels)


@picture
def motion() -> Figure:
    """A bar whose right half is turned up."""
    along_bar, around = np.meshgrid(np.linspace(-1, 1, 120), np.arange(24), indexing="ij")
    angle = 2 * np.pi * around / 24
    points = np.stack([along_bar, 0.13 * np.cos(angle), 0.13 * np.sin(angle)], axis=-1)
    normals = np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=-1).reshape(-1, 3)
    points = points.reshape(-1, 3)

    def bent(by: float, radius: float = 0.25) -> Array:
        x = np.clip(points[:, 0], 0, radius * by)
        a, rest = x / radius, points - np.column_stack([x, 0 * x, 0 * x])
        cos, sin = np.cos(a), np.sin(a)
        turned = np.column_stack(
            [cos * rest[:, 0] - sin * rest[:, 1], sin * rest[:, 0] + cos * rest[:, 1], rest[:, 2]]
        )
        return turned + np.column_stack([radius * sin, radius * (1 - cos), 0 * a])

    i, j = (g.ravel() for g in np.meshgrid(np.arange(119), np.arange(24), indexing="ij"))
    k = (j + 1) % 24
    triangles = np.concatenate(
        [
            np.stack([i * 24 + j, i * 24 + k, (i + 1) * 24 + k], axis=1),
            np.stack([i * 24 + j, (i + 1) * 24 + k, (i + 1) * 24 + j], axis=1),
        ]
    )
    image = bent(2.6)
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 250, [f"t = {t:g}" for t in times], rows=2)
    share = share_of(points[:, 0])
    every = np.concatenate([points, image, np.array([[1.0, 0.85, 0.0]])])
    for row, kind in enumerate(("linear", "rigid")):
        moves = pointmorph.Motion(points, normals, image, kind)
        for axes, t in zip(panels[5 * row :], times, strict=False):
            surface(axes, moves.at(t), triangles, share, along, back=True)
            fit(axes, every, 0.08)
        panels[5 * row].text(
            0.06, 0.95, kind, transform=panels[5 * row].transAxes, color=INK, fontsize=10, va="top"
        )
    return page_of(panels)


@picture
def resampling() -> Figure:
    """A bowl that breaks in two."""
    disk, _ = rings(24)
    x, y = disk.T
    source = np.column_stack([disk, 0.5 * (x**2 + y**2)])
    target = source + np.where(x > 0.15 * np.sin(5 * y), 0.28, -0.28)[:, None] * (1, 0, 0)
    pairs = np.repeat(np.arange(len(disk))[:, None], 2, axis=1)
    normals, radii = unit(np.column_stack([-x, -y, np.ones(len(x))])), np.full(len(x), 0.04)
    clouds = [pointmorph.Cloud(p, normals, radii=radii) for p in (source, target)]
    morph = pointmorph.restore(*clouds, pairs, (target, source))
    plain, filled = morph.frame(0.5), morph.resampled_frame(0.5)
    panels = figure(2, 360, ("the frame at t = 0.5", "with the points that fill its crack"))
    look = rotation(0, -0.7)
    for axes, frame in zip(panels, (plain, filled), strict=True):
        base = np.full((len(frame.positions), 3), rgb(BLUE))
        base[len(plain.positions) :] = rgb(ORANGE)
        light = np.clip(0.45 + 0.6 * np.abs(frame.normals @ look @ unit(LIGHT)), 0.3, 1)[:, None]
        dots(axes, frame.positions @ look, np.clip(base * light, 0, 1), 5.0, linewidths=0)
        fit(axes, plain.positions @ look, 0.02)
    return page_of(panels)


def reddened(distortion: Array) -> Array:
    bad = np.clip(np.floor(5 * distortion.reshape(-1, 1)) / 10, 0, 1)
    return (1 - bad) * rgb("#e3e7eb") + bad * rgb(RED)


@picture
def quality() -> Figure:
    animals = Animals()
    wrong = animals.ends("head", "left fore", "right fore", "left hind", "right hind")
    wrong["left fore"], wrong["right fore"] = (
        (wrong["left fore"][0], wrong["right fore"][1]),
        (wrong["right fore"][0], wrong["left fore"][1]),
    )
    right = animals.ends(*STANDING)
    panels = figure(2, 340, ("all marks right", "left and right exchanged at the fore feet"))
    for axes, features in zip(panels, (right, wrong), strict=True):
        found = pointmorph.morph(*animals.clouds(), features).quality
        seen = animals.source @ FRONT
        surface(axes, seen, animals.source_triangles, found.source.distortion, reddened)
        dots(axes, seen[[place.source for place in found.worst]], YELLOW, 8, edgecolors=INK)
        fit(axes, seen, 0.08)
    return page_of(panels)


# Of points whose right place is known, stated doubt and the share that is wrong; see the page.
STATED = (0.014, 0.034, 0.071, 0.140, 0.264, 0.419, 0.592, 0.828)
WRONG = (0.015, 0.026, 0.060, 0.134, 0.321, 0.495, 0.615, 0.719)
SHARE = (0.164, 0.309, 0.239, 0.143, 0.072, 0.030, 0.023, 0.020)


@picture
def local_confidence() -> Figure:
    animals = Animals()
    whole = animals.target_directions @ unit(np.array(WALKING["left fore"][0])) < 0.93
    renumbered = np.cumsum(whole) - 1
    kept = animals.target_triangles[whole[animals.target_triangles].all(axis=1)]
    target = animals.target[whole]
    morph = pointmorph.morph(pointmorph.Cloud(animals.source), pointmorph.Cloud(target))
    found = morph.measure_confidence()
    panels = figure(3, 290, ("sure (white) and in doubt (red)", "a leg is missing", ""))
    seen = animals.source @ FRONT
    surface(panels[0], seen, animals.source_triangles, found.source, doubtful)
    dots(panels[0], seen[[place.source for place in found.doubtful]], YELLOW, 8, edgecolors=INK)
    fit(panels[0], seen, 0.08)
    surface(panels[1], target @ FRONT, renumbered[kept], rgb(ORANGE) * 0.8 + 0.2)
    fit(panels[1], target @ FRONT, 0.08)
    chart = panels[2]
    chart.set_axis_on()
    chart.set_position((0.74, 0.2, 0.24, 0.72))
    chart.plot((0, 1), (0, 1), color=PALE, lw=1.2)
    chart.plot(STATED, WRONG, color=BLUE, lw=1.2)
    chart.scatter(STATED, WRONG, s=[600 * share for share in SHARE], color=BLUE, zorder=3)
    chart.set(xlim=(0, 1), ylim=(0, 1), xticks=(0, 0.5, 1), yticks=(0, 0.5, 1), aspect="equal")
    for side in ("top", "right"):
        chart.spines[side].set_visible(False)
    chart.set_xlabel("stated doubt", color=INK)
    chart.set_ylabel("share that is wrong", color=INK)
    return page_of(panels)


def doubtful(confidence: Array) -> Array:
    """White where it is sure, red where it isn't."""
    return reddened(2.0 * (1.0 - np.asarray(confidence, float)))


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


def main() -> None:
    parser = argparse.ArgumentParser(description="Draws the pictures of the stage pages.")
    parser.add_argument("stages", nargs="*", metavar="STAGE", help="all if none is named")
    parser.add_argument("--folder", type=Path, default=IMAGES)
    arguments = parser.parse_args()
    if unknown := set(arguments.stages) - set(PICTURES):
        parser.error(f"no picture of {', '.join(sorted(unknown))}; there are {', '.join(PICTURES)}")
    for stage in arguments.stages or PICTURES:
        path = arguments.folder / f"{stage}.png"
        save(PICTURES[stage](), path)
        print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
