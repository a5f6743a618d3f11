"""What is measured of a morph, and its report."""

from __future__ import annotations

import sys
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.stages import Progress
from pointmorph.morphs.confidence import Confidence
from pointmorph.morphs.morph_meshes import AsMeshes
from pointmorph.morphs.quality import (
    FeatureResidual,
    MapFigures,
    MeshPlace,
    MeshQuality,
    Place,
    PointQuality,
    Quality,
)
from pointmorph.shapes.clouds import SIDES

CRACK_TIMES = (0.25, 0.5, 0.75)


class Measured(AsMeshes):
    """How good a morph is. A part of `Morph`."""

    def cracks(
        self, times: tuple[float, ...] = CRACK_TIMES, progress: Progress | None = None
    ) -> dict[str, float]:
        """For each t, the share of neighboring points that are torn apart there."""
        return {f"{t:g}": share for t, share in self._native.cracks(list(times), progress)}

    def measure_quality(self, progress: Progress | None = None) -> Quality:
        """Measures what `quality` returns, with progress and canceling."""
        measured = self._native.quality(True, progress)
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

    @property
    def has_confidence(self) -> bool:
        """Whether there is a `confidence`: it takes what the map was found with, which a morph
        doesn't have that was restored from its pairs or opened from an older file."""
        return bool(self._native.report()["method"])

    def measure_confidence(self, progress: Progress | None = None) -> Confidence:
        """How likely each point is mapped to where it belongs, and what to mark where it isn't.

        Takes `quality`, and little more time. Rows are those of the clouds.

        Parameters
        ----------
        progress : callable, optional
            As for `morph`.

        Raises
        ------
        CloudError
            Unless `has_confidence`.
        Cancelled
            If `progress` returned False.

        Examples
        --------
        >>> import numpy as np
        >>> import pointmorph
        >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
        >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        >>> corner = {"corner": (0, 0), "edge": (29, 29)}
        >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(plane), corner)
        >>> bool(result.measure_confidence().source.min() > 0.9)
        True
        """
        measured = self._native.local_confidence(progress)
        source, target = (measured[side].astype(np.float32) for side in SIDES)
        return Confidence.of(source, target, measured)

    @cached_property
    def confidence(self) -> npt.NDArray[np.float32]:
        """(P,) float32, 0 to 1: how likely each pair is right; the lower of both its ends.

        Measured on first access; see `measure_confidence`.
        """
        return self.measure_confidence().of_pairs(self.pairs)

    def measure_mesh_quality(self, progress: Progress | None = None) -> MeshQuality:
        """Measures what `mesh_quality` returns, with progress and canceling."""
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
        `options`, and figures of the solvers. If `has_confidence`, `likely_right` and `doubtful`
        are `right` and `doubtful` of `Confidence`. If the source has faces (`has_mesh`), `mesh` is
        a dictionary of its `MeshQuality`.

        `update` is "updated" for a morph that was updated, or why it was computed from scratch
        instead; empty for others.

        About the shapes: `choice` (in words, such as "product space: closed surfaces with 1 hole
        through each") and `topology` (of `source` and `target`: `words`; the components as
        `pieces`, largest first, each with `points`, `borders`, `open` and `genus`, the number of
        holes through it, which is None if unknown; and how many of the last ones are `specks`,
        stray points). About cuts: `loop` (given or suggested) and `tips` (rows of unmarked tips
        that were matched).

        If few or no features say how the shapes relate: `confidence` (0 to 1: how likely the map is
        to be right; None for an update of a map that was given, see `LiveMorph`), `margin` (cost of
        the second best map relative to this one; None without one), `rivals` (other maps: `ratio`
        of the costs, or what they count as; `swap`, which is ends, sides, turned, places or
        rolled; `distance`, the largest between two images, in √area; `places`, source rows where
        the maps differ; and a feature that would tell them apart, from `source` to `target` in this
        map and to `rival_target` in the other) and `proposals` (pairs of places to mark: `source`,
        `target`, `confidence`, `is_tip`).
        """
        quality = self._native.quality(False, None)
        report = self._native.report()
        if self.has_confidence:
            confidence = self.measure_confidence()
            report["likely_right"] = confidence.right
            report["doubtful"] = [asdict(place) for place in confidence.doubtful]
            if confidence.warning:
                report["warnings"].append(confidence.warning)
        mesh = {"mesh": asdict(self.mesh_quality)} if self.has_mesh else {}
        return {
            **report,
            "peak_memory_bytes": peak_memory_bytes(),
            "cracks": self.cracks(),
            "quality": {way: quality[way] for way in ("source_to_target", "target_to_source")},
            "worst": quality["worst"],
            "features": {kept.pop("name"): kept for kept in quality["features"]},
            "points": [len(self.source), len(self.target)],
            **mesh,
        }


def peak_memory_bytes() -> int:
    """The most memory that this process has used so far; 0 if unknown."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
