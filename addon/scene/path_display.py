"""The way that a morph object is seen to go: geometry nodes that take its points off the straight
way of the shape keys, and let parts go later than others.

They stand before all other modifiers and add to what the shape keys do. What they need are
attributes, so they work while rendering and in a Blender without the add-on. Both are written by
`write`: the whole straight way from shape to shape, and how far the path lies off it.
"""

import numpy as np

from ..core import path_stages
from ..data import arrays, attribute_names, nodes, versions
from . import stagger_nodes

NAME = "Pointmorph Path"
MODIFIER = "Path"
CURVE = "Curve"


def add(obj, key, created, ways, of_points):
    """Gives a morph object the modifier, or the one that it has the nodes of this version.
    `created` gets every data-block made.

    Parameters
    ----------
    ways : int
        From shape to shape.
    of_points : bool
        Whether it shows pairs, whose normals are their own, or has faces.
    """
    name = NAME if ways == 1 else f"{NAME} {ways}"
    if of_points:
        name += " of Points"
    group = nodes.shared_group(name, lambda name: _group(name, created, ways, of_points))
    known = modifier_of(obj)
    if known is not None:
        nodes.swap_group(obj, known, group)
        return
    modifier = obj.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = group
    modifier.show_group_selector = False
    nodes.put_first(obj, modifier)
    nodes.drive_input(obj, modifier, "t", key)


def remove_unused():
    """Takes the groups of nodes out of the file that no morph object has."""
    nodes.remove_unused_groups(NAME)


def modifier_of(obj):
    """The modifier of a morph object, whatever its name; None where there is none."""
    for modifier in obj.modifiers:
        group = modifier.node_group if modifier.type == "NODES" else None
        if group is not None and group.name.startswith(NAME):
            return modifier
    return None


def remove(obj):
    """Takes the modifier away, as from a copy of a source that morphs itself."""
    modifier = modifier_of(obj)
    if modifier is not None:
        obj.driver_remove(versions.input_path(modifier, "t"))
        obj.modifiers.remove(modifier)


def write(mesh, moves, deviations, normals=()):
    """Writes what the nodes need, in place of what was there.

    Parameters
    ----------
    moves : sequence of (N, 3) array
        From shape to shape.
    deviations, normals : sequences of (K, N, 3) array or None
        Of a way from shape to shape: how far places, and normals, lie off the straight one.
    """
    for old in [a.name for a in mesh.attributes if a.name.startswith("path")]:
        if old.partition("_")[0][4:].isdigit():
            mesh.attributes.remove(mesh.attributes[old])
    for way, move in enumerate(moves):
        arrays.write_attribute(mesh, attribute_names.on_way(way, 0), move.astype(np.float32))
    for named, ways in (
        (attribute_names.on_way, deviations),
        (attribute_names.normal_on_way, normals),
    ):
        for way, values in enumerate(ways):
            for number, value in enumerate(() if values is None else values, 1):
                arrays.write_attribute(mesh, named(way, number), value)


def deviation_at(mesh, way, t):
    """(N, 3), or 0: how far the points lie off the straight way at t, 0 to 1."""
    total = 0.0
    for number, share in enumerate(path_stages.shares(t), 1):
        name = attribute_names.on_way(way, number)
        if name in mesh.attributes:
            total = total + share * arrays.read_vectors(mesh, name)
    return total


# --- The nodes ------------------------------------------------------------------------------------


def _group(name, created, ways, of_points):
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_t_input(group, ways + 1)
    nodes.new_input(
        group,
        "NodeSocketFloat",
        CURVE,
        "1: parts rotate as they move. 0: all points go straight, so that rotating parts shrink",
        default_value=1.0,
        min_value=0.0,
        max_value=1.0,
        subtype="FACTOR",
    )
    stagger_nodes.new_inputs(group, of_points)
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    geometry, t = inputs["Geometry"], inputs["t"]
    done = nodes.shares(build, t, ways + 1)
    sums = _sums(created, of_points)
    together = _off_straight(build, geometry, done, inputs[CURVE], sums)

    moves = [build.attribute(attribute_names.on_way(way, 0), "FLOAT_VECTOR") for way in range(ways)]
    start = build.node("GeometryNodeInputPosition").outputs["Position"]
    for move, share in zip(moves, done, strict=True):
        start = build.math(
            "SUBTRACT", start, build.scaled(move, share), kind="ShaderNodeVectorMath"
        )
    staggered = stagger_nodes.timed(build, inputs, geometry, start, ways, created)
    own = nodes.shares(build, nodes.local_t(build, t, ways + 1), ways + 1)
    ahead = [
        build.scaled(move, build.math("SUBTRACT", own_share, share))
        for move, own_share, share in zip(moves, own, done, strict=True)
    ]
    staggered = build.moved(staggered, Offset=_sum(build, ahead))
    staggered = _off_straight(build, staggered, own, inputs[CURVE], sums)

    is_on = stagger_nodes.is_on(build, inputs)
    shown = nodes.switch(build, "GEOMETRY", is_on, together, staggered)
    build.node("NodeGroupOutput", {"Geometry": shown})
    return group


def _sum(build, vectors):
    total = vectors[0]
    for vector in vectors[1:]:
        total = build.math("ADD", total, vector, kind="ShaderNodeVectorMath")
    return total


def _sums(created, of_points):
    """The groups of nodes that sum what lies off the straight way: places, and points' normals."""
    kinds = (("", path_stages.TIMES), (" of Normals", path_stages.NORMAL_TIMES))
    return [
        nodes.shared_group(
            f"{NAME} Sum{what}", lambda name, times=times: _sum_group(name, created, times)
        )
        for what, times in (kinds if of_points else kinds[:1])
    ]


def _off_straight(build, geometry, done, curve, sums):
    """The geometry on its path, where shape keys have it on the straight way. `done` are fields or
    numbers: the share of each way that is gone."""
    places, *normals = sums
    offsets = _summed(build, done, curve, places, attribute_names.on_way)
    for group in normals:
        turns = _summed(build, done, curve, group, attribute_names.normal_on_way)
        geometry = build.stored(geometry, attribute_names.TURN, "FLOAT_VECTOR", turns)
    return build.moved(geometry, Offset=offsets)


def _summed(build, done, curve, group, named):
    """What lies off all ways, by a group that sums it for one."""
    parts = []
    for way, t in enumerate(done):
        inputs = {"t": t, CURVE: curve}
        for name in versions.group_inputs(group):
            if name.isdigit():
                inputs[name] = build.attribute(named(way, int(name)), "FLOAT_VECTOR")
        parts.append(build.group(group, inputs))
    return _sum(build, parts)


def _sum_group(name, created, times):
    """The sum of what lies off a straight way at `times`, each counted by its share at t.

    Nodes of their own: Blender looks a whole tree through whenever a node is added to it.
    """
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketFloat", "t")
    nodes.new_input(group, "NodeSocketFloat", CURVE)
    for number in range(1, len(times) + 1):
        nodes.new_input(group, "NodeSocketVector", str(number))
    nodes.new_output(group, "NodeSocketVector", "Sum")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    shares = _polynomials(build, inputs["t"], times)
    total = (0.0, 0.0, 0.0)
    for number, share in enumerate(shares, 1):
        counted = build.math("MULTIPLY", share, inputs[CURVE])
        parts = (inputs[str(number)], counted, total)
        total = build.math("MULTIPLY_ADD", *parts, kind="ShaderNodeVectorMath")
    build.node("NodeGroupOutput", {"Sum": total})
    return group


def _polynomials(build, t, times):
    """What `path_stages.shares` gives. Each is a product, which is 0 at both ends to the bit."""
    knots = (0.0, *times, 1.0)
    factors = [build.math("SUBTRACT", t, knot) for knot in knots]
    found = []
    for here in range(1, len(knots) - 1):
        others = [k for k in range(len(knots)) if k != here]
        scale = float(np.prod([knots[here] - knots[k] for k in others]))
        product = build.math("DIVIDE", factors[others[0]], scale)
        for k in others[1:]:
            product = build.math("MULTIPLY", product, factors[k])
        found.append(product)
    return found
