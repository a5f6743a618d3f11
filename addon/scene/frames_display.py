"""How baked frames look in the scene: geometry nodes that show the mesh of the present frame."""

import bpy

from ..data import arrays, attribute_names, nodes, versions
from . import point_shapes, points_display, points_material

FRAMES_NAME = "Pointmorph Frames"


def add_frames_modifier(obj, collection, plan, created):
    """Shows the mesh of `collection` that belongs to the scene's frame, as points or discs."""
    group = nodes.shared_group(FRAMES_NAME, lambda name: _frames_group(name, created))
    modifier = obj.modifiers.new(points_display.MODIFIER, "NODES")
    modifier.node_group = group
    values = {"Collection": collection, "First": plan.first, "Step": plan.step}
    values["Vertices"] = plan.faces
    render = bpy.context.scene.render
    values["Frame Rate"] = render.fps / render.fps_base
    for name, value in values.items():
        versions.set_input(modifier, name, value)


def frames_collection(obj):
    """That which `add_frames_modifier` was called with."""
    return versions.input_value(points_display.points_modifier(obj), "Collection")


def frames_as_vertices(obj):
    """A mesh object that shows what `obj` does, as vertices: for files that know no points."""
    mesh = new_own_mesh(obj.name)
    twin = bpy.data.objects.new(obj.name, mesh)
    twin.matrix_world = obj.matrix_world
    modifier = twin.modifiers.new(points_display.MODIFIER, "NODES")
    own = points_display.points_modifier(obj)
    modifier.node_group = own.node_group
    for name in ("Collection", "First", "Step", "Frame Rate"):
        versions.set_input(modifier, name, versions.input_value(own, name))
    versions.set_input(modifier, "Vertices", True)
    return twin


def _frames_group(name, created):
    material = points_material.material(created)
    group = nodes.new_group(name, created)
    _new_sockets(group)
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    geometry = _per_second(build, inputs["Frame Rate"], _present_mesh(build, inputs))
    radius = build.attribute(attribute_names.RADIUS, "FLOAT")
    radius = build.math("MULTIPLY", radius, inputs["Radius Scale"])
    kept = {attribute_names.VELOCITY: ("FLOAT_VECTOR", "POINT")}
    shown = point_shapes.splats(build, inputs, geometry, radius, kept, created)
    # Blender 5.2 names what nodes show after the mesh that comes first, and puts each name under a
    # path of its own in files: Alembic would get an object for each frame, and USD would end
    # Blender.
    own_mesh = nodes.in_mesh_of(build, inputs["Geometry"], geometry)
    either = nodes.switch(build, "GEOMETRY", inputs["Vertices"], shown, own_mesh)
    finished = build.node("GeometryNodeSetMaterial", {"Geometry": either, "Material": material})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs["Geometry"]})
    return group


def _new_sockets(group):
    def new_input(kind, name, description="", **values):
        nodes.new_input(group, f"NodeSocket{kind}", name, description, **values)

    new_input("Geometry", "Geometry")
    new_input("Collection", "Collection", "A mesh for each frame, in the order of their names")
    new_input("Int", "First", "Scene frame that shows the first mesh")
    new_input("Int", "Step", "Number of frames from one mesh to the next", default_value=1)
    new_input(
        "Float",
        "Frame Rate",
        "Frames per second, by which the velocity is multiplied in renders for motion blur",
        default_value=24.0,
    )
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
