"""What was done last, to be repeated by a command."""

REPEATED = ("morph", "morph_chain", "bake_shape_keys", "bake_frames", "bake_collection")
"""The operators that are noted."""
_FIRST = ("morph", "morph_chain")

_steps = []


def note(name, options):
    """Notes that an operator has done its work.

    Parameters
    ----------
    name : str
        Such as "morph". Others than `REPEATED` aren't noted.
    options : dict
        Those that aren't its defaults.
    """
    if name not in REPEATED:
        return
    if name in _FIRST:
        _steps.clear()
    # What was done again was done better.
    _steps[:] = [step for step in _steps if step[0] != name]
    _steps.append((name, dict(options)))


def steps():
    """The last morph, and what was made of it: a list of (name, options)."""
    return list(_steps)


def forget():
    """Another file was opened."""
    _steps.clear()
