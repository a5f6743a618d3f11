"""How a morph object looks: geometry nodes that show its pairs as coloured points, and a material.

The group of nodes and the material are made once a file and shared by all morph objects.
"""

import bpy

NAME = "Pointmorph Points"
MODIFIER = "Points"

# Not in small letters: Cycles renders an attribute "color" black, Blender 3.4 reserves "normal".
COLOR = "Color"
NORMAL = "Normal"
RADIUS = "Radius"  # in small letters it would be a point cloud's own, which a mesh hasn't
VELOCITY = "velocity"  # to the next frame; by second in renders and files, as Cycles blurs by it
FILE_ID = "point_id"  # in files that don't keep "id"

# How bad the map is at a pair: 0 is perfect, over 1 is bad.
DISTORTION = "distortion"
SHOW_DISTORTION = "Show Distortion"
_RAMP = ((0.0, (0.05, 0.25, 0.9)), (0.5, (1.0, 0.85, 0.1)), (1.0, (0.9, 0.02, 0.02)))
_RAMP_END = 2.0  # the distortion of a fold

_EEVEE_WITH_POINTS = (4, 2, 0)


def add_points_modifier(obj, key, created, stages=("source", "target")):
    """Shows the vertices of `obj` as points, colour and radius at the value of shape key `key`.

    `created` is called with every data-block that had to be made. `stages` are the prefixes of the
    attributes of all shapes, in order.
    """
    name = NAME if len(stages) == 2 else f"{NAME} {len(stages)}"
    group = bpy.data.node_groups.get(name)
    if group is None:
        group = _group(name, stages, _material(created), created)
    modifier = obj.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = group
    drive_input(obj, modifier, "t", key)


def drive_input(obj, modifier, name, key, divisor=1):
    """Makes an input of a modifier's group have the value of a shape key, or a share of it."""
    identifier = input_identifier(modifier.node_group, name)
    curve = obj.driver_add(f'modifiers["{modifier.name}"]["{identifier}"]')
    curve.driver.type = "AVERAGE" if divisor == 1 else "SCRIPTED"
    drive(curve.driver, key)
    if divisor != 1:
        curve.driver.expression = f"t / {divisor}"


def drive(driver, key):
    """Gives a driver the variable t: the value of a shape key."""
    variable = driver.variables.new()
    variable.name = "t"
    variable.type = "SINGLE_PROP"
    target = variable.targets[0]
    target.id_type = "KEY"
    target.id = key.id_data
    target.data_path = key.path_from_id("value")


FRAMES_NAME = "Pointmorph Frames"


def add_frames_modifier(obj, collection, plan, created):
    """Shows the mesh of `collection` that belongs to the scene's frame, as points or discs."""
    group = bpy.data.node_groups.get(FRAMES_NAME)
    if group is None:
        group = _frames_group(_material(created), created)
    modifier = obj.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = group
    values = {"Collection": collection, "First": plan.first, "Step": plan.step}
    values["Vertices"] = plan.faces
    render = bpy.context.scene.render
    values["Frame Rate"] = render.fps / render.fps_base
    for name, value in values.items():
        modifier[input_identifier(group, name)] = value


def remove_unused():
    """Takes the group of nodes and the material out of the file where nothing shows points."""
    group, material = bpy.data.node_groups.get(NAME), bpy.data.materials.get(NAME)
    if group is not None and group.users == 0:
        bpy.data.node_groups.remove(group)
        if material is not None and material.users == 0:
            bpy.data.materials.remove(material)


def frames_collection(obj):
    """That which `add_frames_modifier` was called with."""
    return _input(obj, "Collection")


def frames_as_vertices(obj):
    """A mesh object that shows what `obj` does, as vertices: for files that know no points."""
    mesh = bpy.data.meshes.new(obj.name)
    twin = bpy.data.objects.new(obj.name, mesh)
    twin.matrix_world = obj.matrix_world
    modifier = twin.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = _points_modifier(obj).node_group
    for name in ("Collection", "First", "Step", "Frame Rate"):
        _set_input(twin, name, _input(obj, name))
    _set_input(twin, "Vertices", True)
    return twin


def can_show_distortion(obj):
    """Whether a morph object has the attribute and its nodes know what to do with it."""
    modifier = _points_modifier(obj)
    return (
        modifier is not None
        and SHOW_DISTORTION in _inputs(modifier.node_group)
        and DISTORTION in obj.data.attributes
    )


def shows_distortion(obj):
    """Whether the points have the colours of their distortion now."""
    return can_show_distortion(obj) and bool(_input(obj, SHOW_DISTORTION))


def show_distortion(obj, show):
    """Colours the points by distortion, blue over yellow to red, or with their own colours again.

    Where Eevee draws no point clouds the points are discs meanwhile.
    """
    if show == shows_distortion(obj):
        return
    _set_input(obj, SHOW_DISTORTION, show)
    if bpy.app.version < _EEVEE_WITH_POINTS:
        if show:
            obj.pointmorph.discs_before = bool(_input(obj, "Discs"))
        _set_input(obj, "Discs", show or obj.pointmorph.discs_before)
    obj.update_tag()


def _points_modifier(obj):
    modifier = obj.modifiers.get(MODIFIER)
    known = modifier is not None and modifier.type == "NODES" and modifier.node_group is not None
    return modifier if known else None


def _input(obj, name):
    modifier = _points_modifier(obj)
    return modifier.get(input_identifier(modifier.node_group, name), False)


def _set_input(obj, name, value):
    modifier = _points_modifier(obj)
    modifier[input_identifier(modifier.node_group, name)] = value


def input_identifier(group, name):
    """The key under which a modifier keeps the value of an input of its group."""
    return _inputs(group)[name].identifier


def _inputs(group):
    if hasattr(group, "interface"):
        items = group.interface.items_tree
        return {item.name: item for item in items if item.in_out == "INPUT"}
    return {socket.name: socket for socket in group.inputs}


def new_input(group, kind, name, description="", **values):
    if hasattr(group, "interface"):
        socket = group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
    else:
        socket = group.inputs.new(kind, name)
    socket.description = description
    for key, value in values.items():
        setattr(socket, key, value)


def _new_splat_inputs(group):
    """How points are drawn."""
    new_input(
        group,
        "NodeSocketFloat",
        "Radius Scale",
        "Makes all points larger or smaller",
        default_value=1.0,
        min_value=0.0,
    )
    new_input(
        group,
        "NodeSocketBool",
        "Discs",
        "Shows discs in the surface instead of balls: slower, and visible where point clouds "
        "aren't, as in the Eevee of Blender 3.4, and coloured in Workbench",
    )
    new_input(
        group,
        "NodeSocketBool",
        "Spheres",
        "Shows balls that are made of faces: slower than points, and coloured in Workbench and in "
        "solid shading, whose Color must be set to Attribute",
    )


def new_output(group, kind, name):
    if hasattr(group, "interface"):
        group.interface.new_socket(name, in_out="OUTPUT", socket_type=kind)
    else:
        group.outputs.new(kind, name)


def enabled(sockets, name):
    """The socket of a node that has one for each type of data under the same name."""
    return next(socket for socket in sockets if socket.enabled and socket.name == name)


class Builder:
    """Adds nodes to a tree from left to right."""

    def __init__(self, tree):
        self.tree = tree
        self._column = 0

    def node(self, kind, inputs=None, **settings):
        """A new node with its settings made first, because they decide which sockets it has."""
        node = self.tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(node, key, value)
        for name, value in (inputs or {}).items():
            self._feed(enabled(node.inputs, name), value)
        node.location = (self._column % 8 * 200, -(self._column // 8) * 320)
        self._column += 1
        return node

    def _feed(self, socket, value):
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def math(self, operation, *values, kind="ShaderNodeMath", **settings):
        """What an operation makes of `values`, its inputs in their order."""
        node = self.node(kind, operation=operation, **settings)
        for socket, value in zip(node.inputs, values, strict=False):
            self._feed(socket, value)
        return node.outputs[0]

    def mixed_shaders(self, factor, first, second):
        node = self.node("ShaderNodeMixShader")
        for socket, value in zip(node.inputs, (factor, first, second), strict=True):
            self._feed(socket, value)
        return node.outputs[0]

    def attribute(self, name, kind):
        """The values of a named attribute."""
        node = self.node("GeometryNodeInputNamedAttribute", {"Name": name}, data_type=kind)
        return enabled(node.outputs, "Attribute")


def new_t_input(group, count):
    """The input that a shape key drives, for `count` shapes."""
    new_input(
        group,
        "NodeSocketFloat",
        "t",
        "0 shows colour and radius of the source, 1 of the target. Follows the shape key Morph"
        if count == 2
        else "0 shows colour and radius of the first shape, 1 of the second and so on. Follows the "
        "shape key Morph",
        min_value=0.0,
        max_value=float(count - 1),
    )


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
    """Like `mix_through`. A mix of colours keeps the first alpha, so it's mixed as a number."""
    alphas = [
        build.node("FunctionNodeSeparateColor", {"Color": color}).outputs["Alpha"]
        for color in colors
    ]
    mixed = mix_through(build, colors, factors, "RGBA")
    solid = build.node("FunctionNodeSeparateColor", {"Color": mixed}).outputs
    channels = {name: solid[name] for name in ("Red", "Green", "Blue")}
    channels["Alpha"] = mix_through(build, alphas, factors, "FLOAT")
    return build.node("FunctionNodeCombineColor", channels).outputs["Color"]


def _group(name, stages, material, created):
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    created(group)
    new_input(group, "NodeSocketGeometry", "Geometry")
    new_t_input(group, len(stages))
    _new_splat_inputs(group)
    new_input(
        group,
        "NodeSocketBool",
        SHOW_DISTORTION,
        "Colours the points by how bad the map is there: blue is good, yellow bad, red folded",
    )
    new_output(group, "NodeSocketGeometry", "Geometry")

    build = Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    factors = shares(build, inputs["t"], len(stages))

    def mixed(values, kind):
        return mix_through(build, values, factors, kind)

    def stored(geometry, name, kind, value):
        fields = {"Geometry": geometry, "Name": name, "Value": value}
        node = build.node("GeometryNodeStoreNamedAttribute", fields, data_type=kind, domain="POINT")
        return node.outputs["Geometry"]

    colors = [build.attribute(f"{side}_color", "FLOAT_COLOR") for side in stages]
    color = mix_colors(build, colors, factors)
    color = _or_distortion(build, inputs, color, build.attribute(DISTORTION, "FLOAT"))

    normals = [build.attribute(f"{side}_normal", "FLOAT_VECTOR") for side in stages]
    unit_normal = build.math("NORMALIZE", mixed(normals, "VECTOR"), kind="ShaderNodeVectorMath")

    radii = [build.attribute(f"{side}_radius", "FLOAT") for side in stages]
    radius = build.math("MULTIPLY", mixed(radii, "FLOAT"), inputs["Radius Scale"])

    geometry = stored(inputs["Geometry"], COLOR, "FLOAT_COLOR", color)
    geometry = stored(geometry, NORMAL, "FLOAT_VECTOR", unit_normal)

    shown = _splats(build, inputs, geometry, unit_normal, radius)
    finished = build.node("GeometryNodeSetMaterial", {"Geometry": shown, "Material": material})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs["Geometry"]})
    return group


def _frames_group(material, created):
    group = bpy.data.node_groups.new(FRAMES_NAME, "GeometryNodeTree")
    created(group)
    new_input(group, "NodeSocketGeometry", "Geometry")
    new_input(group, "NodeSocketCollection", "Collection", "A mesh for each frame, by name")
    new_input(group, "NodeSocketInt", "First", "The scene's frame that shows the first mesh")
    new_input(group, "NodeSocketInt", "Step", "Frames from one mesh to the next", default_value=1)
    new_input(
        group,
        "NodeSocketFloat",
        "Frame Rate",
        "Frames a second: what the velocity is multiplied by in renders, for motion blur",
        default_value=24.0,
    )
    _new_splat_inputs(group)
    new_input(
        group,
        "NodeSocketBool",
        "Vertices",
        "Shows the meshes as they are: bare vertices, for formats without points, or their faces",
    )
    new_output(group, "NodeSocketGeometry", "Geometry")

    build = Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    math = build.math

    # The first mesh before its time, the last one after.
    frame = build.node("GeometryNodeInputSceneTime").outputs["Frame"]
    meshes = build.node(
        "GeometryNodeCollectionInfo",
        {"Collection": inputs["Collection"], "Separate Children": True, "Reset Children": True},
    )
    instances = next(s for s in meshes.outputs if s.enabled)
    size = build.node(
        "GeometryNodeAttributeDomainSize", {"Geometry": instances}, component="INSTANCES"
    )
    last = math("SUBTRACT", size.outputs["Instance Count"], 1.0)
    wanted = math("DIVIDE", math("SUBTRACT", frame, inputs["First"]), inputs["Step"])
    wanted = math("MINIMUM", math("MAXIMUM", math("FLOOR", wanted), 0.0), last)
    index = build.node("GeometryNodeInputIndex").outputs["Index"]
    others = math("GREATER_THAN", math("ABSOLUTE", math("SUBTRACT", index, wanted)), 0.5)
    one = build.node(
        "GeometryNodeDeleteGeometry",
        {"Geometry": instances, "Selection": others},
        domain="INSTANCE",
    )
    realized = build.node("GeometryNodeRealizeInstances", {"Geometry": one.outputs["Geometry"]})
    # The renderer and files take it by second.
    rate = inputs["Frame Rate"]
    in_viewport = build.node("GeometryNodeIsViewport").outputs["Is Viewport"]
    factor = math("ADD", rate, math("MULTIPLY", in_viewport, math("SUBTRACT", 1.0, rate)))
    scaled = build.node("ShaderNodeVectorMath", operation="SCALE")
    group.links.new(build.attribute(VELOCITY, "FLOAT_VECTOR"), scaled.inputs[0])
    group.links.new(factor, scaled.inputs["Scale"])
    fields = {"Geometry": realized.outputs["Geometry"], "Name": VELOCITY}
    fields["Value"] = scaled.outputs["Vector"]
    stored = build.node(
        "GeometryNodeStoreNamedAttribute", fields, data_type="FLOAT_VECTOR", domain="POINT"
    )
    geometry = stored.outputs["Geometry"]
    radius = math("MULTIPLY", build.attribute(RADIUS, "FLOAT"), inputs["Radius Scale"])

    normal = build.attribute(NORMAL, "FLOAT_VECTOR")
    shown = _splats(build, inputs, geometry, normal, radius)
    either = switch(build, "GEOMETRY", inputs["Vertices"], shown, geometry)
    finished = build.node("GeometryNodeSetMaterial", {"Geometry": either, "Material": material})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs["Geometry"]})
    return group


def _splats(build, inputs, geometry, normal, radius):
    """What stands for the vertices of `geometry`: points, spheres, or discs in the surface."""
    points = build.node("GeometryNodeMeshToPoints", {"Mesh": geometry, "Radius": radius})
    ball = build.node("GeometryNodeMeshIcoSphere", {"Radius": 1.0, "Subdivisions": 1})
    smooth = build.node("GeometryNodeSetShadeSmooth")
    build.tree.links.new(ball.outputs["Mesh"], smooth.inputs[0])  # by another name since Blender 5
    spheres = _realized(build, geometry, smooth.outputs[0], {"Scale": radius})
    discs = _discs(build, geometry, normal, radius)
    either = switch(build, "GEOMETRY", inputs["Spheres"], points.outputs[0], spheres)
    return switch(build, "GEOMETRY", inputs["Discs"], either, discs)


def _discs(build, geometry, normal, radius):
    """Discs in the surface at the points of `geometry`."""
    disc = build.node("GeometryNodeMeshCircle", {"Vertices": 6, "Radius": 1.0}, fill_type="NGON")
    align = {"Vector": normal}
    if hasattr(bpy.types, "FunctionNodeAlignRotationToVector"):
        upright = build.node("FunctionNodeAlignRotationToVector", align, axis="Z")
    else:
        upright = build.node("FunctionNodeAlignEulerToVector", align, axis="Z")
    where = {"Rotation": upright.outputs["Rotation"], "Scale": radius}
    return _realized(build, geometry, disc.outputs["Mesh"], where)


def _realized(build, geometry, instance, where):
    """A mesh at each vertex of `geometry`, in one. Which colours are active, and so shown by
    Workbench, only `geometry` knows: both are joined, and nothing else of it stays."""
    at_points = {"Points": geometry, "Instance": instance, **where}
    instances = build.node("GeometryNodeInstanceOnPoints", at_points).outputs["Instances"]
    realized = build.node("GeometryNodeRealizeInstances", {"Geometry": instances})
    both = build.node("GeometryNodeJoinGeometry")
    # The last one that is linked comes first.
    for part in (realized.outputs["Geometry"], geometry):
        build.tree.links.new(part, both.inputs[0])
    size = build.node("GeometryNodeAttributeDomainSize", {"Geometry": geometry})
    index = build.node("GeometryNodeInputIndex").outputs["Index"]
    own = build.math("LESS_THAN", index, size.outputs["Point Count"])
    rest = {"Geometry": both.outputs["Geometry"], "Selection": own}
    return build.node("GeometryNodeDeleteGeometry", rest).outputs["Geometry"]


def switch(build, kind, condition, if_false, if_true):
    switch = build.node("GeometryNodeSwitch", input_type=kind)
    build.tree.links.new(condition, next(s for s in switch.inputs if s.enabled))
    build.tree.links.new(if_false, enabled(switch.inputs, "False"))
    build.tree.links.new(if_true, enabled(switch.inputs, "True"))
    return enabled(switch.outputs, "Output")


def _or_distortion(build, inputs, color, distortion):
    """`color`, or while the group's input says so that of the distortion."""
    share = build.math("DIVIDE", distortion, _RAMP_END)
    ramp = build.node("ShaderNodeValToRGB")
    build.tree.links.new(share, ramp.inputs[0])
    elements = ramp.color_ramp.elements
    elements.new(0.5)
    for element, (position, rgb) in zip(elements, _RAMP, strict=True):
        element.position = position
        element.color = (*rgb, 1.0)
    return switch(build, "RGBA", inputs[SHOW_DISTORTION], color, ramp.outputs["Color"])


def _material(created):
    """The one of this file, made when it isn't there."""
    material = bpy.data.materials.get(NAME)
    if material is not None:
        return material
    material = bpy.data.materials.new(NAME)
    created(material)
    if material.node_tree is None:  # before Blender 5.0
        material.use_nodes = True
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    surface.inputs["Roughness"].default_value = 0.6
    if bpy.app.version < _EEVEE_WITH_POINTS:  # whose Eevee takes no notice of alpha by default
        material.blend_method = material.shadow_method = "HASHED"
    build = Builder(tree)
    color = build.node("ShaderNodeAttribute", attribute_name=COLOR)
    tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    tree.links.new(color.outputs["Alpha"], surface.inputs["Alpha"])
    is_back = build.node("ShaderNodeNewGeometry").outputs["Backfacing"]
    solid = build.mixed_shaders(is_back, surface.outputs[0], _back(build, color.outputs))
    tree.links.new(solid, output.inputs["Surface"])
    surface.location, output.location = (1600, 400), (1900, 0)
    return material


def _back(build, color):
    """The shader of backs, which makes a surface of discs or of balls look solid.

    None must keep the light from the next one, which lies a hair lower, nor from one in the same
    place, as pairs of one point are at their end of a morph: light passes through backs. It meets
    fronts where it enters another part of the shape, so shadows stay. To the eye a disc has a back,
    and one that sticks out behind the horizon must not look like a black rim: the light on its
    front shines through.
    """
    lit, shining = (
        build.node(kind, {"Color": color["Color"]}).outputs[0]
        for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent")
    )
    is_eye = build.node("ShaderNodeLightPath").outputs["Is Camera Ray"]
    opacity = build.math("MULTIPLY", is_eye, color["Alpha"])
    nothing = build.node("ShaderNodeBsdfTransparent").outputs[0]
    return build.mixed_shaders(opacity, nothing, build.mixed_shaders(0.5, lit, shining))
