"""How a morph object looks: geometry nodes that show its pairs as colored points, and a material.

The group of nodes and the material are made once a file and shared by all morph objects.
"""

from types import MappingProxyType

import bpy

from ..data import attribute_names, creation, nodes, versions
from . import disc_faces, path_display, point_shapes, points_material, recipes

NAME = "Pointmorph Points"
MODIFIER = "Points"
# What points can be colored by: the group's input that says so, by the attribute.
SHOW = {
    attribute_names.DISTORTION: "Show Distortion",
    attribute_names.CONFIDENCE: "Show Confidence",
}
_MEANINGS = {
    attribute_names.DISTORTION: "Color the points by how bad the map is there: blue is good, "
    "yellow is bad, red is folded",
    attribute_names.CONFIDENCE: "Color the points by how likely the map is right there: blue is "
    "sure, yellow is a toss-up, red is most likely wrong",
}
_BLUE, _YELLOW, _RED = (0.05, 0.25, 0.9), (1.0, 0.85, 0.1), (0.9, 0.02, 0.02)
# Colors at nothing, half-way and all of a value.
_RAMPS = {
    attribute_names.DISTORTION: (2.0, (_BLUE, _YELLOW, _RED)),  # that of a fold
    attribute_names.CONFIDENCE: (1.0, (_RED, _YELLOW, _BLUE)),
}


def add_points_modifier(obj, key, created, stages=("source", "target")):
    """Shows the vertices of `obj` as points, color and radius at the value of shape key `key`.

    `created` is called with every data-block that had to be made. `stages` are the prefixes of the
    attributes of all shapes, in order.
    """
    modifier = obj.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = _shared(stages, created)
    nodes.drive_input(obj, modifier, "t", key)


def renew(obj, created, stages):
    """Gives a morph object that an earlier version made the nodes of this one; see above."""
    modifier = points_modifier(obj)
    if modifier is not None:
        nodes.swap_group(obj, modifier, _shared(stages, created, _transferred(obj)))
    for user in bpy.data.objects:
        if user.data == obj.data:
            _give_faces(user)


def keep_transferred(obj, stages):
    """Makes discs have what was transferred to the points; see above."""
    kept = _transferred(obj)
    with creation.all_or_nothing() as created:
        for user in bpy.data.objects:
            modifier = points_modifier(user) if user.data == obj.data else None
            if _knows_discs(modifier):
                nodes.swap_group(user, modifier, _shared(stages, created, kept))


def _transferred(obj):
    """What was transferred to the points of an object, as `point_shapes.Discs` keep it."""
    attributes, kept = obj.data.attributes, {}
    for name in recipes.names_transferred(obj):
        if name in obj.vertex_groups:
            kept[name] = ("FLOAT", "FACE")
        elif name in attributes:
            kind = attributes[name].data_type
            # Only what corners have can be the colors of a viewport.
            kept[name] = (kind, "POINT" if kind.endswith("COLOR") else "FACE")
    return kept


def remove_unused():
    """Takes the group of nodes and the material out of the file where nothing shows points."""
    path_display.remove_unused()
    nodes.remove_unused_groups(NAME)
    disc_faces.remove_unused()
    material = bpy.data.materials.get(NAME)
    if material is not None and material.users == 0:
        bpy.data.materials.remove(material)


def can_show(obj, attribute):
    """Whether a morph object has the attribute and its nodes know how to color points by it."""
    modifier = points_modifier(obj)
    return (
        modifier is not None
        and SHOW[attribute] in versions.group_inputs(modifier.node_group)
        and attribute in obj.data.attributes
    )


def shows(obj, attribute):
    """Whether the points have the colors of this attribute now."""
    return can_show(obj, attribute) and bool(
        versions.input_value(points_modifier(obj), SHOW[attribute])
    )


def show(obj, wanted):
    """Colors the points by an attribute of SHOW, or as they were if that is None."""
    for attribute, name in SHOW.items():
        if can_show(obj, attribute) and (attribute == wanted) != shows(obj, attribute):
            versions.set_input(points_modifier(obj), name, attribute == wanted)
            obj.update_tag()


def shows_discs(obj):
    """Whether the points are drawn as discs now."""
    modifier = points_modifier(obj)
    return _knows_discs(modifier) and bool(versions.input_value(modifier, point_shapes.DISCS))


def show_discs(obj, show):
    """Draws the points as discs, or not so, where their nodes can."""
    if show != shows_discs(obj) and _knows_discs(points_modifier(obj)):
        versions.set_input(points_modifier(obj), point_shapes.DISCS, show)
        _give_faces(obj)
        obj.update_tag()


def _give_faces(obj):
    """The faces of as many discs as an object of pairs shows, made ahead; none if it shows none."""
    modifier = points_modifier(obj)
    known = {} if modifier is None else versions.group_inputs(modifier.node_group)
    if point_shapes.FACES not in known:
        return
    with creation.all_or_nothing() as created:
        shows = versions.input_value(modifier, point_shapes.DISCS)
        faces = disc_faces.of(len(obj.data.vertices), created) if shows else None
        versions.set_input(modifier, point_shapes.FACES, faces)
    disc_faces.remove_unused()


def _knows_discs(modifier):
    known = {} if modifier is None else versions.group_inputs(modifier.node_group)
    return point_shapes.DISCS in known


def points_modifier(obj):
    modifier = obj.modifiers.get(MODIFIER)
    known = modifier is not None and modifier.type == "NODES" and modifier.node_group is not None
    return modifier if known else None


def _shared(stages, created, kept=MappingProxyType({})):
    def make(name):
        return _group(name, stages, kept, created)

    name = NAME if len(stages) == 2 else f"{NAME} {len(stages)}"
    if kept:
        name += " with " + ", ".join(f"{key} ({kind})" for key, (kind, _) in kept.items())
    return nodes.shared_group(name, make)


def _group(name, stages, kept, created):
    material = points_material.material(created)
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_t_input(group, len(stages))
    point_shapes.new_splat_inputs(group)
    for attribute, name in SHOW.items():
        nodes.new_input(group, "NodeSocketBool", name, _MEANINGS[attribute])
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")

    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    factors = nodes.shares(build, nodes.local_t(build, inputs["t"], len(stages)), len(stages))

    def mixed(values, kind):
        return nodes.mix_through(build, values, factors, kind)

    colors = [build.attribute(f"{side}_color", "FLOAT_COLOR") for side in stages]
    color = nodes.mix_colors(build, colors, factors)
    for attribute in SHOW:
        color = _or_color_of(build, inputs, color, attribute)

    normals = [build.attribute(f"{side}_normal", "FLOAT_VECTOR") for side in stages]
    turn = build.attribute(attribute_names.TURN, "FLOAT_VECTOR")
    normal = build.math("ADD", mixed(normals, "VECTOR"), turn, kind="ShaderNodeVectorMath")
    unit_normal = build.math("NORMALIZE", normal, kind="ShaderNodeVectorMath")

    radii = [build.attribute(f"{side}_radius", "FLOAT") for side in stages]
    radius = build.math("MULTIPLY", mixed(radii, "FLOAT"), inputs["Radius Scale"])

    geometry = build.stored(inputs["Geometry"], attribute_names.COLOR, "FLOAT_COLOR", color)
    geometry = build.stored(geometry, attribute_names.NORMAL, "FLOAT_VECTOR", unit_normal)

    own = (attribute_names.DELAY, attribute_names.TIME, attribute_names.AHEAD)
    discs = point_shapes.Discs({**dict.fromkeys(own, ("FLOAT", "FACE")), **kept})
    shown = point_shapes.splats(build, inputs, geometry, radius, discs, created)
    finished = build.node("GeometryNodeSetMaterial", {"Geometry": shown, "Material": material})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs["Geometry"]})
    return group


def _or_color_of(build, inputs, color, attribute):
    """`color`, or while the group's input says so that of the attribute."""
    most, colors = _RAMPS[attribute]
    share = build.math("DIVIDE", build.attribute(attribute, "FLOAT"), most)
    ramp = build.node("ShaderNodeValToRGB")
    build.tree.links.new(share, ramp.inputs[0])
    elements = ramp.color_ramp.elements
    elements.new(0.5)
    for element, position, rgb in zip(elements, (0.0, 0.5, 1.0), colors, strict=True):
        element.position = position
        element.color = (*rgb, 1.0)
    return nodes.switch(build, "RGBA", inputs[SHOW[attribute]], color, ramp.outputs["Color"])
