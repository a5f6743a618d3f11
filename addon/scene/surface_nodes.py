"""The part of the geometry nodes that puts a surface through points, anew in every frame.

A volume of balls at the points, its border as faces, its inner side removed, and what is left moved
onto the planes of the nearest points, and smoothed.
"""

from ..data import attribute_names, nodes, versions

SURFACE = "Surface"
DETAIL = "Detail"
_REACH = 1.4  # of a ball, in radii of the points; less leaves holes, more bridges gaps
_SMOOTHING = 3  # rounds


def new_inputs(group):
    """Whether there is a surface, and how fine."""
    nodes.new_input(
        group,
        "NodeSocketBool",
        SURFACE,
        "Show a surface through the points instead of points. It has different faces in every "
        "frame",
    )
    nodes.new_input(
        group,
        "NodeSocketFloat",
        DETAIL,
        "Faces of the surface per point along a line. Higher values are slower",
        default_value=1.5,
        min_value=0.5,
        max_value=4.0,
    )


def surface(build, inputs, geometry, normal, radius):
    """The surface through the vertices of `geometry`, with their colors and velocities."""
    mean = build.node("GeometryNodeAttributeStatistic", {"Geometry": geometry, "Attribute": radius})
    mean = mean.outputs["Mean"]
    ball = build.math("MULTIPLY", mean, _REACH)
    voxel = build.math("DIVIDE", mean, inputs[DETAIL])
    points = build.node("GeometryNodeMeshToPoints", {"Mesh": geometry, "Radius": ball})
    volume = build.node("GeometryNodePointsToVolume")
    versions.set_voxel_size(volume)
    for name, value in (("Voxel Size", voxel), ("Radius", ball)):
        build.tree.links.new(value, nodes.enabled(volume.inputs, name))
    build.tree.links.new(points.outputs[0], volume.inputs["Points"])
    faces = build.node("GeometryNodeVolumeToMesh", {"Volume": volume.outputs[0], "Threshold": 0.1})
    border = faces.outputs["Mesh"]

    place = build.node("GeometryNodeInputPosition").outputs["Position"]
    nearest = build.node("GeometryNodeSampleNearest", {"Geometry": geometry}, domain="POINT")
    nearest = nearest.outputs["Index"]

    def at_nearest(value, kind):
        return build.sampled(geometry, kind, value, nearest)

    up = at_nearest(normal, "FLOAT_VECTOR")
    away = build.math(
        "SUBTRACT", place, at_nearest(place, "FLOAT_VECTOR"), kind="ShaderNodeVectorMath"
    )
    height = build.number_of("DOT_PRODUCT", away, up)
    color = build.attribute(attribute_names.COLOR, "FLOAT_COLOR")
    velocity = build.attribute(attribute_names.VELOCITY, "FLOAT_VECTOR")
    for name, kind, value in (
        (_HEIGHT, "FLOAT", height),
        (_OFFSET, "FLOAT_VECTOR", build.scaled(up, height)),
        (attribute_names.COLOR, "FLOAT_COLOR", at_nearest(color, "FLOAT_COLOR")),
        (attribute_names.VELOCITY, "FLOAT_VECTOR", at_nearest(velocity, "FLOAT_VECTOR")),
    ):
        border = build.stored(border, name, kind, value)
    inner = build.math("LESS_THAN", build.attribute(_HEIGHT, "FLOAT"), 0.0)
    outside = build.node("GeometryNodeDeleteGeometry", {"Geometry": border, "Selection": inner})
    offset = build.attribute(_OFFSET, "FLOAT_VECTOR")
    moved = build.moved(outside.outputs[0], Offset=build.scaled(offset, -1.0))
    moved = build.moved(moved, Position=_blurred(build, place, "FLOAT_VECTOR"))
    softened = _blurred(build, build.attribute(attribute_names.COLOR, "FLOAT_COLOR"), "FLOAT_COLOR")
    moved = build.stored(moved, attribute_names.COLOR, "FLOAT_COLOR", softened)
    for name in (_HEIGHT, _OFFSET):
        moved = build.without(moved, name)
    smooth = build.node("GeometryNodeSetShadeSmooth")
    build.tree.links.new(moved, smooth.inputs[0])  # by another name since Blender 5
    return smooth.outputs[0]


_HEIGHT, _OFFSET = "pointmorph_height", "pointmorph_offset"


def _blurred(build, value, kind):
    node = build.node(
        "GeometryNodeBlurAttribute", {"Value": value, "Iterations": _SMOOTHING}, data_type=kind
    )
    return nodes.enabled(node.outputs, "Value")
