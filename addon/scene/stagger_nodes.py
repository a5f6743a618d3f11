"""The part of the geometry nodes that lets parts of a morph go later than others.

Each point has a delay from 0 (goes first) to 1 (goes last): its height, noise, its distance from
an object, or its weight. With an overlap of d, a point of delay p takes d of the whole time, and
begins when p times the rest is over, as with the library's setting `stagger`.
"""

import numpy as np

from ..data import attribute_names, nodes

NOISE_NAME = "Pointmorph Path Noise"
STAGGER = "Stagger"
GROUP_NAME, WEIGHTS_FROM = "Group", "Weights From"
OFF, HEIGHT, NOISE, OBJECT, GROUP = KINDS = ("Off", "Height", "Noise", "Object", "Vertex Group")
INPUTS = {
    OFF: (),
    HEIGHT: ("Direction",),
    NOISE: ("Size", "Seed"),
    OBJECT: ("Object",),
    GROUP: (GROUP_NAME,),
}
"""What else a kind takes; `COMMON` are for all but Off."""
COMMON = ("Overlap", "Falloff", "Reverse")
_LEAST = 0.01  # of the whole time that a point takes
_WAVES = 6


def new_inputs(group, of_points):
    """What the user chooses; and of points, whose vertex groups count."""
    panel = group.interface.new_panel(STAGGER)

    def new(kind, name, description, **values):
        return nodes.new_input(group, kind, name, description, parent=panel, **values)

    new("NodeSocketMenu", STAGGER, "Which parts go first")
    share = {"min_value": 0.0, "max_value": 1.0, "subtype": "FACTOR"}
    new(
        "NodeSocketFloat",
        "Overlap",
        "Share of the time that each point takes. 1: all move together. Small: one after the other",
        default_value=0.5,
        **share,
    )
    new(
        "NodeSocketFloat",
        "Falloff",
        "0: each point goes at constant speed. 1: it starts and ends slowly",
        default_value=1.0,
        **share,
    )
    new("NodeSocketBool", "Reverse", "Reverses the order: the last parts go first")
    new(
        "NodeSocketVector",
        "Direction",
        "Height: parts farther in this direction, in world space, go later",
        default_value=(0.0, 0.0, 1.0),
    )
    new(
        "NodeSocketFloat",
        "Size",
        "Noise: approximate size of the patches that move together",
        default_value=0.5,
        min_value=1e-6,
    )
    new("NodeSocketInt", "Seed", "Noise: another number gives another pattern")
    new("NodeSocketObject", "Object", "Object: parts farther from its origin go later")
    new("NodeSocketString", GROUP_NAME, "Vertex Group: weight 0 goes first, weight 1 last")
    if of_points:
        new(
            "NodeSocketObject",
            WEIGHTS_FROM,
            "Vertex Group: mesh with the vertices of the source that has the group. None: the "
            "points' own group",
        )


def is_on(build, inputs):
    """Whether anything is staggered. Only one node may read a menu: see `timed`."""
    return build.math("GREATER_THAN", _kind(build, inputs), 0.5)


def _kind(build, inputs):
    """The number of the kind in `KINDS`."""
    known = next((n for n in build.tree.nodes if n.bl_idname == "GeometryNodeMenuSwitch"), None)
    if known is not None:
        return known.outputs[0]
    node = build.node("GeometryNodeMenuSwitch", data_type="INT")
    for number, name in enumerate(KINDS):
        if number < 2:  # it comes with two
            node.enum_items[number].name = name
        else:
            node.enum_items.new(name)
    for number, socket in enumerate(node.inputs[1 : len(KINDS) + 1]):
        socket.default_value = number
    build.tree.links.new(inputs[STAGGER], node.inputs[0])
    menu = next(i for i in build.tree.interface.items_tree if i.name == STAGGER and _is_menu(i))
    menu.default_value = OFF
    return node.outputs[0]


def _is_menu(item):
    return getattr(item, "socket_type", "") == "NodeSocketMenu"


def timed(build, inputs, geometry, start, ways, created):
    """The geometry with the delay of each point and the share of its way as attributes.

    Parameters
    ----------
    start : socket
        Where the points are at t = 0.
    ways : int
        The value of t at the end.
    created : callable
        Gets every data-block made.
    """
    # Stored at once: what two nodes ask for is computed twice.
    measured = _measured(build, inputs, start, created)
    geometry = build.stored(geometry, attribute_names.DELAY, "FLOAT", measured)
    delay = build.attribute(attribute_names.DELAY, "FLOAT")
    is_group = build.math("GREATER_THAN", _kind(build, inputs), KINDS.index(GROUP) - 0.5)
    spread = _spread(build, geometry, delay)
    final = nodes.switch(build, "FLOAT", is_group, spread, delay)
    final = build.math("ABSOLUTE", build.math("SUBTRACT", inputs["Reverse"], final))
    geometry = build.stored(geometry, attribute_names.DELAY, "FLOAT", final)
    whole = build.math("DIVIDE", inputs["t"], float(ways))
    takes = build.math("MAXIMUM", inputs["Overlap"], _LEAST)
    begins = build.math("MULTIPLY", delay, build.math("SUBTRACT", 1.0, takes))
    done = build.math("DIVIDE", build.math("SUBTRACT", whole, begins), takes, use_clamp=True)
    # 1 at the end, whatever was rounded before.
    done = build.math("MAXIMUM", done, build.math("FLOOR", whole))
    smooth = build.math("MULTIPLY", done, done)
    smooth = build.math("MULTIPLY", smooth, build.math("MULTIPLY_ADD", done, -2.0, 3.0))
    easing = build.math("MULTIPLY", build.math("SUBTRACT", smooth, done), inputs["Falloff"])
    own = build.math("ADD", done, easing)
    geometry = build.stored(geometry, attribute_names.TIME, "FLOAT", own)
    own = build.attribute(attribute_names.TIME, "FLOAT")
    ahead = build.math("SUBTRACT", own, whole)
    return build.stored(geometry, attribute_names.AHEAD, "FLOAT", ahead)


def _measured(build, inputs, start, created):
    """Of each kind in its own way: what is less goes first."""
    itself = build.node("GeometryNodeSelfObject").outputs[0]
    matrix = build.node("GeometryNodeObjectInfo", {"Object": itself}).outputs["Transform"]
    place = build.node("FunctionNodeTransformPoint", {"Vector": start, "Transform": matrix})
    place = place.outputs[0]
    height = build.number_of("DOT_PRODUCT", place, inputs["Direction"])
    other = build.node(
        "GeometryNodeObjectInfo", {"Object": inputs["Object"]}, transform_space="ORIGINAL"
    )
    far = build.number_of("DISTANCE", place, other.outputs["Location"])
    kind = _kind(build, inputs)
    noise = build.group(
        nodes.shared_group(NOISE_NAME, lambda name: _noise_group(name, created)),
        {"Place": place, "Size": inputs["Size"], "Seed": inputs["Seed"]},
    )
    values = (far, noise, height)
    measured = values[0]
    for number, value in ((KINDS.index(NOISE), values[1]), (KINDS.index(HEIGHT), values[2])):
        is_it = build.math("LESS_THAN", kind, number + 0.5)
        measured = nodes.switch(build, "FLOAT", is_it, measured, value)
    is_group = build.math("GREATER_THAN", kind, KINDS.index(GROUP) - 0.5)
    return nodes.switch(build, "FLOAT", is_group, measured, _weight(build, inputs))


def _noise_group(name, created):
    """Waves in all directions, which take a tenth of the time of the noise texture."""
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketVector", "Place")
    nodes.new_input(group, "NodeSocketFloat", "Size")
    nodes.new_input(group, "NodeSocketInt", "Seed")
    nodes.new_output(group, "NodeSocketFloat", "Noise")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    half_waves = build.math("DIVIDE", np.pi, inputs["Size"])
    shift = build.node("ShaderNodeCombineXYZ")
    for socket, (step, first) in zip(
        shift.inputs, ((1.618, 1.1), (2.718, 2.3), (3.303, 3.7)), strict=True
    ):
        number = build.math("MULTIPLY_ADD", inputs["Seed"], step, first)
        build.tree.links.new(number, socket)
    place = build.scaled(inputs["Place"], half_waves)
    place = build.math("ADD", place, shift.outputs[0], kind="ShaderNodeVectorMath")
    total = None
    for number in range(_WAVES):  # directions that are spread evenly, of several lengths
        z = 1.0 - (number + 0.5) / _WAVES
        angle = 2.39996 * number
        across = np.sqrt(1.0 - z * z)
        length = 0.7 + 0.6 * ((0.618 * number) % 1.0)
        direction = (across * np.cos(angle), across * np.sin(angle), z)
        phase = build.node("ShaderNodeVectorMath", {}, operation="DOT_PRODUCT")
        build.tree.links.new(place, phase.inputs[0])
        phase.inputs[1].default_value = [length * x for x in direction]
        wave = build.math("SINE", phase.outputs["Value"])
        total = wave if total is None else build.math("ADD", total, wave)
    build.node("NodeGroupOutput", {"Noise": total})
    return group


def _weight(build, inputs):
    """Of a vertex group; of points, that of their source's vertex on another mesh, if there is."""
    own = build.attribute(inputs[GROUP_NAME], "FLOAT")
    if WEIGHTS_FROM not in inputs:
        return own
    mesh = build.node("GeometryNodeObjectInfo", {"Object": inputs[WEIGHTS_FROM]})
    mesh = mesh.outputs["Geometry"]
    size = build.node("GeometryNodeAttributeDomainSize", {"Geometry": mesh}, component="MESH")
    there = build.math("GREATER_THAN", size.outputs["Point Count"], 0.5)
    row = build.attribute("source_row", "INT")
    node = build.node(
        "GeometryNodeSampleIndex",
        {"Geometry": mesh, "Value": own, "Index": row},
        data_type="FLOAT",
        domain="POINT",
    )
    return nodes.switch(build, "FLOAT", there, own, nodes.enabled(node.outputs, "Value"))


def _spread(build, geometry, values):
    """The values, stretched so that the least is 0 and the largest 1.

    The bounds of a geometry with the values as places: Attribute Statistic sorts all of them.
    """
    as_place = build.node("ShaderNodeCombineXYZ", {"X": values}).outputs[0]
    line = build.moved(geometry, Position=as_place)
    box = build.node("GeometryNodeBoundBox", {"Geometry": line})
    ends = []
    for end in ("Min", "Max"):
        node = build.node("ShaderNodeSeparateXYZ", {"Vector": box.outputs[end]})
        ends.append(node.outputs["X"])
    least, largest = ends
    length = build.math("SUBTRACT", largest, least)
    return build.math("DIVIDE", build.math("SUBTRACT", values, least), length, use_clamp=True)
