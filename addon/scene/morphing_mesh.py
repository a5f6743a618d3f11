"""What models carry besides their form: a copy of the source that morphs with all it has."""

import contextlib
from itertools import pairwise

import bmesh
import bpy
import numpy as np
import pointmorph

from ..core import path_stages, transforms
from ..data import arrays, attribute_names, creation, nodes, versions
from . import (
    as_shown,
    attribute_transfer,
    blended_textures,
    morph_builder,
    morph_object,
    morph_paths,
    object_looks,
    path_display,
    placement,
    recipes,
    recomputation,
    shape_follower,
    slider_keys,
    stagger,
)


def make_mesh(context, obj):
    """A copy of the source, with its faces, materials, colors, UV maps, weights and modifiers, but
    those that `left_off` names, and the key "Morph" that makes it the target.

    Raises
    ------
    CloudError
        See `result.source_ways`.
    """
    source, places, _, back = morph_paths.source_ways(obj)
    with creation.all_or_nothing() as created:
        mesh = source.data.copy()
        created(mesh)
        copy = creation.copied(source)
        created(copy)
        copy.data = mesh
        versions.own_action(mesh.shape_keys, created)  # which the slider's keys go into
        copy.pointmorph.recipe = ""  # of a source that morphs itself
        copy.pointmorph.property_unset("applied")
        copy.pointmorph.mesh = None
        copy.pointmorph.shown_from = None  # of a source that is a copy itself
        copy.name = mesh.name = f"{obj.name} Mesh"
        copy.hide_render = copy.hide_viewport = copy.hide_select = False
        copy.show_only_shape_key = False
        creation.link(context, copy)
        _know(copy, obj)
        if mesh.shape_keys is None:
            copy.shape_key_add(name="Basis", from_mix=False)
        places = _own_places(source, places, back, np.eye(4))
        key = morph_builder.add_keys(copy, places, morph_object.stage_names(obj)[1:])
        key.value = morph_object.t_key(obj).value
        _write_ways(copy, obj, places, back)
        path_display.remove(copy)  # of a source that morphs itself
        for name in left_off(source):
            copy.modifiers.remove(copy.modifiers[name])
        path_display.add(copy, key, created, len(places) - 1, False)
        copy.active_shape_key_index = copy.data.shape_keys.key_blocks.find(key.name)
    return copy


def left_off(source):
    """Names of the modifiers of a source that a copy of it can't have."""
    if source is None:  # deleted, or undone
        return []
    return [
        modifier.name
        for modifier in source.modifiers
        if modifier.type in nodes.MUST_BE_FIRST or as_shown.is_cache(modifier)
    ]


def _own_places(source, places, back, kept):
    """The places of `result.source_ways` in the own space of a copy of the source, the first bit by
    bit where that is the source's: see `morph_object.kept_matrix_of`."""
    rest = [transforms.move_positions(back, place) for place in places[1:]]
    return [transforms.move_positions(kept, arrays.basis_positions(source.data)), *rest]


def _write_ways(copy, obj, places, back):
    """The ways of the vertices from shape to shape, in the source's own space."""
    rows = morph_object.stage_rows(obj)[0]
    turn = np.eye(4)
    turn[:3, :3] = back[:3, :3]
    ways = []
    for way in range(len(places) - 1):
        names = [
            attribute_names.vertex_on_way(way, number) for number in range(1, path_stages.COUNT + 1)
        ]
        known = all(name in obj.data.attributes for name in names)
        values = [arrays.read_vectors(obj.data, name) for name in names if known]
        ways.append([transforms.move_positions(turn, arrays.by_row(rows, v)) for v in values])
    moves = [end - start for start, end in pairwise(places)]
    path_display.write(copy.data, moves, ways)


def _know(copy, obj):
    """Makes the copy remember what the morph object does."""
    morph_builder.link(copy, recipes.pointers_of(obj), morph_object.source_matrix_of(obj))
    recipes.share_recipe(copy, obj)
    copy.pointmorph.keeps_faces = True
    copy.pointmorph.made_from = obj


def remake_mesh(copy, obj):
    """Gives a copy that `make_mesh` made of the morph object `obj`'s source its present form in
    place: name, t with all that moves it, materials and modifiers stay.

    Returns
    -------
    list of str
        What couldn't follow, in words.
    """
    morph_object.t_key(copy)
    source, places, _, back = morph_paths.source_ways(obj)
    kept = placement.keep(copy)
    back = kept @ back
    places = _own_places(source, places, back, kept)
    mesh, keys = copy.data, copy.data.shape_keys.key_blocks
    own = morph_object.morph_keys(copy)
    base = arrays.key_positions(keys[0])
    moves = {key.name: arrays.key_positions(key) - base for key in keys[1:] if key.name not in own}
    turned = versions.turns_mirrored_faces() and transforms.is_mirrored(kept)
    same = len(base) == len(places[0]) and _has_faces_of(mesh, source.data, turned)
    lost = []
    again = recipes.names_transferred(copy)
    if not same:
        lost += _lost_groups(copy, source)
        _replace_geometry(copy, source)
        if turned:
            mesh.flip_normals()
    arrays.move_vertices(mesh, places[0])
    arrays.write_key(keys[0], places[0])
    morph_builder.write_keys(copy, places)
    _write_ways(copy, obj, places, back)
    with creation.all_or_nothing() as created:  # one of an earlier version has none
        path_display.add(copy, morph_object.t_key(copy), created, len(places) - 1, False)
    lost += _take_uvs(copy, obj, source)
    of_source = source.data.shape_keys.key_blocks if source.data.shape_keys else {}
    for name, move in moves.items():
        if name in of_source:
            positions = arrays.key_positions(of_source[name])
            arrays.write_key(keys[name], transforms.move_positions(kept, positions))
        elif same:
            arrays.write_key(keys[name], places[0] + move)
        else:
            arrays.write_key(keys[name], places[0])
            if name not in again:
                lost.append(morph_builder.lost_words(copy, name))
    for user in morph_object.users_of(copy):
        placed_by = placement.placed_by(user)
        _know(user, obj)
        placement.follow_source(user, placed_by, (base, places[0]))
        user.update_tag()
    return lost


def _has_faces_of(mesh, source, turned):
    """Whether a mesh has the faces of another, whose corners go in another order if it `turned`
    them."""
    corners = [arrays.mesh_corners(one) for one in (mesh, source)]
    if turned:
        corners = [np.sort(one) for one in corners]
    edges = [arrays.mesh_edges(one) for one in (mesh, source)]
    return np.array_equal(*edges) and np.array_equal(*corners)


def _take_uvs(copy, obj, source):
    """Gives a copy the UV maps of its source if the look of that has changed since; otherwise those
    that were edited on the copy stay. Returns what has no room, in words."""
    before, now = (recipes.recipe_of(one).get("shapes", [{}])[0].get("look") for one in (copy, obj))
    if before == now:
        return []
    lost = []
    for layer in source.data.uv_layers:
        if arrays.write_uvs(copy.data, layer.name, arrays.corner_uvs(layer)) is None:
            lost.append(f'"{copy.name}" has no room for the UV map "{layer.name}"')
    shown = object_looks.render_layer(source.data)
    if shown is not None and shown.name in copy.data.uv_layers:
        copy.data.uv_layers[shown.name].active_render = True
    return lost


def remake(context, obj, plan, outcome):
    """Puts what was computed again into a morph object and the copies of the source that were made
    from it; or into a copy whose morph object is gone, which gets another one.

    Returns
    -------
    list of str
        What couldn't follow, in words.
    """
    if morph_object.is_result(obj):
        said = recomputation.apply(obj, plan, outcome)
        for user in morph_object.users_of(obj):
            shape_follower.follow_on(user, context)
        for copy in bpy.data.objects:
            if copy.pointmorph.made_from == obj and is_copy(copy):
                try:
                    _check_mode(copy)
                    if obj.pointmorph.mesh != copy:
                        _check_whole(copy)
                    said += remake_mesh(copy, obj)
                    if obj.pointmorph.mesh == copy:
                        stagger.follow(obj, copy)  # an earlier version didn't
                    said += attribute_transfer.again(context, copy)
                    said += blended_textures.again(context, copy, outcome.drawn)
                except pointmorph.PointmorphError as error:
                    said.append(f'"{copy.name}" was left unchanged. {error}')
        return said + attribute_transfer.again(context, obj)
    provenance = plan.provenance(recipes.pointers_of(obj))
    pairs = morph_builder.build(context, outcome, f"{obj.name} Points", provenance)
    try:
        recipes.remember(pairs, plan.recipe, outcome)
        pairs.pointmorph.mesh = obj
        slider_keys.follow(pairs, obj)
        with contextlib.suppress(RuntimeError):  # its collection is excluded
            pairs.hide_set(True, view_layer=context.view_layer)
        pairs.hide_render = True
        said = remake_mesh(obj, pairs)
        stagger.follow(pairs, obj)
        said += attribute_transfer.again(context, obj)
        said += blended_textures.again(context, obj, outcome.drawn)
    except BaseException:
        morph_builder.remove(pairs)
        raise
    return said


def is_copy(obj):
    """Whether an object is a copy of a source that `make_mesh` made, and of this file."""
    return obj.pointmorph.keeps_faces and morph_object.is_made(obj) and obj.library is None


def _check_mode(copy):
    for user in morph_object.users_of(copy):
        if user.mode != "OBJECT":
            raise pointmorph.CloudError(
                user.name, "a mesh in Object Mode", "another mode", "Switch to Object Mode (Tab)."
            )


def _check_whole(copy):
    if morph_object.is_edited(copy):
        raise pointmorph.CloudError(
            copy.name,
            "the vertices that it was made with",
            "others, as after joining or separating",
            "Undo that, or convert it to a mesh (Object > Convert > Mesh).",
        )


def _lost_groups(copy, source):
    """Which vertex groups go with the vertices, in words: those that were painted on the copy."""
    again = recipes.names_transferred(copy)
    return [
        f'The vertex group "{group.name}" of "{copy.name}" was removed: the vertices have changed'
        for group in copy.vertex_groups
        if group.name not in source.vertex_groups and group.name not in again
    ]


def _replace_geometry(copy, source):
    """Gives a copy the vertices, faces and layers of its source, its shape keys as many points."""
    names = [group.name for group in source.vertex_groups]
    copy.vertex_groups.clear()
    for name in names:
        copy.vertex_groups.new(name=name)
    edited = bmesh.new()
    try:
        edited.from_mesh(source.data)
        edited.to_mesh(copy.data)
    finally:
        edited.free()
    copy.data.update()
    for material in source.data.materials[len(copy.data.materials) :]:
        copy.data.materials.append(material)
    active = source.data.color_attributes.active_color
    if active is not None:
        copy.data.color_attributes.active_color = copy.data.color_attributes[active.name]
