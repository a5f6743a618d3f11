"""What was transferred, in words."""

_MOST = 6  # names that are listed


def listed(where, made):
    """One sentence.

    Parameters
    ----------
    where : str
        How it begins.
    made : dict of str to list of str
        Names by what they are of.

    Examples
    --------
    >>> listed('To "Hill"', {"shape key": ["Smile"], "vertex group": ["arm", "leg"]})
    'To "Hill": the shape key "Smile"; 2 vertex groups, "arm" and "leg"'
    """
    return f"{where}: " + "; ".join(_counted(kind, names) for kind, names in made.items())


def _counted(kind, names):
    quoted = [f'"{name}"' for name in names]
    if len(quoted) == 1:
        return f"the {kind} {quoted[0]}"
    if len(quoted) > _MOST:
        rest = len(quoted) - _MOST + 1
        return f"{len(names)} {kind}s, {', '.join(quoted[: _MOST - 1])} and {rest} more"
    return f"{len(names)} {kind}s, {', '.join(quoted[:-1])} and {quoted[-1]}"
