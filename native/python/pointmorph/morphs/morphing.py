"""Morphs: computed once, then cheap to query."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.errors import CloudError, FeatureError, OptionError
from pointmorph.base.option_table import native_options
from pointmorph.base.stages import Progress
from pointmorph.morphs.measuring import Measured
from pointmorph.shapes.clouds import Cloud, FloatArray
from pointmorph.shapes.features import Feature, native_features

Features = Mapping[str, tuple[int, int] | Feature]


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


class Morph(Measured):
    """A computed match between two clouds, made by `pointmorph.morph`.

    Attributes
    ----------
    source, target : Cloud
        The clouds passed to `morph`.
    pairs : (M, 2) array of int64
        Matching rows of source and target. Every row of both is in at least one pair.
    """

    _live: LiveMorph | None = None

    def __repr__(self) -> str:
        return f"<Morph {self.source.name!r} to {self.target.name!r}: {len(self.pairs)} pairs>"

    @property
    def parts(self) -> tuple[Morph, ...]:
        """The morphs of a chain; here only this one."""
        return (self,)

    def updated(self, features: Features, progress: Progress | None = None) -> Morph:
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
        if self._live is None:
            self._live = LiveMorph.of(self, progress)
        return self._live.updated(features, progress)

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
        from pointmorph.morphs.stored_morphs import write

        write(self, Path(path), resample, dict(origin or {}), progress)

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


class LiveMorph:
    """A map and all that it takes to bend it to changed features in a moment.

    Making one takes about as long as preparing the shapes for a morph. Updates start from its own
    map, never from one another: the same features give the same bits, whatever was asked for
    before. Calls may come from several threads.

    Parameters
    ----------
    source, target : Cloud
    features : mapping of name to (source row, target row) or `Feature`, optional
        Those of the map.
    maps : Morph, or (N, 3) and (M, 3) arrays
        The map: a morph of these clouds with these features and settings, or its
        `source_to_target` and `target_to_source`.
    progress : callable, optional
        As in `morph`.
    **settings
        Those of the morph. Method auto and domain auto only.

    Raises
    ------
    CloudError, FeatureError, OptionError
        Each says what was expected, what was found and what to do.
    Cancelled
        If `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> ends = pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane)
    >>> marks = {"corner": (0, 0), "middle": (465, 465)}
    >>> live = pointmorph.LiveMorph(*ends, marks, pointmorph.morph(*ends, marks))
    >>> places = live.source_to_target({**marks, "middle": (465, 467)})
    >>> bool(np.allclose(places[465], 2 * plane[467]))
    True
    >>> live.updated({**marks, "middle": (465, 467)}).report["update"]
    'updated'
    """

    def __init__(
        self,
        source: Cloud,
        target: Cloud,
        features: Features | None,
        maps: Morph | tuple[npt.ArrayLike, npt.ArrayLike],
        *,
        progress: Progress | None = None,
        **settings: int | float | str | None,
    ) -> None:
        self._native = _pointmorph.LiveMorph(
            source._fields(),
            target._fields(),
            native_features(features),
            native_options(settings),
            start_arrays(maps),
            progress,
        )
        self._clouds = source, target

    @classmethod
    def of(cls, morph: Morph, progress: Progress | None = None) -> LiveMorph:
        """Of a morph, with its own features and settings."""
        live = cls.__new__(cls)
        live._native = _pointmorph.LiveMorph.of(morph._native, progress)
        live._clouds = morph.source, morph.target
        return live

    def source_to_target(self, features: Features, progress: Progress | None = None) -> FloatArray:
        """(N, 3): where source points go, roughly: for display while a feature is dragged.

        Found on the coarsest level alone, several times a second. Hard point features meet
        exactly. For the features as they were, the map itself.
        """
        source, target = self._clouds
        single = source.positions.dtype == target.positions.dtype == np.float32
        found = self._native.source_to_target(native_features(features), progress)
        rows: FloatArray = found.astype(np.float32) if single else found
        return rows

    def updated(self, features: Features, progress: Progress | None = None) -> Morph:
        """The whole morph for changed features: moved, added or deleted ones.

        Its map is about as good as one from scratch. Where a feature lies far from where the map
        has it, or the map would tear, it is computed from scratch; `report["update"]` and a
        warning say so. How likely the map is to be right (`confidence`) is not judged again: it is
        that of the morph in `LiveMorph.of(morph)`, and None where maps were given.
        """
        return Morph(self._native.updated(native_features(features), progress), *self._clouds)


def morph(
    source: Cloud,
    target: Cloud,
    features: Features | None = None,
    *,
    loop: Sequence[str] | Sequence[Sequence[str]] = (),
    start: Morph | tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    frames: bool = False,
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
    frames : bool
        Whether you will ask for frames. Then some of what they take is done while the map is found,
        where a core has nothing else to do: for clouds without faces, of fewer than 300,000 points
        together, on paths that aren't straight. The result is the same.
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
    chosen = native_options(settings)
    if frames:
        chosen.expect_frames()
    native = _native((source, target), features, loop, chosen, start, progress)
    return Morph(native, source, target)


def propose_features(
    source: Cloud,
    target: Cloud,
    features: Features | None = None,
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
    rows = _native((source, target), features, (), chosen, None, progress).report()
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
    clouds: tuple[Cloud, Cloud],
    features: Features | None,
    loop: Sequence[str] | Sequence[Sequence[str]],
    chosen: _pointmorph.MorphOptions,
    start: Morph | tuple[npt.ArrayLike, npt.ArrayLike] | None,
    progress: Progress | None,
) -> _pointmorph.Morph:
    return _pointmorph.Morph(
        clouds[0]._fields(),
        clouds[1]._fields(),
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
