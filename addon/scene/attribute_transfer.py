"""What the target has, brought over along the map: colors, weights, UV maps, shape keys, hair; and
the source's weights to the target."""

import json
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import bpy
import numpy as np
import pointmorph

from ..core import remembered
from ..core.stepping import finish
from ..core.transfer_words import listed
from ..data import arrays, attribute_names, creation, nodes, versions
from . import (
    hair_transfer,
    key_transfer,
    map_ends,
    morph_object,
    points_display,
    recipes,
    vertex_groups,
)
from .shape_reader import is_plain, present_steps, update

NAME = "Pointmorph Colors"
MODIFIER = "Colors"
_READ = "Pointmorph target, while it is read"
_OWN = "pointmorph_transferred"
"""On a source, names of what it got, as JSON: its copies have it, too."""
_NOTES = {False: recipes.TRANSFERRED, True: "transferred_to_source"}
_KINDS = {
    "colors": "color attribute",
    "weights": "vertex group",
    "uvs": "UV map",
    "keys": "shape key",
    "hair": "hair object",
}
"""By what is wanted, what it is called in words."""


@dataclass(frozen=True)
class Wanted:
    """What is brought over, and what goes before its names.

    `back` is for the source's weights, on the target. `onto_source` is for the source itself
    instead of what shows the morph. Recipes of earlier versions have the fields in this order.
    """

    colors: bool
    weights: bool
    uvs: bool
    prefix: str
    keys: bool = False
    hair: bool = False
    back: bool = False
    onto_source: bool = False

    @property
    def back_prefix(self):
        """What goes before the names of the source's weights on the target."""
        return self.prefix.replace("target", "source")


@dataclass
class Found:
    """What the target has, or what became of it along the map.

    Attributes
    ----------
    rows : list of (kind, name, values)
        The values by vertex or by corner.
    keys : list of key_transfer.Key
    hair : list of hair_transfer.Hair or hair_transfer.CarriedHair
    back : list of (name, values)
        Weights of the source, or for the target.
    remarks : list of str
        What isn't as one might expect, in words.
    """

    rows: list = field(default_factory=list)
    keys: list = field(default_factory=list)
    hair: list = field(default_factory=list)
    back: list = field(default_factory=list)
    remarks: list = field(default_factory=list)


def again(context, obj):
    """Brings over what was brought over before, from the target as it is now; to the object alone,
    not to the target. Returns what went wrong, in words."""
    words, wrong = [], []
    for wanted in _all_wanted(obj):
        try:
            carry = finish(read_steps(context, obj, wanted))
            found = carry(lambda stage, fraction: True)
            for said in write(context, obj, wanted, found):
                words += said
        except pointmorph.PointmorphError as error:
            wrong.append(f"Transferred attributes are still those of the old morph. {error}")
    if words:
        note = recipes.recipe_of(obj)[_NOTES[False]]
        recipes.note(obj, _NOTES[False], {**note, "words": words})
    return wrong


def _all_wanted(obj):
    """What was brought over to an object, by prefix: a list of Wanted."""
    note = recipes.recipe_of(obj).get(_NOTES[False])
    if note is None:
        return []
    if "kinds" not in note:  # of an earlier version
        return [replace(Wanted(*note["options"]), back=False)]
    return [
        Wanted(prefix=prefix, **{what: bool(names.get(kind)) for what, kind in _KINDS.items()})
        for prefix, names in note["kinds"].items()
        if any(names.values())
    ]


def words_of(obj):
    """What was transferred to an object, or to its source, at last: a list of sentences."""
    recipe = recipes.recipe_of(obj)
    return [line for note in _NOTES.values() for line in recipe.get(note, {}).get("words", ())]


def _own_names(receiver):
    """Names of what was transferred to an object that morphs were made from."""
    kept = receiver.get(_OWN)
    return (remembered.names(kept) if isinstance(kept, str) else None) or []


def _existing(obj, kinds):
    """Of names by kind, those that an object still has."""
    keys = obj.data.shape_keys
    there = dict.fromkeys(_KINDS.values(), obj.data.attributes)
    there["vertex group"] = obj.vertex_groups
    there["shape key"] = keys.key_blocks if keys is not None else ()
    hair = kinds.get("hair object", ())
    there["hair object"] = hair if hair_transfer.made_on(obj) else ()  # it may be renamed
    found = {kind: [n for n in names if n in there[kind]] for kind, names in kinds.items()}
    return {kind: names for kind, names in found.items() if names}


# --- Reading --------------------------------------------------------------------------------------


def read_steps(context, obj, wanted):
    """A generator that yields often, reads what the target has, and returns a function that takes
    it along the map, to be called with a progress in any thread: it returns what `write` takes.

    Raises
    ------
    CloudError
        When the target is gone, was changed since, or has none of what is asked for.
    """
    target = _unchanged_target(obj)
    steps = _read_target_steps(context, obj, target, wanted)
    return (yield from present_steps(context, [target], steps))


def _unchanged_target(obj):
    target = obj.pointmorph.target
    if target is None:
        advice = "Undo the deletion, or morph again."
        raise recipes.gone_error(obj, -1, "its target", advice)
    if target.type != "MESH":
        raise pointmorph.CloudError(
            target.name,
            "a mesh to transfer attributes from",
            f"an object of type {arrays.type_name(target)}",
            "Its colors and radii are already part of the morph.",
        )
    return target


def _read_target_steps(context, obj, target, wanted):
    update(context, target)
    yield
    with _as_shown(context, target) as mesh:
        yield
        return (yield from _read_mesh_steps(context, obj, (target, mesh), wanted))


@contextmanager
def _as_shown(context, target):
    """The mesh that the viewport shows, which stays while Blender goes on."""
    if is_plain(target):
        yield target.data
        return
    depsgraph = context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(
        target.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
    )
    mesh.name = _READ
    name = mesh.name
    try:
        yield mesh
    finally:
        # By name: undo may have removed it.
        mesh = bpy.data.meshes.get(name)
        if mesh is not None:
            bpy.data.meshes.remove(mesh)


def _read_mesh_steps(context, obj, shapes, wanted):
    target, mesh = shapes
    rows = morph_object.stage_rows(obj)[-1] if morph_object.is_result(obj) else None
    count = int(rows.max()) + 1 if rows is not None else recipes.recipe_of(obj)["points"][-1]
    if len(mesh.vertices) != count:
        raise pointmorph.CloudError(
            target.name,
            f'the {count:,} points "{obj.name}" was made from',
            f"{len(mesh.vertices):,} as shown in the viewport",
            "Recompute the morph first.",
        )
    by_pairs = rows is not None and not wanted.onto_source
    receiver = None if by_pairs else map_ends.read_receiver(obj, wanted.onto_source)
    yield
    shown = map_ends.read_giver(obj, mesh)
    yield
    found = Found()
    yield from _read_attributes_steps(found, obj, target, mesh, wanted)
    if wanted.uvs or (not by_pairs and _needs_uvs(obj, target, wanted)):
        _read_uvs(found, mesh, as_points=by_pairs or receiver.triangles is None)
        yield
    own = shown
    if wanted.keys or wanted.hair or wanted.back:
        matrix = map_ends.target_matrix(obj)
        own = map_ends.read_unmodified_giver(context, matrix, target, shown)
        yield from _read_more_steps(found, obj, target, wanted, by_pairs)
    if len(mesh.vertices) != count:
        raise pointmorph.CloudError(
            target.name,
            "a mesh that doesn't change",
            "changes while it was being read",
            "Try again.",
        )
    if not (found.rows or found.keys or found.hair or found.back):
        raise pointmorph.CloudError(
            target.name,
            "any of the chosen attributes",
            "; ".join(["none", *found.remarks]),
            "Choose attributes that it has.",
        )
    if by_pairs:
        return _carry_by_pairs(found, morph_object.stage_rows(obj))
    return _carry_along_map(found, receiver, (shown, own), not wanted.onto_source)


def _needs_uvs(obj, target, wanted):
    """Whether there is hair that needs a UV map which the object that gets it hasn't got."""
    if not wanted.hair or not hair_transfer.on_surface(target):
        return False
    receiver = map_ends.source_of(obj) if wanted.onto_source else obj
    return not receiver.data.uv_layers


def _read_attributes_steps(found, obj, target, mesh, wanted):
    """Colors and weights, which vertices have; active colors first."""
    if wanted.colors:
        active = mesh.color_attributes.active_color
        for item in sorted(mesh.color_attributes, key=lambda item: item != active):
            found.rows.append(("color attribute", item.name, arrays.vertex_colors(mesh, item)))
            yield
    if wanted.weights:
        without = _transferred_back(obj)
        weights = yield from vertex_groups.read_steps(target, mesh, wanted.back_prefix, without)
        found.rows += [("vertex group", name, values) for name, values in weights]


def _transferred_back(obj):
    """Names of vertex groups that the target of an object got from the source."""
    recipe = recipes.recipe_of(obj)
    return {name for note in _NOTES.values() for name in recipe.get(note, {}).get("back", ())}


def _read_uvs(found, mesh, as_points):
    for layer in mesh.uv_layers:
        uv = arrays.corner_uvs(layer)
        if as_points:
            uv = arrays.first_of_corners(mesh, uv)
        found.rows.append(("UV map", layer.name, uv))


def _read_more_steps(found, obj, target, wanted, by_pairs):
    """Shape keys, hair, and the source's weights."""
    if (wanted.keys or wanted.hair) and by_pairs:
        if target.data.shape_keys or hair_transfer.on_surface(target):
            found.remarks.append("Shape keys and hair need faces: show the morph as a mesh first")
    elif wanted.keys or wanted.hair:
        matrix = map_ends.target_matrix(obj)
        if wanted.keys:
            groups = key_transfer.limiting_groups(target)
            weights = yield from arrays.vertex_group_steps(target.data, groups)
            found.keys = key_transfer.read(target, matrix, weights)
            yield
        if wanted.hair:
            found.hair = hair_transfer.read(target, matrix)
            yield
    if wanted.back:
        map_ends.target_of(obj)
        source = map_ends.source_of(obj)
        without = set(_own_names(source))
        found.back = yield from vertex_groups.read_steps(
            source, source.data, wanted.prefix, without
        )


# --- Along the map --------------------------------------------------------------------------------


def _parts(progress, found):
    """What there is, one after the other; raises Cancelled when `progress` says so."""
    total = max(sum(len(part) for part in (found.rows, found.keys, found.hair, found.back)), 1)
    done = 0
    for what in ("rows", "keys", "hair", "back"):
        for part in getattr(found, what):
            if progress("carrying", done / total) is False:
                raise pointmorph.Cancelled("The transfer was canceled.")
            yield what, part
            done += 1


def _carry_by_pairs(found, rows):
    """To the pairs of a morph object: each has a vertex of both shapes."""

    def carry(progress):
        result = Found(remarks=found.remarks)
        for what, part in _parts(progress, found):
            if what == "rows":
                kind, name, values = part
                result.rows.append((kind, name, values[rows[-1]]))
            else:
                name, values = part
                count = np.maximum(np.bincount(rows[-1]), 1)
                mean = np.bincount(rows[-1], values[rows[0], 0]) / count
                result.back.append((name, mean[:, None].astype(np.float32)))
        return result

    return carry


def _carry_along_map(found, receiver, givers, ends_as_target):
    """To a mesh with faces: each vertex gets what is at the place where it lands.

    `givers` are the target as the viewport shows it, and with its own vertices.
    """

    def carry(progress):
        progress("carrying", 0.0)
        ends = receiver.positions, receiver.landing
        carriers = [
            pointmorph.Carrier(*ends, giver.positions, receiver.triangles, giver.triangles)
            for giver in givers
        ]
        shown, own = carriers if givers[1] is not givers[0] else (carriers[0], carriers[0])
        result = Found(remarks=list(found.remarks))
        for what, part in _parts(progress, found):
            if what == "keys":
                result.keys.append(key_transfer.carried(part, own, receiver.own, ends_as_target))
            elif what == "hair":
                result.hair.append(hair_transfer.carried(part, own, receiver))
            elif what == "back":
                name, values = part
                result.back.append((name, own.returned(values).astype(np.float32)))
            elif part[0] == "UV map" and receiver.triangles is not None:
                result.rows.append(_carry_uvs(part, shown, (receiver, givers[0]), result.remarks))
            else:
                kind, name, values = part
                result.rows.append((kind, name, shown.values(values).astype(np.float32)))
        return result

    return carry


def _carry_uvs(part, carrier, ends, remarks):
    kind, name, values = part
    receiver, giver = ends
    uvs, across = carrier.corner_values(values, giver.loops, receiver.corners, receiver.faces)
    if len(across):
        faces = int(receiver.faces[-1]) + 1
        remarks.append(
            f'{len(across):,} of {faces:,} faces lie across a seam of the UV map "{name}": '
            "their texture is squeezed at the seam"
        )
    return kind, name, uvs.astype(np.float32)


# --- Writing --------------------------------------------------------------------------------------


def write(context, obj, wanted, found):
    """Puts what was taken along the map onto a morph object, a copy of the source, or the source,
    each under its own name after a prefix. A copy shows colors from those of the source to the
    target's.

    Returns
    -------
    (list of str, list of str)
        What was done, and what couldn't be, in sentences.

    Raises
    ------
    CloudError
        When the object has something of such a name of its own, or other points by now.
    """
    receiver = map_ends.source_of(obj) if wanted.onto_source else obj
    target = map_ends.target_of(obj) if found.back else obj.pointmorph.target
    note = recipes.recipe_of(obj).get(_NOTES[wanted.onto_source], {})
    _check_counts(receiver, target, found)
    _check_names(receiver, target, wanted, found, note)
    prefix = wanted.prefix
    remarks = list(found.remarks)
    made = {}  # names by kind
    for kind, name, values in found.rows:
        if kind == "vertex group":
            vertex_groups.write(receiver, prefix + name, values[:, 0])
        elif kind == "UV map" and len(receiver.data.polygons):
            if not _write_uvs(receiver.data, prefix + name, values):
                remarks.append(f'"{receiver.name}" has no room for the UV map "{prefix + name}"')
                continue
        else:
            arrays.write_attribute(receiver.data, prefix + name, values)
        made.setdefault(kind, []).append(prefix + name)
    ends = []  # names of second keys
    t = None
    if found.keys and not wanted.onto_source:
        t = morph_object.t_key(obj), len(obj.pointmorph.via) + 1
    for key in found.keys:
        ends += key_transfer.write(receiver, prefix + key.name, key, t)[1:]
        made.setdefault("shape key", []).append(prefix + key.name)
    for hair in found.hair:
        ends_of = receiver, obj.pointmorph.target
        one = hair_transfer.write(context, ends_of, prefix, hair, not wanted.onto_source)
        if not one.data.surface_uv_map:
            remarks.append(f'"{one.name}" isn\'t attached: "{receiver.name}" has no UV map')
        made.setdefault("hair object", []).append(one.name)
    if obj.pointmorph.keeps_faces and wanted.colors and not wanted.onto_source:
        first = next((name for kind, name, _ in found.rows if kind == "color attribute"), None)
        if first is not None:
            _blend_colors(obj, prefix + first)
    words = [listed(f'To "{receiver.name}"', made)] if made else []
    back = [wanted.back_prefix + name for name, _ in found.back]
    for name, values in found.back:
        vertex_groups.write(target, wanted.back_prefix + name, values[:, 0])
    if back:
        words.append(listed(f'To "{target.name}"', {"vertex group": back}))
    receiver.update_tag()
    made.setdefault("shape key", []).extend(ends)
    _remember(obj, receiver, wanted, made, (back, words + remarks))
    return words, remarks


def _remember(obj, receiver, wanted, made, told):
    """Notes what an object has of a target by now: what was just made, and of what was made before,
    what is still there."""
    name = _NOTES[wanted.onto_source]
    note = recipes.recipe_of(obj).get(name, {})
    back, words = told
    kinds = {prefix: _existing(receiver, names) for prefix, names in note.get("kinds", {}).items()}
    own = kinds.setdefault(wanted.prefix, {})
    for kind, names in made.items():
        own[kind] = list(dict.fromkeys([*own.get(kind, ()), *names]))
    names = list(
        dict.fromkeys(
            one
            for of_kind in kinds.values()
            for kind, names in of_kind.items()
            if kind != _KINDS["hair"]
            for one in names
        )
    )
    back = list(dict.fromkeys([*note.get("back", ()), *back]))
    recipes.note(obj, name, {"names": names, "kinds": kinds, "back": back, "words": words})
    if wanted.onto_source:
        before = _own_names(receiver)
        receiver[_OWN] = json.dumps(list(dict.fromkeys([*before, *names])))
    elif morph_object.is_result(obj):
        points_display.keep_transferred(obj, morph_object.stages(obj))


def _check_counts(receiver, target, found):
    map_ends.check_mode(receiver)
    vertices, corners = len(receiver.data.vertices), len(receiver.data.loops)
    fits = all(
        len(values) == (corners if kind == "UV map" and corners else vertices)
        for kind, _, values in found.rows
    )
    fits = fits and all(len(key.offsets) == vertices for key in found.keys)
    fits = fits and all(len(values) == len(target.data.vertices) for _, values in found.back)
    loops = [hair.loops for hair in found.hair if hair.loops is not None and len(hair.loops)]
    fits = fits and all(rows.max() < corners for rows in loops)
    changed = next((hair for hair in found.hair if not hair_transfer.is_as_read(hair)), None)
    if changed is not None or not fits:
        raise pointmorph.CloudError(
            receiver.name if changed is None else changed.name,
            "an object that doesn't change",
            "changes while it was being read",
            "Try again.",
        )


def _check_names(receiver, target, wanted, found, note):
    keys = receiver.data.shape_keys
    taken = {group.name for group in receiver.vertex_groups}
    taken |= {attribute.name for attribute in receiver.data.attributes}
    known = {*note.get("names", ()), *_own_names(receiver)}
    taken -= known
    taken_keys = {key.name for key in keys.key_blocks} if keys is not None else set()
    taken_keys -= known
    back = {group.name for group in target.vertex_groups} if found.back else set()
    back -= set(note.get("back", ()))
    wishes = [(receiver, kind, wanted.prefix + name, taken) for kind, name, _ in found.rows]
    wishes += [(receiver, "shape key", wanted.prefix + key.name, taken_keys) for key in found.keys]
    wishes += [(target, "vertex group", wanted.back_prefix + name, back) for name, _ in found.back]
    for owner, kind, name, names in wishes:
        if name in names:
            raise pointmorph.CloudError(
                owner.name,
                f'no other {kind} named "{name}"',
                "one",
                "Choose another prefix, or rename the existing one.",
            )


def _write_uvs(mesh, name, uvs):
    attribute = mesh.attributes.get(name)
    if attribute is not None and attribute.domain != "CORNER":  # of an earlier version
        mesh.attributes.remove(attribute)
    return arrays.write_uvs(mesh, name, uvs) is not None


def _blend_colors(obj, name):
    """Shows the copy's active colors at 0, the attribute `name` at the end."""
    mesh = obj.data
    active = mesh.color_attributes.active_color
    own = [item.name for item in mesh.color_attributes if item.name != name]
    start = active.name if active is not None and active.name != name else next(iter(own), None)
    if start is None:
        start = attribute_names.COLOR
        arrays.write_attribute(mesh, start, np.ones((len(mesh.vertices), 4), np.float32))
    mesh.color_attributes.active_color = mesh.color_attributes[start]
    with creation.all_or_nothing() as created:
        group = nodes.shared_group(NAME, lambda name: _colors_group(name, created))
    modifier = obj.modifiers.get(MODIFIER)
    if modifier is None:
        modifier = obj.modifiers.new(MODIFIER, "NODES")
        modifier.node_group = group
        shapes = len(obj.pointmorph.via) + 2
        nodes.drive_input(obj, modifier, "t", morph_object.t_key(obj), shapes - 1)
    elif modifier.node_group is not None:
        nodes.swap_group(obj, modifier, group)
    versions.set_input(modifier, "From", start)
    versions.set_input(modifier, "To", name)
    obj.update_tag()


def _colors_group(name, created):
    group = nodes.new_group(name, created)
    nodes.new_input(group, "NodeSocketGeometry", "Geometry")
    nodes.new_t_input(group, 2)
    nodes.new_input(group, "NodeSocketString", "From", "Color attribute shown at 0")
    nodes.new_input(group, "NodeSocketString", "To", "Color attribute shown at 1")
    nodes.new_output(group, "NodeSocketGeometry", "Geometry")
    build = nodes.Builder(group)
    inputs = build.node("NodeGroupInput").outputs
    colors = [build.attribute(inputs[name], "FLOAT_COLOR") for name in ("From", "To")]
    stored = build.node(
        "GeometryNodeStoreNamedAttribute",
        {
            "Geometry": inputs["Geometry"],
            "Name": inputs["From"],
            "Value": nodes.mix_colors(build, colors, [nodes.local_t(build, inputs["t"], 2)]),
        },
        data_type="FLOAT_COLOR",
        domain="CORNER",
    )
    build.node("NodeGroupOutput", {"Geometry": stored.outputs["Geometry"]})
    return group
