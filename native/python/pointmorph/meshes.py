"""Boundaries, connected parts, normals and closest places of meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph._pointmorph import nearest_neighbors, nearest_rows
from pointmorph.clouds import Faces

# Samples of a surface for its closest places: at least, at most beside one a triangle, and along a
# triangle's side.
_LEAST_SAMPLES, _MOST_SAMPLES, _FINEST = 20_000, 200_000, 64
_MOST_STEPS = 24


def boundary_loops(faces: Faces, vertex_count: int) -> list[npt.NDArray[np.int64]]:
    """Boundary loops of a mesh, longest first by number of vertices.

    Parameters
    ----------
    faces : (F, K) array, or a sequence of polygons
        Vertex rows. Polygons may differ in length.
    vertex_count : int
        Number of vertices of the mesh.

    Returns
    -------
    list of arrays of int64
        Rows along each loop. Loops are simple: where several boundaries meet in one vertex, they
        are split there. Edges that are part of no loop are left out.

    Examples
    --------
    >>> from pointmorph.meshes import boundary_loops
    >>> [sorted(int(v) for v in loop) for loop in boundary_loops([[0, 1, 2], [0, 2, 3]], 4)]
    [[0, 1, 2, 3]]
    """
    edges = face_edges(faces)
    if len(edges) == 0:
        return []
    edges.sort(axis=1)
    _, first, counts = np.unique(
        edges[:, 0] * vertex_count + edges[:, 1], return_index=True, return_counts=True
    )
    around: dict[int, list[int]] = {}
    for a, b in edges[np.sort(first[counts == 1])].tolist():
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)

    loops: list[npt.NDArray[np.int64]] = []
    for start in list(around):
        path = [start]
        position = {start: 0}
        while around[path[-1]]:
            vertex = around[path[-1]].pop()
            around[vertex].remove(path[-1])
            if vertex in position:  # a loop closes; the path continues from its start
                loop = path[position[vertex] :]
                if len(loop) > 2:
                    loops.append(np.asarray(loop, np.int64))
                for dropped in loop[1:]:
                    del position[dropped]
                path = path[: position[vertex] + 1]
            else:
                position[vertex] = len(path)
                path.append(vertex)
    return sorted(loops, key=len, reverse=True)


def parts(faces: Faces, positions: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Labels of the connected parts of a mesh.

    Vertices at the same place are connected. Vertices without faces belong to the nearest part.

    Parameters
    ----------
    faces : (F, K) array, or a sequence of polygons
        Vertex rows.
    positions : (N, 3) array

    Returns
    -------
    (N,) array of int64
        The same label for all vertices of a part.

    Examples
    --------
    >>> import numpy as np
    >>> from pointmorph.meshes import parts
    >>> parts([[0, 1, 2], [3, 4, 5]], np.arange(18.0).reshape(6, 3)).tolist()
    [0, 0, 0, 3, 3, 3]
    """
    count = len(positions)
    if count == 0:
        return np.empty(0, np.int64)
    _, first, place = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    same = first[place.reshape(-1)]
    edges = np.concatenate([face_edges(faces), np.stack([np.arange(count), same], axis=-1)])
    labels = np.arange(count)
    while True:
        lower = labels.copy()
        ends = labels[edges]
        least = ends.min(axis=1)
        for side in (0, 1):
            np.minimum.at(lower, ends[:, side], least)  # labels of labels, resolved below
        while not np.array_equal(lower, lower[lower]):
            lower = lower[lower]
        merged = lower[labels]
        if np.array_equal(merged, labels):
            break
        labels = merged
    used = np.zeros(count, bool)
    used[face_edges(faces).reshape(-1)] = True
    used = np.isin(labels, labels[used])
    if used.any() and not used.all() and np.isfinite(positions).all():
        _spread(labels, used, positions)
    return labels


def _spread(
    labels: npt.NDArray[np.int64], known: npt.NDArray[np.bool_], positions: npt.NDArray[Any]
) -> None:
    """Gives vertices without a known label that of their nearest neighbor with one."""
    size = max(float(np.ptp(positions, axis=0).max()), np.finfo(float).tiny)
    near = nearest_neighbors(np.ascontiguousarray(positions / size, np.float64), 16)
    while True:
        waiting = np.flatnonzero(~known)
        for column in range(near.shape[1]):
            at = waiting[known[near[waiting, column]] & ~known[waiting]]
            labels[at] = labels[near[at, column]]
            known[at] = True
        if known.all() or not known[waiting].any():
            break
    labels[~known] = np.bincount(labels[known]).argmax()


def face_edges(faces: Faces) -> npt.NDArray[np.int64]:
    """(E, 2): the edges of all faces, one by one, without those from a vertex to itself."""
    if isinstance(faces, np.ndarray) and faces.ndim == 2:
        corners = faces.astype(np.int64)
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    else:
        lengths = np.fromiter((len(face) for face in faces), np.int64, len(faces))
        if lengths.sum() == 0:
            return np.empty((0, 2), np.int64)
        flat = np.concatenate([np.asarray(face, np.int64) for face in faces if len(face)])
        ends = np.cumsum(lengths)
        following = np.arange(1, len(flat) + 1)
        full = lengths > 0
        following[ends[full] - 1] = (ends - lengths)[full]
        edges = np.stack([flat, flat[following]], axis=-1)
    proper: npt.NDArray[np.int64] = edges[edges[:, 0] != edges[:, 1]]
    return proper


def vertex_normals(
    positions: npt.NDArray[Any], triangles: npt.NDArray[np.integer[Any]]
) -> npt.NDArray[np.float64]:
    """Unit normals: the mean over the faces around each vertex, weighted by area.

    Parameters
    ----------
    positions : (N, 3) array
    triangles : (F, 3) array

    Returns
    -------
    (N, 3) array of float64
        (0, 0, 1) at vertices without faces of positive area.
    """
    corners = positions[triangles].astype(np.float64)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(positions), 3))
    for axis in range(3):
        for k in range(3):
            normals[:, axis] += np.bincount(
                triangles[:, k], weights=doubled[:, axis], minlength=len(positions)
            )
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), [0.0, 0.0, 1.0])


class ClosestPlaces:
    """The closest place of a surface for each of many places.

    Where several parts of the surface are about as close, it may be on any of them: the search
    begins at the closest of many samples of the surface, and goes on from face to face.

    Parameters
    ----------
    positions : (N, 3) array
    triangles : (F, 3) array

    Raises
    ------
    ValueError
        Without triangles.

    Examples
    --------
    >>> import numpy as np
    >>> from pointmorph.meshes import ClosestPlaces
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> triangle, shares = ClosestPlaces(corners, np.array([[0, 1, 2]])).of([[0.25, 0.25, 9]])
    >>> shares.tolist()
    [[0.5, 0.25, 0.25]]
    """

    def __init__(
        self, positions: npt.NDArray[Any], triangles: npt.NDArray[np.integer[Any]]
    ) -> None:
        if len(triangles) == 0:
            raise ValueError("expected triangles, found none")
        self._corners = np.asarray(positions, np.float64)[triangles]
        self._samples, self._owners = _surface_samples(self._corners)
        self._neighbors = _face_neighbors(np.asarray(positions), np.asarray(triangles))

    def of(
        self, places: npt.ArrayLike, like: npt.NDArray[np.integer[Any]] | None = None
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """The closest place for each of these.

        Parameters
        ----------
        places : (M, 3) array
        like : (M,) array of int, optional
            For each place, the row of one beside it, maybe itself, with which its search begins.
            It's quicker where many share one.

        Returns
        -------
        (M,) array of int64
            The triangle.
        (M, 3) array of float64
            What share its corners have in the place. They are 0 or more, and sum to 1.
        """
        wanted = np.asarray(places, np.float64).reshape(-1, 3)
        if len(wanted) == 0:
            return np.empty(0, np.int64), np.empty((0, 3))
        if like is None:
            found = self._owners[nearest_rows(self._samples, wanted, 1)[:, 0]]
        else:
            asked = np.unique(like)
            first = np.empty(len(wanted), np.int64)
            first[asked] = self._owners[nearest_rows(self._samples, wanted[asked], 1)[:, 0]]
            found = first[like]
        shares, distances = _closest_on(self._corners[found], wanted)
        moving = np.flatnonzero(shares.min(axis=1) <= 0.0)
        for _ in range(_MOST_STEPS):
            # Across the side that is the closest, or round the corner, as long as it gets nearer.
            kept = []
            for side in range(3):
                rows = moving[shares[moving, side] <= 0.0]
                onto = self._neighbors[found[rows], side]
                rows, onto = rows[onto >= 0], onto[onto >= 0]
                tried, reached = _closest_on(self._corners[onto], wanted[rows])
                nearer = reached < distances[rows] * (1.0 - 1e-9)
                rows = rows[nearer]
                found[rows], shares[rows] = onto[nearer], tried[nearer]
                distances[rows] = reached[nearer]
                kept.append(rows)
            moving = np.unique(np.concatenate(kept))
            if len(moving) == 0:
                break
        return found, shares


def closest_points(
    positions: npt.NDArray[Any], places: npt.NDArray[Any], count: int
) -> npt.NDArray[np.int32]:
    """(M, count): rows of the points closest to each place, the closest first."""
    return nearest_rows(positions, places, count)


def _surface_samples(
    corners: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Even samples of triangles, one of each at least, and the triangle of each sample."""
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
    step = max(float(np.sqrt(area / _LEAST_SAMPLES)), 1e-30)
    while True:
        counts = np.clip(np.ceil(longest / step), 1, _FINEST).astype(np.int64)
        if (counts**2).sum() <= len(corners) + _MOST_SAMPLES:
            break
        step *= 1.5
    samples, owners = [], []
    for count in np.unique(counts).tolist():
        rows = np.flatnonzero(counts == count)
        within = _centers(count)
        samples.append(np.einsum("ck,fkd->fcd", within, corners[rows]).reshape(-1, 3))
        owners.append(np.repeat(rows, len(within)))
    return np.concatenate(samples), np.concatenate(owners)


def _centers(count: int) -> npt.NDArray[np.float64]:
    """(count², 3): barycentric coordinates of the centers of so many parts of a triangle."""
    u, v = (x.reshape(-1) for x in np.mgrid[:count, :count])
    first = np.stack([u, v], axis=1)
    places = np.concatenate([first[u + v < count] + 1 / 3, first[u + v < count - 1] + 2 / 3])
    places /= count
    return np.column_stack([1.0 - places.sum(axis=1), places])


def _closest_on(
    corners: npt.NDArray[np.float64], places: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """(M, 3) shares of the corners in the closest place of one triangle each, (M,) distance²."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    w = places - corners[:, 0]
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("ij,ij->i", w, u), np.einsum("ij,ij->i", w, v)
    area = uu * vv - uv * uv
    flat = area <= 1e-14 * uu * vv
    area[flat] = 1.0
    shares = np.empty((len(places), 3))
    shares[:, 1] = (vv * wu - uv * wv) / area
    shares[:, 2] = (uu * wv - uv * wu) / area
    shares[:, 0] = 1.0 - shares[:, 1] - shares[:, 2]
    outside = np.flatnonzero(flat | (shares.min(axis=1) < 0.0))
    if len(outside):
        shares[outside] = _closest_on_sides(corners[outside], places[outside])
    apart = np.einsum("ij,ijk->ik", shares, corners) - places
    return shares, np.einsum("ij,ij->i", apart, apart)


def _closest_on_sides(
    corners: npt.NDArray[np.float64], places: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """(M, 3) shares of the corners in the closest place of a triangle's sides."""
    best = np.full(len(places), np.inf)
    shares = np.zeros((len(places), 3))
    for side in range(3):
        a, b = (side + 1) % 3, (side + 2) % 3
        along = corners[:, b] - corners[:, a]
        length = np.einsum("ij,ij->i", along, along)
        share = np.einsum("ij,ij->i", places - corners[:, a], along)
        share = np.clip(share / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        apart = corners[:, a] + share[:, None] * along - places
        distances = np.einsum("ij,ij->i", apart, apart)
        rows = np.flatnonzero(distances < best)
        best[rows] = distances[rows]
        shares[rows] = 0.0
        shares[rows, a], shares[rows, b] = 1.0 - share[rows], share[rows]
    return shares


def _face_neighbors(
    positions: npt.NDArray[Any], triangles: npt.NDArray[np.integer[Any]]
) -> npt.NDArray[np.int64]:
    """(F, 3): the triangle across the side opposite each corner, -1 without one. Vertices in one
    place count as one."""
    _, same = np.unique(positions, axis=0, return_inverse=True)
    faces = same.reshape(-1)[triangles].astype(np.int64)
    ends = np.sort(np.stack([np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)]), axis=0)
    keys = (ends[0] * (int(faces.max()) + 1) + ends[1]).reshape(-1)
    order = np.argsort(keys, kind="stable")
    twins = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    result = np.full(3 * len(faces), -1, np.int64)
    result[order[twins]] = order[twins + 1] // 3
    result[order[twins + 1]] = order[twins] // 3
    return result.reshape(-1, 3)
