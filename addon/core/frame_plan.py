"""Which frames a bake has, and the morph that they are made of."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pointmorph
import pointmorph.formats
import pointmorph.sequences


@dataclass(frozen=True)
class Easing:
    """How a morph runs over its frames: t from 0 to 1, at shares of the time from 0 to 1."""

    label: str
    tip: str
    at: Callable


EASINGS = {
    "LINEAR": Easing("Linear", "Constant speed", lambda x: x),
    "SMOOTH": Easing("Smooth", "Starts and ends slowly", lambda x: x * x * (3.0 - 2.0 * x)),
}


@dataclass(frozen=True)
class Plan:
    """Which frames there are."""

    first: int
    last: int
    step: int
    easing: str
    resample: bool
    faces: bool

    def numbers(self):
        return range(self.first, self.last + 1, self.step)

    def times(self):
        """t of every frame: 0 at the first, 1 at the last of the range, whole steps or not."""
        ease = EASINGS[self.easing].at
        length = self.last - self.first
        return [float(ease((number - self.first) / length)) for number in self.numbers()]


@dataclass(frozen=True)
class Held:
    """What a morph object holds of its morph, as plain arrays.

    `shapes` are what clouds are made of, `pairs` and `maps` are for each way from a shape to the
    next; no maps where the object has none.
    """

    shapes: list
    pairs: list
    maps: list


def stagger(held, settings, timing):
    """Makes the frames of a morph those of a staggered one: changes `held` and `settings`.

    Parameters
    ----------
    timing : stagger.Timing
        Of the pairs.
    """
    held.shapes[0]["delay"] = timing.by_row(held.pairs[0][:, 0]).delays
    settings.update(
        stagger="delay",
        stagger_order="forward",
        stagger_overlap=max(float(timing.overlap), 0.01),
        stagger_falloff=float(timing.falloff),
    )


def sequence_of(held, plan, settings, poses=None):
    """The frames of a plan, to be made.

    Parameters
    ----------
    held : Held
    plan : Plan
    settings : dict
        Of the library.
    poses : list, optional
        Of shapes that move: what `poses.read_steps` returned.
    """
    clouds = [pointmorph.Cloud(**shape) for shape in held.shapes]
    ways = zip(pairwise(clouds), held.pairs, held.maps, strict=True)
    # A chain is staggered as a whole.
    own = settings if len(held.pairs) == 1 else {**settings, "stagger": "none"}
    morphs = [pointmorph.restore(*ends, pairs, maps, **own) for ends, pairs, maps in ways]
    if len(morphs) == 1:
        morph = morphs[0]
    else:
        whole = own if clouds[0].delay is None else settings
        morph = pointmorph.sequences.Chain(morphs, whole)
    numbers = {"first": plan.first, "step": plan.step}
    if poses is not None:
        return pointmorph.sequences.MovingSequence(
            morph, plan.times(), poses, settings, **numbers, resample=plan.resample
        )
    kind = pointmorph.sequences.FrameSequence if plan.resample else _Pairs
    return kind(morph, plan.times(), **numbers)


class _Pairs(pointmorph.sequences.FrameSequence):
    """Frames without new points, which have ids and velocities all the same."""

    def _at(self, t, stopped):
        resampled, frame = super()._at(t, stopped), self.morph.frame(t)
        own = resampled.ids < len(frame.positions)
        velocities = np.zeros_like(frame.positions)
        velocities[resampled.ids[own]] = resampled.velocities[own]
        ids = np.arange(len(frame.positions), dtype=np.int32)
        return pointmorph.ResampledFrame(**vars(frame), ids=ids, velocities=velocities)
