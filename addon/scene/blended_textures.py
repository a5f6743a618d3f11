"""The look of a morphing mesh: from the source's own to the target's, as it morphs."""

from dataclasses import asdict, replace

import bpy
import numpy as np
import pointmorph

from ..core.look_transfer import Canvas, Options, draw
from ..core.stepping import finish
from ..core.transforms import move_faces, move_positions
from ..data import arrays, creation, images, look_nodes, nodes
from . import (
    baked_colors,
    map_ends,
    morph_object,
    object_looks,
    path_display,
    recipes,
    stagger_nodes,
)
from .shape_reader import present_steps, read_own_steps, update

UV_NAME = "Pointmorph"
_AS_BEFORE = "The textures are still those of the old morph."
_COPY_OF = "pointmorph_copy_of"  # of a material: what it was copied from looked like, and itself
_COLOR = "pointmorph_viewport_color"  # of a material, before t drives it


def options_of(obj):
    """What a mesh's textures were blended with; None where they weren't."""
    known = recipes.recipe_of(obj).get("textures")
    return None if known is None else Options(**known)


def wanted(scene):
    """What a new morph's textures are blended with; None where they aren't to be."""
    settings = scene.pointmorph
    if not settings.blend_textures or settings.show_as != "MESH":
        return None
    # Normals take longer, and need more of the target than is read for the morph itself.
    return replace(chosen(settings), normal=False)


def is_first(obj):
    """Whether an object is a morphing mesh whose look nobody has decided about."""
    return obj.pointmorph.keeps_faces and "textures" not in recipes.recipe_of(obj)


def wanted_again(scene, obj):
    """The same for what shows a morph that is computed again."""
    return wanted(scene) if is_first(obj) else options_of(obj)


def chosen(settings):
    """The Options that the panel shows."""
    return Options(int(settings.texture_size), settings.texture_roughness, settings.texture_normal)


def read_steps(context, obj, options):
    """A generator that yields often, reads a morphing mesh and its target, and returns a function
    that draws the target's look on it, to be called with a progress in any thread.

    Raises
    ------
    CloudError
        When the mesh has no faces, or the target is gone, was changed since, or looks like nothing.
    """
    target = obj.pointmorph.target
    if not obj.data.polygons:
        raise pointmorph.CloudError(
            obj.name, "faces to draw on", "none", "Show the morph as points: they blend colors."
        )
    if not recipes.is_there(target):
        advice = "Undo the deletion, or morph again."
        raise recipes.gone_error(obj, -1, "its target", advice)
    steps = _read_steps(context, obj, target, options)
    return (yield from present_steps(context, [target], steps))


def _read_steps(context, obj, target, options):
    update(context, target)
    yield
    shape = yield from read_own_steps(
        context, target, True, options.normal, baked_colors.parts_for(options)
    )
    recipe = recipes.recipe_of(obj)
    if len(shape.positions) != recipe["points"][-1]:
        raise pointmorph.CloudError(
            target.name,
            f'the {recipe["points"][-1]:,} points "{obj.name}" was made from',
            f"{len(shape.positions):,} as shown in the viewport",
            "Recompute the morph first.",
        )
    model = shape.moved(np.reshape(recipe["shapes"][-1]["matrix"], (4, 4))).model()
    places = map_ends.places_of_target(obj)
    if places is not None and len(places) == len(model.positions):
        model = model.at(places)  # it may have another pose by now
    if not model.has_look:
        raise pointmorph.CloudError(
            target.name,
            "a material, an image or a color attribute",
            "none",
            "Add one, so that there is something to blend to.",
        )
    yield
    matrix = morph_object.source_matrix_of(obj)
    skin = object_looks.read_skin(obj, obj.data).moved(matrix)
    triangles = move_faces(matrix, arrays.mesh_triangles(obj.data))
    yield
    canvas = Canvas(triangles, skin, places_at_end(obj))
    return lambda progress: draw(canvas, model, options, progress)


def places_at_end(obj):
    """(N, 3): where the vertices of a morphing mesh are on the target, in the morph's frame."""
    matrix = morph_object.source_matrix_of(obj)
    return move_positions(matrix, arrays.key_positions(morph_object.last_key(obj)))


def again(context, obj, drawn=None):
    """Blends as before, to the target as it is now. Returns what went wrong, in words.

    Parameters
    ----------
    drawn : Drawn, optional
        If that was drawn already; it is drawn anew where the mesh has other UVs or options. A mesh
        that nobody has decided about takes it, too, if the scene's settings say so.
    """
    options = options_of(obj)
    first = drawn is not None and is_first(obj) and drawn.options == wanted(context.scene)
    if first:
        options = drawn.options
    if options is None:
        return []
    try:
        if drawn is None or drawn.options != options or not _fits(obj, drawn):
            draw_it = finish(read_steps(context, obj, options))
            drawn = draw_it(lambda stage, fraction: True)
        blend(obj, drawn)
    except pointmorph.PointmorphError as error:
        return [not_blended(obj, error) if first else f"{_AS_BEFORE} {error}"]
    return list(drawn.remarks) if first else []


def not_blended(obj, error):
    """In words."""
    return f'"{obj.name}" keeps the look of its source. {error}'


def _fits(obj, drawn):
    """Whether the images of a Drawn lie right on a mesh's present UV maps."""
    if drawn.layout is None or not drawn.uv_name:
        return True
    layer = obj.data.uv_layers.get(drawn.uv_name)
    return layer is not None and np.array_equal(arrays.corner_uvs(layer), drawn.layout)


def blend(obj, drawn):
    """Makes a morphing mesh look like its source at 0 and as drawn at the end. Its materials become
    copies that mix both.

    Raises
    ------
    CloudError
        When the object has other faces by now, or no room for a UV map.
    """
    mesh = obj.data
    if drawn.uvs is not None and len(drawn.uvs) != len(mesh.loops):
        raise pointmorph.CloudError(
            obj.name,
            "an object that doesn't change",
            "changes while it was being read",
            "Try again.",
        )
    uv, before = drawn.uv_name, _images_of(obj)
    mixed = _mixed_materials(obj)
    with creation.all_or_nothing() as created:
        if drawn.uvs is not None:
            uv = _write_layout(obj, drawn.uvs)
        made = _write_images(obj, drawn, created)
        for slot, material in _own_materials(obj, created):
            look_nodes.mix_in(material, drawn, made, uv, lambda *found: _drive(obj, *found))
            _drive_viewport_color(obj, material, drawn.mean)
            slot.material = material
    _remove_replaced(obj, mixed)
    _remove_unused(before)
    recipes.note(obj, "textures", asdict(drawn.options))
    obj.update_tag()


def unblend(obj):
    """Leaves a morphing mesh its source's own look."""
    before = _images_of(obj)
    for material in _mixed_materials(obj):
        _unmix(material)
    _remove_unused(before)
    _remove_layout(obj)
    recipes.note(obj, "textures", None)
    obj.update_tag()


def _mixed_materials(obj):
    """The object's materials that have a second look of its own."""
    found = {slot.material for slot in obj.material_slots if slot.material is not None}
    return [material for material in found if _is_mixed_here(obj, material)]


def _images_of(obj):
    return {image for m in _mixed_materials(obj) for image in look_nodes.images_of(m)}


def _remove_unused(known):
    bpy.data.batch_remove([image for image in known if image is not None and not image.users])


def _remove_replaced(obj, mixed):
    """Removes materials that nothing has any more; those in their place take their names."""
    unused = [material for material in mixed if not material.users]
    names = {material.name for material in unused}
    bpy.data.batch_remove(unused)
    for slot in obj.material_slots:
        name = slot.material.name.rpartition(".")[0]
        if name in names:
            slot.material.name = name


def _write_layout(obj, uvs):
    """The name of a UV map of the images' own."""
    mesh = obj.data
    before = object_looks.render_layer(mesh)
    before = None if before is None else before.name
    layer = arrays.write_uvs(mesh, UV_NAME, uvs)
    if layer is None:
        raise pointmorph.CloudError(
            obj.name, "fewer than eight UV maps", "eight", "Remove one that isn't needed."
        )
    name = layer.name
    if before is not None:
        mesh.uv_layers[before].active_render = True
    return name


def _remove_layout(obj):
    """Removes the UV map of the images' own, unless the source has one of this name or a material
    takes it."""
    source, layer = obj.pointmorph.source, obj.data.uv_layers.get(UV_NAME)
    if layer is None or source is None or UV_NAME in source.data.uv_layers:
        return
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    if not any(look_nodes.takes_uv_map(material, UV_NAME) for material in materials):
        obj.data.uv_layers.remove(layer)


def _write_images(obj, drawn, created):
    """By what they show, the images of a Drawn, in place of those that the object has."""
    values = {}
    if isinstance(drawn.color, np.ndarray):
        values["Color"] = drawn.color
    if isinstance(drawn.roughness, np.ndarray):
        shape = drawn.roughness.shape
        values["Surface"] = np.stack(
            [np.ones(shape), drawn.roughness, np.broadcast_to(drawn.metallic, shape)], axis=-1
        )
    if drawn.normal is not None:
        values["Normal"] = drawn.normal
    mixed = _mixed_materials(obj)
    found = {}
    for what, part in values.items():
        known = look_nodes.image_of(mixed[0], what) if mixed else None
        name = f"{obj.name} {what}"
        found[what] = images.write(name, part, created, what == "Color", known)
    return found


def _own_materials(obj, created):
    """For every material, a slot that gets a copy of its own, which shows the source's look, and
    that. A generator: the slot must be filled before the next."""
    if not obj.material_slots:
        obj.data.materials.append(None)
    own = {}
    for number, slot in enumerate(obj.material_slots):
        material = slot.material
        if material in own:
            slot.material = own[material]
            continue
        own[material] = _own_material(obj, material, _of_source(obj, number), created)
        yield slot, own[material]


def _of_source(obj, number):
    """The material that the source of a morphing mesh has in a slot, or None."""
    source = obj.pointmorph.source
    if source is None or number >= len(source.material_slots):
        return None
    return source.material_slots[number].material


def _own_material(obj, material, of_source, created):
    if material is None:
        active = arrays.active_colors(obj.data)
        color = "" if active is None else active.name
        return look_nodes.new_material(f"{obj.name} Look", color, created)
    if _is_mixed_here(obj, material):
        _unmix(material)
        if not _is_outdated(obj, material, of_source):
            return material
        material = of_source
    copy = material.copy()
    created(copy)
    copy.name = f"{material.name} to {obj.pointmorph.target.name}"
    if not look_nodes.has_nodes(copy):
        look_nodes.add_nodes(copy)
    if look_nodes.is_mixed(copy):  # by another object
        _unmix(copy)
    if material == of_source:
        prints = (object_looks.material_print(obj, one) for one in (material, copy))
        copy[_COPY_OF] = " ".join(prints)
    return copy


def _is_outdated(obj, material, of_source):
    """Whether the source has another look by now than the copy that a morphing mesh has, which
    nobody has changed."""
    if of_source is None or _COPY_OF not in material:
        return False
    before, own = material[_COPY_OF].split()
    return before != object_looks.material_print(
        obj, of_source
    ) and own == object_looks.material_print(obj, material)


def _is_mixed_here(obj, material):
    """Whether a material has the second look of this object, and not of one that it's a copy of."""
    if not look_nodes.has_nodes(material) or not look_nodes.is_mixed(material):
        return False
    key = obj.data.shape_keys
    return key in look_nodes.drivers_of(material)


def _unmix(material):
    look_nodes.unmix(material)
    if _COLOR in material:
        material.driver_remove("diffuse_color")
        material.diffuse_color = material[_COLOR]
        del material[_COLOR]


def _drive(obj, t, staggered):
    nodes.drive_output(t, morph_object.t_key(obj), _last(obj))
    modifier = path_display.modifier_of(obj)
    if modifier is not None:
        nodes.drive_switch(staggered, obj, modifier, stagger_nodes.STAGGER)


def _drive_viewport_color(obj, material, mean):
    """In Solid shading a mesh has the mean color, which goes along."""
    own = list(material.diffuse_color)
    material[_COLOR] = own
    for number, (start, end) in enumerate(zip(own, mean, strict=True)):
        curve = material.driver_add("diffuse_color", number)
        curve.driver.type = "SCRIPTED"
        nodes.drive(curve.driver, morph_object.t_key(obj))
        # Simple enough for Blender to compute without Python, also where scripts may not run.
        curve.driver.expression = f"{start:.5f} + {(end - start) / _last(obj):.5f} * t"


def _last(obj):
    """t at the end."""
    return len(obj.pointmorph.via) + 1
