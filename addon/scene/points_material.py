"""The material that shows a morph object's points in their colors, made once a file."""

import bpy

from ..data import attribute_names, nodes, versions

NAME = "Pointmorph Points"

# An Attribute node would do as well, but where one feeds an alpha, Blender 5.2.3 ends when it
# exports the material as USD ("Used null prim").
_COLOR_NODE = "ShaderNodeVertexColor"


def material(created):
    """The one of this file, made when it isn't there."""
    material = bpy.data.materials.get(NAME)
    if material is not None:
        _mend(material)
        return material
    material = bpy.data.materials.new(NAME)
    created(material)
    tree = versions.node_tree(material)
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    surface.inputs["Roughness"].default_value = 0.6
    build = nodes.Builder(tree)
    color = build.node(_COLOR_NODE, layer_name=attribute_names.COLOR)
    tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    tree.links.new(color.outputs["Alpha"], surface.inputs["Alpha"])
    is_back = build.node("ShaderNodeNewGeometry").outputs["Backfacing"]
    solid = build.mixed_shaders(is_back, surface.outputs[0], _back(build, color.outputs))
    tree.links.new(solid, output.inputs["Surface"])
    nodes.arrange(tree)
    surface.location, output.location = (1600, 400), (1900, 0)
    return material


def _mend(material):
    """Gives a material of an earlier version the node that Blender 5.2 can export."""
    tree = material.node_tree
    for link in list(tree.links):
        if link.to_socket.name == "Alpha" and link.from_node.type == "ATTRIBUTE":
            color = nodes.Builder(tree).node(_COLOR_NODE, layer_name=link.from_node.attribute_name)
            color.location = link.from_node.location
            tree.links.new(color.outputs["Alpha"], link.to_socket)


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
