"""Morphs in a row whose points each go through all of them in a time of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pointmorph import _pointmorph
from pointmorph.errors import CloudError
from pointmorph.morphing import Morph, native_options


class StaggeredChain(Morph):
    """Morphs one after the other as one, staggered over the whole; for its frames.

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
        native = _pointmorph.Morph.chained(
            [part._native for part in parts],
            native_options(settings),
            source._fields()["delay"],
        )
        super().__init__(native, source, target)
        self._parts = tuple(parts)

    @property
    def parts(self) -> tuple[Morph, ...]:
        return self._parts
