"""Pictures of maps: a chequered source, and what each map makes of the chequers on the target.

The pattern is projected from the camera, so on the source it is a perfect grid, and whatever is
bent, torn or smeared on a target is the map's doing. Hues tell places apart: a limb in the wrong
hue has been taken for another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from compare_measures import Floats, Ints, Surface, representatives, similarity
from PIL import Image, ImageDraw, ImageFont
from pointmorph.meshes import Shape, sampling
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from compare_peers import Input

SPLATS = 250_000
"""Points that a mesh is drawn with."""
PANEL = 300
"""Pixels, of a panel's longer side."""
FINER = 3
"""Pixels are drawn so many times smaller, and averaged."""
COLUMNS = 3
CAPTION = 30
CELLS = 22
"""Chequers across the source's longer side."""
BACKGROUND, INK = (246, 246, 244), (45, 46, 50)
INSIDE = 0.55
"""Grey of the inside, where an open patch shows it."""
LIGHT = np.array([-0.35, 0.55, 0.76])
"""From the camera: right, up, toward the eye."""


@dataclass(frozen=True)
class Drawn:
    """Points to draw, in the camera's frame: x right, y up, z toward the eye."""

    positions: Floats
    normals: Floats


def sheet(
    given: Input,
    maps: Mapping[str, Ints],
    folder: Path,
    view: Sequence[float] | None,
    up: str,
) -> Path:
    """Draws the source and, for each map by title, the target with the source's pattern.

    Parameters
    ----------
    view : (3,), optional
        From where to look, in the source's coordinates. Across its two longest sides by default.
    up : str
        x, y or z: the source's axis that points up in the picture.

    Returns
    -------
    Path
        Of the PNG.
    """
    pair = given.pair
    source, target = (
        Surface.of(cloud, shape)
        for cloud, shape in zip((pair.source, pair.target), given.shapes, strict=True)
    )
    scale, turn, shift = 1.0, np.eye(3), np.zeros(3)
    if len(pair.marks) >= 3:
        marked = target.positions[pair.marks[:, 1]], source.positions[pair.marks[:, 0]]
        scale, turn, shift = similarity(*marked)
    axes = camera(source, view, "xyz".index(up))
    own, other = (dense(shape) for shape in given.shapes)
    other = Drawn(scale * other.positions @ turn.T + shift, other.normals @ turn.T)
    own, other = (Drawn(d.positions @ axes.T, d.normals @ axes.T) for d in (own, other))
    seen_source = source.positions @ axes.T
    seen_target = (scale * target.positions @ turn.T + shift) @ axes.T
    low, high = seen_source.min(axis=0), seen_source.max(axis=0)

    panels = [("source", draw(own, pattern(own.positions, low, high)))]
    for title, pairs in maps.items():
        rows = representatives(pairs[:, 1], len(seen_target), np.random.default_rng(0))
        held = np.flatnonzero(rows >= 0)
        partners = seen_source[pairs[rows[held], 0]]
        normals = target.normals[held] @ turn.T @ axes.T
        places = carried(other, seen_target[held], normals, partners)
        panels.append((title.replace("`", ""), draw(other, pattern(places, low, high))))

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{given.shapes[0].name}_to_{given.shapes[1].name}.png"
    # 8 bits a pixel: a third of the size, and no difference to the eye.
    composed(panels).quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    return path


def camera(source: Surface, view: Sequence[float] | None, up: int) -> Floats:
    """(3, 3) rows: right, up and toward the eye."""
    upward = np.eye(3)[up]
    if view is None:
        spread = source.positions - source.positions.mean(axis=0)
        spread = spread - np.outer(spread @ upward, upward)
        # The least axis but one: the least is `upward` itself, along which nothing is left.
        toward = np.linalg.svd(spread, full_matrices=False)[2][1]
        if source.normals.mean(axis=0) @ toward < 0:  # an open patch shows its face
            toward = -toward
    else:
        toward = np.asarray(view, np.float64)
    toward = toward / np.linalg.norm(toward)
    right = np.cross(upward, toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def dense(shape: Shape) -> Drawn:
    """Enough points to look like a surface; a bare cloud as it is."""
    if shape.faces is None:
        cloud = shape.cloud()
    else:
        cloud, _ = sampling.sample(shape, max(SPLATS, 2 * len(shape.positions)))
    surface = Surface.of(cloud, Shape(shape.name, shape.positions))
    return Drawn(surface.positions, surface.normals)


def carried(drawn: Drawn, points: Floats, normals: Floats, partners: Floats) -> Floats:
    """Where drawn points go, by the partners of nearby points of the cloud on the same sheet."""
    distances, near = cKDTree(points).query(drawn.positions, 6, workers=-1)
    # Points that are drawn where the cloud has one count for all, and most may be.
    width = max(np.median(distances[:, 0]) * 2, np.median(distances[:, -1]) * 1e-2)
    weights = np.exp(-((distances / width) ** 2)) + 1e-12
    same = (normals[near] * drawn.normals[:, None]).sum(axis=2) > 0.2
    weights *= np.where(same.any(axis=1, keepdims=True), np.maximum(same, 1e-6), 1.0)
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray((partners[near] * weights[..., None]).sum(axis=1))


def pattern(places: Floats, low: Floats, high: Floats) -> Floats:
    """(N, 3) colours, 0 to 1, of places on the source that spans `low` to `high`."""
    cells = np.floor((places[:, :2] - low[:2]) / (high - low)[:2].max() * CELLS)
    share = np.clip((places - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
    x, y, z = share.T
    # Around the circle of hues along x; y and z shift it, so that no two limbs look alike.
    angle = 2 * np.pi * (0.75 * x + 0.15 * y + 0.2 * z)[:, None]
    hues = 0.52 + 0.4 * np.cos(angle - 2 * np.pi / 3 * np.arange(3))
    light = (cells.sum(axis=1) % 2 == 0)[:, None]
    return np.asarray(np.where(light, 0.25 * hues + 0.75, 0.9 * hues))


def draw(drawn: Drawn, colors: Floats) -> Image.Image:
    """The points as discs, the nearest in front, with a soft light."""
    size = PANEL * FINER
    low, high = drawn.positions.min(axis=0), drawn.positions.max(axis=0)
    scale = 0.94 * size / (high - low)[:2].max()
    middle = (low + high) / 2
    height = math.ceil((high - low)[1] * scale / 0.94)
    width = math.ceil((high - low)[0] * scale / 0.94)
    places = (drawn.positions - middle)[:, :2] * [scale, -scale] + [width / 2, height / 2]
    facing = drawn.normals @ (LIGHT / np.linalg.norm(LIGHT))
    shade = 0.6 + 0.4 * np.clip(facing, 0.0, 1.0)
    colors = np.where(drawn.normals[:, 2:] < 0, INSIDE, colors)
    order = np.argsort(drawn.positions[:, 2])  # the last one drawn is in front

    step = np.median(cKDTree(drawn.positions).query(drawn.positions[:5000], 2)[0][:, 1]) * scale
    reach = np.arange(-math.ceil(step), math.ceil(step) + 1)
    across, down = (offset.ravel() for offset in np.meshgrid(reach, reach))
    disc = across**2 + down**2 <= (step + 0.5) ** 2
    columns = np.floor(places[order, :1]).astype(int) + across[disc]
    rows = np.floor(places[order, 1:]).astype(int) + down[disc]
    inside = (0 <= columns) & (columns < width) & (0 <= rows) & (rows < height)
    front = np.full((height, width), -1)
    front[rows[inside], columns[inside]] = np.broadcast_to(order[:, None], rows.shape)[inside]

    picture: npt.NDArray[np.float64] = np.full((height, width, 3), BACKGROUND, np.float64)
    hit = front >= 0
    picture[hit] = 255 * (colors * shade[:, None])[front[hit]]
    image = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    smaller = (max(width // FINER, 1), max(height // FINER, 1))
    return image.resize(smaller, Image.Resampling.BOX)


def composed(panels: Sequence[tuple[str, Image.Image]]) -> Image.Image:
    """The panels in rows, each above its caption."""
    width = max(image.width for _, image in panels) + 12
    height = max(image.height for _, image in panels) + CAPTION
    columns = min(COLUMNS, len(panels))
    lines = math.ceil(len(panels) / columns)
    result = Image.new("RGB", (columns * width, lines * height), BACKGROUND)
    pen, font = ImageDraw.Draw(result), ImageFont.load_default(size=15)
    for number, (caption, image) in enumerate(panels):
        left, top = number % columns * width, number // columns * height
        room = height - CAPTION - image.height
        result.paste(image, (left + (width - image.width) // 2, top + room // 2))
        place = (left + width / 2, top + height - CAPTION / 2)
        pen.text(place, caption, font=font, fill=INK, anchor="mm")
    return result
