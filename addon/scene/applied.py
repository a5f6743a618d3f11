"""Transforms that the user applied to a morph object (Ctrl+A). Blender puts them into its points
and shape keys, but not into what the morph knows besides, such as normals and curved ways.
"""

import json

import numpy as np

from ..core import remembered, transforms
from ..data import arrays
from . import morph_object

_TOLERANCE = 1e-5  # of the largest coordinate: what Blender rounds
_DIRECTIONS = np.array(
    [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1)], np.float64
)


def note(obj):
    """Notes where a few points of a morph object are at its first and its last shape, also for
    those that share them: by these, `matrix_of` knows what was applied since."""
    noted = json.dumps([_farthest(arrays.key_positions(key)) for key in _ends(obj)])
    for user in morph_object.users_of(obj):
        user.pointmorph.noted = noted


def matrix_of(obj):
    """(4, 4): what was applied to a morph object since it was made, or None: from where its points
    were to where they are."""
    noted = remembered.noted(obj.pointmorph.noted)
    if noted is None or obj.data.shape_keys is None or obj.data.is_editmode:
        return None
    before, now = [], []
    for key, places in zip(_ends(obj), noted, strict=True):
        if key is None or any(row >= len(key.data) for row, *_ in places):
            return None
        before += [place for _, *place in places]
        now += [key.data[row].co for row, *_ in places]
    return _between(np.array(before), np.array(now, np.float64))


def matrix_of_start(obj, start):
    """The same of a morph object that has lost shape keys, by its vertices at the first shape."""
    found = noted_at_start(obj, start)
    return None if found is None else _between(*found)


def noted_at_start(obj, start):
    """Where the few points of the first shape were, and where they are in `start`, (N, 3) arrays;
    None where that isn't known."""
    noted = remembered.noted(obj.pointmorph.noted)
    if noted is None or any(row >= len(start) for row, *_ in noted[0]):
        return None
    before = np.array([place for _, *place in noted[0]])
    return before, start[[row for row, *_ in noted[0]]].astype(np.float64)


def _between(before, now):
    """(4, 4): the transform from some points to others; None where it is none, or no transform."""
    room = _TOLERANCE * max(np.abs(before).max(), np.abs(now).max())
    if np.abs(now - before).max() <= room:
        return None
    matrix = _fitted(before, now)
    # Otherwise the points themselves were edited.
    fits = matrix is not None and np.abs(transforms.apply(matrix, before) - now).max() <= room
    return matrix if fits else None


def _ends(obj):
    """The shape keys of the first and the last shape; None for one that is gone."""
    keys = obj.data.shape_keys
    return keys.reference_key, keys.key_blocks.get(morph_object.morph_keys(obj)[-1])


def _farthest(positions):
    """Points that lie far out in several directions: row and place of each."""
    heights = _DIRECTIONS @ positions.T.astype(np.float64)  # a row each is sought much faster
    rows = sorted({*heights.argmin(axis=1).tolist(), *heights.argmax(axis=1).tolist()})
    return [[row, *map(float, positions[row])] for row in rows]


def _fitted(before, now):
    """(4, 4): the affine map from some points to others; None where they lie in a line."""
    center, center_now = before.mean(axis=0), now.mean(axis=0)
    before, now = before - center, now - center_now
    _, spreads, axes = np.linalg.svd(before)
    if spreads[1] <= 1e-4 * spreads[0]:
        return None
    linear = np.linalg.lstsq(before, now, rcond=1e-4)[0].T
    if spreads[2] <= 1e-4 * spreads[0]:  # flat: nothing tells what became of its normal
        normal = np.cross(linear @ axes[0], linear @ axes[1])
        normal *= np.linalg.det(axes) / max(np.linalg.norm(normal) ** 0.5, 1e-30)
        linear += np.outer(normal, axes[2])
    if abs(np.linalg.det(linear)) < 1e-30:
        return None
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = center_now - linear @ center
    return matrix
