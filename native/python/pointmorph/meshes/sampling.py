"""Evenly sampled clouds from meshes, and thinner clouds from dense ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.errors import CloudError, OptionError
from pointmorph.base.stages import Progress
from pointmorph.meshes.geometry import boundary_loops, vertex_normals
from pointmorph.meshes.shape import Shape
from pointmorph.shapes.clouds import SIDES, Cloud
from pointmorph.shapes.features import Feature

CANDIDATES = 4
"""Random candidates per sample: more make the samples more even, and are slower."""


def sample(
    shape: Shape,
    count: int,
    seed: int = 0,
    keep: Sequence[int] | npt.NDArray[np.integer[Any]] = (),
    progress: Progress | None = None,
) -> tuple[Cloud, npt.NDArray[np.int64]]:
    """Samples a mesh by blue noise, or picks evenly spread points of a point cloud.

    Parameters
    ----------
    shape : Shape
        A mesh, whose attributes are interpolated, or a point cloud with at least `count` points.
    count : int
        Number of samples.
    seed : int
        For the random candidates. The same seed gives the same samples.
    keep : sequence of int
        Vertices that must be samples: features, for instance.
    progress : callable, optional
        As for `pointmorph.morph`.

    Returns
    -------
    cloud : Cloud
        The samples, with the type of the shape's positions. On an open mesh, samples lie evenly
        along its longest boundary, which becomes `cloud.boundary`.
    rows : (len(keep),) array of int64
        The rows of the kept vertices in the cloud.

    Raises
    ------
    CloudError, OptionError
        If the mesh has no area, a point cloud has too few points, or `count` is too small for
        what must be kept.
    """
    cloud, rows, _ = _sample(shape, count, seed, keep, progress)
    return cloud, rows


def sample_pair(
    shapes: Sequence[Shape],
    features: Mapping[str, Feature],
    count: int,
    progress: Progress | None = None,
) -> tuple[list[Cloud], dict[str, Feature]]:
    """Samples source and target, and finds the features among the samples.

    Point features become samples. So do the vertices of curves, unless they are closer together
    than samples are. Samples take their weight in a region from the vertices of their face.

    Parameters
    ----------
    shapes : sequence of Shape
        Source and target.
    features : mapping of name to Feature
        With rows of the shapes.
    count : int
        Number of samples of each shape.
    progress : callable, optional
        As for `pointmorph.morph`.

    Returns
    -------
    clouds : list of Cloud
        Source and target.
    features : dict of name to Feature
        With rows of the clouds.

    Raises
    ------
    CloudError, OptionError
        As for `sample`.
    """
    clouds: list[Cloud] = []
    marked: dict[str, dict[str, Any]] = {name: {} for name in features}
    for side, (of, shape) in enumerate(zip(SIDES, shapes, strict=True)):
        keep: list[int] = []
        places: dict[str, slice] = {}
        for name, feature in features.items():
            rows = feature.rows(side)
            if feature.kind == "curve":
                rows = _thinned_curve(shape, rows, feature.closed, count)
            elif feature.kind == "region":  # at least one of its points
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
    """The vertices of a curve without those closer together than samples: the first stays, and on
    an open curve the last."""
    if shape.faces is None:
        return rows
    area = _face_areas(shape).sum()
    ends = [*rows, rows[0]] if closed else rows
    steps = np.linalg.norm(np.diff(shape.positions[ends].astype(np.float64), axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    # A closed curve keeps at least three sides.
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
"""From values at vertices to values at samples."""


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
            f"vertices to keep from 0 to {len(shape.positions) - 1}",
            f"{kept[0]} to {kept[-1]}",
            "Check the rows of the features.",
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
            f"at least {fixed}, for the boundary and {len(kept)} vertices to keep",
            str(count),
            "Use more samples.",
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
            f"at most {len(shape.positions)}, because {shape.name} has no faces",
            str(count),
            "Use fewer samples, or a mesh.",
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
    """Values interpolated between three corners by barycentric weights."""
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
    """(count, 3) corners and barycentric weights of stratified random points, uniform by area."""
    assert shape.faces is not None
    total = np.cumsum(_face_areas(shape))
    if not (len(total) and np.isfinite(total[-1]) and total[-1] > 0.0):
        raise CloudError(shape.name, "faces with a positive area", "none", "Check the mesh.")
    random = np.random.default_rng(seed)
    place = (np.arange(count) + random.random(count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, place, side="right"), len(total) - 1)
    root, other = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1.0 - root, root * (1.0 - other), root * other], axis=-1)
    return shape.faces[face], weights


def _boundary_points(
    shape: Shape, count: int, kept: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64], list[int] | None]:
    """Points along the longest boundary, at the spacing that the samples will have.

    Returns (K, 3) corners and (K, 3) barycentric weights of the points that aren't kept vertices,
    and the whole boundary as rows of the kept vertices followed by these points.
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
    for position in on_loop:  # a kept vertex replaces the points next to it
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
