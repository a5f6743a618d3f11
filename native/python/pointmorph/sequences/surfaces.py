"""Meshes through in-between clouds, for software that can't use points.

They come from screened Poisson reconstruction (Kazhdan and Hoppe 2013), in its authors' own code,
which is part of MeshLab. It needs the extra `mesh`: pymeshlab and scipy.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import Cancelled, CloudError, ConvergenceError, OptionError
from pointmorph.meshes.geometry import vertex_normals
from pointmorph.morphs.frames import Frame, ResampledFrame
from pointmorph.morphs.morphing import Morph
from pointmorph.shapes.clouds import FloatArray

_NEIGHBORS = 8
_DEEPEST, _SHALLOWEST = 10, 4
_CUBE = 1.1  # side of the cube around the points, in their extent
_POLL = 0.05  # seconds
# In spacings of the points around. Where the surface goes farther than _BALLOON from the points, it
# spans an opening, and is cut off at the distance _OFF. So wide openings stay open, and those
# narrower than twice _BALLOON are closed.
_OFF, _BALLOON = 1.5, 4.0
_COINCIDENT = 0.5  # spacings
_ASKED_AT_ONCE = 64  # rows of which neighbors are asked for
_LOOKED_AT = 4096  # rows that are gone through for these
_BLENDED = 4  # points that a vertex takes its color from
_FEWEST = 12  # points


@dataclass(frozen=True)
class Surface:
    """A mesh through the points of a frame. Its vertices and faces differ from frame to frame."""

    positions: FloatArray
    """(V, 3)"""
    normals: FloatArray
    """(V, 3), unit length"""
    colors: FloatArray
    """(V, 4), from the points around"""
    faces: npt.NDArray[np.int32]
    """(F, 3) rows of `positions`, counterclockwise seen from outside"""
    velocities: FloatArray | None = None
    """(V, 3), from the points around; None if the frame has none"""


def is_available() -> bool:
    """Whether pymeshlab and scipy, the extra `mesh`, are installed."""
    try:
        _search_tree()
    except OptionError:
        return False
    return True


def check_available() -> None:
    """Raises OptionError if pymeshlab or scipy, the extra `mesh`, isn't installed."""
    _search_tree()


class Surfaces:
    """Makes surfaces through the frames of one morph. Thread-safe.

    Parameters
    ----------
    morph : Morph

    Raises
    ------
    OptionError
        If pymeshlab or scipy is missing.
    """

    def __init__(self, morph: Morph) -> None:
        self._tree = _search_tree()
        self._spacing: list[npt.NDArray[np.float64]] = [
            self._point_spacing(cloud.positions)[rows]
            for cloud, rows in zip((morph.source, morph.target), morph.pairs.T, strict=True)
        ]

    def through(
        self, frame: Frame, t: float, stopped: Callable[[], bool] = lambda: False
    ) -> Surface:
        """The smooth surface through the points of a frame, as a mesh.

        Openings narrower than about eight spacings are closed. Wider ones, such as the border of a
        patch, stay open. The same frame gives the same bits.

        Parameters
        ----------
        frame : Frame
            The frame of the morph at t. A resampled frame is best: it has no cracks to bridge.
        t : float
            0 to 1.
        stopped : callable, optional
            Asked many times a second; the work ends when it returns True.

        Returns
        -------
        Surface
            In the type of the frame.

        Raises
        ------
        Cancelled
            If `stopped` returned True.
        CloudError
            If the frame has fewer than 12 points, or all are in one place.
        ConvergenceError
            If no surface was found.
        """
        count = len(frame.positions)
        extent = float(np.ptp(frame.positions, axis=0).max()) if count else 0.0
        if count < _FEWEST or not extent > 0.0:
            raise CloudError(
                "frame",
                f"at least {_FEWEST} points, not all in one place",
                f"{count} points with an extent of {extent:g}",
                "Write the frames without a mesh.",
            )
        center = 0.5 * (frame.positions.min(axis=0) + frame.positions.max(axis=0))
        everywhere = (frame.positions.astype(np.float64) - center) / extent
        apart = self._expected_spacing(everywhere, t) / extent
        rows = self._thinned(everywhere, frame.normals, apart, stopped)
        points = everywhere[rows]
        spacing = self._point_spacing(points)
        positions, faces = _reconstructed(points, frame.normals[rows], _depth(spacing), stopped)
        tree = self._tree(points)
        distance, near = tree.query(positions)
        positions, faces = _without_balloons(positions, faces, distance / spacing[near])

        distance, near = tree.query(positions, _BLENDED)
        weights = 1.0 / np.maximum(distance, 1e-3 * spacing[near[:, :1]]) ** 2
        weights /= weights.sum(axis=1, keepdims=True)
        dtype = frame.positions.dtype

        def blend(values: FloatArray) -> FloatArray:
            mixed: FloatArray = np.einsum("vk,vkc->vc", weights, values[rows[near]]).astype(dtype)
            return mixed

        return Surface(
            (positions * extent + center).astype(dtype),
            vertex_normals(positions, faces).astype(dtype),
            blend(frame.colors),
            faces,
            blend(frame.velocities) if isinstance(frame, ResampledFrame) else None,
        )

    def _point_spacing(self, points: FloatArray) -> npt.NDArray[np.float64]:
        """(N,): the spacing around each point, as if the points were on a square grid."""
        count = min(_NEIGHBORS, len(points) - 1)
        distances = self._tree(points).query(points, count + 1)[0]
        spacing: npt.NDArray[np.float64] = distances[:, -1] * np.sqrt(np.pi / count)
        spacing[spacing == 0.0] = 0.05 * np.median(spacing)  # coincident points
        return spacing

    def _expected_spacing(
        self, points: npt.NDArray[np.float64], t: float
    ) -> npt.NDArray[np.float64]:
        """(N,): the spacing of pairs, interpolated between both ends; of new points, the mean of
        the pairs around."""
        source, target = self._spacing
        spacing = (1.0 - t) * source + t * target
        if len(points) == len(spacing):
            return spacing
        _, near = self._tree(points[: len(spacing)]).query(points[len(spacing) :], _BLENDED)
        return np.concatenate([spacing, spacing[near].mean(axis=1)])

    def _thinned(
        self,
        points: npt.NDArray[np.float64],
        normals: FloatArray,
        spacing: npt.NDArray[np.float64],
        stopped: Callable[[], bool],
    ) -> npt.NDArray[np.int64]:
        """Rows without near-coincident points: near an end, several pairs share one point.

        Asks only for what is around rows that stay, a few at a time: where thousands of pairs share
        a point, each has all others around it.
        """
        tree = self._tree(points)
        stays = np.ones(len(points), bool)
        done = 0
        while done < len(points):
            if stopped():
                raise Cancelled("The mesh was canceled.")
            some = done + np.flatnonzero(stays[done : done + _LOOKED_AT])[:_ASKED_AT_ONCE]
            done = int(some[-1]) + 1 if len(some) == _ASKED_AT_ONCE else done + _LOOKED_AT
            around = tree.query_ball_point(points[some], _COINCIDENT * spacing[some])
            for row, others in zip(some, around, strict=True):
                if stays[row] and len(others) > 1:
                    near = np.asarray(others)
                    stays[near[(near > row) & (normals[near] @ normals[row] > 0.0)]] = False
        return np.flatnonzero(stays)


def _search_tree() -> Any:
    """scipy's kd-tree. Raises OptionError if scipy or pymeshlab is missing."""
    missing = "pymeshlab"
    if importlib.util.find_spec(missing) is not None:
        try:
            from scipy.spatial import cKDTree
        except ImportError:
            missing = "scipy"
        else:
            return cKDTree
    raise OptionError(
        "mesh",
        "pymeshlab and scipy, which make meshes from points",
        f"no {missing}",
        f"Install them: {sys.executable or 'python3'} -m pip install pymeshlab scipy",
    )


def _reconstructed(
    points: npt.NDArray[np.float64],
    normals: FloatArray,
    depth: int,
    stopped: Callable[[], bool],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """(V, 3) vertices and (F, 3) faces, by a process that is killed once `stopped()` is True."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    # A file, not a pipe, for what it complains of: a pipe stays open as long as anything that the
    # process has started, such as a desktop under Wine, and so may the file.
    with tempfile.TemporaryDirectory(prefix="pointmorph-", ignore_cleanup_errors=True) as folder:
        names = ("points.npz", "mesh.npz", "complaint.txt")
        source, destination, said = (os.path.join(folder, name) for name in names)
        np.savez(
            source, points=points, normals=normals.astype(np.float64), depth=depth, scale=_CUBE
        )
        with (
            open(said, "wb") as file,
            subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("_poisson.py")), source, destination],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=file,
            ) as process,
        ):
            try:
                while True:
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(timeout=_POLL)
                        break
                    if stopped():
                        raise Cancelled("The mesh was canceled.")
            finally:
                process.kill()
        complaint = Path(said).read_text(encoding="utf-8", errors="replace")
        if process.returncode != 0:
            detail = (complaint.strip() or f"status {process.returncode}").splitlines()[-1]
            raise ConvergenceError(
                "mesh", "a surface through the points", detail, "Write the frames without a mesh."
            )
        with np.load(destination) as mesh:  # Windows removes no file that is open
            return mesh["positions"], mesh["faces"]


def _depth(spacing: npt.NDArray[np.float64]) -> int:
    """Levels of the octree, enough to resolve the denser regions.

    It is refined only near points, so one level too many costs little.
    """
    fine = float(np.percentile(spacing, 5.0))
    return int(np.clip(np.ceil(np.log2(_CUBE / max(fine, 1e-12))), _SHALLOWEST, _DEEPEST))


def _without_balloons(
    positions: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int32],
    off: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """The mesh without the parts that span openings. `off`: (V,) distance from the points, in
    spacings."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    is_off = off > _OFF
    edges = np.concatenate([faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    edges = edges[is_off[edges].all(axis=1)]
    size = len(positions)
    graph = coo_matrix((np.ones(len(edges), np.int8), edges.T), (size, size))
    _, component = connected_components(graph, directed=False)
    farthest = np.zeros(size)
    np.maximum.at(farthest, component, off)
    balloon = is_off & (farthest[component] > _BALLOON)
    if not balloon.any():
        return positions, faces
    return _clipped(positions, faces, np.where(balloon, off - _OFF, np.minimum(off - _OFF, 0.0)))


def _clipped(
    positions: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int32],
    height: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """The part of the mesh where `height`, linear on each face, is at most 0."""
    above = height > 0.0
    count = above[faces].sum(axis=1)
    whole = faces[count == 0]
    # First the corner that is alone on its side.
    cut = faces[(count == 1) | (count == 2)]
    alone = np.argmax(above[cut] == (above[cut].sum(axis=1) == 1)[:, None], axis=1)
    a, b, c = (cut[np.arange(len(cut)), (alone + k) % 3] for k in range(3))
    ends = np.sort(np.concatenate([np.stack([a, b], axis=1), np.stack([a, c], axis=1)]), axis=1)
    edges, new = np.unique(ends, axis=0, return_inverse=True)
    low, high = edges.T
    share = (height[low] / (height[low] - height[high]))[:, None]
    on_edges = (1.0 - share) * positions[low] + share * positions[high]
    ab, ac = (len(positions) + new.reshape(2, -1)).astype(np.int32)
    lone_above = above[a]  # then a quadrangle stays, else a triangle
    triangles = np.concatenate(
        [
            whole,
            np.stack([a, ab, ac], axis=1)[~lone_above],
            np.stack([ab, b, c], axis=1)[lone_above],
            np.stack([ab, c, ac], axis=1)[lone_above],
        ]
    )
    kept, rows = np.unique(triangles, return_inverse=True)
    vertices = np.concatenate([positions, on_edges])[kept]
    return vertices, rows.reshape(-1, 3).astype(np.int32)
