"""Vertex groups of a mesh that keep its shape or its place when it is wrapped onto another."""

import numpy as np
import pointmorph

KINDS = ("rigid", "fixed")


def mask_groups(obj):
    """By kind, the vertex group of a mesh that was chosen for it.

    Raises
    ------
    CloudError
        For one that the object no longer has.
    """
    found = {}
    for kind in KINDS:
        name = getattr(obj.pointmorph, f"{kind}_group")
        if not name:
            continue
        if name not in obj.vertex_groups:
            raise pointmorph.CloudError(
                obj.name,
                f'the vertex group "{name}", chosen as {kind.capitalize()}',
                "none of that name",
                "Choose another in the panel Masks, or clear the field.",
            )
        found[kind] = obj.vertex_groups[name]
    return found


def mask(count, rows, weights):
    """(count,) array of float32: how much each vertex is kept; None where none is."""
    if not (weights > 0).any():
        return None
    values = np.zeros(count, np.float32)
    values[rows] = weights
    return values
