"""The part of the geometry nodes that turns vertices into points, spheres or discs."""

from dataclasses import dataclass

from ..data import attribute_names, nodes
from . import disc_faces

DISCS = "Discs"
SPHERES = "Spheres"
FACES = "Faces of Discs"
_TILTED = (0.36, 0.48, 0.8)  # no axis, since many normals are
_UP = (0.0, 0.0, 1e-12)  # too little to change a normal that there is
_READ_AS = {"FLOAT2": "FLOAT_VECTOR"}
"""What nodes read attributes as that they write as such, but can't read so."""


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
        "NodeSocketObject",
        FACES,
        "Object made ahead, with a disc for each point. Without it, the faces of the discs are "
        "made in every frame, which is slower",
        hide_in_modifier=True,
    )
    nodes.new_input(
        group,
        "NodeSocketBool",
        SPHERES,
        "Show spheres made of faces instead of points. Slower, but Workbench and Solid "
        "shading show their colors if Color is set to Attribute",
    )


@dataclass(frozen=True)
class Discs:
    """What discs are like.

    Attributes
    ----------
    kept : dict of str to (str, str)
        Point attributes, besides their colors, that they have: type and domain there, by name.
    spare : bool
        Whether more may have been made ahead than there are points: those lie in the last point,
        and have no extent.
    """

    kept: dict
    spare: bool = False


def splats(build, inputs, geometry, radius, discs, created):
    """What stands for the vertices of `geometry`: points, spheres, or discs in the surface, which
    are as the `Discs` say."""
    points = build.node("GeometryNodeMeshToPoints", {"Mesh": geometry, "Radius": radius})
    ball = build.node("GeometryNodeMeshIcoSphere", {"Radius": 1.0, "Subdivisions": 1})
    smooth = build.node("GeometryNodeSetShadeSmooth")
    build.tree.links.new(ball.outputs["Mesh"], smooth.inputs[0])  # by another name since Blender 5
    spheres = _realized(build, geometry, smooth.outputs[0], {"Scale": radius})
    either = nodes.switch(build, "GEOMETRY", inputs[SPHERES], points.outputs[0], spheres)
    shown = _discs(build, inputs, geometry, radius, discs, created)
    return nodes.switch(build, "GEOMETRY", inputs[DISCS], either, shown)


def _discs(build, inputs, geometry, radius, discs, created):
    """Discs in the surface at the points of `geometry`. What can be is computed by point, since
    discs have six times as many vertices."""

    def vector(operation, *values):
        return build.math(operation, *values, kind="ShaderNodeVectorMath")

    def at(name, index, kind="FLOAT_VECTOR"):
        return build.sampled(geometry, kind, build.attribute(name, kind), index)

    normal = build.attribute(attribute_names.NORMAL, "FLOAT_VECTOR")
    normal = vector("NORMALIZE", vector("ADD", normal, _UP))  # upward, where there is none
    across = build.scaled(vector("NORMALIZE", vector("CROSS_PRODUCT", _TILTED, normal)), radius)
    geometry = build.stored(geometry, disc_faces.ACROSS, "FLOAT_VECTOR", across)
    across = build.attribute(disc_faces.ACROSS, "FLOAT_VECTOR")
    along = vector("CROSS_PRODUCT", normal, across)
    position = build.node("GeometryNodeInputPosition").outputs["Position"]

    shown = _faces(build, inputs, geometry, created, discs.spare)
    row = build.attribute(disc_faces.ROW, "INT")
    place = build.sampled(geometry, "FLOAT_VECTOR", position, row, clamp=discs.spare)
    for axis, name in ((across, disc_faces.ACROSS), (along, disc_faces.ALONG)):
        share = build.attribute(name, "FLOAT_VECTOR")
        place = vector(
            "MULTIPLY_ADD", build.sampled(geometry, "FLOAT_VECTOR", axis, row), share, place
        )
    shown = build.moved(shown, Position=place)
    index = build.node("GeometryNodeInputIndex").outputs["Index"]
    for name, (kind, domain) in {
        attribute_names.COLOR: ("FLOAT_COLOR", "POINT"),
        **discs.kept,
    }.items():
        value = at(name, row if domain == "POINT" else index, _READ_AS.get(kind, kind))
        shown = build.stored(shown, name, kind, value, domain)
    for name in (disc_faces.ROW, disc_faces.ACROSS, disc_faces.ALONG):
        shown = build.without(shown, name)
    return shown


def _faces(build, inputs, geometry, created, spare):
    """As many discs as there are points: those that were made ahead, if they are as many, or with
    `spare` enough."""
    count = build.count(geometry, "Point")
    known = build.node(
        "GeometryNodeObjectInfo", {"Object": inputs[FACES]}, transform_space="ORIGINAL"
    ).outputs["Geometry"]
    there = build.count(known, "Face")
    if spare:
        enough = build.math("LESS_THAN", count, build.math("ADD", there, 0.5))
        fit = build.math("MULTIPLY", enough, build.math("GREATER_THAN", count, 0.5))
    else:
        fit = build.math("COMPARE", there, count, 0.5)
    made = build.group(disc_faces.shared_group(created), {disc_faces.COUNT: count})
    return nodes.switch(build, "GEOMETRY", fit, made, known)


def _realized(build, geometry, instance, where):
    """A mesh at each vertex of `geometry`, in one. Which colors are active, and so shown by
    Workbench, only `geometry` knows: both are joined, and nothing else of it stays."""
    at_points = {"Points": geometry, "Instance": instance, **where}
    instances = build.node("GeometryNodeInstanceOnPoints", at_points).outputs["Instances"]
    realized = build.node("GeometryNodeRealizeInstances", {"Geometry": instances})
    return nodes.in_mesh_of(build, geometry, realized.outputs["Geometry"])
