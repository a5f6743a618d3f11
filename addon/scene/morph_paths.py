"""Where the points of a morph object, or the source's own vertices, are on the way."""

from itertools import pairwise

import numpy as np
import pointmorph
import pointmorph.base.option_table

from ..core import path_stages, transforms
from ..data import arrays
from . import applied, morph_object, recipes


def meant(path, settings):
    """The path that a setting stands for in a morph with these settings, a recipe's: automatic goes
    by its method."""
    method = settings.get("method", "auto")
    return "linear" if pointmorph.base.option_table.is_straight(path=path, method=method) else path


def way(obj, path, timing=None):
    """A function from t to the positions of a morph object's points."""
    places = [arrays.key_positions(key) for key in morph_object.stage_keys(obj)]
    normals = [
        arrays.read_vectors(obj.data, f"{stage}_normal") for stage in morph_object.stages(obj)
    ]
    return through(places, normals, path, timing=timing)


def through(places, normals, path, faces=None, timing=None):
    """A function from t, 0 to the number of places less 1, to positions on the way. `faces` are
    those that mustn't turn over there. `timing` is a `stagger.Timing` of all points, or None."""
    motions = [
        pointmorph.Motion(start, normal, end, path, faces=faces)
        for start, normal, end in zip(places, normals, places[1:], strict=False)
    ]

    def at(t):
        number = min(int(t), len(motions) - 1)
        return motions[number].at(t - number)

    return at if timing is None else _pointwise(motions, places, timing)


def _pointwise(motions, places, timing):
    """The same with each point at its own time."""
    count = len(motions)
    off = [
        path_stages.deviations(motion.at, *ends)
        for motion, ends in zip(motions, pairwise(places), strict=True)
    ]

    def at(t):
        times = count * path_stages.local_times(
            t / count, timing.delays, timing.overlap, timing.falloff
        )
        place = places[0].astype(np.float64)
        for number, (start, end) in enumerate(pairwise(places)):
            share = np.clip(times - number, 0.0, 1.0)[:, None]
            place = place + share * (end - start)
            for stage, values in zip(path_stages.shares(share), off[number], strict=True):
                place = place + stage * values
        return places[-1].copy() if t >= count else place

    return at


def source_ways(obj):
    """What the source's own vertices do in the morph.

    Returns
    -------
    Object
        The source.
    list of (N, 3) array
        Where the vertices are at every shape, in the morph's frame.
    list of (N, 3) array
        The normals there, but for the last.
    (4, 4) array
        From the morph's frame to the source's own space.

    Raises
    ------
    CloudError
        When the source is gone, can't hold shape keys, or isn't what was morphed any more.
    """
    source = recipes.shapes_of(obj)[0]
    if source is None:
        advice = "Undo the deletion, or morph again from another mesh."
        raise recipes.gone_error(obj, 0, "its source", advice)
    if source.type != "MESH":
        raise pointmorph.CloudError(
            source.name,
            "a mesh, to hold shape keys",
            f"an object of type {arrays.type_name(source)}",
            "Bake on the morph object instead.",
        )
    if source.mode == "EDIT":
        raise pointmorph.CloudError(
            source.name, "an object in Object Mode", "Edit Mode", "Switch to Object Mode (Tab)."
        )
    start = arrays.basis_positions(source.data)
    matrix = morph_object.source_matrix_of(obj)
    morph_object.morph_key(obj)
    rows = arrays.read_rows(obj.data, "source_row")
    known = arrays.key_positions(obj.data.shape_keys.reference_key)
    if len(start) != rows.max() + 1 or not _same(
        transforms.move_positions(matrix, start)[rows], known
    ):
        if applied.matrix_of(obj) is not None:
            raise pointmorph.CloudError(
                obj.name,
                "points where they were made",
                "others: transforms were applied to it",
                "Recompute it.",
            )
        raise changed_since(source, obj)
    places, normals = [transforms.move_positions(matrix, start)], []
    for stage, landing in morph_object.landings(obj):
        place, normal = np.empty_like(start), np.empty_like(start)
        place[rows] = landing
        normal[rows] = arrays.read_vectors(obj.data, f"{stage}_normal")
        places.append(place)
        normals.append(normal)
    return source, places, normals, np.linalg.inv(matrix)


def changed_since(source, obj):
    """The error that the source of a morph object isn't what was morphed any more."""
    return pointmorph.CloudError(
        source.name,
        f'the vertices that "{obj.name}" was made from',
        "others: the mesh was edited, or its transforms were applied",
        "Recompute the morph, then try again.",
    )


def _same(a, b):
    """Whether positions are equal but for what another processor may round differently."""
    return np.abs(a - b).max() <= 1e-6 * np.abs(b).max()
