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
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # for the add-on

import bpy  # noqa: E402
import numpy as np  # noqa: E402
import paint  # noqa: E402
import studio  # noqa: E402
from mathutils import Matrix  # noqa: E402
from pointmorph.formats import Shape  # noqa: E402

import addon  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "morph.png"
TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)
ASPECT = 480 / 412
AZIMUTH = math.radians(40.0)
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
    parser.add_argument("--width", type=int, default=420, help="of each of the five, in pixels")
    parser.add_argument("--samples", type=int, default=64)
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon.register()
    settings = bpy.context.scene.pointmorph
    settings.source, settings.target = calf(options.folder), koala(options.folder)
    settings.texture_size, settings.texture_roughness = "2048", True
    bpy.ops.pointmorph.morph()
    height = round(options.width / ASPECT)
    render((options.width, height), options.samples)


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


def render(size: tuple[int, int], samples: int) -> None:
    scene = bpy.context.scene
    obj = bpy.context.view_layer.objects.active
    key = obj.data.shape_keys.key_blocks["Morph"]
    ends = [np.array([point.co[:] for point in k.data]) for k in obj.data.shape_keys.key_blocks]
    studio.set_up(scene, ends, size[0] / size[1], AZIMUTH)
    studio.develop(scene, studio.Exposure(size, samples))
    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for t in TIMES:
            key.value = t
            pictures.append(Path(folder) / f"{t:g}.png")
            studio.photograph(scene, pictures[-1])
        studio.contact_sheet(pictures, [f"t = {t:g}" for t in TIMES], PICTURE)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender as a Python module doesn't always survive its own end
