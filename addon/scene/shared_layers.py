"""Parts of one mesh have what is shown of them in layers of the same name: joined, they have one
that is shown."""

import numpy as np

from ..data import arrays, creation
from . import object_looks


def share_uv_map(meshes):
    """Gives the UV map that is rendered one name on all meshes, and returns it. None where no mesh
    has one."""
    rendered = [(mesh, object_looks.render_layer(mesh)) for mesh in meshes]
    rendered = [(mesh, layer) for mesh, layer in rendered if layer is not None]
    names, name = [layer.name for _, layer in rendered], None
    for name in (*names, *(creation.ending_in(name, " Rendered") for name in names)):
        # Where it is another map's, materials go on naming that.
        if all(layer.name == name or name not in mesh.uv_layers for mesh, layer in rendered):
            break
    for mesh, layer in rendered:
        if name not in mesh.uv_layers:
            arrays.write_uvs(mesh, name, arrays.corner_uvs(layer))
    return name


def render_uv_map(mesh, name):
    """Has a mesh render a UV map: joined, it may have another one of its parts'."""
    if name in mesh.uv_layers:
        mesh.uv_layers[name].active_render = True
        mesh.uv_layers.active = mesh.uv_layers[name]


def share_colors(meshes):
    """Gives the active color attribute one name on all meshes, and returns it; those that have none
    get the colors of their materials. Other color attributes of one name are of one kind. None
    where no mesh has any."""
    active = [arrays.active_colors(mesh) for mesh in meshes]
    names = [colors.name for colors in active if colors is not None]
    if not names:
        return None
    for name in (*names, *(creation.ending_in(name, " Shown") for name in names)):
        # Where it is another one's, materials go on naming that.
        if all(
            name not in mesh.attributes or (colors is not None and colors.name == name)
            for mesh, colors in zip(meshes, active, strict=True)
        ):
            break
    for mesh, colors in zip(meshes, active, strict=True):
        if colors is None:
            arrays.write_attribute(mesh, name, object_looks.plain_colors(mesh), "CORNER")
        elif colors.name != name:
            arrays.write_attribute(mesh, name, arrays.corner_colors(mesh, colors), "CORNER")
    for shared in {colors.name for mesh in meshes for colors in mesh.color_attributes}:
        _make_alike(meshes, shared)
    return name


def _make_alike(meshes, name):
    """Has the color attributes of one name be of one kind: Blender has two of that name in a mesh
    otherwise, each with gaps."""
    having = [mesh for mesh in meshes if name in mesh.color_attributes]
    kinds = {
        (colors.data_type, colors.domain)
        for colors in (mesh.color_attributes[name] for mesh in having)
    }
    if len(kinds) < 2:
        return
    for mesh in having:
        values = arrays.corner_colors(mesh, mesh.color_attributes[name])
        arrays.write_attribute(mesh, name, np.ascontiguousarray(values), "CORNER")


def show_colors(mesh, name):
    """Has a mesh show and render a color attribute: joined, it may show another one, or none."""
    if name in mesh.color_attributes:
        arrays.activate_colors(mesh, name)
        mesh.attributes.default_color_name = name
