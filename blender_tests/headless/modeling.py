"""Objects as people make them: Blender's own meshes, animals of one piece, rigs and nodes."""

import bmesh
import bpy
from mathutils import Matrix, Vector
from scenes import add_group, add_object, select, triangles


def primitive(kind, **options):
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(**options)
    return bpy.context.view_layer.objects.active


def creature(name, fat, leg, ear, voxel, faces=None):
    """An animal of ellipsoids in one piece; with so many faces, if they are to be few."""
    parts = [((0, 0, 0), (1.2, 0.55 * fat, 0.5 * fat)), ((1.35, 0, 0.55), (0.45, 0.38, 0.38))]
    parts += [((1.75, 0, 0.45), (0.3, 0.2, 0.18)), ((-1.4, 0, 0.2), (0.5, 0.1, 0.1))]
    for side in (-1, 1):
        parts += [((x, 0.3 * side, -0.3 - leg / 2), (0.17, 0.17, leg)) for x in (-0.8, 0.75)]
        parts.append(((1.25, 0.22 * side, 0.95), (0.1, 0.1, ear)))
    made = bmesh.new()
    for center, radii in parts:
        matrix = Matrix.LocRotScale(Vector(center), None, Vector(radii))
        bmesh.ops.create_icosphere(made, subdivisions=3, radius=1.0, matrix=matrix)
    mesh = bpy.data.meshes.new(name)
    made.to_mesh(mesh)
    made.free()
    obj = add_object(name, mesh)
    remesh = obj.modifiers.new("In one piece", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", voxel
    apply_modifiers(obj)
    if faces is not None:
        obj.modifiers.new("Few", "DECIMATE").ratio = faces / len(triangles(obj.data))
        apply_modifiers(obj)
    return obj


def apply_modifiers(obj):
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    obj.data, old = bpy.data.meshes.new_from_object(obj.evaluated_get(graph)), obj.data
    obj.modifiers.clear()
    bpy.data.meshes.remove(old)


def add_armature(obj, pose):
    """A rig of one bone, which all of the object follows, moved to `pose`."""
    bones = bpy.data.armatures.new("Bones")
    rig = bpy.data.objects.new("Rig", bones)
    bpy.context.scene.collection.objects.link(rig)
    select(rig)
    bpy.ops.object.mode_set(mode="EDIT")
    bone = bones.edit_bones.new("Bone")
    bone.tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones["Bone"].location = pose
    add_group(obj, "Bone", dict.fromkeys(range(len(obj.data.vertices)), 1.0))
    obj.modifiers.new("Rig", "ARMATURE").object = rig


def show_by_nodes(obj, *kinds):
    """Geometry nodes that go through nodes of these kinds."""
    group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    made = group.nodes.new("NodeGroupInput")
    for kind in (*kinds, "NodeGroupOutput"):
        node = group.nodes.new(kind)
        group.links.new(made.outputs[0], node.inputs[0])
        made = node
    obj.modifiers.new("Scatter", "NODES").node_group = group
