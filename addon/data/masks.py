"""Vertex groups of a mesh that keep its shape or its place when it is wrapped onto another."""

import numpy as np
import pointmorph

from . import arrays

KINDS = ("rigid", "fixed")


def mask_groups(obj):
    """By kind, the index of the vertex group that was chosen for it, where the object has it."""
    return {
        kind: obj.vertex_groups[name].index
        for kind, name in _chosen(obj).items()
        if name in obj.vertex_groups
    }


def check_masks(obj):
    """Raises CloudError for a chosen group that the object no longer has."""
    for kind, name in _chosen(obj).items():
        if name not in obj.vertex_groups:
            raise pointmorph.CloudError(
                obj.name,
                f'the vertex group "{name}", chosen as {kind.capitalize()}',
                "none of that name",
                "Choose another in the panel Masks, or clear the field.",
            )


def _chosen(obj):
    names = {kind: getattr(obj.pointmorph, f"{kind}_group") for kind in KINDS}
    return {kind: name for kind, name in names.items() if name}


def read_steps(mesh, features, masks):
    """The rows and weights of feature groups, by name, and of masks, by kind: two dicts, of one
    look at the mesh, since a group can be both. A generator that yields often; see
    `arrays.vertex_group_steps`.

    Parameters
    ----------
    features : dict of int to str
        See `feature_list.feature_groups`.
    masks : dict of str to int
        See `mask_groups`.
    """
    wanted = {*features, *masks.values()}
    found = yield from arrays.vertex_group_steps(mesh, {index: index for index in wanted})
    return (
        {name: found[index] for index, name in features.items()},
        {kind: found[index] for kind, index in masks.items()},
    )


def mask(count, rows, weights):
    """(count,) array of float32: how much each vertex is kept; None where none is."""
    if not (weights > 0).any():
        return None
    values = np.zeros(count, np.float32)
    values[rows] = weights
    return values
