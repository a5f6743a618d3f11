"""Hair curves on a target's surface, on a mesh that morphs into it or on the source.

On a mesh that morphs, Blender's own nodes turn the strands with the surface, and nodes of the
add-on's before these let them grow to the size that they have on the target.
"""

from dataclasses import dataclass

import bpy
import numpy as np

from ..core import transforms
from ..data import arrays, creation, nodes, versions
from ..data.references import find, reference_to
from . import morph_object

MODIFIER = "Surface Deform"
GROWTH_MODIFIER = "Size"
_GROWTH_NAME = "Pointmorph Hair Size"
_GROWTH = "hair_growth"
_SURFACE_UVS = "surface_uv_coordinate"
_ORIGIN = "pointmorph_hair_of"
_DEFORM = "GeometryNodeDeformCurvesOnSurface"


@dataclass(frozen=True)
class Hair:
    """Curves that an object has: (P, 3) points in the morph's frame, and where each begins.

    `scale` is that frame's unit in the curves' own.
    """

    name: str
    reference: int
    points: np.ndarray
    offsets: np.ndarray
    scale: float


@dataclass(frozen=True)
class CarriedHair:
    """The same on another mesh, in its own space.

    Attributes
    ----------
    name : str
    reference : int
        Of the object that it is from.
    points : (P, 3) array
    scales : (P,) array
        How much larger they are.
    growth : (S,) array
        How much larger each strand is once the mesh has become the target.
    loops : (S, 3) array of int, or None
        Corners of the mesh's faces around each root.
    shares : (S, 3) array
        The corners' shares in that place.
    """

    name: str
    reference: int
    points: np.ndarray
    scales: np.ndarray
    growth: np.ndarray
    loops: np.ndarray | None
    shares: np.ndarray


def on_surface(target):
    """Objects of this file with hair curves on the surface of an object."""
    return [
        obj
        for obj in bpy.data.objects
        if obj.type == "CURVES" and obj.library is None and obj.data.surface == target
    ]


def read(target, matrix):
    """All hair of a target.

    Parameters
    ----------
    matrix : (4, 4) array
        From the target's own space to the morph's frame.
    """
    found = []
    for obj in on_surface(target):
        points, offsets = arrays.curve_points(obj.data)
        if len(points):
            to_target = target.matrix_world.inverted() @ obj.matrix_world
            whole = matrix @ np.array(to_target, np.float64)
            scale = abs(np.linalg.det(whole[:3, :3])) ** (1 / 3)
            points = transforms.apply(whole, points)
            found.append(Hair(obj.name, reference_to(obj), points, offsets, scale))
    return found


def carried(hair, carrier, receiver):
    """Hair along the map: a CarriedHair.

    Parameters
    ----------
    hair : Hair
    carrier : pointmorph.Carrier
    receiver : map_ends.Receiver
    """
    counts = np.diff(hair.offsets)
    strands = carrier.strands(hair.points, np.repeat(hair.offsets[:-1], counts))
    # One that has no points has no root.
    empty = counts == 0
    shares = np.zeros((len(counts), strands.shares.shape[1]))
    shares[~empty] = strands.shares
    growth = np.ones(len(counts))
    growth[~empty] = 1.0 / strands.scales
    loops = None
    if strands.triangles is not None:
        loops = np.zeros((len(counts), 3), np.int64)
        loops[~empty] = receiver.loops[strands.triangles]
    own = abs(np.linalg.det(receiver.own[:3, :3])) ** (1 / 3)
    scales = np.repeat(strands.scales, counts[~empty]) * hair.scale * own
    points = transforms.apply(receiver.own, strands.points)
    return CarriedHair(hair.name, hair.reference, points, scales, growth, loops, shares)


def made_on(obj):
    """The hair objects that an object has from a target."""
    return [one for one in on_surface(obj) if _ORIGIN in one]


def is_as_read(hair):
    """Whether what a CarriedHair is from is still there, with as many strands and points."""
    origin = find(bpy.data.objects, hair.reference)
    if origin is None or origin.type != "CURVES":
        return False
    counts = len(origin.data.points), len(origin.data.curves)
    return counts == (len(hair.points), len(hair.shares))


def write(context, ends, prefix, hair, moves):
    """Gives an object a copy of hair, in place of such that was carried onto it before.

    Parameters
    ----------
    ends : (Object, Object)
        That object, and the one that the hair is from.
    prefix : str
        What a new object's name has before that of the hair.
    hair : CarriedHair
    moves : bool
        Whether the hair must move along with the surface as that morphs.

    Returns
    -------
    Object
        Its hair is attached to a place of the surface's UV map, if there is one.
    """
    obj, target = ends
    origin = find(bpy.data.objects, hair.reference)
    curves = origin.data.copy()
    arrays.move_curve_points(curves, hair.points)
    arrays.scale_radii(curves, hair.scales)
    layer = obj.data.uv_layers.active
    curves.surface = obj
    curves.surface_uv_map = "" if layer is None else layer.name
    if layer is not None and hair.loops is not None:
        uvs = arrays.corner_uvs(layer)[hair.loops]
        places = np.einsum("sk,skc->sc", hair.shares, uvs).astype(np.float32)
        arrays.write_attribute(curves, _SURFACE_UVS, places, "CURVE")
    # Those of an earlier version know a name.
    made = next((one for one in made_on(obj) if one[_ORIGIN] in (origin, origin.name)), None)
    if made is None:
        made = _copied(origin, curves, obj)
        made.name = prefix + hair.name
        creation.link(context, made)
        made.hide_set(False)
    else:
        old, made.data = made.data, curves
        if not old.users:
            bpy.data.hair_curves.remove(old)
    made[_ORIGIN] = origin
    curves.name = made.name
    layers = {item.name for item in target.data.uv_layers} if target is not None else set()
    _turn_to(made, target, obj, (layers, curves.surface_uv_map))
    if moves:
        arrays.write_attribute(curves, _GROWTH, hair.growth.astype(np.float32), "CURVE")
        with creation.all_or_nothing() as created:
            _add_modifiers(made, obj, layer is not None, created)
    return made


def _add_modifiers(made, obj, is_attached, created):
    """Makes hair grow and, if it's attached, turn with the mesh that it is on."""
    if is_attached:
        obj.add_rest_position_attribute = True
        if not _deforms(made):
            modifier = made.modifiers.new(MODIFIER, "NODES")
            modifier.node_group = nodes.shared_group(
                MODIFIER, lambda name: _deform_group(name, created)
            )
            nodes.put_first(made, modifier)
    group = nodes.shared_group(_GROWTH_NAME, lambda name: _growth_group(name, created))
    known = made.modifiers.get(GROWTH_MODIFIER)
    if known is not None and known.type == "NODES" and known.node_group is not None:
        nodes.swap_group(made, known, group)
        return
    modifier = made.modifiers.new(GROWTH_MODIFIER, "NODES")
    modifier.node_group = group
    nodes.put_first(made, modifier)
    shapes = len(obj.pointmorph.via) + 2
    nodes.drive_input(made, modifier, "t", morph_object.t_key(obj), shapes - 1)


def _copied(origin, curves, obj):
    """A copy of a hair object with other curves, which lies where `obj` does."""
    made = origin.copy()
    made.data = curves
    made.animation_data_clear()
    made.constraints.clear()
    made.parent = obj
    made.parent_type = "OBJECT"
    made.matrix_parent_inverse.identity()
    made.delta_location = made.delta_rotation_euler = (0.0, 0.0, 0.0)
    made.delta_rotation_quaternion = (1.0, 0.0, 0.0, 0.0)
    made.delta_scale = (1.0, 1.0, 1.0)
    made.matrix_basis.identity()
    made.hide_render = False
    return made


def _turn_to(made, target, obj, uv_maps):
    """Inputs of modifiers that are about the target's surface are about another object's: `uv_maps`
    are the names of the target's and that of the object's."""
    before, after = uv_maps
    for modifier in made.modifiers:
        if modifier.type != "NODES" or modifier.node_group is None:
            continue
        for name, item in versions.plain_inputs(modifier.node_group).items():
            value = versions.input_value(modifier, name)
            if item.socket_type == "NodeSocketObject" and target is not None and value == target:
                versions.set_input(modifier, name, obj)
            elif item.socket_type == "NodeSocketString" and after and value in before:
                versions.set_input(modifier, name, after)
            elif after and versions.input_attribute(modifier, name) in before:
                versions.set_input_attribute(modifier, name, after)
    made.update_tag()


def _deforms(obj):
    """Whether a modifier lets hair follow the surface."""
    groups = [m.node_group for m in obj.modifiers if m.type == "NODES" and m.node_group]
    known = set()
    while groups:
        group = groups.pop()
        if group.name not in known:
            known.add(group.name)
            if any(node.bl_idname == _DEFORM for node in group.nodes):
                return True
            inner = (getattr(node, "node_tree", None) for node in group.nodes)
            groups += [tree for tree in inner if tree is not None]
    return False


def _deform_group(name, created):
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    deformed = build.node(_DEFORM, {"Curves": inputs["Geometry"]})
    build.node("NodeGroupOutput", {"Geometry": deformed.outputs["Curves"]})
    return group


def _growth_group(name, created):
    """Scales each strand about its root, by its growth at t = 1."""
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_t_input(group, 2)
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    strand = build.node("GeometryNodeCurveOfPoint").outputs["Curve Index"]
    first = build.node("GeometryNodePointsOfCurve", {"Curve Index": strand}).outputs["Point Index"]
    place = build.node("GeometryNodeInputPosition").outputs["Position"]
    root = build.node(
        "GeometryNodeFieldAtIndex", {"Value": place, "Index": first}, data_type="FLOAT_VECTOR"
    )
    root = nodes.enabled(root.outputs, "Value")
    more = build.math("SUBTRACT", build.attribute(_GROWTH, "FLOAT"), 1.0)
    more = build.math("MULTIPLY", more, inputs["t"])
    arm = build.math("SUBTRACT", place, root, kind="ShaderNodeVectorMath")
    grown = build.moved(inputs["Geometry"], Offset=build.scaled(arm, more))
    radius = build.attribute("radius", "FLOAT")
    thicker = build.math("MULTIPLY_ADD", radius, more, radius)
    fields = {"Selection": build.has_attribute("radius", "FLOAT"), "Radius": thicker}
    finished = build.node("GeometryNodeSetCurveRadius", {"Curve": grown, **fields})
    build.node("NodeGroupOutput", {"Geometry": finished.outputs[0]})
    return group
