"""Small pictures of shapes, without a renderer: points of their surface, shaded, nearest in front.

For reports. Blender draws better ones.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.meshes.geometry import triangulate
from pointmorph.morphs.morphing import Morph
from pointmorph.shapes.clouds import Cloud, FloatArray

Picture = npt.NDArray[np.uint8]
_Doubles = npt.NDArray[np.float64]

_SAMPLES = 60_000
_PAPER = 250
_LIGHT = np.array([0.35, 0.25, 0.9])
_CLAY = np.array([201.0, 171.0, 138.0])


def film(morph: Morph, size: int = 160, up: str = "z") -> Picture:
    """A strip of pictures: the source, both ends of the way between, the target.

    Parameters
    ----------
    morph : Morph
        With faces, its meshes are drawn, otherwise its points.
    size : int
        Height in pixels.
    up : str
        The axis that is up, y or z.

    Returns
    -------
    (size, 4 size, 3) array of uint8
    """
    if morph.has_mesh:
        faces = morph.source.faces
        assert faces is not None
        triangles = triangulate(morph.source.positions, *faces)[0]
        shapes = [_on_faces(morph.wrapped(t), triangles) for t in (0.0, 0.5, 1.0)]
    else:
        frames = [morph.frame(t) for t in (0.0, 0.5, 1.0)]
        shapes = [(frame.positions, frame.normals, frame.radii) for frame in frames]
    shapes.append(_shape_of(morph.target, morph))
    return np.concatenate([draw(*shape, size=size, up=up) for shape in shapes], axis=1)


def _shape_of(cloud: Cloud, morph: Morph) -> tuple[FloatArray, FloatArray, FloatArray]:
    if cloud.faces is not None and len(cloud.faces[1]):
        return _on_faces(cloud.positions, triangulate(cloud.positions, *cloud.faces)[0])
    frame = morph.frame(1.0)
    return frame.positions, frame.normals, frame.radii


def _on_faces(
    vertices: FloatArray, triangles: npt.NDArray[np.integer[Any]]
) -> tuple[_Doubles, _Doubles, _Doubles]:
    """Points of triangles, spread by area, with normals and a size that covers."""
    corners = vertices[triangles].astype(np.float64)
    sides = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(*sides)
    areas = 0.5 * np.linalg.norm(cross, axis=1)
    if not areas.sum() > 0.0:
        return (
            vertices.astype(np.float64),
            np.zeros_like(vertices, np.float64),
            np.ones(len(vertices)),
        )
    # Even steps in area, and in each triangle the R2 sequence: few holes between samples.
    steps = np.arange(_SAMPLES)
    along = np.cumsum(areas)
    chosen = np.searchsorted(along, (steps + 0.5) / _SAMPLES * along[-1])
    chosen = np.minimum(chosen, len(areas) - 1)
    u, v = ((0.5 + step * steps) % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    beyond = u + v > 1.0
    u[beyond], v[beyond] = 1.0 - u[beyond], 1.0 - v[beyond]
    places = corners[chosen, 0] + u[:, None] * sides[0][chosen] + v[:, None] * sides[1][chosen]
    normals = cross[chosen] / (2.0 * areas[chosen, None])
    return places, normals, np.full(_SAMPLES, 1.6 * np.sqrt(areas.sum() / _SAMPLES))


def draw(
    positions: FloatArray, normals: FloatArray, radii: FloatArray, *, size: int, up: str = "z"
) -> Picture:
    """One shape from its side, a little from above.

    Parameters
    ----------
    positions, normals : (N, 3) arrays
    radii : (N,) array
    size : int
        Width and height in pixels.
    up : str
        y or z.

    Returns
    -------
    (size, size, 3) array of uint8
    """
    turn = _view(up)
    places = positions.astype(np.float64) @ turn.T
    low, high = places.min(axis=0), places.max(axis=0)
    scale = 0.9 * size / max(float((high - low)[:2].max()), 1e-30)
    x, y = ((places[:, axis] - 0.5 * (low + high)[axis]) * scale + 0.5 * size for axis in (0, 1))
    shade = np.abs(normals.astype(np.float64) @ turn.T @ (_LIGHT / np.linalg.norm(_LIGHT)))
    colors = np.clip(_CLAY * (0.35 + 0.7 * shade[:, None]), 0, 255).astype(np.uint8)
    picture = np.full((size, size, 3), _PAPER, np.uint8)
    reach = np.clip(radii.astype(np.float64) * scale, 0.7, 0.03 * size)
    order = np.argsort(places[:, 2], kind="stable")  # what is nearer is painted over the rest
    column = np.rint(x[order]).astype(int)
    row = size - 1 - np.rint(y[order]).astype(int)
    nearest = _nearest(column, row, reach[order], size)
    drawn = nearest >= 0
    picture[drawn] = colors[order[nearest[drawn]]]
    return picture


def _nearest(
    column: npt.NDArray[np.int64], row: npt.NDArray[np.int64], reach: _Doubles, size: int
) -> npt.NDArray[np.int64]:
    """For each pixel the last of the points whose disc covers it; -1 where there is none.

    Only the last point in a pixel can be that for the pixels around, so those are moved about
    instead of all points; for each distance, of those points that reach so far.
    """
    most = int(reach.max())
    steps = np.arange(-most, most + 1)
    distances = steps[:, None] ** 2 + steps**2
    found = np.full((size + 2 * most, size + 2 * most), -1)
    last, count = np.empty(0, np.int64), -1
    for distance in np.unique(distances):
        there = np.flatnonzero(distance <= reach**2)
        if len(there) == 0:
            break
        if len(there) != count:
            last, count = np.full((size, size), -1), len(there)
            last[row[there], column[there]] = there  # of several, numpy keeps the last
        for down, right in np.argwhere(distances == distance):
            part = found[down : down + size, right : right + size]
            np.maximum(part, last, out=part)
    return found[most : most + size, most : most + size]


def _view(up: str) -> _Doubles:
    """Rows: what is right, up and toward the eye in the picture."""
    upward = np.array([0.0, 0.0, 1.0] if up == "z" else [0.0, 1.0, 0.0])
    eye = np.array([0.55, -1.0, 0.35] if up == "z" else [0.55, 0.35, 1.0])
    eye /= np.linalg.norm(eye)
    right = np.cross(upward, eye)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(eye, right), eye])


def png(picture: Picture) -> bytes:
    """A picture as a PNG file."""
    height, width, _ = picture.shape
    lines = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)], axis=1)
    parts: Sequence[tuple[bytes, bytes]] = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(lines.tobytes(), 6)),
        (b"IEND", b""),
    )
    content = b"\x89PNG\r\n\x1a\n"
    for kind, data in parts:
        content += struct.pack(">I", len(data)) + kind + data
        content += struct.pack(">I", zlib.crc32(kind + data))
    return content
