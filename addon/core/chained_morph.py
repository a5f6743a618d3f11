"""Several morphs, one after the other, as one."""

from dataclasses import replace

import numpy as np
from pointmorph.sequences import part_at


class ChainedMorph:
    """Morphs one after the other, with equal shares of t from 0 to 1, as `pointmorph.Morph` is."""

    def __init__(self, morphs):
        self.parts = tuple(morphs)
        self._native = morphs[0]._native  # for its settings
        self.source, self.target = morphs[0].source, morphs[-1].target
        self.pairs = np.column_stack([morphs[0].pairs[:, 0], morphs[-1].pairs[:, 1]])

    def frame(self, t, progress=None):
        number, t = part_at(t, len(self.parts))
        return self.parts[number].frame(t, progress=progress)

    def resampled_frame(self, t, progress=None):
        number, t = part_at(t, len(self.parts))
        frame = self.parts[number].resampled_frame(t, progress)
        # New points of one morph aren't those of another.
        before = sum(morph.inserted(progress) for morph in self.parts[:number])
        ids = np.where(frame.ids < len(self.pairs), frame.ids, frame.ids + before)
        return replace(
            frame, ids=ids.astype(np.int32), velocities=frame.velocities * len(self.parts)
        )

    def inserted(self, progress=None):
        return sum(morph.inserted(progress) for morph in self.parts)
