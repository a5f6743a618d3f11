"""Morphs in a row as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pointmorph import _pointmorph
from pointmorph.base.errors import CloudError
from pointmorph.base.option_table import native_options
from pointmorph.base.stages import Progress
from pointmorph.morphs.frames import Frame, ResampledFrame
from pointmorph.morphs.morphing import Morph
from pointmorph.sequences.frame_sequences import part_at


class Chain(Morph):
    """Morphs one after the other as one, with equal shares of t from 0 to 1; for its frames.

    Where the settings stagger it, each point goes through all of it in a time of its own. New
    points are then those of the whole; otherwise each morph has its own.

    Parameters
    ----------
    parts : sequence of Morph
        Each begins at the shape where the one before ends. Row i of the pairs of all is the same
        point. None is staggered itself. The first one's source says by its `delay` when each point
        goes, if the settings take that.
    settings : mapping
        Those that concern frames.

    Raises
    ------
    CloudError
        If there is no morph, or the pairs don't go on from one to the next.
    """

    def __init__(self, parts: Sequence[Morph], settings: Mapping[str, Any]) -> None:
        if not parts:
            raise CloudError("chain", "at least one morph", "none", "Give morphs in order.")
        source, target = parts[0].source, parts[-1].target
        self.is_staggered = settings.get("stagger", "none") != "none"
        native = _pointmorph.Morph.chained(
            [part._native for part in parts],
            native_options(settings),
            source._fields()["delay"] if self.is_staggered else None,
        )
        super().__init__(native, source, target)
        self._parts = tuple(parts)

    @property
    def parts(self) -> tuple[Morph, ...]:
        return self._parts

    def frame(self, t: float, out: Frame | None = None, progress: Progress | None = None) -> Frame:
        if self.is_staggered:
            return super().frame(t, out, progress)
        number, along = part_at(t, len(self._parts))
        return self._parts[number].frame(along, out, progress)

    def resampled_frame(self, t: float, progress: Progress | None = None) -> ResampledFrame:
        if self.is_staggered:
            return super().resampled_frame(t, progress)
        number, along = part_at(t, len(self._parts))
        frame = self._parts[number].resampled_frame(along, progress)
        # New points of one morph aren't those of another.
        before = sum(part.inserted(progress) for part in self._parts[:number])
        ids = np.where(frame.ids < len(self.pairs), frame.ids, frame.ids + before)
        velocities = frame.velocities * frame.velocities.dtype.type(len(self._parts))
        return replace(frame, ids=ids.astype(np.int32), velocities=velocities)

    def inserted(self, progress: Progress | None = None) -> int:
        if self.is_staggered:
            return super().inserted(progress)
        return sum(part.inserted(progress) for part in self._parts)
