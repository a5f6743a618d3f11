"""Morphs that follow their features while they change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.option_table import native_options
from pointmorph.base.stages import Progress
from pointmorph.morphs.morphing import Morph, start_arrays
from pointmorph.shapes.clouds import Cloud, FloatArray
from pointmorph.shapes.features import Feature, native_features

Features = Mapping[str, tuple[int, int] | Feature]


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
        native: Any = self._native.updated(native_features(features), progress)
        return Morph(native, *self._clouds)
