"""Networks of curves that cut two closed shapes alike, to look at before using them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import _pointmorph
from pointmorph.base.option_table import native_options
from pointmorph.base.stages import Progress
from pointmorph.morphs.morphing import native_loops
from pointmorph.shapes.clouds import Cloud, FloatArray
from pointmorph.shapes.features import Feature, native_features


@dataclass(frozen=True)
class NetworkCurve:
    """A curve from one feature to another, on both shapes."""

    start: str
    end: str
    source: FloatArray
    """(K, 3), in order"""
    target: FloatArray
    """(L, 3), in order"""


@dataclass(frozen=True)
class Network:
    """Curves between features that divide two closed shapes into the same patches."""

    curves: tuple[NetworkCurve, ...]
    """in the order in which they were traced"""
    patches: tuple[tuple[str, ...], ...]
    """the features around each patch, counterclockwise seen from outside"""
    source: npt.NDArray[np.int64]
    """(N,): the patch of each point; -1 for features"""
    target: npt.NDArray[np.int64]
    """(M,): the same for the target"""


def trace_network(
    source: Cloud,
    target: Cloud,
    features: Mapping[str, tuple[int, int] | Feature],
    *,
    loop: Sequence[str] | Sequence[Sequence[str]] = (),
    progress: Progress | None = None,
    **settings: int | float | str | None,
) -> Network:
    """Cuts two closed shapes of the same genus into the same patches, as domain `network` does.

    Parameters and errors are those of `morph`.

    Returns
    -------
    Network

    Examples
    --------
    >>> import numpy as np
    >>> import pointmorph
    >>> u, v = np.meshgrid(np.arange(90) * np.pi / 45, np.arange(36) * np.pi / 18)
    >>> r = 1 + 0.4 * np.cos(v)
    >>> torus = np.stack([r * np.cos(u), r * np.sin(u), 0.4 * np.sin(v)], axis=-1).reshape(-1, 3)
    >>> places = {f"{a} {b}": 12 * b * 90 + 30 * a for a in range(3) for b in range(3)}
    >>> cloud = pointmorph.Cloud(torus.round(4))
    >>> network = pointmorph.trace_network(cloud, cloud, {n: (r, r) for n, r in places.items()})
    >>> len(places) - len(network.curves) + len(network.patches)  # Euler's number of a torus
    0
    """
    curves, patches, source_labels, target_labels = _pointmorph.trace_network(
        source._fields(),
        target._fields(),
        native_features(features),
        native_loops(loop),
        native_options(settings),
        progress,
    )
    ends = [(start, end) for start, end, _, _ in curves]
    kinds: tuple[type[np.floating[Any]], ...] = (
        source.positions.dtype.type,
        target.positions.dtype.type,
    )
    return Network(
        tuple(NetworkCurve(a, b, s.astype(kinds[0]), t.astype(kinds[1])) for a, b, s, t in curves),
        tuple(tuple(ends[dart // 2][dart % 2] for dart in darts) for darts in patches),
        source_labels,
        target_labels,
    )
