"""Draws real models wrapped onto one another, beside what the map alone makes of their vertices.

make_wrapped_pictures.py PAIRS, where PAIRS is a folder with a folder a pair: source.ply,
target.ply. Draws the pairs of `VIEWS`, or those that are named.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pointmorph
from PIL import Image, ImageDraw, ImageFont
from pointmorph import formats

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

IMAGES = Path(__file__).parent / "images"
PANEL = 320
"""Pixels, of each side."""
FINER = 3
"""Pixels are drawn so many times smaller, and averaged."""
CAPTION = 26
COLORS = 48
"""Of a page, so that its file stays small."""
BACKGROUND, INK, EDGE = (246, 246, 244), (45, 46, 50), (48, 58, 78)
FRONT, BACK = (150, 180, 215), (215, 120, 90)
"""Of faces that show their outside, and of those that show their inside: folds."""
LIGHT = np.array([-0.3, 0.5, 0.8])
"""From the camera: right, up, toward the eye."""


@dataclass(frozen=True)
class View:
    """From where to look, and at what: a place as shares of the target's box, or all of it."""

    around: float
    """degrees about the vertical axis; 0 looks against z"""
    above: float = 0.0
    place: tuple[float, float, float] | None = None
    width: float = 1.0
    """of the target's height"""


VIEWS = {
    "koala_spot": (
        View(215, 10),
        View(35, 10),
        View(190, 10, (0.5, 0.8, 0.1), 0.5),
        View(225, 15, (0.2, 0.85, 0.2), 0.3),
    ),
    "man_woman": (
        View(0),
        View(150),
        View(75, 0, (0.56, 0.93, 0.6), 0.1),
        View(0, 35, (0.95, 0.83, 0.5), 0.16),
    ),
    "nefertiti_demosthenes": (
        View(20),
        View(-35),
        View(0, 0, (0.3, 0.6, 0.8), 0.4),
        View(0, 0, (0.5, 0.3, 0.9), 0.4),
    ),
}


def turned(view: View) -> Array:
    """Rows: right, up, toward the eye."""
    a, e = np.radians((view.around, view.above))
    around = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    above = np.array([[1, 0, 0], [0, np.cos(e), -np.sin(e)], [0, np.sin(e), np.cos(e)]])
    result: Array = above @ around
    return result


def drawn(positions: Array, triangles: Rows, box: Array, view: View) -> Image.Image:
    """The faces with their edges, from far to near."""
    axes = turned(view)
    low, high = box
    place = np.array(view.place if view.place else (0.5, 0.5, 0.5))
    middle = axes @ (low + place * (high - low))
    width = view.width * (high - low)[1] if view.place else 1.15 * (high - low).max()
    size = PANEL * FINER
    corners = (positions @ axes.T)[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    shade = np.clip(0.35 + 0.6 * np.maximum(0.0, normals @ LIGHT), 0.0, 1.0)
    colors = np.where(normals[:, 2:] > 0.0, FRONT, BACK) * shade[:, None]
    pixels = (corners[:, :, :2] - middle[:2]) * (1, -1) / width * size + size / 2
    seen = (pixels.max(axis=1) > 0).all(axis=1) & (pixels.min(axis=1) < size).all(axis=1)
    side = np.median(np.linalg.norm(pixels[seen][:, 1] - pixels[seen][:, 0], axis=1))
    image = Image.new("RGB", (size, size), BACKGROUND)
    pen = ImageDraw.Draw(image)
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    for face in order[seen[order]]:
        outline = [(float(x), float(y)) for x, y in pixels[face]]
        red, green, blue = (int(value) for value in colors[face])
        pen.polygon(outline, fill=(red, green, blue))
        if side > 4 * FINER:
            pen.line([*outline, outline[0]], fill=EDGE, width=1 if side < 12 * FINER else 2)
    return image.resize((PANEL, PANEL), Image.Resampling.LANCZOS)


def sheet(rows: Sequence[Sequence[Image.Image]], titles: Sequence[str]) -> Image.Image:
    page = Image.new("RGB", (PANEL * len(titles), CAPTION + PANEL * len(rows)), BACKGROUND)
    pen = ImageDraw.Draw(page)
    font = ImageFont.load_default(16)
    for column, title in enumerate(titles):
        pen.text((PANEL * (column + 0.5), CAPTION / 2), title, fill=INK, font=font, anchor="mm")
        for row, images in enumerate(rows):
            page.paste(images[column], (PANEL * column, CAPTION + PANEL * row))
    return page


def read(path: Path) -> tuple[Array, Rows]:
    shape = formats.read(path)
    corners = np.asarray(shape.faces, dtype=np.int64)
    return np.asarray(shape.positions, dtype=np.float64), corners


def page_of(folder: Path, views: Sequence[View]) -> Image.Image:
    (source, triangles), (target, others) = (
        read(folder / name) for name in ("source.ply", "target.ply")
    )
    alone = pointmorph.morph(pointmorph.Cloud(source), pointmorph.Cloud(target))
    before = np.asarray(alone.source_to_target)
    morph = pointmorph.morph(
        pointmorph.Cloud(source, faces=triangles), pointmorph.Cloud(target, faces=others)
    )
    after = np.asarray(morph.wrapped(1.0))
    box = np.array([target.min(axis=0), target.max(axis=0)])
    rows = [
        [
            drawn(before, triangles, box, view),
            drawn(after, triangles, box, view),
            drawn(target, others, box, view),
        ]
        for view in views
    ]
    return sheet(rows, ("vertices mapped one by one", "wrapped", "the target"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Draws models wrapped onto one another.")
    parser.add_argument("pairs", type=Path, metavar="PAIRS", help="a folder with a folder a pair")
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if none is named")
    parser.add_argument("--folder", type=Path, default=IMAGES)
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(VIEWS):
        parser.error(f"no views of {', '.join(sorted(unknown))}; there are {', '.join(VIEWS)}")
    for name in arguments.names or VIEWS:
        path = arguments.folder / f"wrapped_{name}.png"
        page = page_of(arguments.pairs / name, VIEWS[name])
        page.quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
