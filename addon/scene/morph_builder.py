"""Makes a morph object, all of it or nothing, and gives it other pairs in place."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import bmesh
import bpy
import numpy as np

from ..core import path_stages, remembered
from ..data import arrays, attribute_names, creation, nodes
from . import applied, morph_object, morph_paths, path_display, points_display, recipes


@dataclass(frozen=True)
class Provenance:
    """What a morph object is made from, and where.

    Attributes
    ----------
    shapes : sequence of Object or None
        What is morphed, in order; None for what is gone.
    origin : (3,) array
        Where the frame of the morph lies in the world: the object's location.
    source_matrix : (4, 4) array
        From the first shape's own space to the morph's frame.
    """

    shapes: Sequence
    origin: np.ndarray
    source_matrix: np.ndarray


def build(context, outcome, name, provenance):
    """Makes the morph object of a `computation.Outcome` in the active collection."""
    with creation.all_or_nothing() as created:
        mesh = bpy.data.meshes.new(name)
        created(mesh)
        arrays.fill_mesh(mesh, outcome.source.positions)
        obj = bpy.data.objects.new(name, mesh)
        created(obj)
        obj.location = provenance.origin
        link(obj, provenance.shapes, provenance.source_matrix)
        obj.shape_key_add(name="Basis", from_mix=False)
        write_pairs(obj, outcome)
        key = add_keys(
            obj, [end.positions for end in outcome.ends], morph_object.stage_names(obj)[1:]
        )
        obj.active_shape_key_index = 1
        path_display.add(obj, key, created, len(outcome.ends) - 1, True)
        points_display.add_points_modifier(obj, key, created, morph_object.stages(obj))
        creation.link(context, obj)
    return obj


def link(obj, shapes, source_matrix):
    """Makes a morph object know what it was made from; see `Provenance`."""
    source, *via, target = shapes
    obj.pointmorph.source = source
    obj.pointmorph.target = target
    obj.pointmorph.via.clear()
    for shape in via:
        obj.pointmorph.via.add().object = shape
    obj.pointmorph.source_matrix = np.asarray(source_matrix)[:3, :3].reshape(-1)


def remove(*objects):
    """Takes morph objects and their points out of the file."""
    meshes = [obj.data for obj in objects]
    for obj in objects:
        obj.shape_key_clear()  # a data-block that isn't removed with the mesh
    bpy.data.batch_remove([*objects, *meshes])


def write_pairs(obj, outcome):
    """Writes what the pairs have at all shapes as point attributes."""
    mesh = obj.data
    for stage, end in zip(morph_object.stages(obj), outcome.ends, strict=True):
        arrays.write_attribute(mesh, f"{stage}_row", end.rows)
        arrays.write_attribute(mesh, f"{stage}_normal", end.normals)
        arrays.write_attribute(mesh, f"{stage}_color", end.colors)
        arrays.write_attribute(mesh, f"{stage}_radius", end.radii)
    arrays.activate_colors(mesh, attribute_names.COLOR)
    source_rows, target_rows = outcome.source.rows, outcome.target.rows
    arrays.write_attribute(mesh, "landing", outcome.landing.take(source_rows, axis=0))
    arrays.write_attribute(mesh, "source_onward", outcome.maps[0].take(source_rows, axis=0))
    arrays.write_attribute(mesh, "target_landing", outcome.maps[1].take(target_rows, axis=0))
    for number, landing in enumerate(outcome.stops, 1):
        arrays.write_attribute(mesh, f"landing{number}", landing.take(source_rows, axis=0))
    for stage, end, ways in zip(
        morph_object.stages(obj)[1:], outcome.between, outcome.via_maps, strict=False
    ):
        for name, way in zip(("onward", "back"), ways, strict=True):
            arrays.write_attribute(mesh, f"{stage}_{name}", way.take(end.rows, axis=0))
    arrays.write_attribute(mesh, attribute_names.DISTORTION, outcome.distortion)
    if outcome.confidence is not None:
        arrays.write_attribute(mesh, attribute_names.CONFIDENCE, outcome.confidence)
    _write_ways(mesh, outcome)


def _write_ways(mesh, outcome):
    places = [end.positions for end in outcome.ends]
    ways = outcome.ways
    path_display.write(
        mesh,
        [end - start for start, end in pairwise(places)],
        [None if way is None else way.pairs for way in ways],
        [None if way is None else way.normals for way in ways],
    )
    for number in range(len(ways)):
        for old in range(1, path_stages.COUNT + 1):
            name = attribute_names.vertex_on_way(number, old)
            if name in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[name])
    for number, way in enumerate(ways):
        for stage, values in enumerate(() if way is None else way.vertices, 1):
            name = attribute_names.vertex_on_way(number, stage)
            arrays.write_attribute(mesh, name, values.take(outcome.source.rows, axis=0))


def add_keys(obj, places, names):
    """Adds the key whose value is t, and of a chain a key for each shape after the first, which is
    at full value where t says so.

    Parameters
    ----------
    places : list of (N, 3) array
        Where the points are at every shape.
    names : list of str
        Of the shapes after the first.

    Returns
    -------
    ShapeKey
    """
    key = new_key(obj, morph_object.KEY)
    made = [key.name]
    count = len(names)
    if count > 1:
        key.slider_max = count
    for number, name in enumerate(names if count > 1 else (), 1):
        made.append(new_key(obj, name).name)
        _drive_shape(obj.data.shape_keys, made, number, count)
    recipes.note(obj, "keys", made)
    write_keys(obj, places)
    return obj.data.shape_keys.key_blocks[made[0]]


def _drive_shape(keys, names, number, count):
    """Has the key of shape `number` of a chain be at full value where t says so."""
    curve = keys.key_blocks[names[number]].driver_add("value")
    curve.driver.type = "SCRIPTED"
    nodes.drive(curve.driver, keys.key_blocks[names[0]])
    # Simple enough for Blender to compute without Python, also where scripts may not run.
    curve.driver.expression = (
        f"max(0, min(1, t - {number - 1}))" if number == count else f"max(0, 1 - abs(t - {number}))"
    )


def add_lost_keys(obj, places):
    """Adds those of the keys that `add_keys` made that are gone; `places` are all, with the
    first."""
    names = morph_object.morph_keys(obj)
    keys = obj.data.shape_keys
    lost = [number for number, name in enumerate(names) if name not in keys.key_blocks]
    for number in lost:
        key = new_key(obj, names[number])
        if number == 0 and len(names) > 1:
            key.slider_max = len(names) - 1
        elif number > 0:
            key.driver_remove("value")
            _drive_shape(keys, names, number, len(names) - 1)
    _write_places(obj, places)  # what is noted tells what was applied


def write_keys(obj, places):
    """Writes the places at every shape into the keys that `add_keys` made."""
    _write_places(obj, places)
    applied.note(obj)


def _write_places(obj, places):
    keys = obj.data.shape_keys.key_blocks
    names = morph_object.morph_keys(obj)
    if len(places) > 2:
        arrays.write_key(keys[names[0]], places[0])  # it moves nothing itself
        names = names[1:]
    for name, place in zip(names, places[1:], strict=True):
        arrays.write_key(keys[name], place)


def rebuild(obj, outcome, settings):
    """Gives a morph object other pairs in place: name, t with all that moves it, modifiers,
    materials, and keys that were baked or added to it stay. `settings` are the library's.

    Returns
    -------
    list of str
        What couldn't follow, in words.
    """
    keys = morph_object.stage_keys(obj)
    positions = [end.positions for end in outcome.ends]
    own = {keys[0].name, *morph_object.morph_keys(obj)}
    others = [key for key in obj.data.shape_keys.key_blocks if key.name not in own]
    old_rows = arrays.read_rows(obj.data, "source_row")
    base = arrays.key_positions(keys[0])
    moves = {key.name: arrays.key_positions(key) - base for key in others}
    groups = _weights_by_row(obj, old_rows)

    _resize_points(obj.data, len(positions[0]))
    arrays.move_vertices(obj.data, positions[0])
    arrays.write_key(obj.data.shape_keys.reference_key, positions[0])
    write_keys(obj, positions)
    write_pairs(obj, outcome)
    with creation.all_or_nothing() as created:  # one of an earlier version has none
        key = morph_object.morph_key(obj)
        path_display.add(obj, key, created, len(outcome.ends) - 1, True)
        points_display.renew(obj, created, morph_object.stages(obj))

    lost = []
    baked = remembered.baked(obj.pointmorph.baked) or {}
    for name, move in moves.items():
        key = obj.data.shape_keys.key_blocks[name]
        t, path, *is_staggered = baked.get(name, (None, None))
        if t is not None and not any(is_staggered):
            arrays.write_key(key, morph_paths.way(obj, morph_paths.meant(path, settings))(t))
        elif outcome.source.rows.max() == old_rows.max():
            by_row = np.zeros((old_rows.max() + 1, 3), np.float32)
            by_row[old_rows] = move
            arrays.write_key(key, positions[0] + by_row[outcome.source.rows])
            if any(is_staggered):
                lost.append(_outdated_words(obj, name))
        else:
            arrays.write_key(key, positions[0])
            lost.append(lost_words(obj, name))
    _write_weights(obj, groups, outcome.source.rows)
    obj.update_tag()
    return lost


def lost_words(obj, name):
    """About a shape key that knows nothing of the points that there are now."""
    return (
        f'The shape key "{name}" of "{obj.name}" no longer has an effect: the points have changed'
    )


def _outdated_words(obj, name):
    return (
        f'The shape key "{name}" of "{obj.name}" is still that of the old morph, because it '
        "was baked staggered: bake it again"
    )


def _resize_points(mesh, count):
    """Gives a mesh without faces, and each of its shape keys, another number of vertices."""
    if len(mesh.vertices) == count:
        return
    edited = bmesh.new()
    try:
        edited.from_mesh(mesh)
        edited.verts.ensure_lookup_table()
        for vertex in edited.verts[count:]:
            edited.verts.remove(vertex)
        for _ in range(count - len(edited.verts)):
            edited.verts.new()
        edited.to_mesh(mesh)
    finally:
        edited.free()
    mesh.update()


def _weights_by_row(obj, rows):
    """By vertex group, the weights of the points of the source."""
    names = {group.index: group.name for group in obj.vertex_groups}
    return {
        name: dict(zip(rows[members].tolist(), weights.tolist(), strict=True))
        for name, (members, weights) in arrays.vertex_groups(obj.data, names).items()
    }


def _write_weights(obj, groups, rows):
    for name, weights in groups.items():
        group = obj.vertex_groups[name]
        group.remove(list(range(len(rows))))
        for number, row in enumerate(rows.tolist()):
            if row in weights:
                group.add([number], weights[row], "REPLACE")


def new_key(obj, name):
    key = obj.shape_key_add(name=name, from_mix=False)
    key.value = 0.0  # Blender 5 begins with 1
    return key
