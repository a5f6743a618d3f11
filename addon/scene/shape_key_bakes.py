"""Bakes a morph as shape keys: on the source mesh, or on the morph object."""

import json

import pointmorph

from ..core import remembered, transforms
from ..data import arrays
from . import morph_builder, morph_object, morph_paths, recipes, shape_reader, stagger


def _check_at_rest(obj):
    """Raises CloudError for a morph object that follows its shapes, which keys can't hold."""
    if obj.pointmorph.follows:
        raise pointmorph.CloudError(
            obj.name,
            "a morph at rest, because shape keys can't follow moving shapes",
            "one that follows them",
            "Bake frames, or turn off Follow to bake the shapes as they were morphed.",
        )


def _meant(obj, path):
    return morph_paths.meant(path, recipes.settings_of(obj))


def bake_pairs(context, obj, steps, path):
    """Adds `steps` shape keys to the morph object itself, from the source to the target.

    `path` is the library's setting of that name.

    Returns
    -------
    list of str
        Names of the keys.
    """
    _check_at_rest(obj)
    if not morph_object.is_in_file(obj):
        raise pointmorph.CloudError(
            obj.name,
            "a morph object in this file",
            "one linked from another, which wouldn't keep the keys",
            "Make it local (Object > Relations > Make Local), or bake frames.",
        )
    timing = stagger.timing_of(context, obj)
    way = morph_paths.way(obj, _meant(obj, path), timing)
    names = _add_keys(obj, way, steps, morph_object.stage_names(obj)[1:])
    baked = dict(remembered.baked(obj.pointmorph.baked) or {})
    # All points are at each shape at once, staggered or not.
    baked.update({name: [t, path, timing is not None and t % 1 != 0] for name, t in names.items()})
    obj.pointmorph.baked = json.dumps(baked)
    return list(names)


def bake_source(context, obj, steps, path):
    """Adds `steps` shape keys to the mesh that the morph object `obj` was made from, of a chain as
    many for each shape.

    Returns
    -------
    Object
        The source.
    list of str
        Names of the keys.

    Raises
    ------
    CloudError
        See `source_ways`; and when the source is linked from another file, or has other vertices
        than its shape keys.
    """
    _check_at_rest(obj)
    source, places, normals, back = morph_paths.source_ways(obj)
    if source.data.library is not None:
        raise pointmorph.CloudError(
            source.name,
            "an editable mesh",
            "one linked from another file",
            "Make it local (Object > Relations > Make Local), or bake on the morph object instead.",
        )
    shape_reader.check_keys(source)
    timing = stagger.timing_of(context, obj)
    if timing is not None:
        timing = timing.by_row(morph_object.stage_rows(obj)[0])
    faces = arrays.mesh_triangles(source.data)
    way = morph_paths.through(places, normals, _meant(obj, path), faces, timing)
    names = _add_keys(
        source,
        lambda t: transforms.move_positions(back, way(t)),
        steps,
        morph_object.stage_names(obj)[1:],
    )
    return source, list(names)


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
                key = morph_builder.new_key(obj, name if last else f"{name} {100 * t:.3g} %")
                added.append(key)
                arrays.write_key(key, positions_at(number + t))
                times[key.name] = number + t
    except BaseException:
        for key in reversed(added):
            obj.shape_key_remove(key)
        raise
    obj.active_shape_key_index = len(obj.data.shape_keys.key_blocks) - 1
    return times
