"""Models with materials, images and UV maps."""

import bpy
import numpy as np
from scenes import coordinates, pair, read


def bilinear(values, uvs):
    """By hand, with what is beyond an end taken from the other."""
    height, width = values.shape[:2]
    x, y = uvs[:, 0] * width - 0.5, uvs[:, 1] * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    result = 0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - (x - column)) * np.abs(1 - dy - (y - row))
            result += weight[:, None] * values[(row + dy) % height, (column + dx) % width]
    return result


def corners_of(mesh):
    return read(mesh.loops, "vertex_index", 1, np.int32)


def flat_uvs(obj, name="UVMap", low=0.0, high=1.0):
    """A UV map seen from above: the sheet from -1 to 1 goes from `low` to `high`."""
    layer = obj.data.uv_layers.new(name=name)
    places = coordinates(obj.data.vertices)[corners_of(obj.data)][:, :2]
    uvs = low + (high - low) * (places + 1) / 2
    layer.data.foreach_set("uv", uvs.astype(np.float32).reshape(-1))
    return uvs


def new_image(name, values, packed=True, **options):
    values = np.asarray(values, np.float32)
    image = bpy.data.images.new(name, values.shape[1], values.shape[0], alpha=True, **options)
    image.pixels.foreach_set(values.reshape(-1))
    image.update()
    if packed:
        image.pack()
    return image


def ramp(size=64):
    """Bytes whose red goes with u and whose green with v, as encoded."""
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    return np.stack([u, v, np.full_like(u, 0.2), np.ones_like(u)], axis=-1)


def checker(size=64, fields=4):
    rows, columns = np.indices((size, size)) * fields // size
    values = np.ones((size, size, 4))
    values[..., :3] = np.where((rows + columns) % 2, 0.9, 0.1)[..., None]
    return values


def material(name, color=(0.8, 0.8, 0.8, 1), image=None, **settings):
    """A material with a plain color, or an image in its place."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    tree = made.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = color
    if image is not None:
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        for setting, value in settings.items():
            setattr(node, setting, value)
        tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    return made


def sheets(settings, side=12, **options):
    """Two sheets with UV maps, shown as a mesh when they morph."""
    source, target = pair(side, 10)
    for obj in (source, target):
        flat_uvs(obj, **options)
    settings.show_as = "MESH"
    return source, target


def linear(values):
    values = np.asarray(values, float)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def blue_and_ramp(settings):
    """The same, one with a blue image, the other with a ramp."""
    source, target = sheets(settings)
    source.data.materials.append(
        material("Blue", image=new_image("blue", [[(0, 0, 1, 1)] * 2] * 2))
    )
    target.data.materials.append(material("Ramp", image=new_image("ramp", ramp())))
    settings.texture_size = "256"
    return source, target


def image_of(obj, what="Color"):
    """(H, W, 4): an image of the second look, as encoded."""
    nodes = obj.material_slots[0].material.node_tree.nodes
    image = nodes[f"Pointmorph {what}"].image
    return np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)
