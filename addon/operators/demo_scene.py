"""Something to try it on: two animals in the menu Add > Mesh, and the way to the manual."""

import bpy
import numpy as np
from mathutils import Vector

from ..data import arrays, attribute_names, creation, nodes, versions
from ..data.feature_list import sync_features
from ..data.registration import Registration
from ..scene.feature_marks import mark
from .polls import Explained, activate


def _animal(legs, body, neck, ears, tail):
    """Balls (center, radius) that make up an animal which looks along -y, and its extremities.

    Parameters
    ----------
    legs, body : float
        Length of the legs, and half of that of the body.
    neck, tail : (3,)
        From the shoulders to the head, and from the hips to the end of the tail.
    ears : float
        Their length.
    """
    balls, tips = [], {}

    def limb(name, start, end, thick, thin):
        start, end = Vector(start), Vector(end)
        count = max(3, int((end - start).length / (0.5 * thin)))
        for k in range(count + 1):
            share = k / count
            balls.append((start.lerp(end, share), thick + (thin - thick) * share))
        if name:
            tips[name] = end + (end - start).normalized() * thin

    limb("", (0, -body, legs), (0, body, legs), 0.42, 0.4)
    for side, x in (("L", 0.26), ("R", -0.26)):
        for end, y in (("F", -body), ("H", body)):
            limb(f"foot.{end}{side}", (x, y, legs), (x, y, 0.12), 0.2, 0.16)
    head = Vector((0, -body, legs + 0.15)) + Vector(neck)
    limb("", (0, -body, legs + 0.15), head, 0.3, 0.26)
    limb("nose", head, head + Vector((0, -0.5, -0.1)), 0.28, 0.17)
    for side, x in (("L", 1), ("R", -1)):
        base = head + Vector((0.18 * x, 0.08, 0.18))
        point = base + Vector((0.35 * x, 0.1, 0.9)).normalized() * ears
        limb(f"ear.{side}", base, point, 0.13, 0.1)
    hips = Vector((0, body + 0.2, legs + 0.15))
    limb("tail", hips, hips + Vector(tail), 0.15, 0.11)
    return balls, tips


def _add(context, name, balls, tips, resolution, color):
    """An object with a closed mesh around the balls, marks on the extremities, and a material in
    colors."""
    metaballs = bpy.data.metaballs.new(f"{name} balls")
    metaballs.resolution = resolution
    metaballs.threshold = 0.4
    for center, radius in balls:
        ball = metaballs.elements.new()
        ball.co, ball.radius, ball.stiffness = center, 1.5 * radius, 4.0
    holder = bpy.data.objects.new(f"{name} balls", metaballs)
    context.scene.collection.objects.link(holder)
    try:
        evaluated = holder.evaluated_get(context.evaluated_depsgraph_get())
        mesh = bpy.data.meshes.new_from_object(evaluated)
    finally:
        bpy.data.objects.remove(holder)
        bpy.data.metaballs.remove(metaballs)
    mesh.name = name
    positions = arrays.vertex_positions(mesh)
    colors = color(positions)
    arrays.write_attribute(mesh, attribute_names.COLOR, colors)
    mesh.color_attributes.active_color = mesh.color_attributes[attribute_names.COLOR]
    mesh.materials.append(_material(name, colors.mean(axis=0)))
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    obj = bpy.data.objects.new(name, mesh)
    creation.link(context, obj)
    for tip, place in tips.items():
        apart = np.linalg.norm(positions - np.array(place, np.float32), axis=1)
        mark(obj, tip, [int(np.argmin(apart))])
    return obj


def _material(name, mean):
    """One that shows the color attribute, and in Solid shading the mean of its colors."""
    material = bpy.data.materials.new(name)
    material.diffuse_color = mean
    tree = versions.node_tree(material)
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    color = nodes.Builder(tree).node("ShaderNodeVertexColor", layer_name=attribute_names.COLOR)
    color.location = surface.location.x - 300, surface.location.y
    tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    return material


def _move_beside_others(context, added):
    """Moves new objects along x until nothing stands in them, such as the default cube."""
    context.view_layer.update()
    least, most = _bounds(added)
    others = [o for o in context.view_layer.objects if o not in added and o.visible_get()]
    boxes = [_bounds([other]) for other in others if other.type in arrays.SHAPE_TYPES]
    shift = np.zeros(3)
    for low, high in sorted(boxes, key=lambda box: box[1][0]):
        if (low < most + shift).all() and (least + shift < high).all():
            shift[0] = high[0] + 0.5 - least[0]
    for obj in added:
        obj.location.x += shift[0]


def _bounds(objects):
    """(3,), (3,): the corners of the box around objects, in the world."""
    corners = [obj.matrix_world @ Vector(corner) for obj in objects for corner in obj.bound_box]
    return np.min(corners, axis=0), np.max(corners, axis=0)


def _spotted(positions):
    """Yellow with brown patches."""
    x, y, z = 9 * positions.T
    wave = np.sin(x + 2) + np.sin(y) * np.sin(z)
    brown, yellow = np.array([0.25, 0.1, 0.03, 1]), np.array([0.8, 0.55, 0.2, 1])
    return np.where(wave[:, None] > 0.3, brown, yellow).astype(np.float32)


def _dark_below(positions):
    """Brown, darker toward the feet."""
    share = np.clip(positions[:, 2:] / 1.2, 0, 1)
    low, high = np.array([0.08, 0.03, 0.015, 1]), np.array([0.45, 0.2, 0.08, 1])
    return (low + share * (high - low)).astype(np.float32)


class POINTMORPH_OT_add_demo(Explained, bpy.types.Operator):
    """Add two animals of different proportions that are ready to morph, with features marked"""

    bl_idname = "pointmorph.add_demo"
    bl_label = "Pointmorph Demo"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        return None if context.mode == "OBJECT" else "Switch to Object Mode first"

    def execute(self, context):
        hound = _animal(0.8, 0.95, (0, -0.3, 0.6), 0.3, (0, 0.45, 0.3))
        giraffe = _animal(1.6, 0.7, (0, -0.5, 1.3), 0.35, (0, 0.4, -0.5))
        source = _add(context, "Hound", *hound, 0.06, _dark_below)
        target = _add(context, "Giraffe", *giraffe, 0.075, _spotted)
        source.location.x, target.location.x = -1.4, 1.4
        _move_beside_others(context, [source, target])
        settings = context.scene.pointmorph
        settings.source, settings.target = source, target
        sync_features(context.scene)
        for feature in settings.features:
            feature.confidence = -1.0
        activate(context.view_layer.objects, source)
        if context.region_data is not None:
            target.select_set(True)
            bpy.ops.view3d.view_selected()
            target.select_set(False)
        self.report({"INFO"}, "Press Morph in the sidebar (N), on the Pointmorph tab")
        return {"FINISHED"}


def _add_menu(self, context):
    self.layout.separator()
    self.layout.operator("pointmorph.add_demo", icon="MOD_SIMPLEDEFORM")


registration = Registration(
    classes=(POINTMORPH_OT_add_demo,),
    menus=((bpy.types.VIEW3D_MT_mesh_add, _add_menu),),
)
