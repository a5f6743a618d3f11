"""The morph object: a mesh of one vertex a pair, made in one piece or not at all, and its bakes.

Its basis is the source, its shape key "Morph" the target, and point attributes hold what else the
pairs have at both ends. So it needs nothing but itself for a bake, also in a file opened later.

A chain over more shapes has a key for every shape after the first. The value of "Morph", which
moves nothing itself there, is t all the same, from 0 to the number of shapes less 1, and drives
the others.
"""

import json
from contextlib import contextmanager

import bmesh
import bpy
import numpy as np
import pointmorph

from . import arrays, display, recipes, transforms

KEY = "Morph"


@contextmanager
def all_or_nothing():
    """Gives a function to call with every data-block made; removes them all after an error."""
    created = []
    try:
        yield created.append
    except BaseException:
        for item in created:
            if isinstance(item, bpy.types.Object):
                item.shape_key_clear()  # a data-block that isn't removed with the mesh
        bpy.data.batch_remove(created)
        raise


def is_result(obj):
    """Whether an object is a morph object."""
    return obj is not None and obj.type == "MESH" and "source_row" in obj.data.attributes


def is_made(obj):
    """Whether an object is a morph object, of pairs or with the source's faces."""
    return is_result(obj) or (obj is not None and obj.pointmorph.keeps_faces)


def morph_key(obj):
    """The shape key of a morph object that makes it the target."""
    keys = obj.data.shape_keys
    key = None if keys is None else keys.key_blocks.get(KEY)
    if key is None:
        raise pointmorph.CloudError(
            obj.name,
            f'a morph object with its shape key "{KEY}"',
            "none of that name",
            "Morph again, or give the key its name back.",
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
            "Give the key its name back, or make the chain again.",
        )
    return [keys.reference_key, *(keys.key_blocks[name] for name in names)]


def check_whole(obj):
    """Raises CloudError when a morph object lacks what it was made with."""
    stage_keys(obj)
    for stage in stages(obj):
        for what in ("row", "normal", "color", "radius"):
            if f"{stage}_{what}" not in obj.data.attributes:
                raise pointmorph.CloudError(
                    obj.name, f"the attribute {stage}_{what}", "none of that name", "Morph again."
                )


def stage_rows(obj):
    """(M,) int32 for every shape in order: its point in each pair."""
    check_whole(obj)
    return [arrays.read_rows(obj.data, f"{stage}_row") for stage in stages(obj)]


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
    """(M, 3): where the points of a morph object are at t, straight from shape to shape."""
    keys = stage_keys(obj)
    number = min(max(int(t), 0), len(keys) - 2)
    start, end = (arrays.key_positions(key) for key in keys[number : number + 2])
    return (1.0 - (t - number)) * start + (t - number) * end


def world_position(obj, source_row):
    """Where a morph object shows a row of the source at the present value of its key."""
    value = morph_key(obj).value
    rows = np.flatnonzero(arrays.read_rows(obj.data, "source_row") == source_row)
    if not rows.size:
        raise pointmorph.CloudError(
            obj.name, f"point {source_row} of the source", "none", "Morph again."
        )
    place = positions_at(obj, value)[rows[:1]]
    return transforms.move_positions(np.array(obj.matrix_world), place)[0]


def build(context, outcome, name, origin, source, target, source_matrix, via=()):
    """Makes the morph object in the active collection.

    Parameters
    ----------
    outcome : computation.Outcome
    name : str
    origin : (3,) array
        Where the frame of the morph lies in the world: the object's location.
    source, target : Object or None
        What was morphed, if it's still there.
    source_matrix : (4, 4) array
        From the source's own space to the morph's frame.
    via : sequence of Object or None
        The shapes between, of a chain.
    """
    with all_or_nothing() as created:
        mesh = bpy.data.meshes.new(name)
        created(mesh)
        arrays.fill_mesh(mesh, outcome.source.positions)
        obj = bpy.data.objects.new(name, mesh)
        created(obj)
        obj.location = origin
        link(obj, source, target, source_matrix, via)
        obj.shape_key_add(name="Basis", from_mix=False)
        write_pairs(obj, outcome)
        key = add_keys(obj, [end.positions for end in outcome.ends], stage_names(obj)[1:])
        obj.active_shape_key_index = 1
        display.add_points_modifier(obj, key, created, stages(obj))
        context.collection.objects.link(obj)
    return obj


def link(obj, source, target, source_matrix, via=()):
    """Makes a morph object know what it was made from."""
    obj.pointmorph.source = source
    obj.pointmorph.target = target
    obj.pointmorph.via.clear()
    for shape in via:
        obj.pointmorph.via.add().object = shape
    obj.pointmorph.source_matrix = np.asarray(source_matrix)[:3, :3].reshape(-1)


def source_matrix_of(obj):
    """(4, 4): from the source's own space to the morph's frame, whose origin is the source's."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(obj.pointmorph.source_matrix, (3, 3))
    return matrix


def remove(obj):
    """Takes a morph object and its points out of the file."""
    mesh = obj.data
    obj.shape_key_clear()  # a data-block that isn't removed with the mesh
    bpy.data.batch_remove([obj, mesh])


def write_pairs(obj, outcome):
    """Writes what the pairs have at all shapes as point attributes."""
    mesh = obj.data
    for stage, end in zip(stages(obj), outcome.ends, strict=True):
        arrays.write_attribute(mesh, f"{stage}_row", end.rows)
        arrays.write_attribute(mesh, f"{stage}_normal", end.normals)
        arrays.write_attribute(mesh, f"{stage}_color", end.colors)
        arrays.write_attribute(mesh, f"{stage}_radius", end.radii)
    arrays.activate_colors(mesh, display.COLOR)
    arrays.write_attribute(mesh, "landing", outcome.landing[outcome.source.rows])
    arrays.write_attribute(mesh, "target_landing", outcome.maps[1][outcome.target.rows])
    for number, landing in enumerate(outcome.stops, 1):
        arrays.write_attribute(mesh, f"landing{number}", landing[outcome.source.rows])
    for stage, end, ways in zip(stages(obj)[1:], outcome.between, outcome.via_maps, strict=False):
        for name, way in zip(("onward", "back"), ways, strict=True):
            arrays.write_attribute(mesh, f"{stage}_{name}", way[end.rows])
    arrays.write_attribute(mesh, display.DISTORTION, outcome.distortion)


def t_key(obj):
    """The shape key whose value is t: of a morph object, or of a copy of the source."""
    if not obj.pointmorph.keeps_faces:
        return morph_key(obj)
    name = morph_keys(obj)[0]
    keys = obj.data.shape_keys
    if keys is None or name not in keys.key_blocks:
        raise pointmorph.CloudError(
            obj.name,
            f'its shape key "{name}"',
            "none of that name",
            "Give the key its name back, or make the mesh again.",
        )
    return keys.key_blocks[name]


def morph_keys(obj):
    """Names of the shape keys that `add_keys` made: that whose value is t, and of a chain those of
    the shapes after the first."""
    return recipes.recipe_of(obj).get("keys", [KEY])


def last_key(obj):
    """The shape key that holds the last shape."""
    t_key(obj)
    return obj.data.shape_keys.key_blocks[morph_keys(obj)[-1]]


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
    key = _new_key(obj, KEY)
    made = [key.name]
    count = len(names)
    if count > 1:
        key.slider_max = count
    for number, name in enumerate(names if count > 1 else (), 1):
        made.append(_new_key(obj, name).name)
        curve = obj.data.shape_keys.key_blocks[made[-1]].driver_add("value")
        curve.driver.type = "SCRIPTED"
        display.drive(curve.driver, key)
        # Simple enough for Blender to compute without Python, also where scripts may not run.
        curve.driver.expression = (
            f"max(0, min(1, t - {number - 1}))"
            if number == count
            else f"max(0, 1 - abs(t - {number}))"
        )
    recipes.note(obj, "keys", made)
    write_keys(obj, places)
    return obj.data.shape_keys.key_blocks[made[0]]


def write_keys(obj, places):
    """Writes the places at every shape into the keys that `add_keys` made."""
    keys = obj.data.shape_keys.key_blocks
    names = morph_keys(obj)
    if len(places) > 2:
        arrays.write_key(keys[names[0]], places[0])  # it moves nothing itself
        names = names[1:]
    for name, place in zip(names, places[1:], strict=True):
        arrays.write_key(keys[name], place)


def rebuild(obj, outcome):
    """Gives a morph object other pairs in place: name, t with all that moves it, modifiers,
    materials, and keys that were baked or added to it stay.

    Returns
    -------
    list of str
        What couldn't follow, in words.
    """
    keys = stage_keys(obj)
    positions = [end.positions for end in outcome.ends]
    own = {keys[0].name, *morph_keys(obj)}
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

    lost = []
    baked = json.loads(obj.pointmorph.baked or "{}")
    for name, move in moves.items():
        key = obj.data.shape_keys.key_blocks[name]
        if name in baked:
            t, path = baked[name]
            arrays.write_key(key, _way(obj, path)(t))
        elif outcome.source.rows.max() == old_rows.max():
            by_row = np.zeros((old_rows.max() + 1, 3), np.float32)
            by_row[old_rows] = move
            arrays.write_key(key, positions[0] + by_row[outcome.source.rows])
        else:
            arrays.write_key(key, positions[0])
            lost.append(lost_words(obj, name))
    _write_weights(obj, groups, outcome.source.rows)
    obj.update_tag()
    return lost


def lost_words(obj, name):
    """About a shape key that knows nothing of the points that there are now."""
    return f'The shape key "{name}" of "{obj.name}" moves nothing any more: it has other points now'


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


def _new_key(obj, name):
    key = obj.shape_key_add(name=name, from_mix=False)
    key.value = 0.0  # Blender 5 begins with 1
    return key


# --- Baking ---------------------------------------------------------------------------------------


def _check_at_rest(obj):
    """Raises CloudError for a morph object that follows its shapes, which keys can't hold."""
    if obj.pointmorph.follows:
        raise pointmorph.CloudError(
            obj.name,
            "a morph at rest, because shape keys can't follow the moving shapes",
            "one that follows them",
            "Bake frames, or turn Follow off to bake the shapes as they were morphed.",
        )


def bake_pairs(obj, steps, path):
    """Adds `steps` shape keys to the morph object itself, from the source to the target.

    `path` is the library's setting of that name.
    """
    _check_at_rest(obj)
    names = _add_keys(obj, _way(obj, path), steps, stage_names(obj)[1:])
    baked = json.loads(obj.pointmorph.baked or "{}")
    baked.update({name: [t, path] for name, t in names.items()})
    obj.pointmorph.baked = json.dumps(baked)


def _way(obj, path):
    """A function from t to the positions of a morph object's points."""
    places = [arrays.key_positions(key) for key in stage_keys(obj)]
    normals = [arrays.read_vectors(obj.data, f"{stage}_normal") for stage in stages(obj)]
    return _through(places, normals, path)


def _through(places, normals, path):
    """A function from t, 0 to the number of places less 1, to positions on the way."""
    motions = [
        pointmorph.Motion(start, normal, end, path)
        for start, normal, end in zip(places, normals, places[1:], strict=False)
    ]

    def at(t):
        number = min(int(t), len(motions) - 1)
        return motions[number].at(t - number)

    return at


def bake_source(obj, steps, path):
    """Adds `steps` shape keys to the mesh that the morph object `obj` was made from, of a chain as
    many for each shape.

    Returns
    -------
    Object
        The source.

    Raises
    ------
    CloudError
        See `source_ways`; and when the source is linked from another file.
    """
    _check_at_rest(obj)
    source, places, normals, back = source_ways(obj)
    if source.data.library is not None:
        raise pointmorph.CloudError(
            source.name,
            "a mesh that can be changed",
            "one that is linked from another file",
            "Make it local (Object > Relations > Make Local), or bake on the pairs instead.",
        )
    way = _through(places, normals, path)
    _add_keys(
        source, lambda t: transforms.move_positions(back, way(t)), steps, stage_names(obj)[1:]
    )
    return source


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
    source = obj.pointmorph.source
    if source is None:
        raise pointmorph.CloudError(
            obj.name, "its source in the file", "none", "Morph again, from a mesh that is there."
        )
    if source.type != "MESH":
        raise pointmorph.CloudError(
            source.name,
            "a mesh, to hold shape keys",
            f"an object of type {source.type}",
            "Bake on the pairs instead.",
        )
    if source.mode == "EDIT":
        raise pointmorph.CloudError(
            source.name, "an object in Object Mode", "Edit Mode", "Leave Edit Mode (Tab)."
        )
    start = arrays.basis_positions(source.data)
    matrix = source_matrix_of(obj)
    morph_key(obj)
    rows = arrays.read_rows(obj.data, "source_row")
    known = arrays.key_positions(obj.data.shape_keys.reference_key)
    if len(start) != rows.max() + 1 or not _same(
        transforms.move_positions(matrix, start)[rows], known
    ):
        raise pointmorph.CloudError(
            source.name,
            f'the mesh that "{obj.name}" was made from',
            "one that was changed since",
            "Morph again.",
        )
    places, normals = [transforms.move_positions(matrix, start)], []
    for stage, landing in landings(obj):
        place, normal = np.empty_like(start), np.empty_like(start)
        place[rows] = landing
        normal[rows] = arrays.read_vectors(obj.data, f"{stage}_normal")
        places.append(place)
        normals.append(normal)
    return source, places, normals, np.linalg.inv(matrix)


def map_names(obj):
    """For each way from a shape to the next: the attributes that hold where the points of either
    land on the other."""
    between = stages(obj)[1:-1]
    onward = ["landing1" if between else "landing", *(f"{stage}_onward" for stage in between)]
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


def _same(a, b):
    """Whether positions are equal but for what another processor may round differently."""
    return np.abs(a - b).max() <= 1e-6 * np.abs(b).max()


def stage_names(obj):
    """Names of the shapes of a morph object, in order; what is missing has another."""
    return [KEY if shape is None else shape.name for shape in recipes.shapes_of(obj)]


def _add_keys(obj, positions_at, steps, names):
    """Shape keys at t = 1/steps, 2/steps, … 1, and so on to the number of `names`; all or none.
    `positions_at(t)` gives them.

    Returns
    -------
    dict of str to float
        t of every key.
    """
    added, times = [], {}
    try:
        if obj.data.shape_keys is None:
            added.append(obj.shape_key_add(name="Basis", from_mix=False))
        for number, name in enumerate(names):
            for step in range(1, steps + 1):
                last = step == steps
                t = step / steps
                key = _new_key(obj, name if last else f"{name} {100 * t:.3g} %")
                added.append(key)
                arrays.write_key(key, positions_at(number + t))
                times[key.name] = number + t
    except BaseException:
        for key in reversed(added):
            obj.shape_key_remove(key)
        raise
    obj.active_shape_key_index = len(obj.data.shape_keys.key_blocks) - 1
    return times
