"""One mesh of what several objects show, so that a model of many parts morphs as a whole."""

from functools import partial

import bpy
import numpy as np
import pointmorph
from mathutils import Matrix

from ..core import transforms
from ..data import arrays, creation
from . import as_shown, morph_object, object_looks

_TYPES = ("MESH", *arrays.MADE_TYPES)


def is_of_parts(obj):
    """Whether an object has no surface itself, but may stand for objects that have."""
    if obj.type == "EMPTY" and obj.instance_type == "COLLECTION":
        return True
    return obj.type in {"ARMATURE", "EMPTY"} and bool(obj.children)


def is_part(obj, shapes):
    """Whether an object, which is parented to another, belongs to what is seen of that: it has a
    surface, is none of the `shapes` that morph themselves, and is no morph."""
    return (
        obj.type in _TYPES
        and obj not in shapes
        and obj.visible_get()
        and not obj.pointmorph.keeps_faces
    )


def left_behind(context, obj, shapes):
    """In words, what is seen with an object and isn't morphed with it: objects with a surface that
    are parented to it, but to those `shapes` that are morphed; None where there are none."""
    objects = context.view_layer.objects
    parts = [one for one in objects if one.parent == obj and is_part(one, shapes)]
    if not parts:
        return None
    which = f'"{parts[0].name}"' if len(parts) == 1 else f"{len(parts)} objects"
    return (
        f'{which} parented to "{obj.name}" didn\'t morph with it. To morph all of it, undo, select '
        f'"{obj.name}", click Join Copies and morph the mesh that this makes'
    )


def join(context, chosen, lead):
    """A mesh of what the viewport shows of objects, of all that is parented to them or bent by
    them, and of the collections that they show; in the place of one of them, the `lead`. Those that
    are in it are hidden. An armature in Rest Position goes on bending it.

    Returns
    -------
    Object
    int
        Of how many parts it is made.
    Object or None
        The armature that moves them; the mesh is parented to it if that is in Rest Position.

    Raises
    ------
    CloudError
        When they show no faces, or only those of a single mesh.
    """
    family = _family(context, chosen)
    with creation.all_or_nothing() as created:
        found = _read(context, family, created)
        owners = list(dict.fromkeys(owner for _, owner in found))
        if not found or (len(found) == 1 and owners == list(chosen)):
            raise pointmorph.CloudError(
                lead.name,
                "several objects with faces",
                "one" if found else "none",
                "Select the others as well, or the object that they are parented to.",
            )
        meshes = [mesh for mesh, _ in found]
        rendered = _share_uv_map(meshes)
        for mesh in meshes:
            if not mesh.materials and any(other.materials for other in meshes):
                mesh.materials.append(None)  # else it would get the first one of another
        origin = lead.matrix_world.translation.copy()
        for mesh in meshes:
            mesh.transform(Matrix.Translation(-origin))
        parts = [bpy.data.objects.new(f"{lead.name} Joined", mesh) for mesh in meshes]
        for part in parts:
            created(part)
            context.scene.collection.objects.link(part)
        rig, bones = _rig_of(owners)
        goes_on = rig is not None and rig.data.pose_position == "REST"
        for part, (_, owner) in zip(parts, found, strict=True):
            if goes_on and (owner in bones or not _is_bent(owner, rig)):
                _weigh(part, rig, bones.get(owner))
    joined = _joined(context, parts)
    for mesh in meshes[1:]:
        bpy.data.meshes.remove(mesh)
    if rendered is not None:
        _render_uv_map(joined.data, rendered)
    joined.name = joined.data.name = f"{lead.name} Joined"
    joined.location = origin
    context.scene.collection.objects.unlink(joined)
    as_shown.link_beside(context, lead, joined)
    if goes_on:
        _bend(context, joined, rig, owners)
    for owner in owners:
        as_shown.hide(context, owner)
    return joined, len(found), rig


def _rig_of(owners):
    """The armature that moves all parts that one moves, or None; and by part, the name of the bone
    that this is parented to, itself or what it's parented to."""
    rigs, bones = set(), {}
    for owner in owners:
        rigs |= {m.object for m in owner.modifiers if m.type == "ARMATURE" and m.show_viewport}
        one = owner
        while one.parent is not None:
            if one.parent.type == "ARMATURE" and one.parent_type == "ARMATURE":
                rigs.add(one.parent)
            elif one.parent.type == "ARMATURE" and one.parent_type == "BONE":
                rigs.add(one.parent)
                bones.setdefault(owner, one.parent_bone)
            one = one.parent
    rigs.discard(None)
    if len(rigs) != 1:
        return None, {}
    (rig,) = rigs
    known = [rig.data.bones.get(name) for name in bones.values()]
    if any(bone is None or not bone.use_deform for bone in known):
        return None, {}  # a bone that bends nothing can't move a part of a mesh
    return rig, bones


def _is_bent(owner, rig):
    """Whether an armature bends a part by its vertex groups."""
    by_parent = owner.parent == rig and owner.parent_type == "ARMATURE"
    return by_parent or any(
        m.type == "ARMATURE" and m.show_viewport and m.object == rig for m in owner.modifiers
    )


def _weigh(part, rig, bone):
    """Has a bone, or none, move all of a part, whatever groups with names of bones it has."""
    for group in list(part.vertex_groups):
        if group.name in rig.data.bones:
            part.vertex_groups.remove(group)
    if bone is not None:
        part.vertex_groups.new(name=bone).add(range(len(part.data.vertices)), 1.0, "REPLACE")


def _bend(context, obj, rig, owners):
    """Has an armature in Rest Position move an object from now on, as it bent the parts."""
    bending = [m for one in owners for m in one.modifiers if m.type == "ARMATURE"]
    keeps_volume = bool(bending) and all(m.use_deform_preserve_volume for m in bending)
    context.view_layer.update()
    placed = obj.matrix_world.copy()
    obj.parent = rig
    obj.matrix_world = placed
    modifier = obj.modifiers.new("Armature", "ARMATURE")
    modifier.object, modifier.use_deform_preserve_volume = rig, keeps_volume


def _family(context, chosen):
    """Objects, and all but morphs that is parented to them or bent by one of them."""
    known, found = set(chosen), set(chosen)
    for one in context.view_layer.objects:
        bent_by = {m.object for m in one.modifiers if m.type in {"ARMATURE", "LATTICE"}}
        above = one.parent
        while above is not None and above not in known:
            above = above.parent
        if morph_object.is_made(one):
            continue  # the source's rig moves it, too
        if one not in known and (above is not None or bent_by & set(chosen)):
            found.add(one)
    return found


def _read(context, family, created):
    """What the viewport shows of these objects, as meshes in the world, each with the
    object that shows it."""
    depsgraph = context.evaluated_depsgraph_get()
    found = []
    for obj, matrix, owner in _shown(depsgraph, family):  # before there are new ones
        mesh = bpy.data.meshes.new_from_object(
            obj.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
        )
        created(mesh)
        if len(mesh.polygons):
            _take_materials(mesh, obj)
            _move(mesh, matrix)
            found.append((mesh, owner))
    return found


def _shown(depsgraph, family):
    """Objects that have a surface, where they are seen, and which of a family shows each."""
    found = []
    for shown in depsgraph.object_instances:
        obj = shown.object.original
        owner = shown.parent.original if shown.is_instance else obj
        if owner not in family or shown.object.type not in _TYPES:
            continue
        if obj.evaluated_get(depsgraph) == shown.object:
            if shown.is_instance or shown.show_self:
                found.append((obj, shown.matrix_world.copy(), owner))
        elif obj.type == "MESH":  # else it is the surface of a curve or text itself
            raise pointmorph.CloudError(
                obj.name,
                "a mesh in the viewport",
                "instances",
                'Add the node "Realize Instances" at the end of its Geometry Nodes.',
            )
    return found


def _take_materials(mesh, obj):
    """Materials that an object has in place of those of its data."""
    for index, slot in enumerate(obj.material_slots):
        if slot.link == "OBJECT" and index < len(mesh.materials):
            mesh.materials[index] = slot.material


def _move(mesh, matrix):
    """Takes a mesh through a matrix; faces show the same side, with the same shading."""
    is_flat = abs(matrix.determinant()) < 1e-30  # what it flattens has the normals of its faces
    bent = not is_flat and not transforms.keeps_angles(matrix) and arrays.keep_normals(mesh)
    corners = arrays.mesh_corners(mesh)
    mesh.transform(matrix)
    if transforms.is_mirrored(matrix) and np.array_equal(arrays.mesh_corners(mesh), corners):
        mesh.flip_normals()
    if bent:
        arrays.give_normals_back(mesh, partial(transforms.move_normals, np.array(matrix)))


def _share_uv_map(meshes):
    """Gives the UV map that is rendered one name on all meshes, and returns it: joined, they have
    one that is. None where no mesh has one."""
    rendered = [(mesh, object_looks.render_layer(mesh)) for mesh in meshes]
    rendered = [(mesh, layer) for mesh, layer in rendered if layer is not None]
    names, name = [layer.name for _, layer in rendered], None
    for name in (*names, *(f"{name} Rendered" for name in names)):
        # Where it is another map's, materials go on naming that.
        if all(layer.name == name or name not in mesh.uv_layers for mesh, layer in rendered):
            break
    for mesh, layer in rendered:
        if name not in mesh.uv_layers:
            arrays.write_uvs(mesh, name, arrays.corner_uvs(layer))
    return name


def _render_uv_map(mesh, name):
    """Has a mesh render a UV map: joined, it may have another one of its parts'."""
    if name in mesh.uv_layers:
        mesh.uv_layers[name].active_render = True
        mesh.uv_layers.active = mesh.uv_layers[name]


def _joined(context, parts):
    """The first of some meshes, with all others in it, which are gone."""
    if len(parts) > 1:
        with context.temp_override(
            active_object=parts[0], object=parts[0], selected_editable_objects=parts
        ):
            bpy.ops.object.join()
    return parts[0]
