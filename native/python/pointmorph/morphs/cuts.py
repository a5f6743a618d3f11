"""Cuts through closed shapes, to look at before using them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.option_table import native_options
from pointmorph.base.stages import Progress
from pointmorph.shapes.clouds import Cloud, FloatArray
from pointmorph.shapes.features import Feature, native_features


@dataclass(frozen=True)
class Cut:
    """A closed curve through features, and the two sides of it."""

    curve: FloatArray
    """(K, 3), in order; the last point is connected to the first"""
    normals: FloatArray
    """(K, 3), of the surface along the curve"""
    corners: dict[str, int]
    """by name of the feature: its row of `curve`"""
    sides: npt.NDArray[np.int8]
    """(N,): 1 left of the curve, -1 right of it, 0 on it, seen from outside along the curve"""


def decompose(
    cloud: Cloud,
    loop: Mapping[str, int],
    *,
    progress: Progress | None = None,
    **settings: int | float | str | None,
) -> Cut:
    """Cuts a closed shape in two along a curve through features, as `morph` does with a loop.

    Parameters
    ----------
    cloud : Cloud
        A closed shape. Small holes don't matter.
    loop : mapping of name to row
        At least three features, in their order along the curve.
    progress : callable, optional
        As for `pointmorph.morph`.
    **settings
        See `options`.

    Returns
    -------
    Cut

    Raises
    ------
    CloudError, FeatureError, OptionError, TopologyError
        If the shape is an open patch, or the loop crosses itself or doesn't divide the surface.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> i = np.arange(2000)
    >>> z, a = 1 - (2 * i + 1) / 2000, i * np.pi * (3 - 5**0.5)
    >>> sphere = np.stack([np.cos(a), np.sin(a), z], axis=1)
    >>> sphere[:, :2] *= np.sqrt(1 - z * z)[:, None]
    >>> equator = [int(np.argmax(sphere @ p)) for p in ([1, 0, 0], [-1, 2, 0], [-1, -2, 0])]
    >>> cut = pointmorph.decompose(pointmorph.Cloud(sphere), dict(zip("abc", equator)))
    >>> bool(np.abs(cut.curve[:, 2]).max() < 0.12)  # the spacing of the points is 0.08
    True
    """
    curve, normals, corners, sides = _pointmorph.decompose(
        cloud._fields(), list(loop.values()), list(loop), native_options(settings), progress
    )
    kind: type[np.floating[Any]] = cloud.positions.dtype.type
    return Cut(
        curve.astype(kind), normals.astype(kind), dict(zip(loop, corners, strict=True)), sides
    )


def propose_loop(
    source: Cloud,
    target: Cloud,
    features: Mapping[str, tuple[int, int] | Feature],
    *,
    progress: Progress | None = None,
    **settings: int | float | str | None,
) -> list[str]:
    """Suggests a loop for `morph`: the one that domain `cut` uses if none is given.

    Parameters are those of `morph`. `decompose` shows what a loop cuts.

    Returns
    -------
    list of str
        The names of at least three features, in order.

    Raises
    ------
    CloudError, FeatureError, OptionError
        If a shape is an open patch, or there are fewer than three point features.

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> i = np.arange(2000)
    >>> z, a = 1 - (2 * i + 1) / 2000, i * np.pi * (3 - 5**0.5)
    >>> sphere = np.stack([np.cos(a), np.sin(a), z], axis=1)
    >>> sphere[:, :2] *= np.sqrt(1 - z * z)[:, None]
    >>> around = {n: int(np.argmax(sphere @ p)) for n, p in zip("abc", ([1, 0, 0], [-1, 2, 0],
    ...     [-1, -2, 0]))}
    >>> cloud = pointmorph.Cloud(sphere)
    >>> sorted(pointmorph.propose_loop(cloud, cloud, {n: (r, r) for n, r in around.items()}))
    ['a', 'b', 'c']
    """
    return _pointmorph.propose_loop(
        source._fields(),
        target._fields(),
        native_features(features),
        native_options(settings),
        progress,
    )
