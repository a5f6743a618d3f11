"""Morph objects that follow how their shapes move: armatures, shape keys, modifiers, transforms.

Geometry nodes look every point up where it is on each shape at the moment, by its row, and mix the
places at t. So it works at every frame, when rendering and in files opened without the add-on. A
shape that is gone, or has another number of points by now, isn't followed: the object shows what
was morphed.
"""

import pointmorph

from ..data import arrays, attribute_names, creation, nodes, versions
from . import as_shown, morph_object, path_display, recipes

NAME = "Pointmorph Follow"
MODIFIER = "Follow"


def follow(obj, context, created):
    """Makes a morph object follow its shapes. `created` gets every data-block that is made.

    Raises
    ------
    CloudError
        When a shape is gone, or doesn't have the points any more that were morphed.
    """
    key = morph_object.morph_key(obj)
    shapes = followed(obj, context)
    counts = check_counts(obj, shapes, context)
    modifier = obj.modifiers.get(MODIFIER) or obj.modifiers.new(MODIFIER, "NODES")
    _give_nodes(obj, modifier, created)
    _set_inputs(obj, modifier, shapes, counts)
    _put_before_points(obj, modifier)
    obj.driver_remove(versions.input_path(modifier, "t"))
    nodes.drive_input(obj, modifier, "t", key)
    obj.pointmorph.follows = True
    obj.update_tag()


def followed(obj, context):
    """The shapes that a morph object follows, in order; None for what is gone. One that was morphed
    as shown is a copy, which stands still: its original, which has the same vertices, unless the
    copy was edited."""
    depsgraph = context.evaluated_depsgraph_get()
    found = []
    for shape, count in zip(recipes.shapes_of(obj), _wanted(obj), strict=True):
        original = None if shape is None else recipes.original_of(shape)
        if original != shape and original.type == "MESH" and as_shown.has_its_form(shape):
            evaluated = original.evaluated_get(depsgraph)
            if evaluated.is_evaluated and len(evaluated.data.vertices) == count:
                shape = original
        found.append(shape)
    return found


def follow_on(obj, context):
    """Makes a morph object that follows its shapes do so with the points that it has now."""
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is not None and modifier.node_group is not None:
        with creation.all_or_nothing() as created:
            _give_nodes(obj, modifier, created)
        _set_inputs(obj, modifier, followed(obj, context), _wanted(obj))


def rest(obj):
    """Makes a morph object show what was morphed again."""
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is not None:
        if modifier.node_group is not None:
            obj.driver_remove(versions.input_path(modifier, "t"))
        obj.modifiers.remove(modifier)
    obj.pointmorph.follows = False


def _give_nodes(obj, modifier, created):
    """Those of this version, where the modifier has none or earlier ones."""
    stages = morph_object.stages(obj)
    name = NAME if len(stages) == 2 else f"{NAME} {len(stages)}"
    group = nodes.shared_group(name, lambda name: _group(name, stages, created))
    if modifier.node_group is None:
        modifier.node_group = group
    else:
        nodes.swap_group(obj, modifier, group)


def _set_inputs(obj, modifier, shapes, counts):
    for stage, shape, count in zip(morph_object.stages(obj), shapes, counts, strict=True):
        versions.set_input(modifier, _shape_input(stage), shape)
        versions.set_input(modifier, _count_input(stage), count)


def _wanted(obj):
    """How many points every shape must have."""
    return [int(rows.max()) + 1 for rows in morph_object.stage_rows(obj)]


def check_counts(obj, shapes, context):
    """How many points every shape must have, after a look whether they have them."""
    wanted = _wanted(obj)
    depsgraph = context.evaluated_depsgraph_get()
    for shape, count in zip(shapes, wanted, strict=True):
        if shape is None:
            raise pointmorph.CloudError(
                obj.name,
                "the objects it was made from, to follow them",
                "one that no longer exists",
                "Undo the deletion, or morph other objects.",
            )
        found = len(arrays.points_of(shape.evaluated_get(depsgraph).data))
        if found != count:
            raise pointmorph.CloudError(
                shape.name,
                f'the {count:,} points "{obj.name}" was made from, in the same order',
                f"{found:,} as shown in the viewport",
                "Disable the modifiers that add or remove vertices, or recompute the morph.",
            )
    return wanted


def _put_before_points(obj, modifier):
    """Before the points are made of the vertices, and after the path, which is that at rest."""
    nodes.put_first(obj, modifier)
    path = path_display.modifier_of(obj)
    if path is not None:
        obj.modifiers.move(0, obj.modifiers.find(path.name))


def _shape_input(stage):
    return f"Shape {stage}"


def _count_input(stage):
    return f"Points of {stage}"


def _group(name, stages, created):
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_t_input(group, len(stages))
    for stage in stages:
        nodes.new_input(group, "NodeSocketObject", _shape_input(stage), "Object to follow")
        nodes.new_input(
            group,
            "NodeSocketInt",
            _count_input(stage),
            "Number of points it must have. With any other number, the morph stays at rest",
        )
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")

    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    factors = nodes.shares(build, nodes.local_t(build, inputs["t"], len(stages)), len(stages))
    here = build.node("GeometryNodeInputPosition").outputs["Position"]
    facing = build.node("GeometryNodeInputNormal").outputs["Normal"]
    places, normals, all_there = [], [], None
    for stage in stages:
        shape = build.node(
            "GeometryNodeObjectInfo",
            {"Object": inputs[_shape_input(stage)]},
            transform_space="RELATIVE",
        ).outputs["Geometry"]
        on_mesh, on_cloud = (
            build.node("GeometryNodeAttributeDomainSize", {"Geometry": shape}, component=component)
            for component in ("MESH", "POINTCLOUD")
        )
        points = build.math(
            "ADD",
            on_mesh.outputs["Point Count"],
            nodes.enabled(on_cloud.outputs, "Point Count"),
        )
        there = _compare(build, points, inputs[_count_input(stage)], "EQUAL")
        all_there = there if all_there is None else _both(build, all_there, there)
        row = build.attribute(f"{stage}_row", "INT")

        def looked_up(value, shape=shape, row=row):
            node = build.node(
                "GeometryNodeSampleIndex",
                {"Geometry": shape, "Value": value, "Index": row},
                data_type="FLOAT_VECTOR",
                domain="POINT",
            )
            return nodes.enabled(node.outputs, "Value")

        places.append(looked_up(here))
        # Only faces say where a vertex faces.
        has_faces = _compare(build, on_mesh.outputs["Face Count"], 0.5, "GREATER_THAN")
        own = build.attribute(f"{stage}_normal", "FLOAT_VECTOR")
        normals.append(nodes.switch(build, "VECTOR", has_faces, own, looked_up(facing)))
    moved = build.node(
        "GeometryNodeSetPosition",
        {
            "Geometry": inputs["Geometry"],
            "Selection": all_there,
            "Position": nodes.mix_through(build, places, factors, "VECTOR"),
        },
    ).outputs["Geometry"]
    for stage, normal in zip(stages, normals, strict=True):
        own = build.attribute(f"{stage}_normal", "FLOAT_VECTOR")
        value = nodes.switch(build, "VECTOR", all_there, own, normal)
        moved = build.node(
            "GeometryNodeStoreNamedAttribute",
            {"Geometry": moved, "Name": f"{stage}_normal", "Value": value},
            data_type="FLOAT_VECTOR",
            domain="POINT",
        ).outputs["Geometry"]
    # Normals are what they are on the shapes, not on the path at rest.
    at_rest = {"Geometry": moved, "Selection": all_there, "Name": attribute_names.TURN}
    moved = build.node(
        "GeometryNodeStoreNamedAttribute", at_rest, data_type="FLOAT_VECTOR", domain="POINT"
    ).outputs["Geometry"]
    build.node("NodeGroupOutput", {"Geometry": moved})
    return group


def _compare(build, a, b, operation):
    node = build.node(
        "FunctionNodeCompare", {"A": a, "B": b}, data_type="FLOAT", operation=operation
    )
    if operation == "EQUAL":
        nodes.enabled(node.inputs, "Epsilon").default_value = 0.5
    return node.outputs["Result"]


def _both(build, a, b):
    node = build.node("FunctionNodeBooleanMath", operation="AND")
    build.tree.links.new(a, node.inputs[0])
    build.tree.links.new(b, node.inputs[1])
    return node.outputs["Boolean"]
