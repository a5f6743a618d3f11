"""Boundaries, connected parts, normals and closest places of meshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph._pointmorph import ClosestPlaces as _ClosestPlaces
from pointmorph._pointmorph import nearest_neighbors
from pointmorph._pointmorph import nearest_rows as nearest_rows
from pointmorph._pointmorph import triangulate as _triangulate
from pointmorph.base.errors import CloudError
from pointmorph.shapes.clouds import Faces


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

    Raises
    ------
    CloudError
        If a face has a row that there isn't.

    Examples
    --------
    >>> from pointmorph.meshes import boundary_loops
    >>> [sorted(int(v) for v in loop) for loop in boundary_loops([[0, 1, 2], [0, 2, 3]], 4)]
    [[0, 1, 2, 3]]
    """
    edges = face_edges(faces)
    check_range("faces", edges, vertex_count)
    if len(edges) == 0:
        return []
    edges.sort(axis=1)
    _, first, counts = np.unique(
        edges[:, 0] * vertex_count + edges[:, 1], return_index=True, return_counts=True
    )
    around: dict[int, dict[int, None]] = {}  # in order; at a vertex may be very many
    for a, b in edges[np.sort(first[counts == 1])].tolist():
        around.setdefault(a, {})[b] = None
        around.setdefault(b, {})[a] = None

    loops: list[npt.NDArray[np.int64]] = []
    for start in list(around):
        path = [start]
        position = {start: 0}
        while around[path[-1]]:
            vertex, _ = around[path[-1]].popitem()
            del around[vertex][path[-1]]
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

    Raises
    ------
    CloudError
        If a face has a row that there isn't.

    Examples
    --------
    >>> import numpy as np
    >>> from pointmorph.meshes.geometry import parts
    >>> parts([[0, 1, 2], [3, 4, 5]], np.arange(18.0).reshape(6, 3)).tolist()
    [0, 0, 0, 3, 3, 3]
    """
    count = len(positions)
    if count == 0:
        return np.empty(0, np.int64)
    _, first, place = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    same = first[place.reshape(-1)]
    joined = face_edges(faces)
    check_range("faces", joined, count)
    edges = np.concatenate([joined, np.stack([np.arange(count), same], axis=-1)])
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
    used[joined.reshape(-1)] = True
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


def _check_columns(name: str, rows: npt.NDArray[Any]) -> None:
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise CloudError(
            name, "a table with 3 columns", f"the shape {rows.shape}", "Pass x, y and z of each."
        )


def check_places(name: str, places: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Places as an array (N, 3). Raises CloudError unless they are that, and finite."""
    rows = np.asarray(places, np.float64)
    if rows.ndim == 1 and len(rows) in (0, 3):
        rows = rows.reshape(-1, 3)
    _check_columns(name, rows)
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise CloudError(
            name,
            "finite numbers",
            f"{rows[row].tolist()} in row {row}",
            "Remove or correct such points.",
        )
    return rows


def check_range(name: str, rows: npt.NDArray[Any], count: int) -> None:
    """Raises CloudError unless all are rows of a table with so many."""
    if not np.issubdtype(rows.dtype, np.integer):
        raise CloudError(
            name, "whole numbers", f"{rows.dtype}", "Pass row numbers, counted from 0."
        )
    if rows.size and (rows.min() < 0 or rows.max() >= count):
        raise CloudError(
            name,
            f"rows 0 to {count - 1}",
            f"{rows.min()} to {rows.max()}",
            "Pass row numbers, counted from 0.",
        )


def check_triangles(
    faces: Any, name: str = "faces", count: int | None = None
) -> npt.NDArray[np.int64] | None:
    """Triangles as an array (F, 3), or None where there are none. Raises CloudError unless they are
    that, of a table with `count` rows where that is given."""
    if faces is None or not len(faces):
        return None
    rows = np.asarray(faces)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise CloudError(
            name,
            "triangles, (F, 3)",
            f"the shape {rows.shape}",
            "Cut polygons into triangles: see meshes.triangulate().",
        )
    if count is not None:
        check_range(name, rows, count)
    return rows.astype(np.int64)


def triangulate(
    positions: npt.NDArray[Any],
    offsets: npt.NDArray[np.integer[Any]],
    corners: npt.NDArray[np.integer[Any]],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Polygons as triangles that lie in them, also where they aren't convex.

    Parameters
    ----------
    positions : (N, 3) array
    offsets : (F + 1,) array of int
        Where the corners of each polygon begin, and where the last ones end.
    corners : (C,) array of int
        Their vertices.

    Returns
    -------
    (T, 3) array of int
        Vertices of the triangles.
    (T, 3) array of int
        Their corners: rows of `corners`.

    Raises
    ------
    CloudError
        If a corner is a row that there isn't, or arrays aren't as above.

    Examples
    --------
    >>> import numpy as np
    >>> from pointmorph.meshes import triangulate
    >>> dart = np.array([[0.0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]])
    >>> triangulate(dart, np.array([0, 4]), np.arange(4))[0].tolist()
    [[3, 0, 1], [1, 2, 3]]
    """
    vertices, begins = np.asarray(corners, np.int64), np.asarray(offsets, np.int64)
    _check_columns("positions", positions)
    check_range("faces", vertices, len(positions))
    sizes = np.diff(begins)
    if not len(begins) or begins[0] < 0 or begins[-1] > len(vertices) or (sizes < 0).any():
        raise CloudError(
            "offsets",
            f"rising numbers of 0 to {len(vertices)}, one more than there are polygons",
            f"{begins[:1].tolist()} to {begins[-1:].tolist()}",
            "Pass where the corners of each polygon begin, and where the last ones end.",
        )
    if len(vertices) == 3 * len(sizes) and (sizes == 3).all():
        rows = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    else:
        faces = begins, vertices.astype(np.int32)
        rows = _triangulate(positions, faces, None).astype(np.int64)
    return vertices[rows], rows


class ClosestPlaces:
    """The closest place of a surface for each of many places.

    Parameters
    ----------
    positions : (N, 3) array
    triangles : (F, 3) array

    Raises
    ------
    CloudError
        Without triangles, where their rows aren't those of positions, or if one of these isn't
        finite.

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
        corners = check_places("positions", positions)
        rows = np.asarray(triangles)
        if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
            raise CloudError(
                "triangles",
                "at least one, in a table with 3 columns",
                f"the shape {rows.shape}",
                "Cut polygons into triangles: see meshes.triangulate().",
            )
        check_range("triangles", rows, len(corners))
        self._search = _ClosestPlaces(corners, rows)

    def of(
        self, places: npt.ArrayLike, progress: Callable[[str, float], bool] | None = None
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """The closest place for each of these.

        Parameters
        ----------
        places : (M, 3) array
        progress : callable, optional
            Is called with "closest places" and a fraction from 0 to 1 now and then, and returns
            False to end the search.

        Returns
        -------
        (M,) array of int64
            The triangle.
        (M, 3) array of float64
            What share its corners have in the place. They are 0 or more, and sum to 1.

        Raises
        ------
        CloudError
            A place isn't finite.
        Cancelled
            `progress` returned False.
        """
        wanted = check_places("places", places)
        return self._search.of(wanted, progress)
