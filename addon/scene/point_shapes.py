"""The part of the geometry nodes that turns vertices into points, spheres or discs."""

from ..data import nodes

DISCS = "Discs"
SPHERES = "Spheres"


def new_splat_inputs(group):
    """How points are drawn."""
    nodes.new_input(
        group,
        "NodeSocketFloat",
        "Radius Scale",
        "Make all points larger or smaller",
        default_value=1.0,
        min_value=0.0,
    )
    nodes.new_input(
        group,
        "NodeSocketBool",
        DISCS,
        "Show discs in the surface instead of points. Slower, but Workbench shows their colors",
    )
    nodes.new_input(
        group,
        "NodeSocketBool",
        SPHERES,
        "Show spheres made of faces instead of points. Slower, but Workbench and Solid "
        "shading show their colors if Color is set to Attribute",
    )


def splats(build, inputs, geometry, normal, radius):
    """What stands for the vertices of `geometry`: points, spheres, or discs in the surface."""
    points = build.node("GeometryNodeMeshToPoints", {"Mesh": geometry, "Radius": radius})
    ball = build.node("GeometryNodeMeshIcoSphere", {"Radius": 1.0, "Subdivisions": 1})
    smooth = build.node("GeometryNodeSetShadeSmooth")
    build.tree.links.new(ball.outputs["Mesh"], smooth.inputs[0])  # by another name since Blender 5
    spheres = _realized(build, geometry, smooth.outputs[0], {"Scale": radius})
    discs = _discs(build, geometry, normal, radius)
    either = nodes.switch(build, "GEOMETRY", inputs[SPHERES], points.outputs[0], spheres)
    return nodes.switch(build, "GEOMETRY", inputs[DISCS], either, discs)


def _discs(build, geometry, normal, radius):
    """Discs in the surface at the points of `geometry`."""
    disc = build.node("GeometryNodeMeshCircle", {"Vertices": 6, "Radius": 1.0}, fill_type="NGON")
    align = {"Vector": normal}
    upright = build.node("FunctionNodeAlignRotationToVector", align, axis="Z")
    where = {"Rotation": upright.outputs["Rotation"], "Scale": radius}
    return _realized(build, geometry, disc.outputs["Mesh"], where)


def _realized(build, geometry, instance, where):
    """A mesh at each vertex of `geometry`, in one. Which colors are active, and so shown by
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
