"""How sure a morph is of itself, point by point, and what to mark where it isn't."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class DoubtfulPlace:
    """A place where the map is more likely wrong than right."""

    source: int
    """row of the source: where a mark would help most"""
    target: int
    """row of the target: where the map takes it now"""
    confidence: float
    """mean over the doubtful points there, 0 to 1"""
    share: float
    """share of the surface that they cover, 0 to 1"""
    advice: str
    """where it is, and which mark would settle it"""
    where: str = ""
    """only where it is, such as "toward +X of Fox"; empty in older files"""
    unreached: bool = False
    """whether nothing of the other model comes near, so that this part may have no counterpart"""
    side: str = ""
    """which model the doubtful points are of, "source" or "target"; empty in older files"""


@dataclass(frozen=True)
class Confidence:
    """How likely each point is mapped to where it belongs, to within 0.1 √area; 0 to 1."""

    source: npt.NDArray[np.float32]
    """(N,), of the source's points"""
    target: npt.NDArray[np.float32]
    """(M,), of the target's points"""
    doubtful: tuple[DoubtfulPlace, ...]
    """at most five places, far apart, the worst first; empty if nothing is more likely wrong"""
    right: float
    """how much of the map is likely right, 0 to 1: the mean over the surface of one cloud, of which
    it is lower"""
    warning: str
    """what to do where that is less than 0.8, else empty"""

    def of_pairs(self, pairs: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """(P,): the lower of both ends of each pair."""
        lower: npt.NDArray[np.float32] = np.minimum(
            self.source[pairs[:, 0]], self.target[pairs[:, 1]]
        )
        return lower

    def words(self) -> dict[str, Any]:
        """All but the points, as JSON."""
        return {
            "right": self.right,
            "warning": self.warning,
            "doubtful": [asdict(place) for place in self.doubtful],
        }

    @classmethod
    def of(
        cls,
        source: npt.NDArray[np.float32],
        target: npt.NDArray[np.float32],
        words: Mapping[str, Any],
    ) -> Confidence:
        """From the points and `words`. Raises KeyError or TypeError if these aren't whole."""
        places = tuple(DoubtfulPlace(**place) for place in words["doubtful"])
        return cls(source, target, places, float(words["right"]), str(words["warning"]))
