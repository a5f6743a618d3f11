"""A second look in materials: mixed in by t, beside what a material shows itself."""

import bpy

from . import attribute_names, nodes, versions

_PREFIX = "Pointmorph "
_T, _MIX, _SHADER, _FADE = (_PREFIX + name for name in ("t", "Mix", "Target", "Fade"))
_STAGGERED = _PREFIX + "Staggered"


def is_mixed(material):
    """Whether a material has a second look."""
    return any(node.name.startswith(_PREFIX) for node in material.node_tree.nodes)


def has_nodes(material):
    """Whether there are nodes that say what a material looks like."""
    return versions.uses_nodes(material)


def add_nodes(material):
    """Gives a material without nodes those of the same look."""
    tree = versions.node_tree(material)
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = material.diffuse_color
    shader.inputs["Roughness"].default_value = material.roughness
    shader.inputs["Metallic"].default_value = material.metallic


def drivers_of(material):
    """The shape keys that drive a material's second look."""
    data = material.node_tree.animation_data
    curves = [] if data is None else [c for c in data.drivers if f'"{_T}"' in c.data_path]
    return [t.id for c in curves for v in c.driver.variables for t in v.targets]


def takes_uv_map(material, name):
    """Whether a node of a material names a UV map, outside of groups."""
    found = material.node_tree.nodes if has_nodes(material) else ()
    return any(getattr(node, "uv_map", "") == name for node in found)


def image_of(material, what):
    """The image of the second look that shows `what`; None without one."""
    node = material.node_tree.nodes.get(f"{_PREFIX}{what}")
    return None if node is None else node.image


def images_of(material):
    """The images of the second look."""
    nodes_of = material.node_tree.nodes
    return {n.image for n in nodes_of if n.name.startswith(_PREFIX) and n.type == "TEX_IMAGE"}


def unmix(material):
    """Leaves nothing but a material's own look, and a node by which it's known again."""
    tree = material.node_tree
    for node in list(tree.nodes):
        if node.name.startswith((_MIX, _FADE)):
            first = next(s for s in node.inputs if s.name in ("Shader", "Vector"))
            if first.is_linked:
                for link in list(node.outputs[0].links):
                    tree.links.new(first.links[0].from_socket, link.to_socket)
    if _STAGGERED in tree.nodes:
        tree.nodes[_STAGGERED].outputs[0].driver_remove("default_value")
    for node in list(tree.nodes):
        if node.name.startswith(_PREFIX) and node.name != _T:
            tree.nodes.remove(node)


def mix_in(material, drawn, images, uv, drive):
    """Adds a second look to a material.

    Parameters
    ----------
    drawn : look_transfer.Drawn
    images : dict of str to Image
        By what they show: Color, Surface (roughness in green, metalness in blue), Normal.
    uv : str
        Name of their UV map.
    drive : function
        Takes two nodes: makes one give out t, and the other 1 where parts of the morph go later
        than others, else 0.
    """
    tree = material.node_tree
    outputs = [n for n in tree.nodes if n.type == "OUTPUT_MATERIAL"]
    right = max((n.location.x for n in outputs), default=0.0)
    low = min((n.location.y for n in tree.nodes), default=0.0) - 400.0
    build = _Builder(tree, right - 1000.0, low)
    t = tree.nodes.get(_T)
    if t is not None:
        t.outputs[0].driver_remove("default_value")
        tree.nodes.remove(t)
    t = _own_time(build, drive)
    shader = _shader(build, drawn, images, uv)
    for number, output in enumerate(outputs):
        own = _source_of(output.inputs["Surface"])
        mix = build.add("ShaderNodeMixShader", f"{_MIX} {number}")
        mix.location = (right - 200.0, output.location.y - 150.0)
        tree.links.new(t, mix.inputs[0])
        if own is not None:
            tree.links.new(own, mix.inputs[1])
        tree.links.new(shader, mix.inputs[2])
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
        _fade_displacement(build, tree, output, t, number)


def _own_time(build, drive):
    """The output that says how far each point has gone: t, or its own share of the way."""
    t, staggered = (build.add("ShaderNodeValue", name) for name in (_T, _STAGGERED))
    staggered.outputs[0].default_value = 0.0
    drive(t, staggered)
    own = build.add("ShaderNodeAttribute", _PREFIX + "Own t", attribute_name=attribute_names.TIME)
    mix = build.add("ShaderNodeMix", _PREFIX + "Time", data_type="FLOAT")
    factor, first, second = (socket for socket in mix.inputs if socket.enabled)
    build.tree.links.new(staggered.outputs[0], factor)
    build.tree.links.new(t.outputs[0], first)
    build.tree.links.new(own.outputs["Fac"], second)
    return nodes.enabled(mix.outputs, "Result")


def _fade_displacement(build, tree, output, t, number):
    """The relief of a material's own look goes with it."""
    own = _source_of(output.inputs["Displacement"])
    if own is None:
        return
    left = build.add("ShaderNodeMath", f"{_PREFIX}Rest {number}", operation="SUBTRACT")
    left.inputs[0].default_value = 1.0
    tree.links.new(t, left.inputs[1])
    scaled = build.add("ShaderNodeVectorMath", f"{_FADE} {number}", operation="SCALE")
    tree.links.new(own, scaled.inputs[0])
    tree.links.new(left.outputs[0], scaled.inputs["Scale"])
    tree.links.new(scaled.outputs[0], output.inputs["Displacement"])


def _source_of(socket):
    return socket.links[0].from_socket if socket.is_linked else None


def _shader(build, drawn, images, uv):
    """The output of the second look's shader."""
    tree = build.tree
    place = build.add("ShaderNodeUVMap", _PREFIX + "UV", uv_map=uv) if images else None
    found = {}
    for what, image in images.items():
        node = build.add("ShaderNodeTexImage", _PREFIX + what, image=image)
        tree.links.new(place.outputs[0], node.inputs["Vector"])
        found[what] = node
    kind, name = (
        ("ShaderNodeBsdfPrincipled", "Base Color")
        if drawn.is_lit
        else ("ShaderNodeEmission", "Color")
    )
    shader = build.add(kind, _SHADER)
    shader.label = "Target"
    if "Color" in found:
        tree.links.new(found["Color"].outputs["Color"], shader.inputs[name])
    else:
        shader.inputs[name].default_value = (*drawn.color[:3], 1.0)
    if not drawn.is_lit:
        return shader.outputs[0]
    if "Color" not in found:
        shader.inputs["Alpha"].default_value = drawn.color[3]
    elif float(drawn.color[..., 3].min()) < 1.0:
        tree.links.new(found["Color"].outputs["Alpha"], shader.inputs["Alpha"])
    if "Surface" in found:
        parts = build.add("ShaderNodeSeparateColor", _PREFIX + "Channels")
        tree.links.new(found["Surface"].outputs["Color"], parts.inputs[0])
        tree.links.new(parts.outputs["Green"], shader.inputs["Roughness"])
        tree.links.new(parts.outputs["Blue"], shader.inputs["Metallic"])
    else:
        shader.inputs["Roughness"].default_value = drawn.roughness
        shader.inputs["Metallic"].default_value = drawn.metallic
    if "Normal" in found:
        bent = build.add("ShaderNodeNormalMap", _PREFIX + "Bent", uv_map=uv)
        tree.links.new(found["Normal"].outputs["Color"], bent.inputs["Color"])
        tree.links.new(bent.outputs[0], shader.inputs["Normal"])
    return shader.outputs[0]


class _Builder:
    """Adds nodes under names by which they are found again."""

    def __init__(self, tree, left, top):
        self.tree = tree
        self._left, self._top, self._count = left, top, 0

    def add(self, kind, name, **settings):
        node = nodes.Builder(self.tree).node(kind, **settings)
        node.name = name
        node.location = (
            self._left + 280.0 * (self._count // 3),
            self._top - 320.0 * (self._count % 3),
        )
        self._count += 1
        return node


def new_material(name, color_attribute, created):
    """A material for faces without one: plain, or in the colors of an attribute."""
    material = bpy.data.materials.new(name)
    created(material)
    tree = versions.node_tree(material)
    if color_attribute:
        surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        color = nodes.Builder(tree).node("ShaderNodeVertexColor", layer_name=color_attribute)
        color.location = (surface.location.x - 300.0, surface.location.y)
        tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    return material
