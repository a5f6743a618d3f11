"""Morphs one sampled shape into another, in Blender. The work is done by the library `pointmorph`.

An extension's wheel brings the library. A legacy add-on, for Blender before 4.2, holds it in `lib`
instead, and its own folder must have another name than the library.
"""

import sys
from pathlib import Path

bl_info = {
    "name": "Pointmorph",
    "author": "The Pointmorph developers",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D Viewport > Sidebar > Pointmorph",
    "description": "Morphs one sampled shape into another with other vertices",
    "category": "Animation",
}

_library = Path(__file__).parent / "lib"
if _library.is_dir() and str(_library) not in sys.path:
    sys.path.insert(0, str(_library))

from . import (  # noqa: E402
    baking,
    clicking,
    cuts,
    first_use,
    handlers,
    markers,
    marking,
    operators,
    panels,
    picking,
    properties,
    result_operators,
    result_panels,
    translations,
    watching,
)

# In this order: the others use the properties.
_modules = (
    properties,
    markers,
    picking,
    marking,
    clicking,
    cuts,
    operators,
    baking,
    result_operators,
    panels,
    result_panels,
    first_use,
    handlers,
    watching,
    translations,
)


def register():
    for module in _modules:
        translations.put_tooltips(getattr(module, "_classes", ()))
        module.register()


def unregister():
    for module in reversed(_modules):
        module.unregister()
