"""Shape keys of a morph that somebody has removed or renamed, and how it gets them back."""

import numpy as np

from ..data import arrays, attribute_names, versions
from . import applied, morph_builder, morph_object, path_display, recipes, slider_keys


def words(obj):
    """What has become of the shape keys of a morph object; none where all are there."""
    lost = _names(obj)
    if not lost:
        return []
    names = ", ".join(f'"{name}"' for name in lost)
    kind, were = ("shape key", "was") if len(lost) == 1 else ("shape keys", "were")
    return [f'the {kind} {names} of "{obj.name}" {were} removed or renamed']


def _names(obj):
    keys = obj.data.shape_keys
    # Without its basis, the first of the others is that.
    there = {} if keys is None else keys.key_blocks[1:]
    there = {key.name for key in there}
    return [name for name in morph_object.morph_keys(obj) if name not in there]


def restore(obj):
    """Gives a morph object the shape keys back that it has lost, where they were made. What moved
    the slider went with it."""
    lost = _names(obj)
    editable = morph_object.is_in_file(obj) and obj.mode == "OBJECT"
    if not lost or not editable or _renamed_back(obj, lost):
        return
    places = _places(obj)
    if places is None or (None in recipes.shapes_of(obj) and not _starts_at(obj, places[0])):
        return
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    basis = obj.data.shape_keys.reference_key
    arrays.write_key(basis, places[0])
    if basis.name in lost:
        basis.name = "Basis"
    morph_builder.add_lost_keys(obj, places)
    mesh = morph_object.shown_of(obj)
    if mesh != obj and not _names(mesh):
        slider_keys.let_go(obj)
        slider_keys.follow(obj, mesh)
    renamed = basis.path_from_id("value")  # what went by the slider, if that was it
    for block in _moved_by(obj):
        _drive(block, morph_object.t_key(obj), renamed)


def _moved_by(obj):
    """What a slider may drive."""
    users = morph_object.users_of(obj)
    materials = [slot.material for user in users for slot in user.material_slots]
    trees = [one.node_tree for one in materials if one is not None and one.node_tree is not None]
    keys = [one.data.shape_keys for one in (obj, obj.pointmorph.made_from) if one is not None]
    hair = [child for user in users for child in user.children]
    return [block for block in dict.fromkeys([*users, *hair, *trees, *keys]) if block is not None]


def _drive(block, key, renamed):
    """Has drivers go by a slider again that have lost it, or go by the key that had its name."""
    path = key.path_from_id("value")
    for curve in () if block.animation_data is None else block.animation_data.drivers:
        for variable in curve.driver.variables:
            for target in variable.targets:
                if target.id in (None, key.id_data) and target.data_path in (path, renamed):
                    target.id_type = "KEY"
                    target.id = key.id_data
                    target.data_path = path


def _renamed_back(obj, lost):
    """Gives a slider its name back that was renamed: the path's nodes still go by it. Returns
    whether that was all."""
    name = morph_object.morph_keys(obj)[0]
    modifier = path_display.modifier_of(obj)
    keys = obj.data.shape_keys
    if name not in lost or modifier is None or keys is None:
        return False
    path = versions.input_path(modifier, "t")
    read = {
        target.data_path
        for curve in (() if obj.animation_data is None else obj.animation_data.drivers)
        if curve.data_path == path
        for variable in curve.driver.variables
        for target in variable.targets
        if target.id == keys
    }
    for key in keys.key_blocks[1:]:
        if key.path_from_id("value") in read:
            key.name = name
            return len(lost) == 1
    return False


def _starts_at(obj, start):
    """Whether vertices are where they were made: not where shape keys were applied on the way,
    which can't be told from an edit, and only what was morphed puts right."""
    found = applied.noted_at_start(obj, start)
    if found is None:
        return False
    known, now = found
    return np.allclose(now, known, atol=1e-5 * np.abs(known).max())


def _places(obj):
    """Where the vertices are at every shape; None where the mesh doesn't know it any more."""
    mesh, keys, names = obj.data, obj.data.shape_keys, morph_object.morph_keys(obj)
    ways = [attribute_names.on_way(way, 0) for way in range(len(recipes.pointers_of(obj)) - 1)]
    if any(arrays.point_attribute(mesh, way, "FLOAT_VECTOR") is None for way in ways):
        return None
    moves = [arrays.read_vectors(mesh, way) for way in ways]
    start = arrays.basis_positions(mesh)
    if keys is not None and keys.reference_key.name in names:
        # Of a chain, the slider's own key is at the first shape.
        number = names.index(keys.reference_key.name) + (len(ways) == 1)
        start = start - sum(moves[:number])
    matrix = applied.matrix_of_start(obj, start)
    places = [start]
    for move in moves:
        places.append(places[-1] + (move if matrix is None else move @ matrix[:3, :3].T))
    return places
