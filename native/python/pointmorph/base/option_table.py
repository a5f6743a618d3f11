"""The settings of a morph: a table of them, and what it takes to hand them to the library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from pointmorph import _pointmorph
from pointmorph.base.errors import OptionError


@dataclass(frozen=True)
class Option:
    """A setting of a morph. The default None means automatic."""

    name: str
    kind: str
    """int, float or choice."""
    default: int | float | str | None
    minimum: float
    maximum: float
    choices: tuple[str, ...]
    unit: str
    help: str
    affects: str
    """what has to be made again when it changes: the map (which points belong together, and all
    that follows), the path (every frame between the ends), frames (resampled ones) or nothing"""
    method: str | None
    """the method that uses it; None: both. Settings of method paper also count with method auto
    where the domain isn't auto, since the refinement then starts in that domain"""

    def is_used(self, method: str, domain: str) -> bool:
        """Whether a morph with this method and domain uses the setting.

        Examples
        --------
        >>> import pointmorph
        >>> influence = next(o for o in pointmorph.options() if o.name == "influence")
        >>> influence.is_used("auto", "auto"), influence.is_used("auto", "disk")
        (False, True)
        """
        starts_in_domain = self.method == "paper" and domain != "auto"
        return self.method in (None, method) or starts_in_domain


@lru_cache(maxsize=1)
def options() -> tuple[Option, ...]:
    """All settings of `morph`, with defaults, ranges, units and descriptions.

    Examples
    --------
    >>> import pointmorph
    >>> [option.default for option in pointmorph.options() if option.name == "influence"]
    [8.0]
    """
    return tuple(Option(**row) for row in _pointmorph.option_table())


def is_straight(**settings: Any) -> bool:
    """Whether the points of a morph with these settings go straight."""
    straight: bool = native_options(settings).is_straight()
    return straight


def native_options(settings: Mapping[str, Any]) -> _pointmorph.MorphOptions:
    """The settings as the native library takes them. Raises OptionError."""
    result = _pointmorph.MorphOptions()
    for name, value in settings.items():
        result.set(name, _plain(name, value))
    return result


def _plain(name: str, value: Any) -> int | float | str | None:
    """The Python value of a numpy scalar. Booleans don't count as numbers."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float | str)):
        raise OptionError(
            name, "a number or a word", f"{value!r}", "See pointmorph.options() for the range."
        )
    if isinstance(value, int) and abs(value) >= 2**63:
        return float(value)
    return value
