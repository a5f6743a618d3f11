"""Even clouds from meshes (and thinner clouds from dense ones)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.clouds import Cloud
from pointmorph.errors import CloudError, OptionError
from pointmorph.features import Feature
from pointmorph.formats import Shape
from pointmorph.meshes import boundary_loops, vertex_normals
from pointmorph.morphing import Progress

CANDIDATES = 4
"""Random candidates for every point that is kept: more are evener and slower."""


def sample(
    shape: Shape,
    count: int,
    seed: int = 0,
    keep: Sequence[int] | npt.NDArray[np.integer[Any]] = (),
    progress: Progress | None = None,
) -> tuple[Cloud, npt.NDArray[np.int64]]:
    """Blue noise on the faces of a mesh, or `count` evenly spread points of a bare cloud.

    Parameters
    ----------
    shape : Shape
        A mesh, whose attributes are interpolated, or a cloud with at least `count` points.
    count : int
        Points that the sample has.
    seed : int
        Of the random candidates; the same seed gives the same sample.
    keep : sequence of int
        Vertices that must be in the sample, features for instance.
    progress : callable, optional
        As for `pointmorph.morph`.

    Returns
    -------
    cloud : Cloud
        The sample, in float32 where the shape is. On an open mesh points lie evenly along its
        longest boundary, which the cloud hands over.
    rows : (len(keep),) array of int64
        Where the kept vertices are in the cloud.

    Raises
    ------
    CloudError, OptionError
        For a mesh without area, a cloud with too few points, or a count below what must be kept.
    """
    cloud, rows, _ = _sample(shape, count, seed, keep, progress)
    return cloud, rows


def sample_pair(
    shapes: Sequence[Shape],
    features: Mapping[str, Feature],
    count: int,
    progress: Progress | None = None,
) -> tuple[list[Cloud], dict[str, Feature]]:
    """Source and target with `count` points each, and the features among these.

    Points, and the marked vertices of curves as far as samples are apart, stay; samples belong to a
    region as far as the faces that they lie on do. See `sample` for what is raised.
    """
    clouds: list[Cloud] = []
    marked: dict[str, dict[str, Any]] = {name: {} for name in features}
    for side, (of, shape) in enumerate(zip(("source", "target"), shapes, strict=True)):
        keep: list[int] = []
        places: dict[str, slice] = {}
        for name, feature in features.items():
            rows = feature.rows(side)
            if feature.kind == "curve":
                rows = _thinned_curve(shape, rows, feature.closed, count)
            elif feature.kind == "region":  # one of it at least
                rows = rows[:1] if not (w := feature.weights(side)) else [rows[int(np.argmax(w))]]
            places[name] = slice(len(keep), len(keep) + len(rows))
            keep += rows
        cloud, kept, mixed = _sample(shape, count, 0, keep, progress)
        clouds.append(cloud)
        for name, feature in features.items():
            rows = kept[places[name]].tolist()
            if feature.kind == "region":
                vertices = np.zeros(len(shape.positions))
                vertices[feature.rows(side)] = feature.weights(side) or 1.0
                weights = mixed(vertices)
                rows = np.flatnonzero(weights).tolist()
                marked[name][f"{of}_weights"] = np.clip(weights[rows], 0.0, 1.0).tolist()
            marked[name][of] = rows[0] if feature.kind == "point" else rows
    return clouds, {name: replace(features[name], **fields) for name, fields in marked.items()}


def _thinned_curve(shape: Shape, rows: list[int], closed: bool, count: int) -> list[int]:
    """The curve's first vertex, its last if it's open, and those between that lie apart."""
    if shape.faces is None:
        return rows
    area = _face_areas(shape).sum()
    ends = [*rows, rows[0]] if closed else rows
    steps = np.linalg.norm(np.diff(shape.positions[ends].astype(np.float64), axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    # Three sides at least are left of a closed curve.
    apart = min(np.sqrt(area / count), along[-1] / 4)
    result, last = [rows[0]], 0.0
    for row, place in zip(rows[1:], along[1:], strict=False):
        if place - last >= apart and along[-1] - place >= apart:
            result.append(row)
            last = place
    if not closed:
        result.append(rows[-1])
    return result if len(result) >= (3 if closed else 2) else rows


Mixed = Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
"""From values at the vertices to those at the samples."""


def _sample(
    shape: Shape,
    count: int,
    seed: int,
    keep: Sequence[int] | npt.NDArray[np.integer[Any]],
    progress: Progress | None,
) -> tuple[Cloud, npt.NDArray[np.int64], Mixed]:
    kept, rows_of_kept = np.unique(np.asarray(keep, np.int64), return_inverse=True)
    if len(kept) and not (0 <= kept[0] and kept[-1] < len(shape.positions)):
        raise CloudError(
            shape.name,
            f"vertices 0 to {len(shape.positions) - 1} to keep",
            f"{kept[0]} to {kept[-1]}",
            "Check the features' rows.",
        )
    if shape.faces is None:
        cloud, taken = _thinned(shape, count, kept, progress)
        return cloud, rows_of_kept.astype(np.int64), lambda values: values[taken]

    drawn_corners, drawn_weights = _random_points(shape, CANDIDATES * count, seed)
    corners, weights, boundary = _boundary_points(shape, count, kept)
    corners = np.concatenate([_repeated(kept), corners, drawn_corners])
    weights = np.concatenate([_first_corner(len(kept)), weights, drawn_weights])
    fixed = len(corners) - len(drawn_corners)
    if count < fixed:
        raise OptionError(
            "samples",
            f"at least {fixed} points, for the boundary and {len(kept)} vertices to keep",
            str(count),
            "Ask for more samples.",
        )
    normals = shape.normals
    if normals is None:
        normals = vertex_normals(shape.positions, shape.faces)

    positions = _mixed(shape.positions, corners, weights)
    blended = _mixed(normals, corners, weights)
    blended /= np.maximum(np.linalg.norm(blended, axis=1, keepdims=True), 1e-30)
    chosen = _pointmorph.blue_noise(positions, blended, count, np.arange(fixed), progress)
    dtype = shape.positions.dtype

    def blend(values: npt.NDArray[Any] | None) -> npt.NDArray[Any] | None:
        if values is None:
            return None
        return _mixed(values, corners[chosen], weights[chosen]).astype(dtype)

    cloud = Cloud(
        positions[chosen].astype(dtype),
        blended[chosen].astype(dtype),
        blend(shape.colors),
        blend(shape.radii),
        name=shape.name,
        boundary=boundary,
    )
    return (
        cloud,
        rows_of_kept.astype(np.int64),
        lambda values: _mixed(values, corners[chosen], weights[chosen]),
    )


def _thinned(
    shape: Shape, count: int, kept: npt.NDArray[np.int64], progress: Progress | None
) -> tuple[Cloud, npt.NDArray[np.int64]]:
    if count > len(shape.positions):
        raise OptionError(
            "samples",
            f"at most {len(shape.positions)}, the points of {shape.name}, which has no faces",
            str(count),
            "Ask for fewer samples, or give a mesh.",
        )
    chosen = _pointmorph.blue_noise(shape.positions, shape.normals, count, kept, progress)

    def rows(values: npt.NDArray[Any] | None) -> npt.NDArray[Any] | None:
        return None if values is None else values[chosen]

    cloud = Cloud(
        shape.positions[chosen],
        rows(shape.normals),
        rows(shape.colors),
        rows(shape.radii),
        name=shape.name,
    )
    return cloud, chosen


def _repeated(vertices: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.repeat(vertices[:, None], 3, axis=1)


def _first_corner(count: int) -> npt.NDArray[np.float64]:
    return np.tile([1.0, 0.0, 0.0], (count, 1))


def _mixed(
    values: npt.NDArray[Any], corners: npt.NDArray[np.int64], weights: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Barycentric mean of the values at three corners."""
    result = np.zeros((len(corners), *values.shape[1:]))
    for k in range(3):
        result += weights[:, k].reshape(-1, *[1] * (values.ndim - 1)) * values[corners[:, k]]
    return result


def _face_areas(shape: Shape) -> npt.NDArray[np.float64]:
    assert shape.faces is not None
    a, b, c = (shape.positions[shape.faces[:, k]].astype(np.float64) for k in range(3))
    areas: npt.NDArray[np.float64] = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _random_points(
    shape: Shape, count: int, seed: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Corners and barycentric weights of points that are uniform by area, stratified."""
    assert shape.faces is not None
    total = np.cumsum(_face_areas(shape))
    if not (len(total) and np.isfinite(total[-1]) and total[-1] > 0.0):
        raise CloudError(shape.name, "faces with an area", "none", "Check the mesh.")
    random = np.random.default_rng(seed)
    place = (np.arange(count) + random.random(count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, place, side="right"), len(total) - 1)
    root, other = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1.0 - root, root * (1.0 - other), root * other], axis=-1)
    return shape.faces[face], weights


def _boundary_points(
    shape: Shape, count: int, kept: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], list[int] | None]:
    """Points along the longest boundary at the spacing that the sample will have.

    Returns corners and weights of the points that aren't kept vertices, and the whole boundary as
    rows of (kept vertices, these points).
    """
    assert shape.faces is not None
    none = np.empty((0, 3), np.int64), np.empty((0, 3)), None
    loops = boundary_loops(shape.faces, len(shape.positions))
    if not loops:
        return none
    lengths = [
        np.linalg.norm(shape.positions[x] - shape.positions[np.roll(x, -1)], axis=1) for x in loops
    ]
    longest = int(np.argmax([length.sum() for length in lengths]))
    loop, steps = loops[longest], lengths[longest]
    along = np.concatenate([[0.0], np.cumsum(steps)])

    spacing = np.sqrt(_face_areas(shape).sum() / count)
    number = int(max(np.ceil(along[-1] / spacing), 8))
    even = np.arange(number) * along[-1] / number

    on_loop = np.flatnonzero(np.isin(loop, kept))
    for position in on_loop:  # a kept vertex stands for the points next to it
        gap = np.abs(even - along[position])
        even = even[np.minimum(gap, along[-1] - gap) > 0.5 * spacing]
    segment = np.minimum(np.searchsorted(along, even, side="right") - 1, len(loop) - 1)
    share = (even - along[segment]) / np.maximum(steps[segment], 1e-300)
    start, end = loop[segment], np.roll(loop, -1)[segment]
    corners = np.stack([start, end, end], axis=-1)
    weights = np.stack([1.0 - share, share, np.zeros_like(share)], axis=-1)

    rows = np.concatenate([np.searchsorted(kept, loop[on_loop]), len(kept) + np.arange(len(even))])
    order = np.argsort(np.concatenate([along[on_loop], even]), kind="stable")
    return corners, weights, [int(row) for row in rows[order]]
