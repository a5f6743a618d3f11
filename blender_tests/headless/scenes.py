"""Objects to morph, and what tests ask of a scene."""

import json
import os
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path

import bpy
import numpy as np


def patch(side, bump=0.5, turn=0.0):
    """(side², 3) float32 vertices and (F, 4) quads: a bumpy open sheet, its normals upward."""
    u, v = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    z = bump * np.exp(-3 * (u**2 + v**2)) + 0.1 * np.sin(3 * u + turn) * np.cos(2 * v)
    positions = np.stack([u, v, z], axis=-1).reshape(-1, 3).astype(np.float32)
    rows = np.arange(side * side).reshape(side, side)
    corners = (rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:])
    return positions, np.stack([c.reshape(-1) for c in corners], axis=-1)


def row_at(positions, x, y):
    """Row of the vertex nearest to a place of the sheet."""
    return int(np.argmin(np.hypot(positions[:, 0] - x, positions[:, 1] - y)))


def add_mesh(name, positions, faces=()):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(positions).tolist(), [], np.asarray(faces).tolist())
    mesh.update()
    return add_object(name, mesh)


def add_object(name, data):
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def add_attribute(geometry, name, kind, values, domain="POINT"):
    keys = {"FLOAT": "value", "INT": "value", "FLOAT_VECTOR": "vector"}
    attribute = geometry.attributes.new(name, kind, domain)
    values = np.asarray(values, np.int32 if kind == "INT" else np.float32)
    attribute.data.foreach_set(keys.get(kind, "color"), values.reshape(-1))
    return attribute


def add_group(obj, name, weights):
    """A vertex group from a dict of vertex to weight."""
    group = obj.vertex_groups.new(name=name)
    for vertex, weight in weights.items():
        group.add([vertex], weight, "REPLACE")


def mark(obj, name, x, y):
    add_group(obj, f"pm.{name}", {row_at(coordinates(obj.data.vertices), x, y): 1.0})


def pair(source_side=12, target_side=10, domain="disk"):
    """Two sheets of different size with two features, picked as source and target.

    In the disk the pose needn't be searched for, which takes ten times as long as all the rest,
    and few tests are about it.
    """
    source = add_mesh("Hill", *patch(source_side))
    target = add_mesh("Dune", *patch(target_side, bump=0.8, turn=1.0))
    for obj in (source, target):
        mark(obj, "peak", 0, 0)
        mark(obj, "slope", 0.5, 0.3)
    pick(source, target)
    bpy.context.scene.pointmorph.domain = domain
    return source, target


def torn_pair():
    """A sheet, and the same with its right half drifted away, picked as source and target: frames
    between the ends have a crack."""
    positions, _ = patch(24, bump=0.0)
    apart = positions + np.where(positions[:, :1] > 0, [[0.6, 0, 0]], 0.0).astype(np.float32)
    source, target = add_mesh("Whole", positions), add_mesh("Torn", apart)
    for number in range(0, len(positions), 40):
        for obj in (source, target):
            add_group(obj, f"pm.{number}", {number: 1.0})
    pick(source, target)
    return source, target


def pick(source, target):
    settings = bpy.context.scene.pointmorph
    settings.source, settings.target = source, target


def morph(**options):
    """Computes the morph; returns the object that it makes."""
    assert bpy.ops.pointmorph.morph(**options) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def error_of(operator, **options):
    """What an operator says that must refuse; nothing may have changed."""
    before = data_blocks()
    try:
        done = operator(**options)
    except RuntimeError as error:
        assert data_blocks() == before
        return str(error)
    raise AssertionError(f"it didn't refuse: {done}")


def recompute(obj):
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}


def slider(obj):
    """The shape key whose value is t."""
    return obj.data.shape_keys.key_blocks["Morph"]


def set_t(obj, t):
    slider(obj).value = t
    bpy.context.view_layer.update()


def animate(obj):
    """From the source to the target in frames 1 to 20."""
    for frame, value in ((1, 0.0), (20, 1.0)):
        slider(obj).value = value
        slider(obj).keyframe_insert("value", frame=frame)


def select(obj):
    """Makes an object the only one that is selected, and active."""
    bpy.context.view_layer.update()
    for other in bpy.context.view_layer.objects:
        other.select_set(other == obj)
    bpy.context.view_layer.objects.active = obj


def read(collection, key, width, dtype=np.float32):
    values = np.empty(len(collection) * width, dtype)
    collection.foreach_get(key, values)
    return values.reshape(-1, width) if width > 1 else values


def coordinates(points):
    """(N, 3): `co` of vertices, or of a shape key's data."""
    return read(points, "co", 3)


def triangles(mesh):
    """(F, 3): a mesh's faces as Blender cuts them."""
    mesh.calc_loop_triangles()
    return read(mesh.loop_triangles, "vertices", 3, np.int32)


def centers(positions, faces):
    return positions[faces].mean(axis=1)


def attribute(geometry, name):
    kinds = {
        "INT": ("value", 1, np.int32),
        "FLOAT": ("value", 1, np.float32),
        "FLOAT2": ("vector", 2, np.float32),
        "FLOAT_VECTOR": ("vector", 3, np.float32),
        "FLOAT_COLOR": ("color", 4, np.float32),
        "BYTE_COLOR": ("color", 4, np.float32),
    }
    item = geometry.attributes[name]
    return read(item.data, *kinds[item.data_type])


def row_pairs(obj):
    """(m, 2): rows of source and target from a morph object."""
    return np.stack([attribute(obj.data, f"{side}_row") for side in ("source", "target")], axis=1)


def key(obj, name):
    return coordinates(obj.data.shape_keys.key_blocks[name].data)


def surface_of(obj):
    """The vertices of an object as they are shown."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return coordinates(evaluated.data.vertices)


def shown_cloud(obj):
    """The points that an object shows at the moment, until the scene changes."""
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        parent = instance.parent
        if instance.object.type == "POINTCLOUD" and parent and parent.original == obj:
            return instance.object.data
    raise AssertionError(f"{obj.name} shows no points")


def content(obj):
    """All that a morph object of pairs holds, to compare bit by bit."""
    names = [a.name for a in obj.data.attributes if a.domain == "POINT"]
    known = {"INT", "FLOAT", "FLOAT_VECTOR", "FLOAT_COLOR"}
    found = {
        name: attribute(obj.data, name)
        for name in names
        if obj.data.attributes[name].data_type in known and not name.startswith(".")
    }
    return {**found, "Basis": key(obj, "Basis"), "Morph": key(obj, "Morph")}


def assert_same(a, b):
    assert a.keys() == b.keys()
    for name in a:
        assert np.array_equal(a[name], b[name]), name


def move_vertices(obj, offset):
    positions = coordinates(obj.data.vertices) + np.asarray(offset, np.float32)
    obj.data.vertices.foreach_set("co", positions.reshape(-1))
    obj.data.update()


def shown_points(obj, name=None):
    """What a morph object shows as points at the moment: positions, or an attribute."""
    cloud = shown_cloud(obj)
    return coordinates(cloud.points) if name is None else attribute(cloud, name)


def baked_frames(player):
    """Of an object that shows frames, what its file has of each: arrays by name."""
    content = Path(bpy.path.abspath(player.modifiers["Mesh Cache"].filepath)).read_bytes()
    count, _, _, frames = np.frombuffer(content, "<i4", 4, offset=16)
    vertices = np.frombuffer(content, "<f4", offset=32).reshape(frames, count, 3)
    found = []
    for one in vertices:
        used = int(one[0, 0])
        place, normal, velocity, color, rest = one[1:].reshape(5, -1, 3)[:, :used]
        found.append(
            {
                "position": place,
                "Normal": normal,
                "velocity": velocity,
                "Color": np.column_stack([color, rest[:, 0]]),
                "Radius": rest[:, 1],
                "id": rest[:, 2].astype(np.int32),
            }
        )
    return found


def data_blocks():
    """Names of everything in the file, to see that nothing was left behind."""
    return {
        f"{kind}: {item.name}"
        for kind in dir(bpy.data)
        if isinstance(getattr(bpy.data, kind), bpy.types.bpy_prop_collection)
        for item in getattr(bpy.data, kind)
        if hasattr(item, "name")
    }


def add_point_cloud(name, positions, attributes):
    """A point cloud with these points, from vertices: as a conversion where Blender can do it,
    else as what geometry nodes make of a mesh.

    `attributes` maps a name to (type, values).
    """
    mesh_object = add_mesh(f"{name} points", positions)
    for attribute_name, (kind, values) in attributes.items():
        add_attribute(mesh_object.data, attribute_name, kind, values)
    if bpy.app.version >= (4, 5):
        select(mesh_object)
        bpy.ops.object.convert(target="POINTCLOUD")
        mesh_object.name = name
        return mesh_object
    cloud = add_object(name, bpy.data.pointclouds.new(name))
    group = bpy.data.node_groups.new("From vertices", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes, links = group.nodes, group.links
    info = nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = mesh_object
    points = nodes.new("GeometryNodeMeshToPoints")
    radius = nodes.new("GeometryNodeInputNamedAttribute")
    radius.inputs["Name"].default_value = "radius"
    links.new(info.outputs["Geometry"], points.inputs["Mesh"])
    links.new(next(s for s in radius.outputs if s.enabled), points.inputs["Radius"])
    links.new(points.outputs[0], nodes.new("NodeGroupOutput").inputs[0])
    cloud.modifiers.new("From vertices", "NODES").node_group = group
    return cloud


def listed(settings):
    """Name of every feature in the list, and whether it is on the source and on the target."""
    for obj in filter(None, (settings.source, settings.target)):
        obj.update_tag()
    bpy.context.view_layer.update()
    return [(f.name, f.on_source, f.on_target) for f in settings.features]


def groups(obj):
    """The weights of every vertex group by name and vertex."""
    return {group.name: members(obj, group.index) for group in obj.vertex_groups}


def members(obj, index):
    return {v.index: g.weight for v in obj.data.vertices for g in v.groups if g.group == index}


# --- Without the add-on ---------------------------------------------------------------------------

_READ = """
import json, os, sys
import bpy, numpy as np

def turn_on(modifier, name):
    items = modifier.node_group.interface.items_tree
    identifier = next(item for item in items if item.name == name).identifier
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).value = True
    else:
        modifier[identifier] = True

def add(found, name, points):
    values = np.empty(len(points) * 3, np.float32)
    points.foreach_get("co", values)
    found[name] = values.reshape(-1, 3)

def play(path, out, turned_on, names, frames):
    bpy.ops.wm.open_mainfile(filepath=path)
    assert not hasattr(bpy.types.Scene, "pointmorph")
    found = {}
    if turned_on:
        for name in names:
            turn_on(bpy.data.objects[name].modifiers["Points"], turned_on)
            bpy.data.objects[name].update_tag()
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for name in names:
            shown = bpy.data.objects[name].evaluated_get(depsgraph).data.vertices
            add(found, f"{name} {frame}", shown)
        for instance in depsgraph.object_instances:
            if instance.object.type == "POINTCLOUD" and instance.parent:
                original = instance.parent.original.name
                add(found, f"{original} {frame}", instance.object.data.points)
    np.savez(out, **found)

for line in sys.stdin:
    play(*json.loads(line))
    print("PLAYED", flush=True)
os._exit(0)  # Blender as a Python module doesn't always survive its own end
"""


@cache
def _player():
    """A Blender without the add-on, and without other packages where those aren't beside it; one
    serves all tests, because it takes longer to start than to read a file. It ends with this one.
    """
    start = [sys.executable, "-c", _READ]
    environment = None
    if bpy.app.binary_path:
        start = [bpy.app.binary_path, "--background", "--factory-startup", "--python-expr", _READ]
    else:
        # On Windows, numpy isn't beside this Blender.
        folders = [str(Path(bpy.__file__).parents[5]), str(Path(np.__file__).parents[1])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    pipe = subprocess.PIPE
    return subprocess.Popen(start, stdin=pipe, stdout=pipe, env=environment, text=True)


def played(path, *names, turned_on="", frames=(1, 7, 13, 20)):
    """What another Blender without the add-on shows of objects in a file at some frames, by name
    and frame; after an input of their modifier *Points* was turned on there."""
    out = path.with_suffix(".npz")
    player = _player()
    late = threading.Timer(120, player.kill)
    late.start()
    try:
        print(json.dumps([str(path), str(out), turned_on, names, frames]), file=player.stdin)
        player.stdin.flush()
        # Blender says things of its own there as well.
        said = iter(player.stdout.readline, "")
        assert "PLAYED\n" in said, "the other Blender has ended"
    except BaseException:
        player.kill()
        _player.cache_clear()
        raise
    finally:
        late.cancel()
    with np.load(out) as found:
        return {name: found[name] for name in found.files}
