"""Renders the picture at the head of the README: a calf with a texture turns into a koala.

    python docs/demo/head_picture.py FOLDER [--width PIXELS] [--samples N]

FOLDER holds three files of https://github.com/odedstein/meshes: objects/spot/spot_control_mesh.obj,
objects/spot/spot_texture.svg as a picture spot_texture.png, and objects/koala/koala.obj. It needs
what `build_addon.py setup` installs.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # for the add-on

import bpy  # noqa: E402
import numpy as np  # noqa: E402
import paint  # noqa: E402
import studio  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402
from pointmorph.meshes import Shape  # noqa: E402

import addon  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "calf_to_koala.png"
TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)
ASPECT = 3.6
TURN = math.radians(-36.0)
SPACING = 1.06
"""From one model to the next, in widths of the widest."""
MARGIN, CENTER = 0.3, 0.42
"""Room beside the models, and the height that the camera looks at, in their spacing."""
LENS, ELEVATION = 110.0, math.radians(6.0)
BEHIND = 1.4
"""Where the ground begins to rise, in the models' spacing."""
GROUND, SKY = (0.27, 0.40, 0.43), (0.40, 0.45, 0.52)
LIGHTS = {
    "Key": ((-3.4, -3.0, 4.2), 330.0, 2.2, (1.0, 0.93, 0.84)),
    "Fill": ((4.5, -3.5, 1.8), 45.0, 4.0, (0.80, 0.90, 1.0)),
    "Rim": ((2.6, 2.4, 3.8), 240.0, 2.4, (1.0, 0.97, 0.92)),
}
"""Place, watts and size in the models' spacing, color."""
KOALA_SIZE = 0.25
"""The koala's, in the calf's units."""
FUR = np.array([[0.05, 0.05, 0.06], [0.19, 0.19, 0.21], [0.42, 0.42, 0.44]])
"""Linear red, green and blue of hollows, of the plain surface and of ridges."""
PALE, BLACK = (0.74, 0.70, 0.64), (0.012, 0.011, 0.013)
NOSE, EARS, EYES = 22030, (6380, 6376), (44579, 48599)
"""Vertices of the koala."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--width", type=int, default=2000, help="in pixels")
    parser.add_argument("--samples", type=int, default=160)
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon.register()
    settings = bpy.context.scene.pointmorph
    settings.source, settings.target = calf(options.folder), koala(options.folder)
    settings.texture_size, settings.texture_roughness = "2048", True
    bpy.ops.pointmorph.morph()
    size = options.width, round(options.width / ASPECT)
    build_set(stand_in_a_row(bpy.context.view_layer.objects.active), ASPECT)
    studio.develop(bpy.context.scene, studio.Exposure(size, options.samples))
    studio.photograph(bpy.context.scene, PICTURE)


def calf(folder: Path) -> bpy.types.Object:
    """Spot, subdivided, with its texture."""
    bpy.ops.wm.obj_import(filepath=str(folder / "spot_control_mesh.obj"))
    obj = bpy.context.view_layer.objects.active
    smooth = obj.modifiers.new("Smooth", "SUBSURF")
    smooth.levels, smooth.uv_smooth = 4, "PRESERVE_BOUNDARIES"
    bpy.ops.object.modifier_apply(modifier=smooth.name)
    image = bpy.data.images.load(str(folder / "spot_texture.png"))
    node = _dress(obj, "Calf", "ShaderNodeTexImage", 0.45)
    node.image = image
    _stand(obj, Matrix.Rotation(math.pi, 4, "Z"))
    return obj


def koala(folder: Path) -> bpy.types.Object:
    """Gray, paler below and in the ears, with a black nose."""
    bpy.ops.wm.obj_import(filepath=str(folder / "koala.obj"))
    obj = bpy.context.view_layer.objects.active
    _stand(obj, Matrix.Scale(KOALA_SIZE, 4))
    mesh = obj.data
    mesh.calc_loop_triangles()
    positions = np.array([vertex.co[:] for vertex in mesh.vertices])
    normals = np.array([vertex.normal[:] for vertex in mesh.vertices])
    triangles = np.array([triangle.vertices[:] for triangle in mesh.loop_triangles])
    shape = paint.painted(Shape("Koala", positions, normals, None, None, triangles), FUR)
    colors = shape.colors
    assert colors is not None

    def tint(share: np.ndarray, color: tuple[float, float, float]) -> None:
        share = np.clip(share, 0.0, 1.0)[:, None]
        colors[:, :3] += share * (np.array(color) - colors[:, :3])

    def near(row: int, radius: float, soft: float) -> np.ndarray:
        apart = np.linalg.norm(positions - positions[row], axis=1)
        return np.clip((radius + soft - apart) / soft, 0.0, 1.0)

    tint((-normals[:, 2] - 0.15) / 0.6, PALE)
    for ear in EARS:
        tint(near(ear, 0.1, 0.1) * np.clip(-normals[:, 1], 0.0, 1.0), PALE)
    tint(near(NOSE, 0.07, 0.025), BLACK)
    for eye in EYES:
        tint(near(eye, 0.024, 0.012), BLACK)
    attribute = mesh.color_attributes.new("Fur", "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", colors.astype(np.float32).reshape(-1))
    node = _dress(obj, "Koala", "ShaderNodeVertexColor", 0.8)
    node.layer_name = "Fur"
    return obj


def _dress(obj: bpy.types.Object, name: str, kind: str, roughness: float) -> bpy.types.Node:
    """Gives an object a material whose color comes from a node of this kind."""
    obj.name = name
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Roughness"].default_value = roughness
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs["Color"], surface.inputs["Base Color"])
    obj.data.materials.clear()
    obj.data.materials.append(material)
    return node


def _stand(obj: bpy.types.Object, matrix: Matrix) -> None:
    """Turns an object's mesh, and sets it on the ground."""
    mesh = obj.data
    mesh.transform(matrix @ obj.matrix_world)
    obj.matrix_world = Matrix()
    mesh.transform(Matrix.Translation((0, 0, -min(vertex.co.z for vertex in mesh.vertices))))
    for face in mesh.polygons:
        face.use_smooth = True


def stand_in_a_row(morph: bpy.types.Object) -> float:
    """Takes the morph out of the scene and puts a copy for each of the times there, side by side
    on the ground; returns how far apart they are."""
    key = morph.data.shape_keys.key_blocks["Morph"]
    copies = []
    for t in TIMES:
        key.value = t
        bpy.context.view_layer.update()
        shown = morph.evaluated_get(bpy.context.evaluated_depsgraph_get())
        copy = bpy.data.objects.new(f"t = {t:g}", bpy.data.meshes.new_from_object(shown))
        for number, material in enumerate(copy.data.materials):
            copy.data.materials[number] = _at_rest(material, t)
        copy.data.transform(Matrix.Rotation(TURN, 4, "Z"))
        copies.append(copy)
    corners = [np.array([corner[:] for corner in copy.bound_box]) for copy in copies]
    apart = max(float(np.ptp(box[:, 0])) for box in corners) * SPACING
    for number, (copy, box) in enumerate(zip(copies, corners, strict=True)):
        middle = (box.min(axis=0) + box.max(axis=0)) / 2.0
        place = (number - (len(TIMES) - 1) / 2.0) * apart
        copy.location = (place - middle[0], -middle[1], -box[:, 2].min())
        bpy.context.scene.collection.objects.link(copy)
    bpy.data.objects.remove(morph)
    return apart


def _at_rest(material: bpy.types.Material, t: float) -> bpy.types.Material:
    """A copy of a material that mixes both looks by t, which stays as it is at one t."""
    copy = material.copy()
    copy.node_tree.animation_data_clear()
    copy.node_tree.nodes["Pointmorph t"].outputs[0].default_value = t
    return copy


def build_set(apart: float, aspect: float) -> None:
    """The ground, which rises behind the models without an edge, lights, and a camera."""
    scene = bpy.context.scene
    bend = 3.0 * apart
    profile = [(-8.0 * apart, 0.0)]
    for angle in np.linspace(0.0, math.pi / 2.0, 24):
        profile.append((BEHIND * apart + bend * math.sin(angle), bend * (1.0 - math.cos(angle))))
    profile.append((BEHIND * apart + bend, 12.0 * apart))
    rows = [(x, y, z) for y, z in profile for x in (-20.0 * apart, 20.0 * apart)]
    faces = [(k, k + 1, k + 3, k + 2) for k in range(0, len(rows) - 2, 2)]
    mesh = bpy.data.meshes.new("Ground")
    mesh.from_pydata(rows, [], faces)
    for face in mesh.polygons:
        face.use_smooth = True
    ground = bpy.data.objects.new("Ground", mesh)
    scene.collection.objects.link(ground)
    material = bpy.data.materials.new("Ground")
    if material.node_tree is None:
        material.use_nodes = True
    surface = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (*GROUND, 1.0)
    surface.inputs["Roughness"].default_value = 0.9
    mesh.materials.append(material)
    for name, (place, energy, size, color) in LIGHTS.items():
        light = bpy.data.lights.new(name, "AREA")
        light.energy, light.size, light.color = energy * apart**2, size * apart, color
        lamp = bpy.data.objects.new(name, light)
        lamp.location = [x * apart for x in place]
        lamp.rotation_euler = (-lamp.location).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
    world = bpy.data.worlds.new("Sky")
    world.use_nodes = True
    background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*SKY, 1.0)
    scene.world = world
    camera = bpy.data.cameras.new("Camera")
    camera.lens, camera.sensor_width = LENS, 36.0
    holder = bpy.data.objects.new("Camera", camera)
    width = (len(TIMES) + MARGIN) * apart
    distance = width * LENS / 36.0
    back = Vector((0.0, -math.cos(ELEVATION), math.sin(ELEVATION)))
    holder.location = Vector((0.0, 0.0, CENTER * apart)) + distance * back
    holder.rotation_euler = back.to_track_quat("Z", "Y").to_euler()
    camera.clip_end = 10.0 * distance
    scene.collection.objects.link(holder)
    scene.camera = holder


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender as a Python module doesn't always survive its own end
