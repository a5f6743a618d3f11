"""What models carry besides their form: a copy of the source that morphs with all it has, and
what the target has, brought over along the map.
"""

import bmesh
import bpy
import numpy as np
import pointmorph

from . import arrays, display, following, remaking, result, surfaces, transforms
from .features import PREFIX

NAME = "Pointmorph Colors"
MODIFIER = "Colors"


# --- The source's mesh ----------------------------------------------------------------------------


def make_mesh(context, obj):
    """A copy of the source, with its faces, materials, colours, UV maps, weights and modifiers,
    and the key "Morph" that makes it the target.

    Raises
    ------
    CloudError
        See `result.source_ways`.
    """
    source, places, _, back = result.source_ways(obj)
    with result.all_or_nothing() as created:
        mesh = source.data.copy()
        created(mesh)
        copy = source.copy()
        created(copy)
        copy.data = mesh
        copy.pointmorph.recipe = ""  # of a source that morphs itself
        copy.name = mesh.name = f"{obj.name} Mesh"
        copy.hide_render = False
        context.collection.objects.link(copy)
        _know(copy, obj)
        if mesh.shape_keys is None:
            copy.shape_key_add(name="Basis", from_mix=False)
        places = _own_places(source, places, back)
        key = result.add_keys(copy, places, result.stage_names(obj)[1:])
        key.value = result.t_key(obj).value
        copy.active_shape_key_index = copy.data.shape_keys.key_blocks.find(key.name)
    return copy


def _own_places(source, places, back):
    """The places of `result.source_ways` in the source's own space, the first bit by bit."""
    rest = [transforms.move_positions(back, place) for place in places[1:]]
    return [arrays.basis_positions(source.data), *rest]


def _know(copy, obj):
    """Makes the copy remember what the morph object does."""
    shapes = remaking.shapes_of(obj)
    matrix = np.reshape(obj.pointmorph.source_matrix, (3, 3))
    result.link(copy, shapes[0], shapes[-1], matrix, shapes[1:-1])
    remaking.share_recipe(copy, obj)
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
    result.t_key(copy)
    source, places, _, back = result.source_ways(obj)
    places = _own_places(source, places, back)
    mesh, keys = copy.data, copy.data.shape_keys.key_blocks
    own = result.morph_keys(copy)
    base = arrays.key_positions(keys[0])
    moves = {key.name: arrays.key_positions(key) - base for key in keys[1:] if key.name not in own}
    same = len(base) == len(places[0]) and all(
        np.array_equal(read(mesh), read(source.data))
        for read in (arrays.mesh_edges, arrays.mesh_corners)
    )
    if not same:
        _replace_geometry(copy, source)
    arrays.move_vertices(mesh, places[0])
    arrays.write_key(keys[0], places[0])
    result.write_keys(copy, places)
    lost = []
    of_source = source.data.shape_keys.key_blocks if source.data.shape_keys else {}
    for name, move in moves.items():
        if name in of_source:
            arrays.write_key(keys[name], arrays.key_positions(of_source[name]))
        elif same:
            arrays.write_key(keys[name], places[0] + move)
        else:
            arrays.write_key(keys[name], places[0])
            lost.append(result.lost_words(copy, name))
    for user in remaking.users_of(copy):
        _know(user, obj)
        user.update_tag()
    return lost


def remake(context, obj, plan, outcome):
    """Puts what was computed again into a morph object and the copies of the source that were made
    from it; or into a copy whose morph object is gone.

    Returns
    -------
    list of str
        What couldn't follow, in words.
    """
    if result.is_result(obj):
        said = remaking.apply(obj, plan, outcome)
        for user in remaking.users_of(obj):
            following.follow_on(user)
        for copy in bpy.data.objects:
            if copy.pointmorph.made_from == obj and is_copy(copy):
                try:
                    said += remake_mesh(copy, obj)
                    said += _transfer_again(context, copy)
                except pointmorph.PointmorphError as error:
                    said.append(f'"{copy.name}" stays as it was. {error}')
        return said + _transfer_again(context, obj)
    shapes = remaking.shapes_of(obj)
    pairs = result.build(
        context, outcome, obj.name, plan.origin, shapes[0], shapes[-1], plan.source_matrix,
        shapes[1:-1],
    )  # fmt: skip
    try:
        remaking.remember(pairs, plan.recipe, outcome)
        said = remake_mesh(obj, pairs)
        said += _transfer_again(context, obj)
    finally:
        mesh = pairs.data
        pairs.shape_key_clear()  # a data-block that isn't removed with the mesh
        bpy.data.batch_remove([pairs, mesh])
    return said


def is_copy(obj):
    """Whether an object is a copy of a source that `make_mesh` made, and can be changed now."""
    return obj.pointmorph.keeps_faces and obj.library is None and obj.mode == "OBJECT"


def _transfer_again(context, obj):
    """Brings over what was brought over before, from the target as it is now. Returns what went
    wrong, in words."""
    before = remaking.recipe_of(obj).get("transferred")
    if before is None:
        return []
    try:
        transfer(context, obj, *before["options"])
    except pointmorph.PointmorphError as error:
        return [f"What was brought over is of the old morph. {error}"]
    return []


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


# --- What the target has --------------------------------------------------------------------------


def transfer(context, obj, colors, weights, uvs, prefix):
    """Brings what the target has onto a morph object, or a copy of the source, along the map.

    Colours and UV maps become point attributes, weights vertex groups, each under its own name
    after `prefix`. A copy of the source shows colours from those of the source to the target's.

    Returns
    -------
    list of str
        Names on the morph object.

    Raises
    ------
    CloudError
        When the target is gone, was changed since, or has none of what is asked for.
    """
    target = _unchanged_target(obj)
    with remaking.present(context, [target]):
        remaking.update(context, target)
        depsgraph = context.evaluated_depsgraph_get()
        evaluated = target.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
        try:
            found = _read_target(obj, target, mesh, colors, weights, uvs)
        finally:
            evaluated.to_mesh_clear()
    taken = {group.name for group in obj.vertex_groups}
    taken |= {attribute.name for attribute in obj.data.attributes}
    known = set(remaking.recipe_of(obj).get("transferred", {}).get("names", ()))
    for kind, name, _ in found:
        if prefix + name in taken - known:
            raise pointmorph.CloudError(
                obj.name,
                f'no {kind} "{prefix + name}" of its own',
                "one",
                "Choose another prefix, or rename what is there.",
            )
    for kind, name, values in found:
        if kind == "vertex group":
            _write_group(obj, prefix + name, values)
        else:
            arrays.write_attribute(obj.data, prefix + name, values)
    if obj.pointmorph.keeps_faces and colors:
        first = next((name for kind, name, _ in found if kind == "colour attribute"), None)
        if first is not None:
            _blend_colors(obj, prefix + first)
    names = [prefix + name for _, name, _ in found]
    remaking.note(
        obj,
        "transferred",
        {"names": names, "options": [bool(colors), bool(weights), bool(uvs), prefix]},
    )
    return names


def _unchanged_target(obj):
    target = obj.pointmorph.target
    if target is None:
        raise pointmorph.CloudError(
            obj.name, "its target in the file", "none", "Undo its removal, or morph again."
        )
    if target.type != "MESH":
        raise pointmorph.CloudError(
            target.name,
            "a mesh, for attributes to be brought over",
            f"an object of type {target.type}",
            "Its colours and radii are part of the morph already.",
        )
    return target


def _read_target(obj, target, mesh, colors, weights, uvs):
    """What there is, as (kind, name, a row for each point of `obj`); the active colours first."""
    rows = result.stage_rows(obj)[-1] if result.is_result(obj) else None
    count = int(rows.max()) + 1 if rows is not None else remaking.recipe_of(obj)["points"][-1]
    if len(mesh.vertices) != count:
        raise pointmorph.CloudError(
            target.name,
            f'the {count:,} points that "{obj.name}" was made from',
            f"{len(mesh.vertices):,} as it is shown",
            "Compute the morph again first.",
        )
    if rows is not None:
        corners = None
        places = rows[:, None], np.ones((len(rows), 1))
    else:
        corners, *places = _landing_places(obj, mesh)

    def along(values):
        """Values of vertices, at the places."""
        return surfaces.mean(values, *places)

    found = []
    if colors:
        active = mesh.color_attributes.active_color
        for item in sorted(mesh.color_attributes, key=lambda item: item != active):
            values = arrays.vertex_colors(mesh, item)
            found.append(("colour attribute", item.name, along(values)))
    if weights:
        groups = {
            group.index: group.name
            for group in target.vertex_groups
            if not group.name.startswith(PREFIX)
        }
        for name, (members, values) in arrays.vertex_groups(mesh, groups).items():
            whole = np.zeros((len(mesh.vertices), 1), np.float32)
            whole[members, 0] = values
            found.append(("vertex group", name, along(whole)[:, 0]))
    if uvs:
        for layer in mesh.uv_layers:
            uv = arrays.corner_uvs(layer)
            if corners is None:
                values = along(arrays.first_of_corners(mesh, uv))
            else:
                values = surfaces.mean(uv, corners, places[1])
            found.append(("UV map", layer.name, values))
    if not found:
        raise pointmorph.CloudError(
            target.name,
            "something to bring over: colours, weights or UV maps",
            "nothing of what was asked for",
            "Choose what it has.",
        )
    return found


def _landing_places(obj, mesh):
    """Where the vertices of a copy of the source land on the target's mesh.

    Returns
    -------
    (N, 3) array or None
        Corners of the triangle that each vertex lands in.
    (N, K) array of int
        Vertices of the target around.
    (N, K) array
        Their shares, which sum to 1.
    """
    recipe = remaking.recipe_of(obj)
    pairs = obj.pointmorph.made_from
    if pairs is not None and result.is_result(pairs):
        rows = result.stage_rows(pairs)[-1]
        positions = arrays.by_row(rows, arrays.key_positions(result.stage_keys(pairs)[-1]))
    else:
        matrix = np.reshape(recipe["shapes"][-1]["matrix"], (4, 4))
        positions = transforms.move_positions(matrix, arrays.vertex_positions(mesh))
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(obj.pointmorph.source_matrix, (3, 3))
    landing = transforms.move_positions(matrix, arrays.key_positions(result.last_key(obj)))
    triangle, members, shares = surfaces.around(positions, arrays.mesh_triangles(mesh), landing)
    corners = None if triangle is None else arrays.triangle_loops(mesh)[triangle]
    return corners, members, shares


def _write_group(obj, name, weights):
    group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
    group.remove(list(range(len(weights))))
    for number in np.flatnonzero(weights > 0).tolist():
        group.add([number], float(weights[number]), "REPLACE")


def _blend_colors(obj, name):
    """Shows the copy's active colours at 0, the attribute `name` at the end."""
    mesh = obj.data
    active = mesh.color_attributes.active_color
    own = [item.name for item in mesh.color_attributes if item.name != name]
    start = active.name if active is not None and active.name != name else next(iter(own), None)
    if start is None:
        start = display.COLOR
        arrays.write_attribute(mesh, start, np.ones((len(mesh.vertices), 4), np.float32))
    mesh.color_attributes.active_color = mesh.color_attributes[start]
    group = bpy.data.node_groups.get(NAME)
    with result.all_or_nothing() as created:
        if group is None:
            group = _colors_group(created)
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is None:
        modifier = obj.modifiers.new(MODIFIER, "NODES")
        modifier.node_group = group
        shapes = len(obj.pointmorph.via) + 2
        display.drive_input(obj, modifier, "t", result.t_key(obj), shapes - 1)
    modifier[display.input_identifier(group, "From")] = start
    modifier[display.input_identifier(group, "To")] = name
    obj.update_tag()


def _colors_group(created):
    group = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    created(group)
    display.new_input(group, "NodeSocketGeometry", "Geometry")
    display.new_t_input(group, 2)
    display.new_input(group, "NodeSocketString", "From", "Colour attribute that is shown at 0")
    display.new_input(group, "NodeSocketString", "To", "Colour attribute that is shown at 1")
    display.new_output(group, "NodeSocketGeometry", "Geometry")
    build = display.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    colors = [build.attribute(inputs[name], "FLOAT_COLOR") for name in ("From", "To")]
    stored = build.node(
        "GeometryNodeStoreNamedAttribute",
        {
            "Geometry": inputs["Geometry"],
            "Name": inputs["From"],
            "Value": display.mix_colors(build, colors, [inputs["t"]]),
        },
        data_type="FLOAT_COLOR",
        domain="CORNER",
    )
    build.node("NodeGroupOutput", {"Geometry": stored.outputs["Geometry"]})
    return group
