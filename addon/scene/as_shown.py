"""What modifiers and shape keys make of an object in the viewport. A morph starts from it: from a
copy where a mesh that morphs can't have them as well, because they would change the target, too."""

import contextlib

import bpy
import numpy as np
import pointmorph

from ..core.features import PREFIX, meant
from ..data import areas, arrays, creation
from ..data.feature_list import feature_groups
from . import morph_builder, morph_object, shape_reader

_KEPT = {
    "COLLISION",
    "DATA_TRANSFER",
    "EDGE_SPLIT",
    "NORMAL_EDIT",
    "PARTICLE_SYSTEM",
    "SURFACE",
    "TRIANGULATE",
    "UV_PROJECT",
    "UV_WARP",
    "VERTEX_WEIGHT_EDIT",
    "VERTEX_WEIGHT_MIX",
    "VERTEX_WEIGHT_PROXIMITY",
    "WEIGHTED_NORMAL",
}
"""Modifiers that leave the vertices where they are, on the target as well."""

_AT_REST = {
    "ARMATURE",
    "CAST",
    "CURVE",
    "DISPLACE",
    "HOOK",
    "LATTICE",
    "LAPLACIANDEFORM",
    "MESH_DEFORM",
    "NODES",
    "SIMPLE_DEFORM",
    "SURFACE_DEFORM",
    "WARP",
}
"""Modifiers that do nothing to the target either if they do nothing to the source now."""

_NOT_APPLIED = {"COLLISION", "PARTICLE_SYSTEM", "SURFACE"}
"""Modifiers that make no mesh that a copy could have."""

_ROUNDER = 0.01
"""Of the diagonal: how far Subdivision Surface may move vertices, on average, to stay. A ball of
162 vertices is moved by 0.006 and ends 0.005 from a head; one of 42 by 0.022, and 0.013 from it."""


def keeps_vertices(kinds):
    """Whether modifiers of these types leave a mesh its vertices, wherever these then are."""
    return kinds <= (_KEPT - {"EDGE_SPLIT"}) | (_AT_REST - {"NODES"})


def left_out(obj):
    """Names of what can make an object look different from its own mesh, in words: modifiers, shape
    keys that show, and a parent that bends it. Empty where the viewport shows the mesh itself."""
    if obj is None or obj.type != "MESH":
        return []
    names = [modifier.name for modifier in obj.modifiers if modifier.show_viewport]
    return names + _keys_that_show(obj) + _bending_parent(obj)


def is_changed_in_any_case(obj):
    """Whether more than what deforms it for now makes an object look different from its mesh."""
    return _what_shows(obj)[0]


def may_change(obj):
    """Whether any of these can make `changed_by` name something, for all that one can tell without
    looking."""
    return _what_shows(obj) != (False, False, False)


def _what_shows(obj):
    """Of a source: whether something in any case changes it so that its own mesh can't be morphed
    and keep it; whether something does so if it moves vertices now; and whether Subdivision Surface
    rounds it at the end, which may do so."""
    shown = [m.type for m in obj.modifiers if m.show_viewport and m.type not in _KEPT]
    rounds = bool(shown) and shown[-1] == "SUBSURF"
    while shown and shown[-1] == "SUBSURF":
        shown.pop()
    surely = bool(_keys_that_show(obj)) or any(kind not in _AT_REST for kind in shown)
    return surely, bool(shown or _bending_parent(obj)), rounds


def _bending_parent(obj):
    return [obj.parent.name] if obj.parent and obj.parent_type in {"ARMATURE", "LATTICE"} else []


def _keys_that_show(obj):
    keys = obj.data.shape_keys
    if keys is None:
        return []
    pinned = obj.show_only_shape_key and obj.active_shape_key_index > 0
    shown = any(key.value and not key.mute for key in keys.key_blocks[1:])
    return ["shape keys"] if pinned or (shown and not obj.show_only_shape_key) else []


def changed_by(context, obj):
    """What changes a source so that its own mesh can't be morphed and keep it, in words; empty
    where it can. The scene must be up to date."""
    if obj.type != "MESH" or morph_object.is_result(obj):
        return []
    if not obj.evaluated_get(context.evaluated_depsgraph_get()).is_evaluated:
        return []  # who reads it says why
    shown = [m for m in obj.modifiers if m.show_viewport and m.type not in _KEPT]
    names = [modifier.name for modifier in shown] + _keys_that_show(obj) + _bending_parent(obj)
    surely, if_it_moves, rounds = _what_shows(obj)
    if surely or (if_it_moves and _moved(context, obj, True, np.max) > 1e-5):
        return names
    return names if rounds and _moved(context, obj, False, np.mean) > _ROUNDER else []


def is_rigged(obj):
    """Whether an armature can bend an object."""
    by_parent = obj.parent is not None and obj.parent_type == "ARMATURE"
    return by_parent or any(m.type == "ARMATURE" and m.show_viewport for m in obj.modifiers)


def is_posed(obj):
    """Whether an armature, which isn't in Rest Position, bends an object."""
    return bool(posing(obj))


def posing(obj):
    """The armatures, none of which is in Rest Position, that bend an object."""
    rigs = {m.object for m in obj.modifiers if m.type == "ARMATURE" and m.show_viewport}
    if obj.parent_type == "ARMATURE":
        rigs.add(obj.parent)
    rigs.discard(None)
    return {r for r in rigs if r.type == "ARMATURE" and r.data.pose_position == "POSE"}


def pose_of(context, obj):
    """A short string that tells the poses in which armatures show an object; None for one that they
    don't move now. The scene must be up to date."""
    rigs = posing(obj)
    if not rigs:
        return None
    now = _places_shown(context, obj)
    with at_rest(context, rigs):
        rest = _places_shown(context, obj)
    room = 1e-5 * np.linalg.norm(np.ptp(rest, axis=0)) if len(rest) else 0.0
    is_moved = len(now) != len(rest) or (len(now) and np.abs(now - rest).max() > room)
    return arrays.digest(now) if is_moved else None


def _places_shown(context, obj):
    evaluated = shape_reader.evaluated_of(obj, context.evaluated_depsgraph_get())
    return arrays.positions_of(evaluated.data)


@contextlib.contextmanager
def at_rest(context, rigs):
    """Has armatures show what they bend in Rest Position meanwhile."""
    bones = {rig.data for rig in rigs}
    try:
        for one in bones:
            one.pose_position = "REST"
        context.view_layer.update()
        yield
    finally:
        for one in bones:
            one.pose_position = "POSE"
        context.view_layer.update()


def is_cache(modifier):
    """Whether a modifier puts vertices in places from a file, wherever they were before it."""
    return modifier.type == "MESH_SEQUENCE_CACHE" or (
        modifier.type == "MESH_CACHE" and modifier.deform_mode == "OVERWRITE"
    )


def has_cache(obj):
    """Whether an object has such a modifier."""
    return any(is_cache(modifier) for modifier in obj.modifiers)


def how_to_keep(obj, called):
    """In words: what makes a morph of an object, which is `called` something, that keeps what its
    copy as shown has applied."""
    if has_cache(obj):  # which would undo the morph
        return "show the morph as points or discs and turn on Follow"
    if is_posed(obj):  # with Keep Modifiers, the pose would be there twice
        return (
            f"set its armature to Rest Position, that of the target as well, choose {called} as "
            "the source and morph again"
        )
    return f"choose {called} as the source, turn on Keep Modifiers and morph again"


def posed_twice(context, source, target):
    """In words, that two characters are posed, the first of which is read at rest because its
    armature goes on bending it; None where they aren't. The scene must be up to date."""
    if not (is_posed(source) and is_posed(target)):
        return None
    if not (changed_by(context, source) and changed_by(context, target)):
        return None
    return (
        f'"{target.name}" was taken as it is posed now, and the armature of "{source.name}" poses '
        "it once more: set both armatures to Rest Position"
    )


def dropped_by(obj):
    """Names of modifiers that a copy can't have applied and goes without: particles, collisions."""
    return [modifier.name for modifier in obj.modifiers if modifier.type in _NOT_APPLIED]


def _moved(context, obj, alone, how):
    """How far an object's own vertices are moved, of its diagonal; 1 where these aren't there.

    Parameters
    ----------
    alone : bool
        Without the modifiers that leave vertices in place or round the mesh.
    how : callable
        What it takes of all vertices.
    """
    tried = obj
    if alone:
        tried = creation.copied(obj)
        context.scene.collection.objects.link(tried)
    try:
        for modifier in list(tried.modifiers) if alone else ():
            if modifier.type in _KEPT or modifier.type == "SUBSURF":
                tried.modifiers.remove(modifier)
        evaluated = tried.evaluated_get(context.evaluated_depsgraph_get())
        own, places = arrays.basis_positions(obj.data), arrays.vertex_positions(evaluated.data)
    finally:
        if alone:
            bpy.data.objects.remove(tried)
    if not len(own) or len(places) < len(own) or (alone and len(places) != len(own)):
        return 1.0
    diagonal = float(np.linalg.norm(np.ptp(own, axis=0)))
    away = np.linalg.norm(places[: len(own)] - own, axis=1)
    return float(how(away)) / diagonal if diagonal > 0 else 0.0


def is_taken_as_shown(view_layer, obj):
    """Whether a morph starts from a copy of a source, as far as panels can tell, which ask at every
    redraw: without making anything, and by the whole where a rig and Subdivision Surface both move
    the vertices. None where that isn't known yet."""
    surely, if_it_moves, rounds = _what_shows(obj)
    if surely or not (if_it_moves or rounds):
        return surely
    evaluated = _evaluated_in(view_layer, obj)
    if evaluated is None:
        return None
    own, places = arrays.basis_positions(obj.data), arrays.vertex_positions(evaluated.data)
    if not len(own) or len(places) < len(own):
        return True
    how, much = (np.mean, _ROUNDER) if rounds else (np.max, 1e-5)
    away = np.linalg.norm(places[: len(own)] - own, axis=1)
    return bool(how(away) > much * np.linalg.norm(np.ptp(own, axis=0)))


def vertices_shown(view_layer, obj):
    """How many vertices the viewport shows of a mesh; None where that isn't known yet."""
    evaluated = _evaluated_in(view_layer, obj)
    return None if evaluated is None else len(evaluated.data.vertices)


def _evaluated_in(view_layer, obj):
    depsgraph = view_layer.depsgraph  # which isn't brought up to date: panels ask
    evaluated = None if depsgraph is None else obj.evaluated_get(depsgraph)
    if evaluated is None or not evaluated.is_evaluated or evaluated.type != "MESH":
        return None
    return evaluated


def visibility_of(obj):
    """What `copy_as_shown` changes of an object in this view layer: whether it is hidden, left out
    of renders and selected."""
    return obj.hide_get(), obj.hide_render, obj.select_get()


def copy_as_shown(context, obj, hides=True):
    """A copy of an object without modifiers and shape keys that looks the same, with materials,
    UV maps, weights and colors. The object itself is hidden, if it `hides`.

    Raises
    ------
    CloudError
        When the viewport shows nothing of it.
    """
    with creation.all_or_nothing() as created:
        mesh = _mesh_as_shown(context, obj, created)
        copy = _copy(obj, mesh, created)
        if copy.parent_type in {"ARMATURE", "LATTICE"}:  # which would bend it once more
            copy.parent_type = "OBJECT"
        copy.name = mesh.name = creation.ending_in(obj.name, " as Shown")
        for index, slot in enumerate(obj.material_slots):
            if slot.link == "OBJECT" and index < len(copy.material_slots):
                copy.material_slots[index].link = "OBJECT"
                copy.material_slots[index].material = slot.material
        copy.pointmorph.shown_from = obj
        if obj.type == "MESH":
            _keep_points(obj, copy)
        link_beside(context, obj, copy)
        _put_at(context, obj, copy)
        note_form(copy)
    if hides:
        hide(context, obj)
    return copy


def renew(context, copy):
    """Gives a copy the form that its original has now, and returns the mesh that it had."""
    obj, before = copy.pointmorph.shown_from, copy.data
    with creation.all_or_nothing() as created:
        mesh = _mesh_as_shown(context, obj, created)
        mesh.name = creation.ending_in(obj.name, " as Shown")
        copy.data = mesh
        try:
            if obj.type == "MESH":
                _keep_points(obj, copy)
                for name in ("rigid_group", "fixed_group"):
                    setattr(copy.pointmorph, name, getattr(obj.pointmorph, name))
            _put_at(context, obj, copy)
            note_form(copy)
        except BaseException:
            copy.data = before
            raise
    hide(context, obj)
    return before


def put_back(context, copy, mesh, visibility):
    """Gives a copy the mesh that it had before `renew`, and shows its original as before."""
    now, copy.data = copy.data, mesh
    if not now.users:
        bpy.data.meshes.remove(now)
    note_form(copy)
    _show(context, copy.pointmorph.shown_from, visibility)


def note_form(copy):
    """Has a copy know what was made, which the user may change."""
    copy.pointmorph.shown_form = f"{_places_of(copy)} {_rest_of(copy)}"


def has_its_form(copy):
    """Whether a copy's vertices are where they were made. True where an earlier version made it."""
    return not copy.pointmorph.shown_form or (
        copy.pointmorph.shown_form.split()[0] == _places_of(copy)
    )


def is_as_made(copy):
    """Whether a copy is as it was made, in all that its mesh has but marks. False where an earlier
    version made it: that didn't note it."""
    return copy.pointmorph.shown_form == f"{_places_of(copy)} {_rest_of(copy)}"


def _places_of(copy):
    return arrays.digest(arrays.vertex_positions(copy.data))


def _rest_of(copy):
    mesh = copy.data
    kept = [a for a in mesh.attributes if not a.name.startswith(".") and arrays.is_read(a)]
    found = {a.name: arrays.read_attribute(a) for a in sorted(kept, key=lambda a: a.name)}
    names = {g.index: g.name for g in copy.vertex_groups if not g.name.startswith(PREFIX)}
    parts = [arrays.mesh_edges(mesh), arrays.mesh_corners(mesh)]
    for name, values in found.items():
        parts += [name.encode(), values]
    for name, weights in arrays.vertex_groups(mesh, names).items():
        parts += [name.encode(), *weights]
    return arrays.digest(*parts)


def _mesh_as_shown(context, obj, created):
    depsgraph = context.evaluated_depsgraph_get()
    evaluated = shape_reader.evaluated_of(obj, depsgraph)
    if not shape_reader.is_in(context.view_layer, obj):
        raise shape_reader.disabled(obj)
    mesh = bpy.data.meshes.new_from_object(
        evaluated, preserve_all_data_layers=True, depsgraph=depsgraph
    )
    created(mesh)
    if obj.type != "MESH" and not len(mesh.polygons):
        raise pointmorph.CloudError(obj.name, "faces in the viewport", "none", _advice(obj))
    if not len(mesh.vertices):
        raise shape_reader.nothing_shown(obj, depsgraph)
    return mesh


def _advice(obj):
    """What gives an object faces that is no mesh and shows none."""
    if obj.type == "META":  # those of a family are one surface, which the first one has
        family = bpy.data.objects.get(obj.name.partition(".")[0])
        if family not in (None, obj) and family.type == "META":
            return f'Choose "{family.name}", which shows the whole surface of these metaballs.'
    if obj.type in {"CURVE", "FONT"}:
        return "Extrude, bevel or fill the curve, or choose another object."
    return "Choose another object."


def link_beside(context, obj, copy):
    """Puts a copy into the collections of its original that are in this view layer."""
    in_layer = [context.view_layer.layer_collection]
    for layer in in_layer:
        in_layer += [child for child in layer.children if not child.exclude]
    there = {layer.collection for layer in in_layer}
    homes = [
        one
        for one in obj.users_collection
        if one in there and one.is_editable and one.override_library is None
    ]
    for one in homes:
        one.objects.link(copy)
    if not homes:
        creation.link(context, copy)
    areas.put_in_local_views(obj, copy)


def _put_at(context, obj, copy):
    """Constraints, animation and parents' vertices don't come along: a copy lies where they put its
    original now."""
    context.view_layer.update()
    if copy.matrix_world != obj.matrix_world:
        copy.matrix_world = obj.matrix_world.copy()
        context.view_layer.update()


def hide(context, obj):
    obj.hide_set(True, view_layer=context.view_layer)
    if obj.is_editable:
        obj.hide_render = True


def hide_all(context, objects):
    """Hides objects, or none of them."""
    before = [(obj, visibility_of(obj)) for obj in objects]
    try:
        for obj in objects:
            hide(context, obj)
    except BaseException:
        for obj, visibility in before:
            _show(context, obj, visibility)
        raise


def still_rendered(objects):
    """That some objects which are hidden are in renders nevertheless, in words; a list, empty where
    they aren't."""
    linked = [obj for obj in objects if not obj.is_editable and not obj.hide_render]
    if not linked:
        return []
    which = f'"{linked[0].name}" is' if len(linked) == 1 else f"{len(linked)} objects are"
    return [
        f"{which} linked from another file and can't be hidden in renders: make a library override "
        "(Object > Relations > Make Library Override) and turn off its camera icon"
    ]


def _show(context, original, visibility):
    if original is None:  # deleted meanwhile
        return
    hidden, not_rendered, selected = visibility
    with contextlib.suppress(RuntimeError):  # it isn't in this view layer any more
        original.hide_set(hidden, view_layer=context.view_layer)
        original.select_set(selected, view_layer=context.view_layer)
    if original.is_editable:
        original.hide_render = not_rendered


_PLACE = (
    "parent",
    "parent_type",
    "parent_bone",
    "matrix_parent_inverse",
    "rotation_mode",
    "matrix_basis",
    "delta_location",
    "delta_rotation_euler",
    "delta_rotation_quaternion",
    "delta_scale",
)
"""What says where an object lies."""


def _copy(obj, mesh, created):
    """An object with this mesh in the place of another, with all that this has besides modifiers,
    where both are meshes."""
    if obj.type != "MESH":
        copy = bpy.data.objects.new(obj.name, mesh)
        created(copy)
        for name in _PLACE:
            setattr(copy, name, getattr(obj, name))
        return copy
    copy = creation.copied(obj)
    # Its mesh is the original's until the new one is there: keys must not be removed with it.
    try:
        forget_morph(copy)
        _remove_modifiers(copy)
        copy.data = mesh
        copy.show_only_shape_key = False
    except BaseException:
        bpy.data.objects.remove(copy)
        raise
    created(copy)
    return copy


def _keep_points(obj, copy):
    """A feature of one vertex is one on the copy, too, where modifiers mirror or spread it; a path
    that they mirror is one path."""
    groups = {index: index for index in feature_groups(obj)}
    marked, spread = (arrays.vertex_groups(one.data, groups) for one in (obj, copy))
    edges = [arrays.mesh_edges(one.data) for one in (obj, copy)]
    for index, own in marked.items():
        rows = spread[index][0]
        kept = meant(own, edges[0], spread[index], edges[1])
        if len(kept[0]) < len(rows):
            group = copy.vertex_groups[index]
            group.remove(rows.tolist())
            for row, weight in zip(*kept, strict=True):
                group.add([int(row)], float(weight), "REPLACE")


def _remove_modifiers(copy):
    drivers = () if copy.animation_data is None else copy.animation_data.drivers
    for driver in [one for one in drivers if one.data_path.startswith("modifiers[")]:
        copy.animation_data.drivers.remove(driver)
    copy.modifiers.clear()


_OF_MORPH = (
    "source",
    "target",
    "source_matrix",
    "via",
    "made_from",
    "mesh",
    "keeps_faces",
    "is_preview",
    "follows",
    "recipe",
    "faces",
    "noted",
    "applied",
    "too_fine",
    "baked",
    "key_frames",
    "has_key_frames",
    "shown_before",
    "report",
)
"""What an object knows of the morph that it is."""


def forget_morph(obj):
    """Makes a morph, or a copy of one, an object like any other."""
    for name in _OF_MORPH:
        obj.pointmorph.property_unset(name)


def remove(context, copy, visibility):
    """Takes a copy away, and shows its original as before."""
    original = copy.pointmorph.shown_from
    morph_builder.remove(copy)
    _show(context, original, visibility)
