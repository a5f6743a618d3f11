"""The morph object: a mesh of one vertex a pair, made in one piece or not at all, and its bakes.

Its basis is the source, its shape key "Morph" the target, and point attributes hold what else the
pairs have at both ends. So it needs nothing but itself for a bake, also in a file opened later.

A chain over more shapes has a key for every shape after the first. The value of "Morph", which
moves nothing itself there, is t all the same, from 0 to the number of shapes less 1, and drives
the others.
"""

import bpy
import numpy as np
import pointmorph

from ..data import arrays, versions
from . import path_display, recipes

KEY = "Morph"
ROW = "source_row"
"""The attribute by which a morph object of pairs is known."""

_ATTRIBUTES = {"row": "INT", "normal": "FLOAT_VECTOR", "color": "FLOAT_COLOR", "radius": "FLOAT"}
"""What the pairs have of each shape, by the end of its name."""

_HOW_BACK = (
    "Recompute it to get the key back. If that fails, undo its removal, or Alt-click Morph for a "
    "new result."
)
"""What to do where a shape key is gone."""


def is_result(obj):
    """Whether an object is a morph object of pairs; not a mesh to which such were joined, or a copy
    of it, which have their attributes."""
    if not _moves(obj) or obj.pointmorph.keeps_faces or ROW not in obj.data.attributes:
        return False
    return bool(obj.pointmorph.recipe) or any(recipes.pointers_of(obj))


def is_made(obj):
    """Whether an object is a morph object, of pairs or with the source's faces."""
    return is_result(obj) or (_moves(obj) and obj.pointmorph.keeps_faces)


def _moves(obj):
    """Whether it wasn't converted (Object > Convert): a plain mesh has neither keys nor nodes, and
    anything else is no mesh."""
    if obj is None or obj.type != "MESH":
        return False
    return obj.data.shape_keys is not None or path_display.modifier_of(obj) is not None


def shown_of(obj):
    """What shows a morph object of points: the mesh that was made for it, or itself."""
    mesh = obj.pointmorph.mesh
    shows = recipes.is_there(mesh) and mesh.pointmorph.made_from == obj and is_made(mesh)
    return mesh if shows else obj


def users_of(obj):
    """The objects of this file that share a morph object's points, itself among them."""
    return [other for other in bpy.data.objects if other.data == obj.data]


def made_with(obj):
    """A morph object of points, or a mesh whose points are gone, and the meshes that were made from
    it."""
    return [obj, *(one for one in bpy.data.objects if one.pointmorph.made_from == obj)]


def is_edited(obj):
    """Whether a morph object has more or fewer vertices than it was made with: something was joined
    to it or separated from it, say."""
    return vertices_added(obj) != 0


def vertices_added(obj):
    """How many vertices more than it was made with a morph object has, or fewer, below 0."""
    recipe = recipes.recipe_of(obj)
    if "points" not in recipe or obj.mode == "EDIT":
        return 0
    now = len(obj.data.vertices)
    if obj.pointmorph.keeps_faces:
        return now - recipe["points"][0]
    return now - (recipes.report_of(obj) or {}).get("pairs", now)


def is_in_file(obj):
    """Whether an object and its data can be changed: neither is linked from another file."""
    return obj.is_editable and obj.data.is_editable


def is_beside(mesh, obj):
    """Whether a mesh was made from a morph object that another one shows: a duplicate, or one more
    mesh of the source."""
    is_mesh = is_made(mesh) and mesh.pointmorph.made_from == obj
    return is_mesh and shown_of(obj) not in (obj, mesh)


def morph_key(obj):
    """The shape key of a morph object that makes it the target."""
    keys = obj.data.shape_keys
    key = None if keys is None else keys.key_blocks.get(KEY)
    if key is None or key == keys.reference_key:
        raise pointmorph.CloudError(
            obj.name,
            f'a morph object with its shape key "{KEY}"',
            "none of that name" if key is None else "only a basis of that name",
            _HOW_BACK,
        )
    return key


def stages(obj):
    """Of every shape of a morph object in order: the prefix of its attributes."""
    between = len(obj.pointmorph.via)
    return ["source", *(f"via{number + 1}" for number in range(between)), "target"]


def stage_keys(obj):
    """The shape keys that hold the shapes of a morph object, in order."""
    key = morph_key(obj)
    keys = obj.data.shape_keys
    if not len(obj.pointmorph.via):
        return [keys.reference_key, key]
    names = morph_keys(obj)[1:]
    missing = [name for name in names if name not in keys.key_blocks]
    if missing:
        raise pointmorph.CloudError(
            obj.name,
            f'a chain with its shape key "{missing[0]}"',
            "none of that name",
            _HOW_BACK,
        )
    return [keys.reference_key, *(keys.key_blocks[name] for name in names)]


def check_whole(obj):
    """Raises CloudError when a morph object lacks what it was made with."""
    stage_keys(obj)
    for stage in stages(obj):
        for what, kind in _ATTRIBUTES.items():
            name = f"{stage}_{what}"
            if arrays.point_attribute(obj.data, name, kind) is None:
                found = "another type" if name in obj.data.attributes else "none of that name"
                raise pointmorph.CloudError(
                    obj.name, f"the attribute {name}", found, "Morph again."
                )


def stage_rows(obj):
    """(M,) int32 for every shape in order: its point in each pair."""
    check_whole(obj)
    found = [arrays.read_rows(obj.data, f"{stage}_row") for stage in stages(obj)]
    for stage, rows in zip(stages(obj), found, strict=True):
        # As every point is in a pair, there are no fewer pairs than points.
        if not len(rows) or not 0 <= rows.min() <= rows.max() < len(rows):
            raise pointmorph.CloudError(
                obj.name, f"rows of points as {stage}_row", "others", "Morph again."
            )
    return found


def read_stage(obj, stage, key, row):
    """What a morph object holds of one of its shapes, a row for each point of that.

    Parameters
    ----------
    stage, key, row
        Of the shape: see `stages`, `stage_keys` and `stage_rows`.

    Returns
    -------
    dict of str to array
        `positions`, `normals`, `colors` and `radii`.
    """
    mesh = obj.data
    values = {
        "positions": arrays.key_positions(key),
        "normals": arrays.read_vectors(mesh, f"{stage}_normal"),
        "colors": arrays.read_attribute(mesh.attributes[f"{stage}_color"]),
        "radii": arrays.read_attribute(mesh.attributes[f"{stage}_radius"]),
    }
    return {what: arrays.by_row(row, array) for what, array in values.items()}


def positions_at(obj, t):
    """(M, 3): where the points of a morph object are at t, all together on their path."""
    keys = stage_keys(obj)
    number = min(max(int(t), 0), len(keys) - 2)
    start, end = (arrays.key_positions(key) for key in keys[number : number + 2])
    share = t - number
    straight = (1.0 - share) * start + share * end
    modifier = path_display.modifier_of(obj)
    if modifier is None:
        return straight
    curve = versions.input_value(modifier, path_display.CURVE)
    return straight + curve * path_display.deviation_at(obj.data, number, share)


def position_of(obj, source_row, shown):
    """(3,): where a morph object has a row of the source at the present value of the slider of
    `shown`, which is one of `made_with`."""
    value = t_key(shown).value
    rows = np.flatnonzero(arrays.read_rows(obj.data, "source_row") == source_row)
    if not rows.size:
        raise pointmorph.CloudError(
            obj.name, f"point {source_row} of the source", "none", "Morph again."
        )
    return positions_at(obj, value)[rows[0]]


def source_matrix_of(obj):
    """(4, 4): from the source's own space to the morph's frame, whose origin is the source's; of a
    mesh with the source's faces, from its own space, where that is another one."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(obj.pointmorph.source_matrix, (3, 3))
    return matrix @ np.linalg.inv(kept_matrix_of(obj))


def kept_matrix_of(obj):
    """(4, 4): from the source's own space to that of a mesh with its faces: what was applied to the
    mesh (Ctrl+A), and its points keep."""
    matrix = np.reshape(obj.pointmorph.applied, (4, 4)).astype(np.float64)
    usable = obj.pointmorph.keeps_faces and np.isfinite(matrix).all() and np.linalg.det(matrix)
    return matrix if usable else np.eye(4)


def t_key(obj):
    """The shape key whose value is t: of a morph object, or of a copy of the source."""
    if not obj.pointmorph.keeps_faces:
        return morph_key(obj)
    name = morph_keys(obj)[0]
    keys = obj.data.shape_keys
    key = None if keys is None else keys.key_blocks.get(name)
    if key is None or key == keys.reference_key:
        raise pointmorph.CloudError(
            obj.name,
            f'its shape key "{name}"',
            "none of that name" if key is None else "only a basis of that name",
            _HOW_BACK,
        )
    return key


def morph_keys(obj):
    """Names of the shape keys that `add_keys` made: that whose value is t, and of a chain those of
    the shapes after the first."""
    return recipes.recipe_of(obj).get("keys", [KEY])


def last_key(obj):
    """The shape key that holds the last shape."""
    t_key(obj)
    return obj.data.shape_keys.key_blocks[morph_keys(obj)[-1]]


def map_names(obj):
    """For each way from a shape to the next: the attributes that hold where the points of either
    land on the other."""
    between = stages(obj)[1:-1]
    onward = [f"{stage}_onward" for stage in ("source", *between)]
    if onward[0] not in obj.data.attributes:  # made by an earlier version
        onward[0] = "landing1" if between else "landing"
    back = [*(f"{stage}_back" for stage in between), "target_landing"]
    return list(zip(onward, back, strict=True))


def landings(obj):
    """Of every shape but the last: its prefix, and (M, 3) where the source's points of the pairs
    are at the shape after it."""
    mesh = obj.data
    names = [*(f"landing{number + 1}" for number in range(len(obj.pointmorph.via))), "landing"]
    return [
        (stage, arrays.read_vectors(mesh, name))
        for stage, name in zip(stages(obj), names, strict=False)
    ]


def stage_names(obj):
    """Names of the shapes of a morph object, in order; what is missing has another."""
    return [
        KEY if shape is None else recipes.original_of(shape).name
        for shape in recipes.pointers_of(obj)
    ]
