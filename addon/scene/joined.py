"""One mesh of what several objects show, so that a model of many parts morphs as a whole."""

from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np
import pointmorph
from mathutils import Matrix

from ..core import transforms
from ..data import arrays, creation
from . import as_shown, morph_object, shared_layers

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


@dataclass(frozen=True)
class _Movers:
    """What moves the parts of a model.

    Attributes
    ----------
    rig : Object or None
        The armature that alone does so, and can go on moving the mesh of all.
    bones : dict of Object to str
        By part, the bone that this is parented to, itself or what it's parented to.
    instead : str
        In words, what is to be done for a mesh that is moved, where something else moves them, too.
    """

    rig: bpy.types.Object | None
    bones: dict
    instead: str = ""

    @property
    def goes_on(self):
        """Whether the armature is in Rest Position, so that it would do nothing to the mesh now."""
        return self.rig is not None and self.rig.data.pose_position == "REST"

    @property
    def words(self):
        """The end of a sentence about the mesh."""
        if self.goes_on:
            return f', and "{self.rig.name}" moves it'
        if self.rig is not None:
            return (
                f', in their present pose. For a mesh that "{self.rig.name}" moves, undo, set that '
                "to Rest Position and join again"
            )
        return f", in their present pose. {self.instead}" if self.instead else ""


def join(context, chosen, lead):
    """A mesh of what the viewport shows of objects, of all that is parented to them or bent by
    them, and of the collections that they show; in the place of one of them, the `lead`. Those that
    are in it are hidden, and those that were hidden are so in renders, too. An armature in Rest
    Position goes on bending it.

    Returns
    -------
    Object
    int
        Of how many parts it is made.
    list of str
        The end of a sentence about how it moves, and what is to be said besides.

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
        movers = _movers_of(owners)
        parts = _parts(context, found, lead, movers, created)
        rendered, colors = shared_layers.share_uv_map(meshes), shared_layers.share_colors(meshes)
        joined = _joined(context, parts)
        for mesh in meshes[1:]:
            bpy.data.meshes.remove(mesh)
        if rendered is not None:
            shared_layers.render_uv_map(joined.data, rendered)
        if colors is not None:
            shared_layers.show_colors(joined.data, colors)
        joined.name = joined.data.name = creation.ending_in(lead.name, " Joined")
        joined.location = lead.matrix_world.translation
        context.scene.collection.objects.unlink(joined)
        as_shown.link_beside(context, lead, joined)
        if movers.goes_on:
            _bend(context, joined, movers.rig, owners)
        with context.temp_override(area=None):  # what only a local view leaves out isn't hidden
            unseen = [one for one in family if _is_only_rendered(one)]
        as_shown.hide_all(context, owners)
    said = [movers.words, *as_shown.still_rendered([*owners, *unseen])]
    return joined, len(found), said + _hide_in_renders(unseen)


def _is_only_rendered(obj):
    """Whether an object with a surface is hidden, itself or with its collections, and would be
    rendered beside the mesh of the others."""
    return obj.type in _TYPES and not obj.visible_get() and not obj.hide_render


def _hide_in_renders(objects):
    """Hides objects in renders where that's possible, and says so; a list, empty where none is."""
    objects = [one for one in objects if one.is_editable]
    if not objects:
        return []
    for one in objects:
        one.hide_render = True
    if len(objects) == 1:
        which = f'"{objects[0].name}", which was hidden, isn\'t in the mesh, and is'
    else:
        which = f"{len(objects)} objects, which were hidden, aren't in the mesh, and are"
    return [f"{which} now hidden in renders, too"]


def _parts(context, found, lead, movers, created):
    """Objects with the meshes that were read of others, around the place of the `lead`."""
    meshes = [mesh for mesh, _ in found]
    away = Matrix.Translation(-lead.matrix_world.translation)
    parts = []
    for mesh, owner in found:
        if not mesh.materials and any(other.materials for other in meshes):
            mesh.materials.append(None)  # else it would get the first one of another
        mesh.transform(away)
        part = bpy.data.objects.new("Part", mesh)
        created(part)
        context.scene.collection.objects.link(part)
        if movers.goes_on and (owner in movers.bones or not _is_bent(owner, movers.rig)):
            _weigh(part, movers.rig, movers.bones.get(owner))
        parts.append(part)
    return parts


def _movers_of(owners):
    """What moves the parts of a model."""
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
    if len(rigs) > 1:
        names = " and ".join(sorted(f'"{rig.name}"' for rig in rigs))
        return _Movers(
            None,
            {},
            f"{names} move them, and only one can move a mesh. For meshes that they move, undo and "
            "join the parts of each by themselves",
        )
    if not rigs:
        return _Movers(None, {})
    (rig,) = rigs
    for name in bones.values():
        bone = rig.data.bones.get(name)
        if bone is None:
            return _Movers(None, {}, f'"{rig.name}" has no bone "{name}" any longer')
        if not bone.use_deform:  # which can't move a part of a mesh
            return _Movers(
                None,
                {},
                f'For a mesh that "{rig.name}" moves, undo, turn on Deform for its bone "{name}" '
                "(Bone properties) and join again",
            )
    return _Movers(rig, bones)


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
        if not owner.visible_get():  # left out of the local view
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


def _joined(context, parts):
    """The first of some meshes, with all others in it, which are gone."""
    if len(parts) > 1:
        with context.temp_override(
            active_object=parts[0], object=parts[0], selected_editable_objects=parts
        ):
            bpy.ops.object.join()
    return parts[0]
