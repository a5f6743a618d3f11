"""How baked frames look in the scene: geometry nodes that show the mesh of the present frame."""

from dataclasses import replace

import bpy

from ..core import frame_cache
from ..data import arrays, attribute_names, nodes, versions
from . import point_shapes, points_display, points_material, surface_nodes

FRAMES_NAME = "Pointmorph Frames"
CACHED_NAME = "Pointmorph Cached Frames"
ROWS_NAME = "Pointmorph Cache Rows"
ROWS, VERTICES = "Rows", "Vertices"  # inputs of these
_DISCS = point_shapes.Discs({attribute_names.VELOCITY: ("FLOAT_VECTOR", "POINT")})


def add_frames_modifier(obj, collection, plan, created):
    """Shows the mesh of `collection` that belongs to the scene's frame, as points or discs."""
    group = nodes.shared_group(FRAMES_NAME, lambda name: _frames_group(name, created))
    modifier = obj.modifiers.new(points_display.MODIFIER, "NODES")
    modifier.node_group = group
    values = {"Collection": collection, "First": plan.first, "Step": plan.step}
    values["Vertices"] = plan.faces
    values["Frame Rate"] = frame_rate()
    for name, value in values.items():
        versions.set_input(modifier, name, value)


def frame_rate():
    """Of the scene, by second."""
    render = bpy.context.scene.render
    return render.fps / render.fps_base


def frames_collection(obj):
    """That which `add_frames_modifier` was called with."""
    return versions.input_value(points_display.points_modifier(obj), "Collection")


def frames_as_vertices(obj):
    """A mesh object that shows what `obj` does, as vertices: for files that know no points."""
    mesh = new_own_mesh(obj.name)
    twin = bpy.data.objects.new(obj.name, mesh)
    twin.matrix_world = obj.matrix_world
    modifier = twin.modifiers.new(points_display.MODIFIER, "NODES")
    modifier.node_group = points_display.points_modifier(obj).node_group
    share_frames(twin, obj)
    versions.set_input(modifier, "Vertices", True)
    return twin


def share_frames(obj, other):
    """Makes an object show the frames that another one does, at the same time."""
    modifier, own = (points_display.points_modifier(one) for one in (obj, other))
    for name in ("Collection", "First", "Step", "Frame Rate"):
        versions.set_input(modifier, name, versions.input_value(own, name))
    obj.update_tag()


def _frames_group(name, created):
    material = points_material.material(created)
    group = nodes.new_group(name, created)
    _new_sockets(group)
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    geometry = _per_second(build, inputs["Frame Rate"], _present_mesh(build, inputs))
    radius = build.attribute(attribute_names.RADIUS, "FLOAT")
    radius = build.math("MULTIPLY", radius, inputs["Radius Scale"])
    shown = point_shapes.splats(build, inputs, geometry, radius, _DISCS, created)
    # Blender 5.2 names what nodes show after the mesh that comes first, and puts each name under a
    # path of its own in files: Alembic would get an object for each frame, and USD would end
    # Blender.
    own_mesh = nodes.in_mesh_of(build, inputs["Geometry"], geometry)
    either = nodes.switch(build, "GEOMETRY", inputs["Vertices"], shown, own_mesh)
    finished = build.node("GeometryNodeSetMaterial", {"Geometry": either, "Material": material})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs["Geometry"]})
    return group


def cached_group(created):
    """The group of nodes that shows what `core.frame_cache` wrote, once the Mesh Cache modifier has
    read it: vertices stand for numbers. No vertices, no points, as without the file."""

    def make(name):
        return _cached_group(name, points_material.material(created), created)

    return nodes.shared_group(CACHED_NAME, make)


def rows_group(created):
    """The group of nodes that makes the vertices that the Mesh Cache modifier moves, and keeps the
    object's own mesh, which knows the active colors, as an instance beside them."""

    def make(name):
        group = nodes.new_group(name, created)
        nodes.new_input(group, "NodeSocketGeometry", "Geometry")
        nodes.new_input(group, "NodeSocketInt", VERTICES, "As many as the file has", min_value=0)
        nodes.new_output(group, "NodeSocketGeometry", "Geometry")
        build = nodes.Builder(group)
        inputs = build.node("NodeGroupInput").outputs
        # Without edges, which take as long as all the rest.
        points = build.node("GeometryNodePoints", {"Count": inputs[VERTICES]})
        rows = build.node("GeometryNodePointsToVertices", {"Points": points.outputs[0]})
        own = build.node("GeometryNodeGeometryToInstance")
        build.tree.links.new(inputs["Geometry"], own.inputs[0])
        both = build.node("GeometryNodeJoinGeometry")
        for part in (own.outputs[0], rows.outputs[0]):
            build.tree.links.new(part, both.inputs[0])
        build.node("NodeGroupOutput", {"Geometry": both.outputs["Geometry"]})
        return group

    return nodes.shared_group(ROWS_NAME, make)


def _cached_group(name, material, created):
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_input(group, "NodeSocketInt", ROWS, "Most points of a frame", min_value=0)
    _new_rate_input(group)
    point_shapes.new_splat_inputs(group)
    surface_nodes.new_inputs(group)
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    parts = build.node("GeometryNodeSeparateComponents", {"Geometry": inputs["Geometry"]}).outputs
    own = build.node("GeometryNodeRealizeInstances", {"Geometry": parts["Instances"]}).outputs[0]
    vertices = _cached_points(build, parts["Mesh"], inputs[ROWS])
    geometry = _per_second(build, inputs["Frame Rate"], vertices)
    radius = build.attribute(attribute_names.RADIUS, "FLOAT")
    radius = build.math("MULTIPLY", radius, inputs["Radius Scale"])
    normal = build.attribute(attribute_names.NORMAL, "FLOAT_VECTOR")
    # Spheres ask it which colors are active; discs know that by themselves.
    in_own = nodes.in_mesh_of(build, own, geometry)
    either = nodes.switch(build, "GEOMETRY", inputs[point_shapes.SPHERES], geometry, in_own)
    splats = point_shapes.splats(
        build, inputs, either, radius, replace(_DISCS, spare=True), created
    )
    faces = surface_nodes.surface(build, inputs, geometry, normal, radius)
    faces = nodes.in_mesh_of(build, own, faces)
    shown = nodes.switch(build, "GEOMETRY", inputs[surface_nodes.SURFACE], splats, faces)
    finished = build.node("GeometryNodeSetMaterial", {"Geometry": shown, "Material": material})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs["Geometry"]})
    return group


def _cached_points(build, cached, rows):
    """The points of the present frame as vertices, with their attributes: see `frame_cache`."""
    math = build.math
    place = build.node("GeometryNodeInputPosition").outputs["Position"]

    def vector_at(index):
        return build.sampled(cached, "FLOAT_VECTOR", place, index)

    def parts_of(vector):
        return build.node("ShaderNodeSeparateXYZ", {"Vector": vector}).outputs

    index = build.node("GeometryNodeInputIndex").outputs["Index"]
    first = math("ADD", index, 1.0)  # numbers are whole up to 2²⁴: see `frame_cache.MOST`

    def vector(number):
        start = math("MULTIPLY", rows, float(number))
        return vector_at(math("ADD", start, first))

    count = parts_of(vector_at(0))["X"]
    points = build.node(
        "GeometryNodePoints", {"Count": count, "Position": vector(frame_cache.POSITION)}
    )
    geometry = build.node("GeometryNodePointsToVertices", {"Points": points.outputs[0]}).outputs[0]
    rest = parts_of(vector(frame_cache.REST))
    red, green, blue = (parts_of(vector(frame_cache.COLOR))[axis] for axis in "XYZ")
    color = build.node(
        "FunctionNodeCombineColor", {"Red": red, "Green": green, "Blue": blue, "Alpha": rest["X"]}
    ).outputs["Color"]
    for name, kind, value in (
        (attribute_names.NORMAL, "FLOAT_VECTOR", vector(frame_cache.NORMAL)),
        (attribute_names.VELOCITY, "FLOAT_VECTOR", vector(frame_cache.VELOCITY)),
        (attribute_names.COLOR, "FLOAT_COLOR", color),
        (attribute_names.RADIUS, "FLOAT", rest["Y"]),
        ("id", "INT", rest["Z"]),
    ):
        geometry = build.stored(geometry, name, kind, value)
    return geometry


def _new_rate_input(group):
    nodes.new_input(
        group,
        "NodeSocketFloat",
        "Frame Rate",
        "Frames per second, by which the velocity is multiplied in renders for motion blur",
        default_value=24.0,
    )


def _new_sockets(group):
    def new_input(kind, name, description="", **values):
        nodes.new_input(group, f"NodeSocket{kind}", name, description, **values)

    new_input("Geometry", "Geometry")
    new_input("Collection", "Collection", "A mesh for each frame, in the order of their names")
    new_input("Int", "First", "Scene frame that shows the first mesh")
    new_input("Int", "Step", "Number of frames from one mesh to the next", default_value=1)
    _new_rate_input(group)
    point_shapes.new_splat_inputs(group)
    new_input(
        "Bool",
        "Vertices",
        "Show the meshes as they are: bare vertices, for formats without points, or their faces",
    )
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")


def _present_mesh(build, inputs):
    """The mesh that belongs to the scene's frame: the first before its time, the last after."""
    math = build.math
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
    return realized.outputs["Geometry"]


def _per_second(build, rate, geometry):
    """`geometry` with its velocity per second, not per frame, in renders and files."""
    math = build.math
    in_viewport = build.node("GeometryNodeIsViewport").outputs["Is Viewport"]
    factor = math("ADD", rate, math("MULTIPLY", in_viewport, math("SUBTRACT", 1.0, rate)))
    scaled = build.node("ShaderNodeVectorMath", operation="SCALE")
    velocity = build.attribute(attribute_names.VELOCITY, "FLOAT_VECTOR")
    build.tree.links.new(velocity, scaled.inputs[0])
    build.tree.links.new(factor, scaled.inputs["Scale"])
    fields = {"Geometry": geometry, "Name": attribute_names.VELOCITY}
    fields["Value"] = scaled.outputs["Vector"]
    stored = build.node(
        "GeometryNodeStoreNamedAttribute", fields, data_type="FLOAT_VECTOR", domain="POINT"
    )
    return stored.outputs["Geometry"]


def new_own_mesh(name):
    """A mesh for an object that shows frames as meshes: what `nodes.in_mesh_of` puts them into."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(1)
    arrays.activate_colors(mesh, attribute_names.COLOR)
    return mesh
