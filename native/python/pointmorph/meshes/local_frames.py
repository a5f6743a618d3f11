"""What a map does to directions on a surface, at every point of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pointmorph.meshes.geometry import check_triangles, nearest_rows

Floats = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

_NEIGHBORS = 12  # for differentials, where there are no faces
_REACH_OF_FRAMES = 0.04  # of √area: how far away differentials are averaged
_CELLS_AROUND, _NEAREST_CELLS = 24, 6
_COLLAPSED, _SOUND = 0.2, 0.5  # least stretch, of the usual one: to be ignored, and to be trusted
_OTHERWISE, _ALIKE = 0.25, 0.7  # cosines of turns against those around


def local_frames(
    positions: npt.ArrayLike, images: npt.ArrayLike, faces: npt.ArrayLike | None = None
) -> Floats:
    """The differential of a map at each point: what it does to directions.

    Parameters
    ----------
    positions, images : (N, 3) array_like
        Points, and where the map takes them.
    faces : (F, 3) array_like of int, optional
        Triangles. Without them, the nearest points tell what lies in the surface.

    Returns
    -------
    (N, 3, 3) array
        Matrices that take directions in the surface as the map does, and the normal to the normal
        there, by the square root of how much areas grow. They are means over 0.04 √area around,
        turns and stretches each by themselves, because maps of real shapes are uneven.
    """
    start, end = np.asarray(positions, np.float64), np.asarray(images, np.float64)
    triangles = check_triangles(faces)
    if triangles is None:
        pieces = _pieces_of_neighbors(start, end)
    else:
        pieces = _pieces_of_triangles(start, end, triangles)
    turns = np.tile(np.eye(3), (len(start), 1, 1))
    stretches = turns
    # From far to near: what is known close by counts the more, the better it's known.
    for times in (16.0, 4.0, 1.0) if len(pieces.weights) else ():
        if times == 1.0:
            pieces = _agreeing(pieces, _turn(turns)[nearest_rows(start, pieces.places, 1)[:, 0]])
        reach = times * pieces.reach
        cells = _smoothed(_gathered(pieces, reach), reach)
        near = nearest_rows(cells.places, start, min(_NEAREST_CELLS, len(cells.weights)))
        away = ((cells.places[near] - start[:, None]) ** 2).sum(axis=2)
        least = away.min(axis=1, keepdims=True)
        spread = np.maximum((reach / 2) ** 2, np.maximum(least, 1e-300))
        shares = np.exp(-(away - least) / (2 * spread))
        own_turns, own_stretches, known = _mixed(cells, near, shares)
        known = known[:, None, None]
        turns = known * own_turns + (1.0 - known) * turns
        stretches = known * own_stretches + (1.0 - known) * stretches
    frames: Floats = _turn(turns) @ stretches
    return frames


@dataclass(frozen=True)
class _Pieces:
    """What a map does to small pieces of a surface: how it turns each, and how it stretches each
    before, both (P, 3, 3).

    `trust` is how much of the weight is known: nothing where the map has collapsed, as in the
    pocket of a mouth that the other shape hasn't got. `reach` is how far away differentials are
    averaged.
    """

    places: Floats
    weights: Floats
    trust: Floats
    turns: Floats
    stretches: Floats
    reach: float


def _pieces_of_triangles(start: Floats, end: Floats, triangles: Rows) -> _Pieces:
    before, after = (
        np.stack([rows[triangles[:, k]] - rows[triangles[:, 0]] for k in (1, 2)], axis=2)
        for rows in (start, end)
    )
    _, area = _across(before)
    sides = np.einsum("fji,fjk->fik", before, before)
    good = area > 1e-10 * np.trace(sides, axis1=1, axis2=2)
    reach = _REACH_OF_FRAMES * float(np.sqrt(0.5 * area[good].sum()))
    places = start[triangles[good]].mean(axis=1)
    return _pieces(places, area[good], before[good], after[good], reach)


def _pieces_of_neighbors(start: Floats, end: Floats) -> _Pieces:
    near = nearest_rows(start, start, min(_NEIGHBORS, len(start)))
    before, after = (rows[near] - rows[:, None] for rows in (start, end))
    away = np.einsum("nki,nki->nk", before, before)
    farthest = np.maximum(away.max(axis=1, keepdims=True), 1e-300)
    weighted = before * ((1.0 - away / (1.1 * farthest)) ** 2)[:, :, None]
    sizes, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", weighted, before))
    known = sizes[:, 1] > 1e-6 * np.maximum(sizes[:, 2], 1e-300)
    plane = axes[known][:, :, 1:]
    moved = np.einsum("nki,nkj->nij", after[known], weighted[known])
    moved = moved @ plane / sizes[known][:, None, 1:]
    reach = float(np.sqrt(farthest.mean()))
    return _pieces(start[known], np.ones(len(plane)), plane, moved, reach)


def _pieces(
    places: Floats, weights: Floats, before: Floats, after: Floats, reach: float
) -> _Pieces:
    """From two sides of each piece, (P, 3, 2), before and after."""
    across, area = _across(before)
    onto, area_there = _across(after)
    grown = np.sqrt(area_there / area)[:, None] * onto
    basis = np.concatenate([before, across[:, :, None]], axis=2)
    frames = np.concatenate([after, grown[:, :, None]], axis=2) @ np.linalg.inv(basis)
    _, sizes, right = np.linalg.svd(frames)
    usual = float(np.median(sizes[:, 1])) if len(sizes) else 1.0
    known = (sizes[:, 2] / max(usual, 1e-300) - _COLLAPSED) / (_SOUND - _COLLAPSED)
    trust = weights * np.clip(known, 0.0, 1.0)
    stretches = np.einsum("pji,pj,pjk->pik", right, sizes, right)
    return _Pieces(places, weights, trust, _turn(frames), stretches, reach)


def _turn(matrices: Floats) -> Floats:
    """(N, 3, 3): the rotations that are the closest to matrices."""
    left, _, right = np.linalg.svd(matrices)
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    turns: Floats = left @ right
    return turns


def _agreeing(pieces: _Pieces, around: Floats) -> _Pieces:
    """The same with less trust in those that turn otherwise than what lies around, as in the
    wrinkles of a map."""
    cosine = 0.5 * (np.einsum("nij,nij->n", pieces.turns, around) - 1.0)
    agreed = np.clip((cosine - _OTHERWISE) / (_ALIKE - _OTHERWISE), 0.0, 1.0)
    return replace(pieces, trust=pieces.trust * agreed)


def _gathered(pieces: _Pieces, reach: float) -> _Pieces:
    """The means of pieces that lie close to each other."""
    step = reach / 2 or 1.0
    corner = pieces.places.min(axis=0)
    key = np.minimum(np.floor((pieces.places - corner) / step), 2.0**20).astype(np.int64)
    _, cell = np.unique((key[:, 0] * 2**21 + key[:, 1]) * 2**21 + key[:, 2], return_inverse=True)
    cell = cell.reshape(-1)
    count = int(cell.max()) + 1

    def sums(values: Floats, weights: Floats) -> Floats:
        flat = values.reshape(len(values), -1)
        found: Floats = np.empty((count, flat.shape[1]))
        for k, column in enumerate(flat.T):
            found[:, k] = np.bincount(cell, weights * column, count)
        return found.reshape(count, *values.shape[1:])

    one = np.ones((len(cell), 1))
    weights, trust = sums(one, pieces.weights)[:, 0], sums(one, pieces.trust)[:, 0]
    known = np.maximum(trust, 1e-300)[:, None, None]
    stretches = sums(pieces.stretches, pieces.trust) / known
    turns = sums(pieces.turns, pieces.trust) / known
    places = sums(pieces.places, pieces.weights) / weights[:, None]
    return _Pieces(places, weights, trust, turns, stretches, reach)


def _smoothed(cells: _Pieces, reach: float) -> _Pieces:
    """Each with those around it."""
    near = nearest_rows(cells.places, cells.places, min(_CELLS_AROUND, len(cells.places)))
    away = ((cells.places[near] - cells.places[:, None]) ** 2).sum(axis=2)
    shares = np.exp(-away / (2 * max((reach / 2) ** 2, 1e-300)))
    turns, stretches, known = _mixed(cells, near, shares)
    return replace(cells, turns=turns, stretches=stretches, trust=known * cells.weights)


def _mixed(
    cells: _Pieces, near: npt.NDArray[np.int32], shares: Floats
) -> tuple[Floats, Floats, Floats]:
    """The mean turns and stretches of cells, and how well they are known, 0 to 1."""
    trusted = shares * cells.trust[near]
    total = trusted.sum(axis=1)
    known = total / np.maximum((shares * cells.weights[near]).sum(axis=1), 1e-300)
    trusted = trusted / np.maximum(total, 1e-300)[:, None]
    turns = np.einsum("nk,nkij->nij", trusted, cells.turns[near])
    stretches = np.einsum("nk,nkij->nij", trusted, cells.stretches[near])
    return turns, stretches, known


def _across(sides: Floats) -> tuple[Floats, Floats]:
    """(F, 3) unit normals of what two sides span, (F, 3, 2), and (F,) areas."""
    normals = np.cross(sides[:, :, 0], sides[:, :, 1])
    areas = np.linalg.norm(normals, axis=1)
    return normals / np.maximum(areas, 1e-300)[:, None], areas
