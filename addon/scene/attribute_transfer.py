"""What the target has, brought over along the map: colors, weights, UV maps."""

from contextlib import contextmanager
from dataclasses import astuple, dataclass

import bpy
import numpy as np
import pointmorph

from ..core import transforms
from ..core.features import PREFIX
from ..core.stepping import finish
from ..data import arrays, attribute_names, creation, nodes, surfaces, versions
from . import morph_object, recipes
from .shape_reader import is_plain, present_steps, update

NAME = "Pointmorph Colors"
MODIFIER = "Colors"
_READ = "Pointmorph target, while it is read"


@dataclass(frozen=True)
class Wanted:
    """What is brought over, and what goes before its names."""

    colors: bool
    weights: bool
    uvs: bool
    prefix: str


def again(context, obj):
    """Brings over what was brought over before, from the target as it is now. Returns what went
    wrong, in words."""
    before = recipes.recipe_of(obj).get("transferred")
    if before is None:
        return []
    wanted = Wanted(*before["options"])
    try:
        carry = finish(read_steps(context, obj, wanted))
        write(obj, wanted, carry(lambda stage, fraction: True))
    except pointmorph.PointmorphError as error:
        return [f"Transferred attributes are still those of the old morph. {error}"]
    return []


# --- Reading --------------------------------------------------------------------------------------


def read_steps(context, obj, wanted):
    """A generator that yields often, reads what the target has, and returns a function that takes
    it along the map, to be called with a progress in any thread.

    Colors and UV maps become point attributes, weights vertex groups. A row each for a point of
    `obj`, a morph object or a copy of the source, as (kind, name, values); active colors first.

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
        raise pointmorph.CloudError(
            obj.name, "its target in this file", "none", "Undo the deletion, or morph again."
        )
    if target.type != "MESH":
        raise pointmorph.CloudError(
            target.name,
            "a mesh to transfer attributes from",
            f"an object of type {target.type}",
            "Its colors and radii are already part of the morph.",
        )
    return target


def _read_target_steps(context, obj, target, wanted):
    update(context, target)
    yield
    with _as_shown(context, target) as mesh:
        yield
        return (yield from _read_mesh_steps(obj, target, mesh, wanted))


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


def _read_mesh_steps(obj, target, mesh, wanted):
    rows = morph_object.stage_rows(obj)[-1] if morph_object.is_result(obj) else None
    count = int(rows.max()) + 1 if rows is not None else recipes.recipe_of(obj)["points"][-1]
    if len(mesh.vertices) != count:
        raise pointmorph.CloudError(
            target.name,
            f'the {count:,} points "{obj.name}" was made from',
            f"{len(mesh.vertices):,} as shown in the viewport",
            "Recompute the morph first.",
        )
    landing = None if rows is not None else _read_landing(obj, mesh)
    yield
    found = []  # (kind, name, values by vertex or by corner)
    if wanted.colors:
        active = mesh.color_attributes.active_color
        for item in sorted(mesh.color_attributes, key=lambda item: item != active):
            found.append(("color attribute", item.name, arrays.vertex_colors(mesh, item)))
            yield
    if wanted.weights:
        groups = {
            group.index: group.name
            for group in target.vertex_groups
            if not group.name.startswith(PREFIX)
        }
        weights = yield from arrays.vertex_group_steps(mesh, groups)
        for name, (members, values) in weights.items():
            whole = np.zeros((count, 1), np.float32)
            whole[members, 0] = values
            found.append(("vertex group", name, whole))
    if wanted.uvs:
        for layer in mesh.uv_layers:
            uv = arrays.corner_uvs(layer)
            if rows is not None or landing.triangles is None:
                uv = arrays.first_of_corners(mesh, uv)
            found.append(("UV map", layer.name, uv))
            yield
    if len(mesh.vertices) != count:
        raise pointmorph.CloudError(
            target.name,
            "a mesh that doesn't change",
            "changes while it was being read",
            "Try again.",
        )
    if not found:
        raise pointmorph.CloudError(
            target.name,
            "colors, weights or UV maps to transfer",
            "none of the requested kinds",
            "Choose something that it has.",
        )

    def carry(progress):
        corners = None
        if rows is not None:
            places = rows[:, None], np.ones((len(rows), 1))
        else:
            progress("map", 0.0)
            corners, *places = landing.places()
        carried = []
        for number, (kind, name, values) in enumerate(found):
            if progress("transfer", number / len(found)) is False:
                raise pointmorph.Cancelled("The transfer was canceled.")
            members, shares = places
            if kind == "UV map" and corners is not None:
                members = corners
            carried.append((kind, name, surfaces.mean(values, members, shares)))
        return carried

    return carry


@dataclass(frozen=True)
class _Landing:
    """Where the vertices of a copy of the source land on the target's mesh."""

    positions: np.ndarray
    triangles: np.ndarray | None
    loops: np.ndarray | None
    landing: np.ndarray

    def places(self):
        """(N, 3) corners of the triangle that each vertex lands in, or None; (N, K) vertices of the
        target around, and (N, K) their shares, which sum to 1."""
        triangle, members, shares = surfaces.around(self.positions, self.triangles, self.landing)
        return None if triangle is None else self.loops[triangle], members, shares


def _read_landing(obj, mesh):
    recipe = recipes.recipe_of(obj)
    pairs = obj.pointmorph.made_from
    if pairs is not None and morph_object.is_result(pairs):
        rows = morph_object.stage_rows(pairs)[-1]
        positions = arrays.by_row(rows, arrays.key_positions(morph_object.stage_keys(pairs)[-1]))
    else:
        matrix = np.reshape(recipe["shapes"][-1]["matrix"], (4, 4))
        positions = transforms.move_positions(matrix, arrays.vertex_positions(mesh))
    matrix = morph_object.source_matrix_of(obj)
    landing = transforms.move_positions(matrix, arrays.key_positions(morph_object.last_key(obj)))
    triangles = arrays.mesh_triangles(mesh)
    loops = None if triangles is None else arrays.triangle_loops(mesh)
    return _Landing(positions, triangles, loops, landing)


# --- Writing --------------------------------------------------------------------------------------


def write(obj, wanted, found):
    """Puts what was taken along the map onto a morph object, or a copy of the source, each under
    its own name after a prefix. A copy shows colors from those of the source to the target's.

    Returns
    -------
    list of str
        Names on the object.

    Raises
    ------
    CloudError
        When the object has something of such a name of its own, or other points by now.
    """
    count = len(obj.data.vertices)
    if any(len(values) != count for *_, values in found):
        raise pointmorph.CloudError(
            obj.name,
            "an object that doesn't change",
            "changes while it was being read",
            "Try again.",
        )
    prefix = wanted.prefix
    taken = {group.name for group in obj.vertex_groups}
    taken |= {attribute.name for attribute in obj.data.attributes}
    known = set(recipes.recipe_of(obj).get("transferred", {}).get("names", ()))
    for kind, name, _ in found:
        if prefix + name in taken - known:
            raise pointmorph.CloudError(
                obj.name,
                f'no other {kind} named "{prefix + name}"',
                "one",
                "Choose another prefix, or rename the existing one.",
            )
    for kind, name, values in found:
        if kind == "vertex group":
            _write_group(obj, prefix + name, values[:, 0])
        else:
            arrays.write_attribute(obj.data, prefix + name, values)
    if obj.pointmorph.keeps_faces and wanted.colors:
        first = next((name for kind, name, _ in found if kind == "color attribute"), None)
        if first is not None:
            _blend_colors(obj, prefix + first)
    names = [prefix + name for _, name, _ in found]
    recipes.note(obj, "transferred", {"names": names, "options": list(astuple(wanted))})
    return names


def _write_group(obj, name, weights):
    """A vertex group in place of one of that name; by way of an attribute, which takes a hundredth
    of the time that a call for each vertex does."""
    group = obj.vertex_groups.get(name)
    if group is not None:
        obj.vertex_groups.remove(group)
    arrays.write_attribute(obj.data, name, weights)
    obj.data.attributes.active = obj.data.attributes[name]
    with bpy.context.temp_override(object=obj, active_object=obj):
        bpy.ops.geometry.attribute_convert(mode="VERTEX_GROUP")


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
