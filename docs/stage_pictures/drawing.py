"""How the pictures are drawn: one palette, surfaces, curves, points, files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial import cKDTree

from stage_pictures.shapes import Array, Rows, rotation, unit

IMAGES = Path(__file__).resolve().parents[1] / "images"


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
    """A shaded surface, far triangles first. `color` is one, or one a triangle, or, with `paint`,
    values of points."""
    corners = seen[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    shown = np.flatnonzero((normals[:, 2] > 0) | back)
    corners, normals = corners[shown], normals[shown]
    if paint is None:
        base = np.broadcast_to(color, (len(triangles), 3))[shown]
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


def numbered(axes: Axes, at: Array, text: str, color: str) -> None:
    """A disc with a number."""
    dots(axes, at[None], color, 15)
    ink = INK if color == YELLOW else "white"
    axes.annotate(
        text, at[:2], color=ink, ha="center", va="center_baseline", fontsize=9, weight="bold",
        zorder=5,
    )  # fmt: skip


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
