"""Base colors, alpha, roughness and normals that can't be read from a material's nodes one by one,
such as those of procedural textures: Cycles computes them, in a scene of its own, on an image that
has a place for every face."""

import hashlib
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pointmorph

from ..core import looks, texels, textures
from ..core.looks import Constant, ImageColor, Relief
from ..core.textures import Texture
from ..data import arrays, bare_colors, images, other_blender
from ..data.materials import Pictures
from ..data.references import find, reference_to
from . import color_bake, object_looks

_UV = "Pointmorph Baked"
_PIXELS = 16  # a face
_KEPT = 8
COLORS = ("color", "alpha")
SURFACE = ("roughness", "metallic")
RELIEF = ("relief",)
"""Parts of a Surface."""
_KINDS = {
    bare_colors.COLOR: ("color",),
    bare_colors.ALPHA: ("alpha",),
    bare_colors.SURFACE: SURFACE,
    bare_colors.RELIEF: RELIEF,
}
"""What is baked at once: a channel each, but for colors and normals."""

_known = {}
"""By what it depends on, what was baked last: Texture and UVs."""


def parts_for(options):
    """What of a target is baked to draw its look with these `Options`, or None."""
    if options is None:
        return COLORS
    return COLORS + SURFACE * options.roughness + RELIEF * options.normal


def needed_steps(context, obj, as_shown, parts):
    """Pictures to read an object's materials with, for which those are baked of which something
    can't be read otherwise. A generator that returns them, and yields words while another Blender
    bakes: see `stepping`.

    Parameters
    ----------
    as_shown : bool
        As the viewport shows it, else its own mesh.
    parts : collection of str
        COLORS, SURFACE, RELIEF.
    """
    baked, layout, why_not = {}, {}, ""
    for kind, kinds_parts in _KINDS.items():
        wanted = [part for part in kinds_parts if part in parts]
        evaluated = _evaluated(context, obj) if as_shown else None
        mesh = (obj if evaluated is None else evaluated).data
        if not object_looks.unread_materials(obj, mesh, wanted):
            continue
        made = []
        try:
            copy = _copy(context, obj, evaluated, made.append)
            baked[kind], layout[_UV] = yield from _baked_steps(context, copy, kind, wanted, made)
        except pointmorph.CloudError as error:
            why_not = str(error)
        finally:
            _remove(made)

    def nodes(material, part):
        kind = next(kind for kind, names in _KINDS.items() if part in names)
        texture, unread = baked.get(kind, (None, ()))
        # What the viewport shows has copies of the materials.
        if part not in parts or material.original not in unread:
            return None
        shown = ImageColor(texture, _UV, extension=textures.EXTEND, shrinks=False)
        if kind == bare_colors.RELIEF:
            return Relief(shown, Constant((1.0,) * 4), _UV)
        is_color = kind == bare_colors.COLOR
        return shown if is_color else looks.channel(shown, _KINDS[kind].index(part))

    return Pictures(nodes=nodes, uvs=layout, why_not=why_not)


def _evaluated(context, obj):
    return obj.evaluated_get(context.evaluated_depsgraph_get())


def _baked_steps(context, copy, kind, parts, made):
    """What was baked of a copy of an object, a Texture and the materials it's for, and its UVs.
    Removes what was made before it yields."""
    mesh = copy.data
    materials = object_looks.materials_of(copy, mesh)
    unread = object_looks.unread_materials(copy, mesh, parts)
    key = _key(context, copy, kind, [one in unread for one in materials], materials)
    if key not in _known or _depends_on_pixels(unread):
        counts = arrays.corner_counts(mesh)
        corners = arrays.vertex_positions(mesh)[arrays.mesh_corners(mesh)]
        uvs, owners = texels.lay_out(counts, texels.extents(corners, counts), _size(len(counts)))
        image = bpy.data.images.new(_UV, *owners.shape, alpha=True, float_buffer=True, is_data=True)
        made.append(image)
        image.generated_color = (0.0, 0.0, 0.0, 0.0)
        painted = _painted_images(unread)
        what = color_bake.NORMALS if kind == bare_colors.RELIEF else color_bake.GLOW
        is_here = other_blender.command() is None or not all(map(images.is_whole, painted))
        shown = [one if one in unread else None for one in materials]
        _dress(copy, uvs, image, shown, kind, made.append)
        if is_here:
            _show_paint(copy, painted, made.append)
            _bake(context, copy, what, made.append)
            baked = arrays.image_pixels(image)
        else:
            painted = [reference_to(image) for image in painted]
            baked = yield from _bake_elsewhere_steps(context, copy, what, painted, made)
        while len(_known) >= _KEPT:
            del _known[next(iter(_known))]
        _known[key] = _texture(baked, owners, kind == bare_colors.COLOR), uvs
    texture, uvs = _known[key]
    return (texture, unread), uvs


def _texture(baked, owners, is_color):
    # Not Blender's own margin: that mixes neighbors at the corners of faces.
    values = texels.filled(baked, baked[..., 3] > 0.0, owners)
    values = textures.to_srgb(values) if is_color else np.clip(values, 0.0, 1.0)
    values = (values * 255.0 + 0.5).astype(np.uint8)
    values[..., 3] = 255
    return Texture(_UV, values, is_srgb=is_color, is_solid=True)


def _size(faces):
    """Pixels along a side of an image that has some for each face."""
    return next((size for size in (1024, 2048) if faces * _PIXELS <= size**2), texels.LARGEST)


def _key(context, copy, kind, unread, materials):
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
    return context.scene.frame_current, copy.name, kind, *unread, found.digest()


def _depends_on_pixels(materials):
    return any(bare_colors.images_of(one.node_tree) for one in materials)


def _painted_images(materials):
    """The images with paint that no file has yet."""
    found = (image for one in materials for image in bare_colors.images_of(one.node_tree))
    return [image for image in dict.fromkeys(found) if image.is_dirty]


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


def _dress(copy, uvs, image, materials, kind, created):
    """Gives every slot a material that shows nothing but what is asked for and is baked onto the
    image; black where there is None."""
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
            bare[material] = bare_colors.bare(material, kind, created)
        slot.link = "OBJECT"
        slot.material = bare[material]
    for material in bare.values():
        nodes = material.node_tree.nodes
        nodes.active = nodes.new("ShaderNodeTexImage")
        nodes.active.image = image


def _show_paint(copy, painted, created):
    """Makes the materials of a copy show what was painted on images, not what files have of it."""
    instead = {}
    for image in filter(images.is_whole, painted):
        pixels = images.painted(image)
        if pixels is not None:
            instead[image] = color_bake.stand_in(image, pixels)
            created(instead[image])
    for slot in copy.material_slots:
        bare_colors.show_instead(slot.material.node_tree, instead, created)


def _bake(context, copy, what, created):
    try:
        color_bake.bake(context, copy, context.scene.frame_current, what, created)
    except TypeError:
        raise pointmorph.CloudError(
            "Cycles",
            "an enabled renderer, to bake colors",
            "a disabled one",
            "Enable it (Edit > Preferences > Add-ons > Cycles Render Engine).",
        ) from None
    except RuntimeError as error:
        raise _not_baked(copy.name, str(error).strip()) from None


def _bake_elsewhere_steps(context, copy, what, painted, made):
    """The pixels, which another Blender bakes, with what was `painted`, references to images.
    Yields what it waits for."""
    name, frame = copy.name, str(context.scene.frame_current)
    with tempfile.TemporaryDirectory(dir=bpy.app.tempdir, ignore_cleanup_errors=True) as folder:
        asked, baked = (str(Path(folder, file)) for file in ("asked.blend", "baked.npy"))
        bpy.data.libraries.write(asked, {copy}, path_remap="ABSOLUTE")
        _remove(made)  # nothing of it is to be seen meanwhile
        made.clear()
        for reference in painted:
            yield
            image = find(bpy.data.images, reference)
            pixels = None if image is None else images.painted(image)
            if pixels is not None:
                np.savez(Path(folder, f"{reference}.npz"), name=image.name, pixels=pixels)
        arguments = asked, name, frame, what, baked
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
