"""What modifiers and shape keys make of an object in the viewport, which a morph takes of the
target but not of the source."""

import bpy
import pointmorph

from ..data import creation


def left_out(obj):
    """What a morph leaves out of a source, in words: names of modifiers, and shape keys that show.
    Empty where the viewport shows the mesh itself."""
    if obj is None or obj.type != "MESH":
        return []
    names = [modifier.name for modifier in obj.modifiers if modifier.show_viewport]
    keys = obj.data.shape_keys
    if keys is not None and any(key.value and not key.mute for key in keys.key_blocks[1:]):
        names.append("shape keys")
    return names


def vertices_shown(view_layer, obj):
    """How many vertices the viewport shows of a mesh; None where that isn't known yet."""
    depsgraph = view_layer.depsgraph  # which isn't brought up to date: panels ask
    evaluated = None if depsgraph is None else obj.evaluated_get(depsgraph)
    if evaluated is None or not evaluated.is_evaluated or evaluated.type != "MESH":
        return None
    return len(evaluated.data.vertices)


def copy_as_shown(context, obj):
    """A copy of an object without modifiers and shape keys that looks the same, with materials,
    UV maps, weights and colors. The object itself is hidden.

    Raises
    ------
    CloudError
        When the viewport shows nothing of it.
    """
    depsgraph = context.evaluated_depsgraph_get()
    with creation.all_or_nothing() as created:
        mesh = bpy.data.meshes.new_from_object(
            obj.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
        )
        created(mesh)
        if not len(mesh.vertices):
            raise pointmorph.CloudError(
                obj.name, "vertices in the viewport", "none", "Enable it, or check its modifiers."
            )
        copy = obj.copy()
        created(copy)
        copy.modifiers.clear()
        copy.data = mesh
        copy.name = mesh.name = f"{obj.name} as Shown"
        for index, slot in enumerate(obj.material_slots):
            if slot.link == "OBJECT" and index < len(copy.material_slots):
                copy.material_slots[index].link = "OBJECT"
                copy.material_slots[index].material = slot.material
        creation.link(context, copy)
    obj.hide_set(True)
    if obj.is_editable:
        obj.hide_render = True
    return copy
