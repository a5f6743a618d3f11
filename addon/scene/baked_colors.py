"""Base colors that can't be read from a material's nodes one by one, such as those of procedural
textures: Cycles computes them, in a scene of its own, on an image that has a place for every
face."""

import hashlib
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pointmorph

from ..core import texels, textures
from ..core.looks import ImageColor
from ..core.textures import Texture
from ..data import arrays, bare_colors, other_blender
from ..data.materials import Pictures
from . import color_bake, object_looks

_UV = "Pointmorph Baked"
_PIXELS = 16  # a face
_KEPT = 4

_known = {}
"""By what it depends on, what was baked last: Texture and UVs."""


def needed_steps(context, obj, evaluated=None):
    """Pictures to read an object's materials with, for which those are baked whose base color can't
    be read otherwise. A generator that returns them, and yields words while another Blender bakes:
    see `stepping`.

    Parameters
    ----------
    evaluated : Object, optional
        As the viewport shows it, where that is what is read.
    """
    mesh = (obj if evaluated is None else evaluated).data
    if not object_looks.unread_materials(obj, mesh):
        return Pictures()
    made = []
    try:
        copy = _copy(context, obj, evaluated, made.append)
        return (yield from _baked_steps(context, copy, made))
    except pointmorph.CloudError as error:
        return Pictures(why_not=str(error))
    finally:
        _remove(made)


def _baked_steps(context, copy, made):
    """Pictures with what was baked of a copy of an object. Removes what was made before it
    yields."""
    mesh = copy.data
    materials = object_looks.materials_of(copy, mesh)
    unread = object_looks.unread_materials(copy, mesh)
    key = _key(context, copy, materials)
    if key not in _known or _depends_on_pixels(unread):
        counts = arrays.corner_counts(mesh)
        corners = arrays.vertex_positions(mesh)[arrays.mesh_corners(mesh)]
        uvs, owners = texels.lay_out(counts, texels.extents(corners, counts), _size(len(counts)))
        image = bpy.data.images.new(_UV, *owners.shape, alpha=True, float_buffer=True, is_data=True)
        made.append(image)
        image.generated_color = (0.0, 0.0, 0.0, 0.0)
        is_here = other_blender.command() is None or _has_unsaved_pixels(unread)
        shown = [one if one in unread else None for one in materials]
        _dress(copy, uvs, image, shown, made.append)
        if is_here:
            _bake(context, copy, made.append)
            baked = arrays.image_pixels(image)
        else:
            baked = yield from _bake_elsewhere_steps(context, copy, made)
        # Not Blender's own margin: that mixes neighbors at the corners of faces.
        colors = texels.filled(baked, baked[..., 3] > 0.0, owners)
        values = (textures.to_srgb(colors) * 255.0 + 0.5).astype(np.uint8)
        values[..., 3] = 255
        while len(_known) >= _KEPT:
            del _known[next(iter(_known))]
        _known[key] = Texture(_UV, values, is_srgb=True, is_solid=True), uvs
    texture, uvs = _known[key]
    color = ImageColor(texture, _UV, extension=textures.EXTEND, shrinks=False)
    return Pictures(
        # What the viewport shows has copies of the materials.
        nodes=lambda material: color if material.original in unread else None,
        uvs={_UV: uvs},
    )


def _size(faces):
    """Pixels along a side of an image that has some for each face."""
    return next((size for size in (1024, 2048) if faces * _PIXELS <= size**2), texels.LARGEST)


def _key(context, copy, materials):
    """What the colors of an object depend on, but for the pixels of images."""
    mesh = copy.data
    found = hashlib.blake2b(digest_size=16)
    parts = [arrays.vertex_positions(mesh), arrays.mesh_corners(mesh), arrays.corner_counts(mesh)]
    parts += [arrays.material_indices(mesh), np.array(copy.matrix_world)]
    parts += [arrays.corner_uvs(layer) for layer in mesh.uv_layers]
    parts += [arrays.read_attribute(item) for item in mesh.color_attributes]
    for part in parts:
        found.update(np.ascontiguousarray(part).tobytes())
    for one in materials:
        found.update(b"" if one is None else object_looks.described_nodes(one).encode())
    return context.scene.frame_current, copy.name, found.digest()


def _depends_on_pixels(materials):
    return any(bare_colors.images_of(one.node_tree) for one in materials)


def _has_unsaved_pixels(materials):
    """Whether images were painted on that a file doesn't have yet."""
    return any(
        image.is_dirty for one in materials for image in bare_colors.images_of(one.node_tree)
    )


# --- The copy that is baked -----------------------------------------------------------------------


def _copy(context, obj, evaluated, created):
    """The object with a mesh of its own, which shows what is read, and nothing that moves it."""
    if evaluated is None:
        mesh = obj.data.copy()
    else:
        graph = context.evaluated_depsgraph_get()
        mesh = bpy.data.meshes.new_from_object(
            evaluated, preserve_all_data_layers=True, depsgraph=graph
        )
    created(mesh)
    copy = obj.copy()
    created(copy)
    copy.data = mesh
    copy.animation_data_clear()
    copy.modifiers.clear()
    copy.constraints.clear()
    copy.parent = None
    copy.matrix_world = obj.matrix_world
    if copy.data.shape_keys:
        copy.shape_key_clear()
    if evaluated is not None:
        _keep_generated(copy, obj.data)
    return copy


def _keep_generated(copy, before):
    """Generated coordinates are those of the mesh before its modifiers."""
    mesh = copy.data
    mesh.use_auto_texspace = False
    mesh.texspace_location = before.texspace_location
    mesh.texspace_size = before.texspace_size
    shown = arrays.vertex_positions(mesh)
    at_rest = arrays.basis_positions(before)
    if len(shown) != len(at_rest):
        return
    arrays.move_vertices(mesh, at_rest)
    copy.shape_key_add(name="Basis", from_mix=False)
    key = copy.shape_key_add(name="Shown", from_mix=False)
    arrays.write_key(key, shown)
    key.value = 1.0


def _dress(copy, uvs, image, materials, created):
    """Gives every slot a material that glows with its base color and is baked onto the image;
    black where there is None."""
    mesh = copy.data
    layer = arrays.write_uvs(mesh, _UV, uvs)
    if layer is None:
        raise pointmorph.CloudError(
            copy.name, "fewer than eight UV maps", "eight", "Remove one that isn't needed."
        )
    mesh.uv_layers.active = mesh.uv_layers[_UV]
    black = bare_colors.black(created)
    bare = {None: black}
    for material, slot in zip(materials, copy.material_slots, strict=True):
        if material not in bare:
            bare[material] = bare_colors.bare(material, created)
        slot.link = "OBJECT"
        slot.material = bare[material]
    for material in bare.values():
        nodes = material.node_tree.nodes
        nodes.active = nodes.new("ShaderNodeTexImage")
        nodes.active.image = image


def _bake(context, copy, created):
    try:
        color_bake.bake(context, copy, context.scene.frame_current, created)
    except TypeError:
        raise pointmorph.CloudError(
            "Cycles",
            "an enabled renderer, to bake colors",
            "a disabled one",
            "Enable it (Edit > Preferences > Add-ons > Cycles Render Engine).",
        ) from None
    except RuntimeError as error:
        raise _not_baked(copy.name, str(error).strip()) from None


def _bake_elsewhere_steps(context, copy, made):
    """The pixels, which another Blender bakes. Yields what it waits for."""
    name, frame = copy.name, str(context.scene.frame_current)
    with tempfile.TemporaryDirectory(dir=bpy.app.tempdir, ignore_cleanup_errors=True) as folder:
        asked, baked = (str(Path(folder, file)) for file in ("asked.blend", "baked.npy"))
        bpy.data.libraries.write(asked, {copy}, path_remap="ABSOLUTE")
        _remove(made)  # nothing of it is to be seen meanwhile
        made.clear()
        arguments = asked, name, frame, baked
        words = yield from other_blender.run_steps(color_bake.__file__, *arguments)
        if words is not None:
            raise _not_baked(name, words)
        return np.load(baked)


def _not_baked(name, why):
    return pointmorph.CloudError(name, "colors that Cycles bakes", why, "Bake them to an image.")


def _remove(made):
    for item in made:
        if isinstance(item, bpy.types.Object) and item.data.shape_keys:
            item.shape_key_clear()
    for scene in [item for item in made if isinstance(item, bpy.types.Scene)]:
        made.remove(scene)
        bpy.data.scenes.remove(scene)
    bpy.data.batch_remove(made)
