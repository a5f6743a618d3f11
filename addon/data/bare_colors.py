"""Materials that glow with their base color, or with numbers that they have, or only bend normals,
and do nothing else: to be baked, and described."""

import bpy

from . import versions
from .materials import CLEAR, METALS

COLOR, ALPHA, SURFACE, RELIEF = "COLOR", "ALPHA", "SURFACE", "RELIEF"
"""What they glow with: their base color; alpha; roughness as red and metalness as green. With
RELIEF, they are plain and white, and have their normals."""
_MIXES = ("MIX_SHADER", "ADD_SHADER")
# What nodes say that has to do with how they are shown, not with what they compute.
_FOR_SHOW = {"name", "label", "width", "height", "parent", "select", "hide", "show_options"}
_FOR_SHOW |= {"show_preview", "show_texture", "location", "location_absolute", "color", "color_tag"}
_FOR_SHOW |= {"use_custom_color", "warning_propagation"}


def bare(material, kind, created):
    """A copy of a material whose shaders are replaced by a glow, or by a plain one.

    Parameters
    ----------
    kind : str
        COLOR, ALPHA, SURFACE or RELIEF.
    created : function
        Called with every data-block made.
    """
    copy = material.copy()
    created(copy)
    tree = copy.node_tree
    _strip(tree, kind, created)
    output = tree.get_output_node("CYCLES")
    copy.displacement_method = "BUMP"  # normals are baked, not places
    for name in ("Volume",) if kind == RELIEF else ("Volume", "Displacement"):
        for link in output.inputs[name].links:
            tree.links.remove(link)
    return copy


def black(created):
    """A material for faces that aren't looked at."""
    material = bpy.data.materials.new("Pointmorph Black")
    created(material)
    tree = versions.node_tree(material)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    glow = tree.nodes.new("ShaderNodeEmission")
    glow.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    tree.links.new(glow.outputs[0], output.inputs["Surface"])
    return material


def _strip(tree, kind, created):
    for node in list(tree.nodes):
        shaders = [output for output in node.outputs if output.type == "SHADER"]
        if node.type == "GROUP" and node.node_tree is not None and shaders:
            node.node_tree = node.node_tree.copy()
            created(node.node_tree)
            _strip(node.node_tree, kind, created)
        elif node.type in _MIXES:
            if kind != ALPHA or node.type == "ADD_SHADER" or _is_by_path(node):
                _leave_out_clear(tree, node)
        elif shaders and (kind == ALPHA or node.type not in CLEAR):
            _replace(tree, node, shaders[0], kind)


def _replace(tree, node, shader, kind):
    """Puts a glow, or a plain shader with the same normals, in a shader's place."""
    name = next((n for n in ("Base Color", "Color") if n in node.inputs), None)
    if name is None or not shader.is_linked:
        return
    has_normals = kind == RELIEF
    glow = tree.nodes.new("ShaderNodeBsdfDiffuse" if has_normals else "ShaderNodeEmission")
    shown = glow.inputs["Color"]
    if has_normals:
        if "Normal" in node.inputs and node.inputs["Normal"].is_linked:
            _feed(tree, node.inputs["Normal"], glow.inputs["Normal"])
    elif kind == COLOR:
        _feed(tree, node.inputs[name], shown)
    else:
        numbers = tree.nodes.new("ShaderNodeCombineXYZ")
        tree.links.new(numbers.outputs[0], shown)
        if kind == ALPHA:
            for socket in numbers.inputs:
                _feed_number(tree, node, "Alpha", float(node.type not in CLEAR), socket)
        else:
            _feed_number(tree, node, "Roughness", 0.5, numbers.inputs["X"])
            _feed_number(tree, node, "Metallic", float(node.type in METALS), numbers.inputs["Y"])
    for place in [link.to_socket for link in shader.links]:
        tree.links.new(glow.outputs[0], place)


def _feed_number(tree, node, name, plain, socket):
    """Gives a socket what a shader's input of that name gets; without such an input, `plain`."""
    if name in node.inputs:
        _feed(tree, node.inputs[name], socket)
    else:
        socket.default_value = plain


def _feed(tree, known, socket):
    """Gives a socket what another one gets."""
    if known.is_linked:
        tree.links.new(known.links[0].from_socket, socket)
    else:
        socket.default_value = known.default_value


def _is_by_path(node):
    """Whether a mix of shaders depends on the light's path."""
    factor = node.inputs[0]
    return factor.is_linked and factor.links[0].from_node.type == "LIGHT_PATH"


def _leave_out_clear(tree, node):
    """Of two mixed shaders, takes the one with a color where the other is transparent, or where the
    mix depends on the light's path; of a sum, the first."""
    sides = [socket for socket in node.inputs if socket.type == "SHADER"]
    colored = [side.is_linked and side.links[0].from_node.type not in CLEAR for side in sides]
    factor = node.inputs[0]
    is_sum = node.type == "ADD_SHADER"
    by_path = not is_sum and _is_by_path(node)
    if all(colored) and not (is_sum or by_path):
        return
    kept = colored.index(True) if any(colored) else 0
    if is_sum:
        for link in sides[1 - kept].links:
            tree.links.remove(link)
        return
    for link in factor.links:
        tree.links.remove(link)
    factor.default_value = float(kept)


def images_of(tree):
    """The images that nodes of a tree, or of groups in it, show."""
    found = []
    for node in tree.nodes:
        if getattr(node, "image", None) is not None:
            found.append(node.image)
        elif node.type == "GROUP" and node.node_tree is not None:
            found += images_of(node.node_tree)
    return found


def show_instead(tree, instead, created):
    """Makes nodes of a tree, and copies of groups in it, show other images.

    Parameters
    ----------
    instead : dict of Image to Image
    created : function
        Called with every data-block made.
    """
    for node in tree.nodes:
        if getattr(node, "image", None) in instead:
            node.image = instead[node.image]
        elif node.type == "GROUP" and not instead.keys().isdisjoint(_images_in(node)):
            node.node_tree = node.node_tree.copy()
            created(node.node_tree)
            show_instead(node.node_tree, instead, created)


def _images_in(group):
    return () if group.node_tree is None else images_of(group.node_tree)


# --- What nodes say -------------------------------------------------------------------------------


def described(tree):
    """What the nodes of a tree compute, in words: the same for the same."""
    numbers = {node.name: number for number, node in enumerate(tree.nodes)}
    words = [_described_node(node) for node in tree.nodes]
    for link in tree.links:
        ends = (
            f"{numbers[node.name]}.{socket.identifier}"
            for node, socket in ((link.from_node, link.from_socket), (link.to_node, link.to_socket))
        )
        words.append(" > ".join(ends) + (" muted" if link.is_muted else ""))
    return "\n".join(words)


def _described_node(node):
    words = [node.bl_idname]
    words += _described_properties(node)
    for socket in node.inputs:
        value = getattr(socket, "default_value", None)
        if value is not None and not socket.is_linked:
            words.append(f"{socket.identifier} {_value(value)}")
    if node.type in ("RGB", "VALUE", "NORMAL"):
        words.append(_value(node.outputs[0].default_value))
    return " ".join(words)


def _described_properties(item):
    found = []
    for known in item.bl_rna.properties:
        name = known.identifier
        if name in _FOR_SHOW or name.startswith("bl_") or name == "rna_type":
            continue
        if known.type == "POINTER":
            found += _described_pointer(name, getattr(item, name))
        elif known.type not in ("COLLECTION", "STRING") and not known.is_readonly:
            found.append(f"{name} {_value(getattr(item, name))}")
        elif known.type == "STRING" and not known.is_readonly:
            found.append(f"{name} {getattr(item, name)!r}")
    return found


def _described_pointer(name, found):
    if found is None:
        return []
    if isinstance(found, bpy.types.NodeTree):
        return [f"{name} [{described(found)}]"]
    if isinstance(found, bpy.types.ID):
        return [f"{name} {found.name!r}"]
    if isinstance(found, bpy.types.ColorRamp):
        ends = [f"{_value(e.position)} {_value(e.color)}" for e in found.elements]
        return [name, *_described_properties(found), *ends]
    if isinstance(found, bpy.types.CurveMapping):
        points = [f"{_value(p.location)} {p.handle_type}" for c in found.curves for p in c.points]
        return [name, *points]
    return []


def _value(value):
    if isinstance(value, (str, bool, int)):
        return str(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    try:
        return " ".join(f"{float(x):.6g}" for x in value)
    except TypeError:
        return getattr(value, "name", "")
    except ValueError:  # a set of words
        return " ".join(sorted(value))
