"""What objects look like: their materials, images and color attributes, as the core takes them."""

import zlib
from dataclasses import replace

import numpy as np

from ..core import looks
from ..core.look_transfer import Skin
from ..core.looks import PLAIN, AttributeColor, Look
from ..data import arrays, bare_colors, images
from ..data.materials import Pictures, Reader


def read_skin(obj, mesh, with_relief=False, pictures=None):
    """The Skin of an object's mesh, be it its own or the one that the viewport shows; None without
    faces. Normals and normal maps are read `with_relief`. It has a look where there are `pictures`,
    a `materials.Pictures`.

    A face's color comes from its material, if that has an image or an attribute there; else from
    the active color attribute; else it is the material's plain color.
    """
    if not mesh.polygons:
        return None
    layer = render_layer(mesh)
    return Skin(
        arrays.triangle_loops(mesh),
        None if pictures is None else _read_look(obj, mesh, with_relief, pictures),
        None if layer is None else arrays.corner_uvs(layer),
        _name_of(layer),
        arrays.smooth_faces(mesh)[arrays.triangle_faces(mesh)],
        arrays.corner_normals(mesh) if with_relief else None,
    )


def render_layer(mesh):
    """The UV map that renderers take where a material names none."""
    layers = mesh.uv_layers
    return next((layer for layer in layers if layer.active_render), next(iter(layers), None))


def vertex_colors(mesh, skin):
    """(N, 4): the color of every vertex, the mean of its faces' corners; None without any."""
    if skin is None or skin.look is None:
        return arrays.mesh_colors(mesh)
    active = arrays.active_colors(mesh)
    if active is not None and all(
        surface.color == AttributeColor(active.name) for surface in skin.look.used()
    ):
        return arrays.vertex_colors(mesh, active)
    return arrays.mean_of_corners(mesh, skin.look.corner_colors())


def plain_colors(mesh):
    """(C, 4): of every corner, what its face's material has as a plain color, and white where that
    comes from an image, an attribute or nodes."""
    reader = _reader(mesh, False, _WITHOUT_PIXELS)
    colors = []
    for material in list(mesh.materials) or [None]:
        surface, has_own = (PLAIN, False) if material is None else reader.surface(material)
        is_plain = not has_own and isinstance(surface.color, looks.Constant)
        colors.append(tuple(surface.color.value) if is_plain else (1.0, 1.0, 1.0, 1.0))
    slots = arrays.material_indices(mesh).clip(0, len(colors) - 1)
    return np.array(colors, np.float32)[np.repeat(slots, arrays.corner_counts(mesh))]


def materials_of(obj, mesh):
    """The material of every slot, be it the object's or the mesh's."""
    found = list(mesh.materials)
    for number, slot in enumerate(obj.material_slots[: len(found)]):
        if slot.link == "OBJECT":
            found[number] = slot.material
    return found


def unread_materials(obj, mesh, parts):
    """The materials of an object's faces of which some of these parts of a Surface can't be read
    from their nodes."""
    found = []

    def note(material, part):
        if part in parts:
            found.append(material)

    reader = _reader(mesh, "relief" in parts, Pictures(images.without_pixels, note))
    for material in _used(materials_of(obj, mesh), mesh):
        if material is not None:
            reader.surface(material)
    return list(dict.fromkeys(found))


def _used(materials, mesh):
    """Those that faces have."""
    if not materials:
        return []
    slots = np.unique(arrays.material_indices(mesh).clip(0, len(materials) - 1))
    return list(dict.fromkeys(materials[slot] for slot in slots.tolist()))


def described_nodes(material):
    """What the nodes of a material compute, in words: the same for the same."""
    tree = material.node_tree
    return "" if tree is None else bare_colors.described(tree)


def _named_nodes(material, part):
    """In place of what nodes compute: their description."""
    return looks.Applied(f"nodes {zlib.crc32(described_nodes(material).encode()):08x}", None, ())


_WITHOUT_PIXELS = Pictures(images.without_pixels, _named_nodes)


def described_steps(obj):
    """What tells whether an object's look has changed, besides its active color attribute and what
    is painted on images: a list of texts and arrays, None where there's no look, or where it moves
    by itself. A generator that yields often and returns it."""
    mesh = obj.data
    moving = [m for m in materials_of(obj, mesh) if m is not None and _is_animated(m)]
    if not mesh.polygons or moving:
        return None
    look = _read_look(obj, mesh, False, _WITHOUT_PIXELS)
    yield
    if look is None:
        return None
    found = [arrays.material_indices(mesh)]
    for surface in look.surfaces:
        found += [words.encode() for words in _words_of(surface)]
    found += [look.uvs[name] for name in sorted(look.uvs)]
    yield
    found += [look.colors[name] for name in sorted(look.colors)]
    return found


def material_print(obj, material):
    """What tells whether a material looks the same on an object's mesh as before: a short text."""
    surface, _ = _reader(obj.data, False, _WITHOUT_PIXELS).surface(material)
    return f"{zlib.crc32(' '.join(_words_of(surface)).encode()):08x}"


def _words_of(surface):
    """What a surface says, in words, the same for the same."""
    parts = ("color", "alpha", "roughness", "metallic")
    return [looks.described(getattr(surface, what)) for what in parts]


def _is_animated(material):
    return any(
        item is not None and item.animation_data is not None
        for item in (material, material.node_tree)
    )


def _read_look(obj, mesh, with_relief, pictures):
    """The Look of an object's mesh; None where it has neither materials nor colors."""
    materials = materials_of(obj, mesh)
    active = arrays.active_colors(mesh)
    if not any(materials) and active is None:
        return None
    reader = _reader(mesh, with_relief, pictures)
    slots = arrays.material_indices(mesh).clip(0, max(len(materials) - 1, 0))
    used, numbers = np.unique(slots, return_inverse=True)
    surfaces = []
    for slot in used.tolist():
        material = materials[slot] if materials else None
        surface, has_own = (PLAIN, False) if material is None else reader.surface(material)
        if not has_own and active is not None:
            source = f'the color attribute "{active.name}"'
            surface = replace(surface, color=AttributeColor(active.name), source=source)
            reader.used_colors.add(active.name)
        surfaces.append(surface)
    return Look(
        tuple(surfaces),
        np.repeat(numbers.reshape(-1), arrays.corner_counts(mesh)),
        {name: arrays.corner_uvs(mesh.uv_layers[name]) for name in reader.used_uvs} | pictures.uvs,
        {
            name: arrays.corner_colors(mesh, mesh.color_attributes[name])
            for name in reader.used_colors
        },
        tuple(dict.fromkeys(reader.remarks)),
    )


def _reader(mesh, with_relief, pictures):
    return Reader(
        _name_of(render_layer(mesh)),
        [layer.name for layer in mesh.uv_layers],
        [item.name for item in mesh.color_attributes],
        _name_of(arrays.active_colors(mesh)),
        with_relief,
        pictures,
    )


def _name_of(item):
    """The name of a layer or an attribute; empty where there is none."""
    return "" if item is None else item.name


def words(shapes):
    """Where the colors of shapes come from, to be told to the user; and what is to be said besides,
    a list."""
    told, remarks = [], []
    for shape in shapes:
        look = None if shape.skin is None else shape.skin.look
        if look is not None:
            told.append(f'"{shape.name}" from {_listed(look.sources)}')
            remarks += [f'"{shape.name}": {remark}' for remark in look.remarks]
        elif shape.colors is not None:
            told.append(f'"{shape.name}" from its color attribute')
    return ("Colors: " + "; ".join(told)) if told else "", remarks


def _listed(sources):
    """No more than three by name."""
    most = 3
    more = len(sources) - most
    shown = sources[:most] + ([f"{more} more"] if more > 0 else [])
    return ", ".join(shown)
