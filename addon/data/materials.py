"""What materials say of color, roughness and so on, as far as it can be read from their nodes."""

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from mathutils import Euler, Matrix

from ..core import looks
from ..core.looks import Applied, Constant, ImageColor, Relief, Surface
from . import images, versions

CLEAR = ("BSDF_TRANSPARENT", "HOLDOUT")
"""Types of shaders without a color."""
METALS = ("BSDF_GLOSSY", "BSDF_ANISOTROPIC", "BSDF_METALLIC")
"""Those of shaders that are metal."""
_STEPS = 257  # of a color ramp
_NUMBERS = ("alpha", "roughness", "metallic")
_PARTS = (*_NUMBERS, "relief")  # what may be _Unread


@dataclass(frozen=True)
class Pictures:
    """Where a Reader gets what isn't in the nodes themselves.

    Attributes
    ----------
    image : function
        See `images.read`.
    nodes : function
        From a material, and a part of its Surface that can't be read from its nodes ("color",
        "alpha", "roughness", "metallic", "relief"), to what stands in its place, an expression of
        `core.looks` or a Relief, or to None.
    uvs : dict of str to (C, 2) array
        UV maps that such expressions take, besides those of the mesh.
    why_not : str
        Why there are no such expressions, for the user.
    """

    image: Callable = images.read
    nodes: Callable = lambda material, part: None
    uvs: dict = field(default_factory=dict)
    why_not: str = ""


@dataclass(frozen=True)
class _Unread:
    """A number or a relief that nodes compute in a way that can't be read.

    Attributes
    ----------
    plain : expression, Relief or None
        What stands for it where nothing better does.
    words : tuple of str
        The nodes.
    """

    plain: object
    words: tuple


class Reader:
    """Reads the materials of one mesh.

    Parameters
    ----------
    uv : str
        Name of the UV map that textures have by default; "" where the mesh has none.
    uvs, colors : collections of str
        Names of its UV maps and color attributes.
    active_color : str
    with_relief : bool
        Whether normal maps, and what else bends normals, are read.
    pictures : Pictures

    Attributes
    ----------
    remarks : list of str
        What couldn't be read, in words.
    used_uvs, used_colors : sets of str
        What the surfaces that were read ask for.
    """

    def __init__(self, uv, uvs, colors, active_color, with_relief, pictures):
        self._uv, self._uvs, self._colors = uv, set(uvs), set(colors)
        self._active_color = active_color
        self._with_relief = with_relief
        self._pictures = pictures
        self._textures = {}
        self.remarks = []
        self.used_uvs, self.used_colors = set(), set()
        self._from = []
        self._unread, self._unread_color = [], []

    def surface(self, material):
        """The Surface of a material, and whether its color comes from somewhere: an image, an
        attribute, nodes."""
        self._from, self._unread, self._unread_color = [], [], []
        tree = material.node_tree if versions.uses_nodes(material) else None
        found = None
        if tree is not None:
            output = tree.get_output_node("ALL")
            if output is not None and output.inputs["Surface"].is_linked:
                found = self._shader(*_origin(output.inputs["Surface"], ()))
        if found is None:
            numbers = (_number(x) for x in (1.0, material.roughness, material.metallic))
            found = Surface(_constant(material.diffuse_color), *numbers)
            if tree is not None:
                self.remarks.append(
                    f'The shader of the material "{material.name}" can\'t be read: its viewport '
                    "color is used instead"
                )
        else:
            if found.color is None:
                found = replace(found, color=self._color_of_nodes(material))
            if self._with_relief:
                found = replace(found, relief=self._displaced(output, found.relief))
            found = replace(found, **self._parts_of_nodes(material, found))
        is_own = bool(self._from)
        if self._unread:
            words = ", ".join(dict.fromkeys(self._unread))
            self.remarks.append(f'Nodes of the material "{material.name}" can\'t be read ({words})')
        source = " and ".join(dict.fromkeys(self._from)) or f'the material "{material.name}"'
        return replace(found, source=source), is_own

    def _color_of_nodes(self, material):
        """What stands for a color that can't be read from the nodes one by one."""
        found = self._pictures.nodes(material, "color")
        if found is not None:
            self._from = [f'the nodes of the material "{material.name}"']
            return found
        words = ", ".join(dict.fromkeys(self._unread_color))
        said = f'Nodes of the material "{material.name}" can\'t be read ({words})'
        why_not = f". {self._pictures.why_not}" if self._pictures.why_not else ""
        self.remarks.append(f"{said}: its viewport color is used instead{why_not}")
        return _constant(material.diffuse_color)

    def _parts_of_nodes(self, material, surface):
        """By name, what stands for other parts of a surface that can't be read."""
        made = {}
        for name in _PARTS:
            value = getattr(surface, name)
            if isinstance(value, _Unread):
                made[name] = self._pictures.nodes(material, name)
                if made[name] is None:
                    self._unread += value.words
                    made[name] = value.plain
        return made

    # --- Shaders ----------------------------------------------------------------------------------

    def _shader(self, output, path):
        """The Surface of a shader's output; None for one that can't be read."""
        if output is None:
            return None
        node = output.node
        if node.type in ("MIX_SHADER", "ADD_SHADER"):
            return self._mixed_shaders(node, path)
        inputs = node.inputs
        name = next((n for n in ("Base Color", "Color") if n in inputs), None)
        if name is None or node.type in CLEAR:
            return None
        if node.type == "EMISSION":
            return Surface(self._color(inputs[name], path), is_lit=False)
        roughness, metallic = _number(0.5), _number(0.0)
        if "Roughness" in inputs:
            roughness = self._number(inputs["Roughness"], path)
        if node.type in METALS:
            metallic = _number(1.0)
        elif "Metallic" in inputs:
            metallic = self._number(inputs["Metallic"], path)
        alpha = self._number(inputs["Alpha"], path) if "Alpha" in inputs else _number(1.0)
        color = self._color(inputs[name], path)
        return Surface(color, alpha, roughness, metallic, self._relief(inputs, path))

    def _mixed_shaders(self, node, path):
        shaders = [socket for socket in node.inputs if socket.type == "SHADER"]
        origins = [_origin(socket, path) for socket in shaders]
        kinds = [None if output is None else output.node.type for output, _ in origins]
        solid = [
            None if kind is None or kind in CLEAR else self._shader(*origin)
            for kind, origin in zip(kinds, origins, strict=True)
        ]
        known = [surface for surface in solid if surface is not None]
        if not known:
            return None
        share = None
        if node.type == "MIX_SHADER":
            factor = _origin(node.inputs[0], path)[0]
            # By way of the light's path, glTF's files say that nothing shades.
            if factor is None or factor.node.type != "LIGHT_PATH":
                share = self._number(node.inputs[0], path)
        if len(known) == 1:
            if share is None or not set(kinds) & set(CLEAR):
                return known[0]
            if solid[0] is not None:
                share = _combined("rest", lambda x: 1.0 - x, share)
            alpha = _combined("math MULTIPLY", np.multiply, known[0].alpha, share)
            return replace(known[0], alpha=alpha)
        if share is None:
            return known[0]
        mixed = {
            name: _combined(
                "blend MIX", looks.BLENDS["MIX"], share, *(getattr(s, name) for s in known)
            )
            for name in _NUMBERS
        }
        reliefs = [surface.relief for surface in known]
        if any(relief is not reliefs[0] for relief in reliefs):
            mixed["relief"] = _or_unread(reliefs[0], node.bl_label)
        mixed["color"] = None
        if isinstance(share, _Unread):
            self._unread_color += share.words
        elif all(surface.color is not None for surface in known):
            colors = [surface.color for surface in known]
            mixed["color"] = _applied("blend MIX", looks.BLENDS["MIX"], share, *colors)
        return replace(known[0], **mixed)

    def _relief(self, inputs, path):
        if not self._with_relief or "Normal" not in inputs:
            return None
        output, path = _origin(inputs["Normal"], path)
        if output is None:
            return None
        node = output.node
        uv = getattr(node, "uv_map", "") or self._uv
        if node.type != "NORMAL_MAP" or node.space != "TANGENT" or uv not in self._uvs:
            return _Unread(None, (node.label or node.bl_label,))
        before = len(self._unread)
        color = self._value(node.inputs["Color"], path, as_number=False)
        strength = self._value(node.inputs["Strength"], path)
        words = tuple(self._unread[before:])
        del self._unread[before:]
        if words:
            return _Unread(None, words)
        self.used_uvs.add(uv)
        return Relief(color, strength, uv)

    def _displaced(self, output, relief):
        """A relief, where a material's output is displaced as well."""
        displacing, _ = _origin(output.inputs["Displacement"], ())
        if displacing is None:
            return relief
        node = displacing.node
        return _or_unread(relief, node.label or node.bl_label)

    # --- Values -----------------------------------------------------------------------------------

    def _color(self, socket, path):
        """A color, whose sources are noted; None where it can't be read."""
        before = len(self._unread)
        noted = self._from
        self._from = []
        found = self._value(socket, path, as_number=False)
        found_in, self._from = self._from, noted
        if len(self._unread) > before:
            self._unread_color += self._unread[before:]
            del self._unread[before:]
            return None
        self._from += found_in
        return found

    def _number(self, socket, path):
        """A number, or `_Unread`."""
        before = len(self._unread)
        found = self._value(socket, path)
        words = tuple(self._unread[before:])
        del self._unread[before:]
        return _Unread(found, words) if words else found

    def _value(self, socket, path, as_number=None):
        """The expression of an input."""
        as_number = socket.type == "VALUE" if as_number is None else as_number
        noted = list(self._from)
        output, inner = _origin(socket, path)
        if output is None:
            return _default(inner)
        found = self._output(output, inner)
        if found is None:
            self._unread.append(output.node.label or output.node.bl_label)
            self._from = noted
            return _default(socket)
        if as_number:
            self._from = noted  # only what colors come from is told
            if output.type == "RGBA":
                return looks.brightness(found)
        return found

    def _output(self, output, path):
        """The expression of a node's output; None for one that can't be read."""
        node = output.node
        read = getattr(self, f"_read_{node.type.lower()}", None)
        return None if read is None else read(node, output, path)

    def _parts(self, path, *sockets):
        return [self._value(socket, path) for socket in sockets]

    def _read_rgb(self, node, output, path):
        return _constant(output.default_value)

    def _read_value(self, node, output, path):
        return _number(output.default_value)

    def _read_tex_image(self, node, output, path):
        if node.image is None or node.projection != "FLAT":
            return None
        place = self._uv_place(node.inputs["Vector"], path)
        if place is None:
            return None
        key = node.image.session_uid
        if key not in self._textures:
            texture, said = self._pictures.image(node.image)
            self._textures[key] = texture
            if said:
                self.remarks.append(f"{said[0].upper()}{said[1:]}")
        texture = self._textures[key]
        if texture is None:
            return None
        shows_alpha = node.outputs["Alpha"].is_linked
        closest = node.interpolation == "Closest"
        found = ImageColor(texture, *place, node.extension, closest, shows_alpha)
        if output.name == "Alpha":
            return looks.channel(found, 3)
        self._from.append(f'the image "{node.image.name}"')
        return found

    def _uv_place(self, socket, path):
        """Name of the UV map and the matrix of a texture's vector; None for any other."""
        output, path = _origin(socket, path)
        name, matrix = self._uv, None
        if output is not None and output.node.type == "MAPPING":
            mapping = output.node
            matrix = _mapping_matrix(mapping)
            output, path = _origin(mapping.inputs["Vector"], path)
            if matrix is None or output is None:
                return None
        if output is not None:
            node = output.node
            if node.type == "UVMAP":
                name = node.uv_map or self._uv
            elif node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
                name = node.attribute_name
            elif node.type != "TEX_COORD" or output.name != "UV":
                return None
        if name not in self._uvs:
            return None
        self.used_uvs.add(name)
        return name, matrix

    def _read_attribute_named(self, name, output):
        if name not in self._colors:
            return None
        self.used_colors.add(name)
        found = looks.AttributeColor(name)
        if output.name == "Alpha":
            return looks.channel(found, 3)
        self._from.append(f'the color attribute "{name}"')
        return looks.brightness(found) if output.name == "Fac" else found

    def _read_vertex_color(self, node, output, path):
        return self._read_attribute_named(node.layer_name or self._active_color, output)

    def _read_attribute(self, node, output, path):
        if node.attribute_type != "GEOMETRY":
            return None
        return self._read_attribute_named(node.attribute_name, output)

    def _read_mix(self, node, output, path):
        if node.data_type == "VECTOR":
            return None
        blend = node.blend_type if node.data_type == "RGBA" else "MIX"
        sockets = [socket for socket in node.inputs if socket.enabled]
        return self._blended(node, blend, sockets, path, node.clamp_factor, node.clamp_result)

    def _read_mix_rgb(self, node, output, path):
        return self._blended(node, node.blend_type, node.inputs, path, True, node.use_clamp)

    def _blended(self, node, blend, sockets, path, clamps_factor, clamps):
        if blend not in looks.BLENDS or len(sockets) != 3:
            return None
        parts = self._parts(path, *sockets)
        if clamps_factor:
            parts[0] = _clamped(parts[0])
        found = _applied(f"blend {blend}", looks.BLENDS[blend], *parts)
        return _clamped(found) if clamps else found

    def _read_math(self, node, output, path):
        function = looks.MATHS.get(node.operation)
        if function is None:
            return None
        found = _applied(f"math {node.operation}", function, *self._parts(path, *node.inputs[:2]))
        return _clamped(found) if node.use_clamp else found

    def _read_gamma(self, node, output, path):
        return _applied("gamma", looks.gamma, *self._parts(path, *node.inputs[:2]))

    def _read_invert(self, node, output, path):
        return _applied("inverted", looks.inverted, *self._parts(path, *node.inputs[:2]))

    def _read_rgbtobw(self, node, output, path):
        return looks.brightness(self._parts(path, node.inputs[0])[0])

    def _read_separate_color(self, node, output, path):
        if getattr(node, "mode", "RGB") != "RGB":
            return None
        number = list(node.outputs).index(output)
        return looks.channel(self._parts(path, node.inputs[0])[0], number)

    _read_seprgb = _read_separate_color

    def _read_valtorgb(self, node, output, path):
        ramp = node.color_ramp
        steps = np.array([ramp.evaluate(k / (_STEPS - 1)) for k in range(_STEPS)])
        name = f"ramp {zlib.crc32(steps.astype(np.float32).tobytes()):08x}"
        found = _applied(name, looks.ramp(steps), self._parts(path, node.inputs[0])[0])
        return looks.channel(found, 3) if output.name == "Alpha" else found


def _origin(socket, path):
    """The output that feeds an input, whatever lies between, and the groups around it, the
    outermost first. Without one, None and the input itself that says the value."""
    while socket.is_linked:
        link = socket.links[0]
        if link.is_muted or not link.is_valid:
            break
        output = link.from_socket
        node = output.node
        if node.mute:
            inner = next((x for x in node.internal_links if x.to_socket == output), None)
            if inner is None:
                break
            socket = inner.from_socket
        elif node.type == "REROUTE":
            socket = node.inputs[0]
        elif node.type == "GROUP" and node.node_tree is not None:
            ends = [n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT"]
            end = next((n for n in ends if n.is_active_output), None)
            if end is None:
                break
            path = (*path, node)
            socket = next(s for s in end.inputs if s.identifier == output.identifier)
        elif node.type == "GROUP_INPUT" and path:
            socket = next(s for s in path[-1].inputs if s.identifier == output.identifier)
            path = path[:-1]
        else:
            return output, path
    return None, socket


def _default(socket):
    value = getattr(socket, "default_value", None)
    if value is None:
        return _number(0.0)
    return _number(value) if socket.type in ("VALUE", "INT") else _constant(value)


def _constant(color):
    return Constant((*(float(x) for x in color[:3]), float(color[3]) if len(color) > 3 else 1.0))


def _number(value):
    return Constant((float(value),) * 3 + (1.0,))


def _applied(name, function, *parts):
    """What is the same everywhere stays so."""
    found = Applied(name, function, parts)
    if all(isinstance(part, Constant) for part in parts):
        return Constant(tuple(float(x) for x in found.at([None])[0]))
    return found


def _combined(name, function, *parts):
    """`_applied` to numbers some of which may be `_Unread`."""
    words = [word for part in parts if isinstance(part, _Unread) for word in part.words]
    plain = (part.plain if isinstance(part, _Unread) else part for part in parts)
    found = _applied(name, function, *plain)
    return _Unread(found, tuple(words)) if words else found


def _or_unread(relief, word):
    """A relief that something else bends as well."""
    if isinstance(relief, _Unread):
        return _Unread(relief.plain, (*relief.words, word))
    return _Unread(relief, (word,))


def _clamped(expression):
    return _applied("clamped", looks.clamped, expression)


def _mapping_matrix(node):
    """(2, 3): what a Mapping node does to UVs; None where that isn't fixed."""
    if node.vector_type not in ("POINT", "TEXTURE") or any(s.is_linked for s in node.inputs[1:]):
        return None
    location, rotation, scale = (
        node.inputs[name].default_value if name in node.inputs else (0.0, 0.0, 0.0)
        for name in ("Location", "Rotation", "Scale")
    )
    matrix = Matrix.LocRotScale(location, Euler(rotation), scale)
    if node.vector_type == "TEXTURE":
        if math.isclose(matrix.determinant(), 0.0):
            return None
        matrix.invert()
    return np.array(matrix)[:2, (0, 1, 3)]
