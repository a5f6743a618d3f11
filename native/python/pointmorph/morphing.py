"""Morphs: computed once, then cheap to query."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.carrying import Carrier, fans
from pointmorph.clouds import Cloud, FloatArray
from pointmorph.denser_meshes import DenserMesh
from pointmorph.errors import CloudError, FeatureError, OptionError
from pointmorph.features import Feature, native_features
from pointmorph.quality import (
    FeatureResidual,
    MapFigures,
    MeshPlace,
    MeshQuality,
    Place,
    PointQuality,
    Quality,
)

if TYPE_CHECKING:
    from pointmorph.live import LiveMorph

Progress = Callable[[str, float], bool | None]
"""Called with the name of a stage and the fraction of it that is done; returns False to cancel.
`pointmorph.stage_label` gives the stage in words."""

CRACK_TIMES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Option:
    """A setting of a morph. The default None means automatic."""

    name: str
    kind: str
    """int, float or choice."""
    default: int | float | str | None
    minimum: float
    maximum: float
    choices: tuple[str, ...]
    unit: str
    help: str
    affects: str
    """what has to be made again when it changes: the map (which points belong together, and all
    that follows), the path (every frame between the ends), frames (resampled ones) or nothing"""
    method: str | None
    """the method that uses it; None: both. Settings of method paper also count with method auto
    where the domain isn't auto, since the refinement then starts in that domain"""

    def is_used(self, method: str, domain: str) -> bool:
        """Whether a morph with this method and domain uses the setting.

        Examples
        --------
        >>> import pointmorph
        >>> influence = next(o for o in pointmorph.options() if o.name == "influence")
        >>> influence.is_used("auto", "auto"), influence.is_used("auto", "disk")
        (False, True)
        """
        starts_in_domain = self.method == "paper" and domain != "auto"
        return self.method in (None, method) or starts_in_domain


@lru_cache(maxsize=1)
def options() -> tuple[Option, ...]:
    """All settings of `morph`, with defaults, ranges, units and descriptions.

    Examples
    --------
    >>> import pointmorph
    >>> [option.default for option in pointmorph.options() if option.name == "influence"]
    [8.0]
    """
    return tuple(Option(**row) for row in _pointmorph.option_table())


@dataclass(frozen=True)
class Frame:
    """An in-between cloud, with one row per pair of `Morph.pairs`."""

    positions: FloatArray
    """(M, 3)"""
    normals: FloatArray
    """(M, 3), unit length between the ends"""
    colors: FloatArray
    """(M, 4), red green blue alpha; white if neither cloud has colors"""
    radii: FloatArray
    """(M,)"""


@dataclass(frozen=True)
class ResampledFrame(Frame):
    """An in-between cloud without cracks, with as many rows as that takes."""

    ids: npt.NDArray[np.int32]
    """(M,), ascending: the row of a pair; higher for a new point, which keeps its id in all
    frames"""
    velocities: FloatArray
    """(M, 3), per unit of t; divide by the number of frames for velocities per frame"""


@dataclass(frozen=True)
class Proposal:
    """Two places that probably belong together, from `pointmorph.propose_features`."""

    name: str
    """tip.1, tip.2 … for ends of limbs, place.1 … for places between them"""
    source: int
    """row of the source"""
    target: int
    """row of the target"""
    confidence: float
    """0 to 1: about how often such a pair is within 0.1 √area of the truth"""


class Morph:
    """A computed match between two clouds, made by `pointmorph.morph`.

    Attributes
    ----------
    source, target : Cloud
        The clouds passed to `morph`.
    pairs : (M, 2) array of int64
        Matching rows of source and target. Every row of both is in at least one pair.
    """

    def __init__(self, native: _pointmorph.Morph, source: Cloud, target: Cloud) -> None:
        self._native = native
        self.source = source
        self.target = target
        self._live: LiveMorph | None = None
        self.pairs: npt.NDArray[np.int64] = native.pairs()
        single = source.positions.dtype == target.positions.dtype == np.float32
        self._dtype: type[np.floating[Any]] = np.float32 if single else np.float64

    def __repr__(self) -> str:
        return f"<Morph {self.source.name!r} to {self.target.name!r}: {len(self.pairs)} pairs>"

    @property
    def parts(self) -> tuple[Morph, ...]:
        """The morphs of a chain; here only this one."""
        return (self,)

    def empty_frame(self) -> Frame:
        """A frame of the right size and type to pass to `frame` as `out`."""
        m = len(self.pairs)
        return Frame(
            np.empty((m, 3), self._dtype),
            np.empty((m, 3), self._dtype),
            np.empty((m, 4), self._dtype),
            np.empty(m, self._dtype),
        )

    def updated(
        self, features: Mapping[str, tuple[int, int] | Feature], progress: Progress | None = None
    ) -> Morph:
        """The morph of the same clouds for changed features, from where this one is.

        The first call keeps what further ones need (`LiveMorph`), which takes memory and about as
        long as preparing the shapes for a morph did. See `LiveMorph.updated`.

        Raises
        ------
        FeatureError, OptionError
            OptionError for method paper and for domains other than auto.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> ends = pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane)
        >>> result = pointmorph.morph(*ends, {"middle": (465, 465)})
        >>> result.updated({"middle": (465, 467)}).report["update"]
        'updated'
        """
        from pointmorph.live import LiveMorph

        if self._live is None:
            self._live = LiveMorph.of(self, progress)
        return self._live.updated(features, progress)

    def frame(self, t: float, out: Frame | None = None, progress: Progress | None = None) -> Frame:
        """The in-between cloud at t, along paths of the kind that the setting `path` names.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1 (the target, bit for bit).
        out : Frame, optional
            An earlier frame of this morph to overwrite, which saves allocating memory.
        progress : callable, optional
            As in `morph`. Only the first frame on a path that isn't straight takes long.

        Returns
        -------
        Frame
            float32 if both clouds are float32, otherwise float64.

        Raises
        ------
        OptionError
            If t lies outside of [0, 1], or `out` has the wrong size or type.
        Cancelled
            If `progress` returned False.
        """
        if out is None:
            out = self.empty_frame()
        arrays = (out.positions, out.normals, out.colors, out.radii)
        for array, columns in zip(arrays, (3, 3, 4, 1), strict=True):
            fits = array.size == columns * len(self.pairs) and array.dtype == self._dtype
            if not (fits and array.flags.c_contiguous and array.flags.writeable):
                raise OptionError(
                    "out",
                    f"writable contiguous {self._dtype.__name__} arrays of {len(self.pairs)} rows",
                    f"shape {array.shape} and {array.dtype}",
                    "Pass an earlier frame of this morph, or what empty_frame() returned.",
                )
        self._write_frame(float(t), arrays, progress)
        return out

    def _write_frame(
        self, t: float, arrays: tuple[FloatArray, ...], progress: Progress | None
    ) -> None:
        """Writes the frame at t into positions, normals, colors and radii."""
        native = self._native
        write = native.frame_float32 if self._dtype is np.float32 else native.frame_float64
        if 0.0 < t < 1.0:
            native.lay_out_paths(progress)
        write(t, *arrays)

    def _lay_out_paths(self, progress: Progress | None) -> None:
        """Finds what all frames share; otherwise the first one does."""
        self._native.lay_out_paths(progress)

    def _content(self) -> Iterator[npt.NDArray[Any]]:
        """All that frames depend on besides the settings."""
        yield self.pairs
        yield from (self.source_to_target, self.target_to_source)
        if self.source.delay is not None:
            yield self.source.delay
        for t in (0.0, 1.0):
            yield from vars(self.frame(t)).values()

    def _settings(self) -> dict[str, Any]:
        """The settings that results depend on."""
        settings: dict[str, Any] = self._native.report()["options"]
        settings.pop("threads")
        return settings

    def _known_report(self) -> dict[str, Any]:
        """The report with as much as has been measured already."""
        known: dict[str, Any] | None = vars(self).get("report")
        return self._native.report() if known is None else known

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        resample: bool = False,
        origin: Mapping[str, Any] | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Writes the morph as one file, whole or not at all, for `pointmorph.open_morph`.

        Parameters
        ----------
        path : path
            Its suffix is usually .morph.
        resample : bool
            Also keep which points resampled frames get, which takes as long as some of these
            frames. Without it, whoever opens the file and asks for a resampled frame finds out
            again.
        origin : mapping, optional
            Where the morph comes from, as JSON; kept as it is.
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        OptionError
            If it's a chain of several morphs.
        FileError
            If the file can't be written.
        Cancelled
            If `progress` returned False.
        """
        from pointmorph.stored_morphs import save

        save(self, path, resample=resample, origin=origin, progress=progress)

    def resampled_frame(self, t: float, progress: Progress | None = None) -> ResampledFrame:
        """The in-between cloud at t, with new points where it would have cracks.

        New points lie on the smooth surface of the points around them and take their colors. They
        grow and shrink, so that nothing pops. The first call finds out when they appear and vanish;
        after that, calls may come in any order and from several threads.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1 (the target, bit for bit).
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        OptionError
            If t lies outside of [0, 1].
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
        >>> frame = result.resampled_frame(0.5)
        >>> bool(np.array_equal(frame.ids[:900], np.arange(900)))
        True
        """
        native = self._native
        single = self._dtype is np.float32
        make = native.resampled_frame_float32 if single else native.resampled_frame_float64
        return ResampledFrame(**make(float(t), progress))

    def inserted(self, progress: Progress | None = None) -> int:
        """The number of new points in all resampled frames together."""
        return self._native.inserted(progress)

    @cached_property
    def source_to_target(self) -> FloatArray:
        """(N, 3): where the map takes each source point; smooth, not snapped to target points."""
        return self._native.source_to_target(None).astype(self._dtype)

    @cached_property
    def target_to_source(self) -> FloatArray:
        """(M, 3): where the map takes each target point; smooth, not snapped to source points."""
        return self._native.target_to_source(None).astype(self._dtype)

    @property
    def has_mesh(self) -> bool:
        """Whether the source has faces for `wrapped`. With method paper it has none."""
        return self._native.has_mesh()

    def wrapped(self, t: float = 1.0, progress: Progress | None = None) -> FloatArray:
        """The vertices of the source's mesh at t: with its own faces, the mesh on its way.

        At 1 the mesh is wrapped onto the target: its faces lie smoothly on the target's surface,
        into its tips and hollows, as far as it has vertices for them. The first call wraps it;
        after that, calls are quick and may come from several threads.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1. In between, vertices travel as the setting `path`
            says.
        progress : callable, optional
            As for `morph`.

        Returns
        -------
        (N, 3) array
            In the order of the source's vertices, and of their type.

        Raises
        ------
        CloudError
            Unless `has_mesh`.
        OptionError
            If t lies outside of [0, 1].
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-1, 1, 12))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> corner = np.arange(132).reshape(11, 12)[:, :-1].reshape(-1, 1)
        >>> faces = corner + [0, 1, 13, 12]
        >>> ends = [pointmorph.Cloud(size * plane, faces=faces) for size in (1, 2)]
        >>> result = pointmorph.morph(*ends, {"corner": (0, 0), "other": (11, 11)})
        >>> result.wrapped(1).shape
        (144, 3)
        """
        wrapped: FloatArray = self._native.wrapped(float(t), progress)
        return wrapped.astype(self.source.positions.dtype, copy=False)

    @property
    def has_target_mesh(self) -> bool:
        """Whether the target has faces for `wrapped_target`. With method paper it has none."""
        return self._native.has_target_mesh()

    def wrapped_target(self, t: float = 0.0, progress: Progress | None = None) -> FloatArray:
        """The vertices of the target's mesh at t: with its own faces, the mesh on its way.

        Like `wrapped`, the other way round: at 0 the target's mesh is wrapped onto the source, at 1
        it is where it is, bit for bit.

        Parameters
        ----------
        t : float
            0 to 1.
        progress : callable, optional
            As for `morph`.

        Returns
        -------
        (M, 3) array
            In the order of the target's vertices, and of their type.

        Raises
        ------
        CloudError
            Unless `has_target_mesh`.
        OptionError
            If t lies outside of [0, 1].
        Cancelled
            If `progress` returned False.
        """
        wrapped: FloatArray = self._native.wrapped_target(float(t), progress)
        return wrapped.astype(self.target.positions.dtype, copy=False)

    def vertex_times(self, t: float, side: str = "source") -> npt.NDArray[np.float64]:
        """How far each vertex of the source's or the target's mesh has gone at t.

        Parameters
        ----------
        t : float
            0 to 1.
        side : str
            source or target.

        Returns
        -------
        (N,) array
            0 (still the source) to 1 (the target already): t itself unless the setting `stagger`
            lets some go first.

        Raises
        ------
        OptionError
            If there is no such side.
        """
        if side not in ("source", "target"):
            raise OptionError("side", "source or target", repr(side), "Choose one of them.")
        return self._native.vertex_times(side == "source", float(t))

    def denser(
        self,
        side: str = "source",
        *,
        tolerance: float = 0.002,
        most_vertices: int = 200_000,
        progress: Progress | None = None,
    ) -> DenserMesh:
        """The mesh of one model with more faces where the other has what it can't show.

        Only there: faces that lie off the other model once they are wrapped onto it, or that it
        reaches beyond, are cut, until they fit or are small.

        Parameters
        ----------
        side : str
            source or target: whose mesh.
        tolerance : float
            How far faces may lie off, in √area of the other model.
        most_vertices : int
            It ends before there are more.
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        CloudError
            If that model has no faces.
        OptionError
            If an argument is out of range.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))
        >>> corner = np.arange(20).reshape(4, 5)[:, :-1].reshape(-1, 1)
        >>> faces = corner + [0, 1, 6, 5]
        >>> flat, high = (np.stack([x, y, h * x**2], axis=-1).reshape(-1, 3) for h in (0, 0.5))
        >>> ends = [pointmorph.Cloud(rows, faces=faces) for rows in (flat, high)]
        >>> mesh = pointmorph.morph(*ends).denser(tolerance=0.01)
        >>> bool(np.allclose(mesh.extended(flat), mesh.positions))
        True
        """
        if side not in ("source", "target"):
            raise OptionError("side", "source or target", repr(side), "Choose one of them.")
        if not 1e-4 <= tolerance <= 1:
            raise OptionError(
                "tolerance", "a number from 0.0001 to 1", f"{tolerance}", "Try 0.002."
            )
        cloud = self.source if side == "source" else self.target
        most = min(max(int(most_vertices), len(cloud)), 2**31 - 1)
        faces, parents, ends, wrapped = self._native.denser(
            side == "source", float(tolerance), most, progress
        )
        mesh = DenserMesh(faces, parents, ends, wrapped, wrapped)
        return replace(mesh, positions=mesh.extended(cloud.positions))

    def carrier(self, side: str = "source", progress: Progress | None = None) -> Carrier:
        """Carries what the other shape has to the points of this one, along the map.

        Weights and colors, UVs, displacements such as those of shape keys, and strands of hair: see
        `Carrier`. With faces, vertices take it from where they are `wrapped`; else from where the
        map takes them.

        Parameters
        ----------
        side : str
            source or target: the shape that gets it.
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        OptionError
            If there is no such side.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
        >>> up = np.tile([0.0, 0, 1], (900, 1))
        >>> bool(np.allclose(result.carrier().displacements(up), 0.5 * up))
        True
        """
        if side not in ("source", "target"):
            raise OptionError("side", "source or target", repr(side), "Choose one of them.")
        if side == "source":
            taker, giver = self.source, self.target
            meshed = self.has_mesh
            images = self.wrapped(1.0, progress) if meshed else self.source_to_target
        else:
            taker, giver = self.target, self.source
            meshed = self.has_target_mesh
            images = self.wrapped_target(0.0, progress) if meshed else self.target_to_source
        own, others = (
            None if cloud.faces is None else fans(*cloud.faces)[0] for cloud in (taker, giver)
        )
        return Carrier(taker.positions, images, giver.positions, own, others)

    @property
    def source_domain(self) -> npt.NDArray[np.float64]:
        """The source's points in the common domain: (N, 2) in the unit disk; (N, 3) on the unit
        sphere, also for a cut (left patch above); (N, 12) in the product space."""
        return self._native.source_domain()

    @property
    def target_domain(self) -> npt.NDArray[np.float64]:
        """(M, 2), (M, 3) or (M, 12): the target's points in the same domain."""
        return self._native.target_domain()

    @property
    def source_boundary(self) -> npt.NDArray[np.int64]:
        """Rows of the source's boundary, in order along it."""
        return self._native.source_boundary()

    @property
    def target_boundary(self) -> npt.NDArray[np.int64]:
        """Rows of the target's boundary, in order along it."""
        return self._native.target_boundary()

    def cracks(
        self, times: tuple[float, ...] = CRACK_TIMES, progress: Progress | None = None
    ) -> dict[str, float]:
        """For each t, the share of neighboring points that are torn apart there."""
        return {f"{t:g}": share for t, share in self._native.cracks(list(times), progress)}

    def measure_quality(self, progress: Progress | None = None) -> Quality:
        """Measures what `quality` returns, with progress and cancelling."""
        measured = self._native.quality(progress)
        return Quality(
            PointQuality(**measured["source"]),
            PointQuality(**measured["target"]),
            MapFigures(**measured["source_to_target"]),
            MapFigures(**measured["target_to_source"]),
            tuple(Place(**place) for place in measured["worst"]),
            tuple(FeatureResidual(**feature) for feature in measured["features"]),
        )

    @cached_property
    def quality(self) -> Quality:
        """The quality of the maps, per point and in figures, with advice for bad places.

        Measured on first access. Rows are those of the clouds; see `Quality`.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
        >>> result.quality.source.stretch.shape
        (900, 2)
        >>> result.quality.source_to_target.flipped
        0.0
        """
        return self.measure_quality()

    def measure_mesh_quality(self, progress: Progress | None = None) -> MeshQuality:
        """Measures what `mesh_quality` returns, with progress and cancelling."""
        measured = self._native.mesh_quality(progress)
        worst = tuple(MeshPlace(**place) for place in measured.pop("worst"))
        return MeshQuality(**measured, worst=worst)

    @cached_property
    def mesh_quality(self) -> MeshQuality:
        """How good the source's faces look where they are wrapped onto the target.

        Measured on first access, of `wrapped(1)`. Raises CloudError unless `has_mesh`.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-1, 1, 12))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> corner = np.arange(132).reshape(11, 12)[:, :-1].reshape(-1, 1)
        >>> ends = [pointmorph.Cloud(plane, faces=corner + [0, 1, 13, 12]) for _ in range(2)]
        >>> pointmorph.morph(*ends).mesh_quality.grade
        'good'
        """
        return self.measure_mesh_quality()

    @cached_property
    def report(self) -> dict[str, Any]:
        """What was done, how long it took, and how good the result is.

        Always: `stages` (seconds per stage), `seconds`, `peak_memory_bytes` (of the process),
        `points`, `pairs`, `feature_residual` (the largest of hard points, in spacings of the common
        domain), `features` (by name, as in `Quality.features`), `cracks`, `quality` (`MapFigures`
        in both directions), `worst` (as in `Quality.worst`), `warnings`, `method`, `domain`,
        `options`, and figures of the solvers. If the source has faces (`has_mesh`), `mesh` is a
        dictionary of its `MeshQuality`.

        `update` is "updated" for a morph that was updated, or why it was computed from scratch
        instead; empty for others.

        About the shapes: `choice` (in words, such as "product space: closed surfaces of genus 1 and
        0") and `topology` (of `source` and `target`: `words`; the components as `pieces`, largest
        first, each with `points`, `borders`, `open` and `genus`, which is None if unknown; and how
        many of the last ones are `specks`, stray points). About cuts: `loop` (given or suggested)
        and `tips` (rows of unmarked tips that were matched).

        If few or no features say how the shapes relate: `confidence` (0 to 1: how likely the map is
        to be right; None for an update of a map that was given, see `LiveMorph`), `margin` (cost of
        the second best map relative to this one; None without one), `rivals` (other maps: `ratio`
        of the costs; `swap`, which is ends, sides, turned or places; `distance`, the largest
        between two images, in √area; `places`, source rows where the maps differ; and a feature
        that would tell them apart, from `source` to `target` in this map and to `rival_target` in
        the other) and `proposals` (pairs of places to mark: `source`, `target`, `confidence`,
        `is_tip`).
        """
        quality = self.quality
        mesh = {"mesh": asdict(self.mesh_quality)} if self.has_mesh else {}
        return {
            **self._native.report(),
            "peak_memory_bytes": peak_memory_bytes(),
            "cracks": self.cracks(),
            "quality": {
                "source_to_target": asdict(quality.source_to_target),
                "target_to_source": asdict(quality.target_to_source),
            },
            "worst": [asdict(place) for place in quality.worst],
            "features": {
                kept.name: {key: value for key, value in asdict(kept).items() if key != "name"}
                for kept in quality.features
            },
            "points": [len(self.source), len(self.target)],
            **mesh,
        }


def morph(
    source: Cloud,
    target: Cloud,
    features: Mapping[str, tuple[int, int] | Feature] | None = None,
    *,
    loop: Sequence[str] | Sequence[Sequence[str]] = (),
    start: Morph | tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    progress: Progress | None = None,
    **settings: int | float | str | None,
) -> Morph:
    """Matches the points of two clouds.

    Parameters
    ----------
    source, target : Cloud
        Of any sizes; no common mesh and no faces needed. Where a cloud has faces, it stands for
        their surface: the match is found on even samples of them, and the vertices follow. Method
        paper knows points only.
    features : mapping of name to (source row, target row) or `Feature`, optional
        Pairs of rows are points to match exactly. For curves, regions and soft features, use
        `Feature`.
    loop : sequence of str, or of such sequences, optional
        Features, in order, along which closed models are cut with method `paper` or domain `cut`;
        see `decompose`. Without one, domain `cut` suggests a loop through the features on tips, and
        says so in the report. Open patches and domain `sphere` need none. For domain `network`,
        loops are optional: they are its first curves, and may share features.
    start : Morph, or (N, 3) and (M, 3) arrays, optional
        An earlier morph of these clouds, or its `source_to_target` and `target_to_source`, as a
        start after you add or move a feature. It is ignored if it contradicts the features. Method
        auto only.
    progress : callable, optional
        Called on this thread with the name of the stage and the fraction of it that is done; see
        `stage_label`. Returns False to cancel. The GIL is released between calls.
    **settings
        See `options`. None means automatic.

    Returns
    -------
    Morph

    Raises
    ------
    CloudError, FeatureError, OptionError, TopologyError, ConvergenceError
        Each says what was expected, what was found and what to do.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> bump = np.stack([x, y, np.exp(-4 * (x**2 + y**2))], axis=-1).reshape(-1, 3)
    >>> corner = {"corner": (0, 0)}
    >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(bump), corner)
    >>> bool(np.array_equal(result.frame(0).positions, plane[result.pairs[:, 0]]))
    True
    """
    native = _native(source, target, features, loop, native_options(settings), start, progress)
    return Morph(native, source, target)


def propose_features(
    source: Cloud,
    target: Cloud,
    features: Mapping[str, tuple[int, int] | Feature] | None = None,
    *,
    progress: Progress | None = None,
    **settings: int | float | str | None,
) -> tuple[Proposal, ...]:
    """Suggests pairs of places to mark as features.

    Computes a morph to find them. Parameters and errors are those of `morph`, except for method
    paper, which needs features itself.

    Returns
    -------
    tuple of Proposal
        First ends of limbs, then places between them, most confident first. They exclude
        `features`.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> rows = np.random.default_rng(1).normal(size=(2000, 3)) * (3, 1, 1)
    >>> ellipsoid = rows / np.linalg.norm(rows / (3, 1, 1), axis=1)[:, None]
    >>> cloud = pointmorph.Cloud(ellipsoid)
    >>> all(0 <= p.confidence <= 1 for p in pointmorph.propose_features(cloud, cloud))
    True
    """
    if settings.get("method") == "paper":
        raise OptionError("method", "auto", "paper", "Leave the method out; paper needs features.")
    chosen = native_options(settings)
    chosen.propose_features()
    rows = _native(source, target, features, (), chosen, None, progress).report()
    counts = {True: 0, False: 0}
    proposals = []
    for row in rows["proposals"]:
        counts[row["is_tip"]] += 1
        name = f"{'tip' if row['is_tip'] else 'place'}.{counts[row['is_tip']]}"
        proposals.append(Proposal(name, row["source"], row["target"], row["confidence"]))
    return tuple(proposals)


def native_loops(loop: Sequence[str] | Sequence[Sequence[str]]) -> list[list[str]]:
    """The loops as a list: none, one, or several."""
    single = [name for name in loop if isinstance(name, str)]
    if single:
        if len(single) < len(loop):
            raise FeatureError(
                "loop", "feature names, or sequences of them", repr(loop), "Use one or the other."
            )
        return [single]
    return [list(names) for names in loop]


def _native(
    source: Cloud,
    target: Cloud,
    features: Mapping[str, tuple[int, int] | Feature] | None,
    loop: Sequence[str] | Sequence[Sequence[str]],
    chosen: _pointmorph.MorphOptions,
    start: Morph | tuple[npt.ArrayLike, npt.ArrayLike] | None,
    progress: Progress | None,
) -> _pointmorph.Morph:
    return _pointmorph.Morph(
        source._fields(),
        target._fields(),
        native_features(features),
        native_loops(loop),
        chosen,
        *start_arrays(start),
        progress,
    )


def restore(
    source: Cloud,
    target: Cloud,
    pairs: npt.ArrayLike,
    maps: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    **settings: int | float | str | None,
) -> Morph:
    """Rebuilds an earlier morph, for its frames, without computing it again.

    Parameters
    ----------
    source, target : Cloud
        With normals and radii.
    pairs : (M, 2) array_like of int
        Its `pairs`.
    maps : (N, 3) and (M, 3) array_like, optional
        Its `source_to_target` and `target_to_source`, for paths other than straight ones. Without
        them, points move to the mean of their partners.
    **settings
        The settings that concern frames: `path`, `omega` and so on.

    Raises
    ------
    CloudError, OptionError
        If the pairs don't fit the clouds, normals or radii are missing, or a setting is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> up = np.tile([0.0, 0, 1], (900, 1))
    >>> ends = [pointmorph.Cloud(size * plane, up, radii=np.full(900, 0.07)) for size in (1, 2)]
    >>> rows = np.arange(900)
    >>> result = pointmorph.restore(*ends, np.column_stack([rows, rows]), path="linear")
    >>> bool(np.allclose(result.frame(0.5).positions, 1.5 * plane))
    True
    """
    rows = np.ascontiguousarray(pairs, dtype=np.int64)
    if rows.ndim != 2 or rows.shape[1] != 2 or len(rows) == 0:
        raise CloudError(
            "pairs",
            "an array with 2 columns",
            f"the shape {rows.shape}",
            "Pass the pairs of a morph.",
        )
    rows = np.clip(rows, -1, 2**31 - 1)
    images = start_arrays(maps)
    kept: dict[str, Any] = {
        "source_images": images[0],
        "target_images": images[1],
        "source_ends": None,
        "target_ends": None,
        "resampling": None,
    }
    native = _pointmorph.Morph.restore(
        source._fields(), target._fields(), rows, kept, native_options(settings)
    )
    return Morph(native, source, target)


def is_straight(**settings: Any) -> bool:
    """Whether the points of a morph with these settings go straight."""
    straight: bool = native_options(settings).is_straight()
    return straight


def native_options(settings: Mapping[str, Any]) -> _pointmorph.MorphOptions:
    """The settings as the native library takes them. Raises OptionError."""
    result = _pointmorph.MorphOptions()
    for name, value in settings.items():
        result.set(name, _plain(name, value))
    return result


def start_arrays(
    start: Morph | tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> tuple[npt.NDArray[np.float64] | None, npt.NDArray[np.float64] | None]:
    if start is None:
        return None, None
    maps = (start.source_to_target, start.target_to_source) if isinstance(start, Morph) else start
    source, target = (np.asarray(rows, dtype=np.float64) for rows in maps)
    for rows in (source, target):
        if rows.ndim != 2 or rows.shape[1] != 3:
            raise CloudError(
                "start",
                "two arrays with 3 columns",
                f"the shape {rows.shape}",
                "Pass source_to_target and target_to_source of an earlier morph.",
            )
    return source, target


def _plain(name: str, value: Any) -> int | float | str | None:
    """The Python value of a numpy scalar. Booleans don't count as numbers."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float | str)):
        raise OptionError(
            name, "a number or a word", f"{value!r}", "See pointmorph.options() for the range."
        )
    if isinstance(value, int) and abs(value) >= 2**63:
        return float(value)
    return value


def peak_memory_bytes() -> int:
    """The most memory that this process has used so far; 0 if unknown."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
