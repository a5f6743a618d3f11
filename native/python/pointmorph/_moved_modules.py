"""Modules that scripts know by an earlier name: they still work there, with a warning."""

import importlib
import sys
import warnings
from types import ModuleType
from typing import Any

_MOVED = {
    "frame_stores": "sequences",
    "moving": "sequences",
    "moving_shapes": "sequences",
    "sampling": "meshes",
    "source_meshes": "sequences",
    "surfaces": "sequences",
}
_RENAMED = {"Pose": "ShapeState"}


class _Moved(ModuleType):
    """Imports the module that has the names now when it is asked for one of them."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        old = self.__name__
        new = f"pointmorph.{_MOVED[old.rpartition('.')[2]]}"
        warnings.warn(f"{old} is now {new}", DeprecationWarning, stacklevel=2)
        return getattr(importlib.import_module(new), _RENAMED.get(name, name))


def keep_old_names(package: ModuleType) -> None:
    """Adds the old names to the package, also for ``import pointmorph.surfaces``."""
    for name in _MOVED:
        full = f"{package.__name__}.{name}"
        sys.modules[full] = _Moved(full)
        setattr(package, name, sys.modules[full])
