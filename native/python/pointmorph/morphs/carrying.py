"""What a shape has besides its form, carried along a map: weights, UVs, shape keys, hair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import CloudError
from pointmorph.meshes.geometry import (
    ClosestPlaces,
    check_places,
    check_range,
    check_triangles,
    nearest_rows,
)
from pointmorph.meshes.local_frames import local_frames

Floats = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

_AROUND = 3  # for values, where there are no faces
_MOST_STRETCH = 4.0  # times the usual one: beyond, a map has collapsed
_JUMP = 2.0  # times what UVs differ by as far away as that, at most: beyond, there's a seam
_REACH = 1.5  # times the size of a face: how far one looks for a way around a seam


class Carrier:
    """Carries what the points of one shape, the giver, have to those of another, the taker.

    Parameters
    ----------
    positions : (N, 3) array_like
        The taker's points.
    images : (N, 3) array_like
        Where the map takes them on the giver.
    onto : (M, 3) array_like
        The giver's points.
    faces, onto_faces : (F, 3) array_like of int, optional
        Triangles of both shapes. Without those of the giver, values are between the nearest points.

    Raises
    ------
    CloudError
        If rows don't fit each other, if they aren't rows of what they belong to, or if a place
        isn't finite; so do the methods.

    Examples
    --------
    >>> import numpy as np
    >>> from pointmorph.morphs.carrying import Carrier
    >>> plane = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> faces = np.array([[0, 1, 2], [0, 2, 3]])
    >>> upright = plane[:, [0, 2, 1]] * [2, 1, 2]  # twice as large, and turned about the x axis
    >>> carrier = Carrier(plane, upright, upright, faces, faces)
    >>> carrier.values([[0.0], [0.25], [0.5], [1.0]]).ravel().tolist()
    [0.0, 0.25, 0.5, 1.0]
    >>> forward = carrier.displacements(np.tile([0.0, -1, 0], (4, 1)))
    >>> bool(np.allclose(forward, [0, 0, 0.5]))
    True
    """

    def __init__(
        self,
        positions: npt.ArrayLike,
        images: npt.ArrayLike,
        onto: npt.ArrayLike,
        faces: npt.ArrayLike | None = None,
        onto_faces: npt.ArrayLike | None = None,
    ) -> None:
        self._positions = _places("positions", positions)
        self._images = _places("images", images)
        self._onto = _places("onto", onto)
        _check_rows("images", self._images, len(self._positions))
        self._faces = check_triangles(faces, "faces", len(self._positions))
        self._onto_faces = check_triangles(onto_faces, "onto_faces", len(self._onto))

    @cached_property
    def frames(self) -> Floats:
        """(N, 3, 3): the differential of the map at each point of the taker. It takes directions
        on the taker to those on the giver: turned, and stretched as the surface is; across the
        surface, by the mean stretch."""
        return local_frames(self._positions, self._images, self._faces)

    def values(self, values: npt.ArrayLike) -> Floats:
        """(N, K), from (M, K): values of the giver's points, at the places of the taker's."""
        given = _table("values", values, len(self._onto))
        return _mean(given, *self._landed[1:])

    def returned(self, values: npt.ArrayLike) -> Floats:
        """(M, K), from (N, K): the other way, values of the taker's points to the giver's."""
        given = _table("values", values, len(self._positions))
        return _mean(given, *self._returned[1:])

    def displacements(self, offsets: npt.ArrayLike) -> Floats:
        """(N, 3), from (M, 3): how the taker's points move, so that it changes as the giver does.

        Each offset is turned and stretched by the differential of the map, so that the corner of a
        mouth goes up along the cheek, wherever the cheek lies.
        """
        given = _places("offsets", offsets)
        _check_rows("offsets", given, len(self._onto))
        moved: Floats = np.einsum("nij,nj->ni", self._frames_back, self.values(given))
        return moved

    def strands(self, points: npt.ArrayLike, roots: npt.ArrayLike) -> Strands:
        """Points that grow on the giver's surface, such as those of hair, on the taker's.

        Every strand is turned and stretched as a whole, as the map does where its root is.

        Parameters
        ----------
        points : (P, 3) array_like
        roots : (P,) array_like of int
            For each point, the row of the first one of its strand.
        """
        given = _places("points", points)
        rows = _rows("roots", roots, len(given))
        if len(rows) != len(given):
            raise CloudError(
                "roots",
                f"{len(given)}, one for each point",
                f"{len(rows)}",
                "For each point, pass the row of the first point of its strand.",
            )
        first, strand = np.unique(rows, return_inverse=True)
        strand = strand.reshape(-1)
        triangle, members, shares = self._image.around(given[first])
        base = _mean(self._images, members, shares)
        start = _mean(self._positions, members, shares)
        turns = np.einsum("nk,nkij->nij", shares, self._frames_back[members])
        moved = start[strand] + np.einsum("nij,nj->ni", turns[strand], given - base[strand])
        triangles = None if self._faces is None else triangle
        return Strands(moved, triangles, shares, np.cbrt(np.abs(np.linalg.det(turns))))

    def corner_values(
        self,
        values: npt.ArrayLike,
        triangle_corners: npt.ArrayLike,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
    ) -> tuple[Floats, Rows]:
        """Values that the corners of faces have, such as UVs, which jump where there is a seam.

        A face of the taker that lies across a seam of the giver goes with the side that its middle
        is on. Its corners beyond get what is at the seam: no face is stretched over the whole
        image, but what it shows is squeezed there.

        Parameters
        ----------
        values : (C, K) array_like
            Of the giver's corners.
        triangle_corners : (F, 3) array_like of int
            The corners of the giver's triangles: rows of `values`.
        vertices, faces : (D,) array_like of int
            For each of the taker's corners, its vertex and its face.

        Returns
        -------
        (D, K) array
            Of the taker's corners.
        (S,) array of int
            The taker's faces that lie across a seam.
        """
        if self._onto_faces is None:
            raise CloudError(
                "corner values", "a shape with faces", "one without", "Use values() for points."
            )
        given = _of_corners(values, triangle_corners, len(self._onto_faces))
        vertices = _rows("vertices", vertices, len(self._positions))
        faces = _rows("faces", faces, None)
        if len(vertices) != len(faces):
            raise CloudError(
                "faces",
                f"{len(vertices)}, one for each corner",
                f"{len(faces)}",
                "Pass a vertex and a face for each corner.",
            )
        places = self._images[vertices]
        middles = _middles(places, faces)
        hits, _, shares = self._landed
        found = np.einsum("nk,nkc->nc", shares[vertices], given[hits[vertices]])
        corners_there = self._onto[self._onto_faces]
        reached = np.einsum("nk,nkc->nc", shares, corners_there[hits])
        off = np.linalg.norm(reached - self._images, axis=1)
        starts, _, shares = self._giver.around(middles)
        inside = np.einsum("nk,nkc->nc", shares, given[starts])
        # A value that differs more than it may do that far away belongs to another side.
        steepest = _steepest(corners_there, given)
        apart = np.linalg.norm(places - middles[faces], axis=1)
        most = np.maximum(steepest[hits[vertices]], steepest[starts[faces]]) * apart
        jumps = np.linalg.norm(found - inside[faces], axis=1) > _JUMP * most + 1e-9
        torn = np.unique(faces[jumps])
        if not len(torn):
            return found, torn
        sheet = _Sheet(self._onto, self._onto_faces, given)
        order = np.argsort(faces, kind="stable")
        ends = np.searchsorted(faces[order], np.stack([torn, torn + 1]))
        across = []
        for face, first, last in zip(torn.tolist(), *ends.tolist(), strict=True):
            corners = order[first:last]
            reach = _REACH * float(apart[corners].max())
            at, shares, away = sheet.places(
                int(starts[face]), middles[face], reach, places[corners]
            )
            found[corners] = np.einsum("nk,nkc->nc", shares, given[at])
            if (away > off[vertices[corners]] + 1e-5 * reach).any():
                across.append(face)
        return found, np.array(across, np.int64)

    @cached_property
    def _giver(self) -> _Surface:
        return _Surface(self._onto, self._onto_faces)

    @cached_property
    def _image(self) -> _Surface:
        """The taker where the map takes it."""
        return _Surface(self._images, self._faces)

    @cached_property
    def _landed(self) -> tuple[Rows, Rows, Floats]:
        """What is around the taker's points on the giver."""
        return self._giver.around(self._images)

    @cached_property
    def _returned(self) -> tuple[Rows, Rows, Floats]:
        """What is around the giver's points on the taker."""
        return self._image.around(self._onto)

    @cached_property
    def _frames_back(self) -> Floats:
        """(N, 3, 3): what takes directions on the giver to those on the taker; where the map has
        collapsed, not longer than elsewhere."""
        left, stretch, right = np.linalg.svd(self.frames)
        usual = float(np.median(stretch[:, 1])) or 1.0
        stretch = np.clip(stretch, usual / _MOST_STRETCH, usual * _MOST_STRETCH)
        back: Floats = np.einsum("nji,nj,nkj->nik", right, 1.0 / stretch, left)
        return back


@dataclass(frozen=True)
class Strands:
    """What `Carrier.strands` returns.

    Attributes
    ----------
    points : (P, 3) array
        On the taker.
    triangles : (S,) array of int or None
        The taker's triangle that each root is on, strands in order; None without faces.
    shares : (S, 3) array
        What share its corners have in that place.
    scales : (S,) array
        How much larger each strand has become.
    """

    points: Floats
    triangles: Rows | None
    shares: Floats
    scales: Floats


def _of_corners(values: npt.ArrayLike, corners: npt.ArrayLike, count: int) -> Floats:
    """(F, 3, K): the values of the corners of `count` triangles."""
    by_corner = _table("values", values)
    rows = np.asarray(corners)
    _check_rows("triangle_corners", rows, count)
    if rows.shape[1] != 3:
        raise CloudError(
            "triangle_corners",
            "a table with 3 columns",
            f"the shape {rows.shape}",
            "Pass the corners of each triangle.",
        )
    check_range("triangle_corners", rows, len(by_corner))
    given: Floats = by_corner[rows]
    return given


def _middles(places: Floats, faces: Rows) -> Floats:
    """For each number of a face, the mean of the places of its corners."""
    sizes = np.maximum(np.bincount(faces), 1)
    sums = [np.bincount(faces, column) for column in places.T]
    means: Floats = np.stack(sums, axis=1) / sizes[:, None]
    return means


def _steepest(corners: Floats, values: Floats) -> Floats:
    """(F,): by how much values, (F, 3, K), differ per length within a triangle, at most."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    differ = np.linalg.norm(values - np.roll(values, 1, axis=1), axis=2)
    slopes: Floats = (differ / np.maximum(sides, 1e-300)).max(axis=1)
    return slopes


class _Sheet:
    """Triangles that are joined where the values of their corners are the same on both sides."""

    def __init__(self, positions: Floats, triangles: Rows, values: Floats) -> None:
        self._corners = positions[triangles]
        self._centers = self._corners.mean(axis=1)
        apart = np.linalg.norm(self._corners - self._centers[:, None], axis=2)
        self._sizes = apart.max(axis=1)
        self._beside = _joined(positions, triangles, values)

    def places(
        self, start: int, middle: Floats, reach: float, places: Floats
    ) -> tuple[Rows, Floats, Floats]:
        """The closest to each place among the triangles that one gets to from a first one, not far
        from a middle: which it is, the shares of its corners, and how far away."""
        found = {start}
        edge = [start]
        while edge:
            beside = self._beside[edge].reshape(-1)
            near = np.unique(beside[beside >= 0])
            away = np.linalg.norm(self._centers[near] - middle, axis=1)
            near = near[away <= reach + self._sizes[near]]
            edge = [row for row in near.tolist() if row not in found]
            found.update(edge)
        rows = np.array(sorted(found), np.int64)
        corners = self._corners[rows]
        own = np.arange(3 * len(rows)).reshape(-1, 3)
        nearest, shares = ClosestPlaces(corners.reshape(-1, 3), own).of(places)
        apart = np.einsum("nk,nkc->nc", shares, corners[nearest]) - places
        return rows[nearest], shares, np.linalg.norm(apart, axis=1)


def _joined(positions: Floats, triangles: Rows, values: Floats) -> Rows:
    """(F, 3): the triangle across the side opposite each corner; -1 without one, and across a
    seam. Vertices in one place count as one."""
    _, same = np.unique(positions, axis=0, return_inverse=True)
    vertices = same.reshape(-1)[triangles]
    # A corner is a vertex with its values, so that a side has the same two corners on both sides.
    scale = max(float(np.ptp(values.reshape(-1, values.shape[2]), axis=0).max()), 1e-30)
    keys = np.concatenate([vertices[:, :, None], np.round(values / (1e-6 * scale))], axis=2)
    _, corner = np.unique(keys.reshape(-1, keys.shape[2]), axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3).astype(np.int64)
    ends = np.sort(np.stack([np.roll(corner, -1, axis=1), np.roll(corner, -2, axis=1)]), axis=0)
    sides = (ends[0] * (int(corner.max()) + 1) + ends[1]).reshape(-1)
    order = np.argsort(sides, kind="stable")
    twins = np.flatnonzero(sides[order[1:]] == sides[order[:-1]])
    result = np.full(3 * len(triangles), -1, np.int64)
    result[order[twins]] = order[twins + 1] // 3
    result[order[twins + 1]] = order[twins] // 3
    return result.reshape(-1, 3)


class _Surface:
    """What places are near to on a shape; with faces or without."""

    def __init__(self, positions: Floats, triangles: Rows | None) -> None:
        self._positions, self._triangles = positions, triangles
        self._search = None if triangles is None else ClosestPlaces(positions, triangles)

    def around(self, places: Floats) -> tuple[Rows, Rows, Floats]:
        """For each place, the triangle that is the closest, or without any the nearest point; the
        rows of the points around it; their shares, which sum to 1."""
        if self._triangles is not None and self._search is not None:
            triangle, shares = self._search.of(places)
            return triangle, self._triangles[triangle], shares
        positions = self._positions
        members = nearest_rows(positions, places, min(_AROUND, len(positions))).astype(np.int64)
        distances = np.linalg.norm(positions[members] - places[:, None], axis=2)
        scale = max(float(np.ptp(positions, axis=0).max()), 1e-30)
        shares = 1.0 / np.maximum(distances, 1e-9 * scale) ** 2
        return members[:, 0], members, shares / shares.sum(axis=1, keepdims=True)


def _mean(values: Floats, members: Rows, shares: Floats) -> Floats:
    """(N, K): of the values of K members, by their shares."""
    mean: Floats = np.einsum("nk,nkc->nc", shares, values[members])
    return mean


def _places(name: str, places: npt.ArrayLike) -> Floats:
    """(N, 3), of at least one."""
    found: Floats = check_places(name, places)
    if not len(found):
        raise CloudError(name, "at least one point", "none", "Pass points.")
    return found


def _table(name: str, values: npt.ArrayLike, count: int | None = None) -> Floats:
    """(N, K), of `count` rows where that is known."""
    try:
        found = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise CloudError(name, "a table of numbers", str(error), "Pass numbers.") from error
    _check_rows(name, found, len(found) if count is None and found.ndim else count or 0)
    return found


def _rows(name: str, rows: npt.ArrayLike, count: int | None) -> Rows:
    """(N,), each a row of a table with `count`, where that is known."""
    found = np.asarray(rows)
    if found.ndim != 1:
        raise CloudError(
            name, "a list of numbers", f"the shape {found.shape}", "Pass one number for each."
        )
    if not found.size:
        return found.astype(np.int64)
    check_range(name, found, count or np.iinfo(np.int64).max)
    return found.astype(np.int64)


def _check_rows(name: str, rows: npt.NDArray[Any], count: int) -> None:
    if rows.ndim != 2 or len(rows) != count:
        raise CloudError(
            name,
            f"a table with {count} rows, one for each point",
            f"the shape {rows.shape}",
            "Pass a row for each point, in order.",
        )
