"""The morph: computed once, cheap to ask."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.clouds import Cloud, FloatArray
from pointmorph.errors import CloudError, FeatureError, OptionError
from pointmorph.features import Feature, native_features
from pointmorph.quality import FeatureResidual, MapFigures, Place, PointQuality, Quality

Progress = Callable[[str, float], bool | None]
"""Gets a stage's name and the fraction of it that is done; returns False to ask for the end."""

CRACK_TIMES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Option:
    """A setting of a morph. `default` None means automatic."""

    name: str
    kind: str
    """int, float or choice."""
    default: int | float | str | None
    minimum: float
    maximum: float
    choices: tuple[str, ...]
    unit: str
    help: str


@lru_cache(maxsize=1)
def options() -> tuple[Option, ...]:
    """All settings that `morph` takes, with their defaults, ranges, units and meanings.

    Examples
    --------
    >>> import pointmorph
    >>> [option.default for option in pointmorph.options() if option.name == "influence"]
    [8.0]
    """
    return tuple(Option(**row) for row in _pointmorph.option_table())


@dataclass(frozen=True)
class Frame:
    """An in-between cloud: one row for each pair of `Morph.pairs`."""

    positions: FloatArray
    """(M, 3)"""
    normals: FloatArray
    """(M, 3), unit length between the ends"""
    colors: FloatArray
    """(M, 4), red green blue alpha; white where neither cloud has colours"""
    radii: FloatArray
    """(M,)"""


@dataclass(frozen=True)
class ResampledFrame(Frame):
    """An in-between cloud without cracks: as many rows as it takes."""

    ids: npt.NDArray[np.int32]
    """(M,), ascending: the row of a pair, or higher for a new point, which keeps its own as long
    as it lives"""
    velocities: FloatArray
    """(M, 3), the distance for t from 0 to 1 at this speed; divide it by the number of frames"""


@dataclass(frozen=True)
class Proposal:
    """Two places that probably belong together. Made by `pointmorph.propose_features`."""

    name: str
    """tip.1, tip.2 … for ends of limbs on both shapes, place.1 … for places between them"""
    source: int
    """row of the source"""
    target: int
    """row of the target"""
    confidence: float
    """about how often such a pair lies within 0.1 √area of the truth, 0 to 1"""


class Morph:
    """A finished correspondence between two clouds. Made by `pointmorph.morph`.

    Attributes
    ----------
    source, target : Cloud
        As they were handed in.
    pairs : (M, 2) array of int64
        Rows of source and target that belong together. Every row of both is in at least one pair.
    """

    def __init__(self, native: _pointmorph.Morph, source: Cloud, target: Cloud) -> None:
        self._native = native
        self.source = source
        self.target = target
        self.pairs: npt.NDArray[np.int64] = native.pairs()
        single = source.positions.dtype == target.positions.dtype == np.float32
        self._dtype: type[np.floating[Any]] = np.float32 if single else np.float64

    def __repr__(self) -> str:
        return f"<Morph {self.source.name!r} to {self.target.name!r}: {len(self.pairs)} pairs>"

    @property
    def parts(self) -> tuple[Morph, ...]:
        """The morphs that it goes through one after the other: itself."""
        return (self,)

    def empty_frame(self) -> Frame:
        """Arrays of the right size and type to pass as `out` to `frame`."""
        m = len(self.pairs)
        return Frame(
            np.empty((m, 3), self._dtype),
            np.empty((m, 3), self._dtype),
            np.empty((m, 4), self._dtype),
            np.empty(m, self._dtype),
        )

    def frame(self, t: float, out: Frame | None = None) -> Frame:
        """The in-between cloud at t, along the paths of the setting `path`.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1 (the target, bit for bit).
        out : Frame, optional
            An earlier frame of this morph, to write into: nothing is allocated then.

        Returns
        -------
        Frame
            float32 where both clouds came as float32, else float64.

        Raises
        ------
        OptionError
            For t outside [0, 1] or an `out` of another size or type.
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
                    "Pass what empty_frame() or an earlier frame of this morph returned.",
                )
        native = self._native
        write = native.frame_float32 if self._dtype is np.float32 else native.frame_float64
        write(float(t), *arrays)
        return out

    def resampled_frame(self, t: float, progress: Progress | None = None) -> ResampledFrame:
        """The in-between cloud at t with new points where it would show cracks.

        New points lie on the smooth surface of the points around, take their colours, and come and
        go with their radius: nothing pops. Where they live is found when the first such frame is
        asked for; after that, frames can be asked for in any order, from several threads.

        Parameters
        ----------
        t : float
            0 (the source, bit for bit) to 1 (the target, bit for bit).
        progress : callable, optional
            As in `morph`.

        Raises
        ------
        OptionError
            For t outside [0, 1].
        Cancelled
            When `progress` returned False.

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
        """How many new points there are in all the re-sampled frames together."""
        return self._native.inserted(progress)

    @cached_property
    def source_to_target(self) -> FloatArray:
        """(N, 3): where every source point lands on the target; smooth, not snapped to samples."""
        return self._native.source_to_target(None).astype(self._dtype)

    @cached_property
    def target_to_source(self) -> FloatArray:
        """(M, 3): where every target point lands on the source; smooth, not snapped to samples."""
        return self._native.target_to_source(None).astype(self._dtype)

    @property
    def source_domain(self) -> npt.NDArray[np.float64]:
        """(N, 2): the source's points in the unit disk; (N, 3) on the unit sphere, which the
        disks of a cut are glued to, the left one above; (N, 12) in the product space."""
        return self._native.source_domain()

    @property
    def target_domain(self) -> npt.NDArray[np.float64]:
        """(M, 2), (M, 3) or (M, 12): where the target's points lie there."""
        return self._native.target_domain()

    @property
    def source_boundary(self) -> npt.NDArray[np.int64]:
        """Rows of the source's boundary in order."""
        return self._native.source_boundary()

    @property
    def target_boundary(self) -> npt.NDArray[np.int64]:
        """Rows of the target's boundary in order."""
        return self._native.target_boundary()

    def cracks(
        self, times: tuple[float, ...] = CRACK_TIMES, progress: Progress | None = None
    ) -> dict[str, float]:
        """By t, the share of neighbouring points between which the in-between cloud is open."""
        return {f"{t:g}": share for t, share in self._native.cracks(list(times), progress)}

    def measure_quality(self, progress: Progress | None = None) -> Quality:
        """The same as `quality`, with a function to follow and cancel the measuring."""
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
        """How good the maps are, by point and in figures, and what would help where they are bad.

        Measured when first asked for. Rows are those of the clouds; see `Quality`.

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

    @cached_property
    def report(self) -> dict[str, Any]:
        """What was done, how long it took and how good it is.

        `stages` (seconds by stage), `seconds`, `peak_memory_bytes` (of the process), `pairs`,
        `feature_residual` (the largest of hard points, in spacings of the common domain),
        `features` (by name, those of `Quality.features`), `cracks`, `quality` (the figures of
        `MapFigures` both ways), `worst` (those of `Quality.worst`), `warnings`, `method`, `domain`,
        `choice` (the domain and what the shapes are, in words, such as "product space: closed
        surfaces of genus 1 and 0"), `topology` (of `source` and `target`: `words`; `pieces`, the
        one with the most points first, each with `points`, `borders`, `open` and `genus`, None
        where the points don't say for sure; and how many of the last ones are `specks`),
        `loop` (given, or proposed for a cut), `tips` (rows of unmarked tips that a cut brought
        together),
        `options` and what the solver needed on both sides.

        Where few or no features said how the clouds lie to each other: `confidence` (about how
        likely the map is right, 0 to 1), `margin` (cost of the second best map over that of this
        one; None where there is none), `rivals` (other maps that were found: `ratio` of costs;
        `swap`, which is ends, sides, turned or places; `distance`, the largest between two images,
        in √area; `places`, source rows where they differ; and a mark that tells them apart,
        `source`, with its partner `target` now and `rival_target` then) and `proposals` (pairs of
        places to mark: `source`, `target`, `confidence`, `is_tip`).
        """
        quality = self.quality
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
    """Finds which point of one cloud belongs to which point of the other.

    Parameters
    ----------
    source, target : Cloud
        Any sizes; no common mesh, no faces needed.
    features : mapping of name to (source row, target row) or `Feature`, optional
        Points that must coincide; curves, regions, and what is soft are a `Feature`.
    loop : sequence of str, or of such sequences, optional
        Features, in order, through which a closed model is cut (methods that cut: `paper`, or
        domain `cut`); see `decompose`. Domain `cut` proposes one through the features on tips
        where none is given, and says so in the report. An open patch takes none, and domain
        `sphere` uses none. Several loops, which may share features, are the first curves of domain
        `network`, which needs none.
    start : Morph, or (N, 3) and (M, 3) arrays, optional
        An earlier morph of these clouds, or its `source_to_target` and `target_to_source`: after a
        feature was added or moved, the new map is found from the old one. Where that contradicts
        the features, it isn't used. Method auto only.
    progress : callable, optional
        Called with the stage's name and the fraction done of it, on this thread. Returns False to
        cancel. The GIL is free in between.
    **settings
        See `options`. None is automatic.

    Returns
    -------
    Morph

    Raises
    ------
    CloudError, FeatureError, OptionError, TopologyError, ConvergenceError
        Each says what was expected, what was found and what to do.
    Cancelled
        When `progress` returned False.

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
    """Finds places that a user may want to mark, and their partners.

    Computes the morph for it. Parameters, progress and errors are those of `morph`; the method
    paper, which needs features, isn't available.

    Returns
    -------
    tuple of Proposal
        First the tips, then the places between, each the most confident first. None of `features`.

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
        raise OptionError(
            "method", "auto", "paper", "Leave the method out: paper starts from features."
        )
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
    """None, one, or several, as lists."""
    single = [name for name in loop if isinstance(name, str)]
    if single:
        if len(single) < len(loop):
            raise FeatureError(
                "loop", "names of features, or sequences of them", repr(loop), "Don't mix the two."
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
        *_start_arrays(start),
        progress,
    )


def restore(
    source: Cloud,
    target: Cloud,
    pairs: npt.ArrayLike,
    maps: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    **settings: int | float | str | None,
) -> Morph:
    """A morph that was found earlier, to ask for frames: nothing is computed again.

    Parameters
    ----------
    source, target : Cloud
        With normals and radii.
    pairs : (M, 2) array_like of int
        Its `pairs`.
    maps : (N, 3) and (M, 3) array_like, optional
        Its `source_to_target` and `target_to_source`, for paths other than straight ones; without
        them points go to the mean of their partners.
    **settings
        Those that concern frames: `path`, `omega` and so on.

    Raises
    ------
    CloudError, OptionError
        For pairs that don't fit the clouds, missing normals or radii, or bad settings.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> up = np.tile([0.0, 0, 1], (900, 1))
    >>> ends = [pointmorph.Cloud(size * plane, up, radii=np.full(900, 0.07)) for size in (1, 2)]
    >>> rows = np.arange(900)
    >>> result = pointmorph.restore(*ends, np.column_stack([rows, rows]))
    >>> bool(np.allclose(result.frame(0.5).positions, 1.5 * plane))
    True
    """
    rows = np.ascontiguousarray(pairs, dtype=np.int64)
    if rows.ndim != 2 or rows.shape[1] != 2 or len(rows) == 0:
        raise CloudError(
            "pairs", "an array of 2 columns", f"the shape {rows.shape}", "Take those of a morph."
        )
    rows = np.clip(rows, -1, 2**31 - 1)
    native = _pointmorph.Morph.restore(
        source._fields(),
        target._fields(),
        rows,
        *_start_arrays(maps),
        native_options(settings),
    )
    return Morph(native, source, target)


def native_options(settings: Mapping[str, Any]) -> _pointmorph.MorphOptions:
    """The settings as the native library takes them. Raises OptionError."""
    result = _pointmorph.MorphOptions()
    for name, value in settings.items():
        result.set(name, _plain(name, value))
    return result


def _start_arrays(
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
                "two arrays of 3 columns",
                f"the shape {rows.shape}",
                "Take source_to_target and target_to_source of an earlier morph.",
            )
    return source, target


def _plain(name: str, value: Any) -> int | float | str | None:
    """The Python value behind a numpy scalar; a bool is no number here."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float | str)):
        raise OptionError(
            name, "a number or a word", f"{value!r}", "See pointmorph.options() for its range."
        )
    if isinstance(value, int) and abs(value) >= 2**63:
        return float(value)
    return value


def peak_memory_bytes() -> int:
    """The largest amount of memory that this process has held so far, 0 where unknown."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
