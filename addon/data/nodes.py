"""Trees of nodes, built in code."""

import functools
import pathlib
import zlib

import bpy

from . import arrays, attribute_names, versions

MUST_BE_FIRST = {"MULTIRES", "SOFT_BODY"}
"""Types of modifiers that need a mesh's own vertices: Blender lets none that moves these be above.
"""

_MARK = "pointmorph_version"


@functools.cache
def _version():
    """What tells the groups of nodes of this version from those that a file has of another one: a
    checksum of the add-on's code, which makes them."""
    files = sorted(pathlib.Path(__file__).parents[1].glob("*/*.py"))
    return f"{zlib.crc32(b''.join(file.read_bytes() for file in files)):08x}"


def shared_group(name, make):
    """The group of that name as this version makes it, which `make(name)` does where the file has
    none. One that another version made stays as it is, with all that uses it."""
    mark = f"{name}: {_version()}"
    for group in bpy.data.node_groups:
        if group.library is None and group.get(_MARK) == mark:
            return group
    group = make(name)
    arrange(group)
    group[_MARK] = mark
    return group


def new_group(name, created):
    """An empty group of geometry nodes, which `created` gets."""
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    created(group)
    return group


def remove_unused_groups(name):
    """Takes shared groups whose name begins so out of the file where nothing has them."""
    while groups := [g for g in bpy.data.node_groups if is_shared(g, name) and not g.users]:
        bpy.data.batch_remove(groups)  # and then those that only these had


def is_shared(group, name):
    """Whether it is a shared group whose name begins so."""
    return group.get(_MARK, "").startswith(name)


def is_own(modifier):
    """Whether a modifier has nodes that the add-on made."""
    group = modifier.node_group if modifier.type == "NODES" else None
    return group is not None and _MARK in group


def swap_group(obj, modifier, group):
    """Gives a modifier another group in place of the one that it has; inputs of the same name keep
    their values and what moves these."""
    old = modifier.node_group
    if old == group:
        return
    after = versions.group_inputs(group)
    names = [n for n in versions.plain_inputs(old) if n in after]
    values = {name: versions.input_value(modifier, name) for name in names}
    before = {name: versions.input_path(modifier, name) for name in names}
    curves = {name: _curves(obj, path) for name, path in before.items()}
    modifier.node_group = group
    for name in names:
        if values[name] is not None:
            versions.set_input(modifier, name, values[name])
        for curve in curves[name]:
            curve.data_path = versions.input_path(modifier, name)


def _curves(obj, path):
    """The animation and the driver of a property, each if there is one."""
    data = obj.animation_data
    drivers = () if data is None else [d for d in data.drivers if d.data_path == path]
    return [c for c in (versions.curve_of(obj, path), *drivers) if c is not None]


def put_first(obj, modifier):
    """Before all other modifiers that can come after it; new ones come last."""
    kinds = [other.type for other in obj.modifiers]
    bound = [place for place, kind in enumerate(kinds) if kind in MUST_BE_FIRST]
    obj.modifiers.move(len(kinds) - 1, bound[-1] + 1 if bound else 0)


def drive_input(obj, modifier, name, key, divisor=1):
    """Makes an input of a modifier's group have the value of a shape key, or a share of it."""
    _drive_share(obj.driver_add(versions.input_path(modifier, name)), key, divisor)


def drive_output(node, key, divisor=1):
    """The same, of the value that a node gives out."""
    _drive_share(node.outputs[0].driver_add("default_value"), key, divisor)


def drive_switch(node, obj, modifier, name):
    """Makes a value that a node gives out 1 where an input of an object's modifier is a whole
    number above 0."""
    driver = node.outputs[0].driver_add("default_value").driver
    driver.type = "SCRIPTED"
    variable = driver.variables.new()
    variable.name = "kind"
    variable.type = "SINGLE_PROP"
    variable.targets[0].id = obj
    variable.targets[0].data_path = versions.input_path(modifier, name)
    driver.expression = "min(kind, 1)"


def drive_count(obj, name, other, switch, count):
    """Makes an input of an object's first modifier a number while a property of another object, by
    its path, is on, and 0 while it is off."""
    path = versions.input_path(obj.modifiers[0], name)
    obj.driver_remove(path)
    driver = obj.driver_add(path).driver
    driver.type = "SCRIPTED"
    variable = driver.variables.new()
    variable.name = "on"
    variable.type = "SINGLE_PROP"
    variable.targets[0].id = other
    variable.targets[0].data_path = switch
    # Simple enough for Blender to compute without Python, also where scripts may not run.
    driver.expression = f"on * {count}"


def _drive_share(curve, key, divisor):
    curve.driver.type = "AVERAGE" if divisor == 1 else "SCRIPTED"
    drive(curve.driver, key)
    if divisor != 1:
        curve.driver.expression = f"t / {divisor}"


def follow_input(obj, modifier, name, leader, leading):
    """Makes an input of a modifier have the value of the same one of another object's modifier."""
    path = versions.input_path(modifier, name)
    obj.driver_remove(path)
    driver = obj.driver_add(path).driver
    driver.type = "AVERAGE"
    variable = driver.variables.new()
    variable.type = "SINGLE_PROP"
    variable.targets[0].id = leader
    variable.targets[0].data_path = versions.input_path(leading, name)


def drive(driver, key):
    """Gives a driver the variable t: the value of a shape key."""
    variable = driver.variables.new()
    variable.name = "t"
    variable.type = "SINGLE_PROP"
    target = variable.targets[0]
    target.id_type = "KEY"
    target.id = key.id_data
    target.data_path = key.path_from_id("value")


def is_of_key(driver):
    """Whether a driver does nothing but what `drive` makes it do."""
    variables = driver.variables
    return (
        driver.type == "AVERAGE"
        and len(variables) == 1
        and (variables[0].name, variables[0].type) == ("t", "SINGLE_PROP")
        and variables[0].targets[0].id_type == "KEY"
    )


def new_input(group, kind, name, description="", **values):
    """The new socket; `parent` is the panel that it belongs to."""
    place = {"parent": values.pop("parent")} if "parent" in values else {}
    socket = group.interface.new_socket(name, in_out="INPUT", socket_type=kind, **place)
    socket.description = description
    for key, value in values.items():
        setattr(socket, key, value)
    return socket


def new_output(group, kind, name):
    group.interface.new_socket(name, in_out="OUTPUT", socket_type=kind)


def enabled(sockets, name):
    """The socket of a node that has one for each type of data under the same name."""
    return next(socket for socket in sockets if socket.enabled and socket.name == name)


def arrange(tree):
    """Puts the nodes in rows, in the order in which they were made."""
    arrays.place_nodes(tree, [(i % 8 * 200, i // 8 * -320) for i in range(len(tree.nodes))])


class Builder:
    """Adds nodes to a tree.

    Blender goes through the whole tree whenever something in it is set, so nothing is set to what
    it is already.
    """

    def __init__(self, tree):
        self.tree = tree

    def node(self, kind, inputs=None, **settings):
        """A new node with its settings made first, because they decide which sockets it has."""
        node = self.tree.nodes.new(kind)
        for key, value in settings.items():
            if getattr(node, key) != value:
                setattr(node, key, value)
        for name, value in (inputs or {}).items():
            self._feed(enabled(node.inputs, name), value)
        return node

    def _feed(self, socket, value):
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif socket.default_value != value:
            socket.default_value = value

    def group(self, group, inputs):
        """What another group of nodes, with one output, makes of `inputs`."""
        return self.node("GeometryNodeGroup", inputs, node_tree=group).outputs[0]

    def math(self, operation, *values, kind="ShaderNodeMath", **settings):
        """What an operation makes of `values`, its inputs in their order."""
        node = self.node(kind, operation=operation, **settings)
        for socket, value in zip(node.inputs, values, strict=False):
            self._feed(socket, value)
        return node.outputs[0]

    def number_of(self, operation, first, second):
        """What an operation on two vectors gives that is a number."""
        node = self.node("ShaderNodeVectorMath", operation=operation)
        for socket, value in zip(node.inputs, (first, second), strict=False):
            self._feed(socket, value)
        return node.outputs["Value"]

    def mixed_shaders(self, factor, first, second):
        node = self.node("ShaderNodeMixShader")
        for socket, value in zip(node.inputs, (factor, first, second), strict=True):
            self._feed(socket, value)
        return node.outputs[0]

    def attribute(self, name, kind):
        """The values of a named attribute."""
        node = self.node("GeometryNodeInputNamedAttribute", {"Name": name}, data_type=kind)
        return enabled(node.outputs, "Attribute")

    def has_attribute(self, name, kind):
        """Whether there is a named attribute."""
        node = self.node("GeometryNodeInputNamedAttribute", {"Name": name}, data_type=kind)
        return node.outputs["Exists"]

    def stored(self, geometry, name, kind, value, domain="POINT"):
        """The geometry with an attribute of that name."""
        fields = {"Geometry": geometry, "Name": name, "Value": value}
        node = self.node("GeometryNodeStoreNamedAttribute", fields, data_type=kind, domain=domain)
        return node.outputs["Geometry"]

    def without(self, geometry, name):
        """The geometry without the attribute of that name."""
        fields = {"Geometry": geometry, "Name": name}
        return self.node("GeometryNodeRemoveAttribute", fields).outputs["Geometry"]

    def sampled(self, geometry, kind, value, index, clamp=False):
        """What a field gives at the points of `geometry` that are asked for; beyond the last one
        0, or with `clamp` what it gives there."""
        fields = {"Geometry": geometry, "Value": value, "Index": index}
        node = self.node(
            "GeometryNodeSampleIndex", fields, data_type=kind, domain="POINT", clamp=clamp
        )
        return enabled(node.outputs, "Value")

    def count(self, geometry, what):
        """How many points or faces a mesh has: `what` is "Point" or "Face"."""
        node = self.node("GeometryNodeAttributeDomainSize", {"Geometry": geometry})
        return node.outputs[f"{what} Count"]

    def moved(self, geometry, **where):
        """The geometry with its points elsewhere: `Position` or `Offset`."""
        return self.node("GeometryNodeSetPosition", {"Geometry": geometry, **where}).outputs[0]

    def scaled(self, vector, factor):
        node = self.node("ShaderNodeVectorMath", operation="SCALE")
        self._feed(node.inputs[0], vector)
        self._feed(node.inputs["Scale"], factor)
        return node.outputs[0]


def new_t_input(group, count):
    """The input that a shape key drives, for `count` shapes."""
    first, second = (
        ("the source", "the target") if count == 2 else ("the first shape", "the second")
    )
    more = "" if count == 2 else ", and so on"
    new_input(
        group,
        "NodeSocketFloat",
        "t",
        f"0 shows the colors and radii of {first}, 1 those of {second}{more}. Driven by the shape "
        "key Morph",
        min_value=0.0,
        max_value=float(count - 1),
    )


def local_t(build, t, count):
    """`t`, or where a morph of `count` shapes is staggered that of each point."""
    own = build.attribute(attribute_names.TIME, "FLOAT")
    own = build.math("MULTIPLY", own, float(count - 1)) if count > 2 else own
    return switch(build, "FLOAT", build.has_attribute(attribute_names.TIME, "FLOAT"), t, own)


def shares(build, t, count):
    """Of the shapes after the first: how far the way to each of them is done at `t`, 0 to 1."""
    if count == 2:
        return [t]
    found = []
    for number in range(count - 1):
        found.append(build.math("SUBTRACT", t, float(number), use_clamp=True))
    return found


def mix_through(build, values, factors, kind):
    """The first of `values`, mixed with one after the other of the rest."""
    result = values[0]
    for value, factor in zip(values[1:], factors, strict=True):
        ends = {"Factor": factor, "A": result, "B": value}
        node = build.node("ShaderNodeMix", ends, data_type=kind, clamp_factor=False)
        result = enabled(node.outputs, "Result")
    return result


def mix_colors(build, colors, factors):
    """Like `mix_through`. A mix of colors is slower than that of their channels, and keeps the
    first alpha."""
    separate = [build.node("FunctionNodeSeparateColor", {"Color": color}) for color in colors]
    channels = {
        name: mix_through(build, [node.outputs[name] for node in separate], factors, "FLOAT")
        for name in ("Red", "Green", "Blue", "Alpha")
    }
    return build.node("FunctionNodeCombineColor", channels).outputs["Color"]


def switch(build, kind, condition, if_false, if_true):
    switch = build.node("GeometryNodeSwitch", input_type=kind)
    build.tree.links.new(condition, next(s for s in switch.inputs if s.enabled))
    build.tree.links.new(if_false, enabled(switch.inputs, "False"))
    build.tree.links.new(if_true, enabled(switch.inputs, "True"))
    return enabled(switch.outputs, "Output")


def in_mesh_of(build, own, geometry):
    """The vertices and faces of `geometry` in the mesh of `own`, in place of all that it has; but
    it keeps its name, and says which colors are active."""
    both = build.node("GeometryNodeJoinGeometry")
    # The last one that is linked comes first.
    for part in (geometry, own):
        build.tree.links.new(part, both.inputs[0])
    index = build.node("GeometryNodeInputIndex").outputs["Index"]
    is_own = build.math("LESS_THAN", index, build.count(own, "Point"))
    rest = {"Geometry": both.outputs["Geometry"], "Selection": is_own}
    return build.node("GeometryNodeDeleteGeometry", rest).outputs["Geometry"]
