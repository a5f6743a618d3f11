"""Whether the library that the extension brings can be loaded here, and what to say if not."""

import importlib
import platform

# What the extension has wheels for, as people call it. docs/release.md says how each was tested.
SUPPORTED = "Linux and Windows on x86-64, and macOS on Apple silicon, in Blender 4.2 to 5.2"

_SYSTEMS = {"Darwin": "macOS"}


def check(load=importlib.import_module):
    """Loads the library. Raises ImportError that tells the user what is missing and what to do."""
    try:
        load("pointmorph")
    except ImportError as error:
        raise ImportError(f"{_words(error)} ({error})", name=error.name) from error


def _words(error):
    system = platform.system()
    here = f"{_SYSTEMS.get(system, system)} on {platform.machine()}"
    python = ".".join(platform.python_version_tuple()[:2])
    if error.name == "pointmorph":
        return (
            f"This copy of Pointmorph has no library for {here} with Python {python}. "
            f"Pointmorph runs on {SUPPORTED}. "
            "Install the zip that is named after your system, or the one for all systems."
        )
    return (
        f"Pointmorph's library can't be loaded on {here} with Python {python}. "
        f"Pointmorph runs on {SUPPORTED}. "
        "Remove the extension, restart Blender, and install it again."
    )
