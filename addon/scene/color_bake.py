"""Cycles bakes an object's glow, or its normals, on the image that its materials show, in a scene
of its own.

As a script, this file does so in another Blender. Its arguments are a file with the object, its
name, the frame, what is baked, and the file where the pixels go. Beside the first file are those
with what was painted on images: see `images.painted`.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

RENDERER = "CYCLES"
GLOW, NORMALS = "EMIT", "NORMAL"
"""What is baked: the normals as a normal map has them, for the active UV map."""


def bake(context, obj, frame, what, created):
    """Bakes an object that no scene has. Raises TypeError where there is no Cycles, RuntimeError
    where it can't bake.

    Parameters
    ----------
    what : str
        GLOW or NORMALS.
    created : function
        Called with the scene.
    """
    scene = bpy.data.scenes.new("Pointmorph Bake")
    created(scene)
    scene.render.engine = RENDERER
    scene.frame_current = frame
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", 1, 0
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    scene.collection.objects.link(obj)
    layer = scene.view_layers[0]
    layer.objects.active = obj
    obj.hide_render = obj.hide_viewport = False
    obj.select_set(True, view_layer=layer)
    here = {"scene": scene, "view_layer": layer, "active_object": obj, "object": obj}
    chosen = {"selected_objects": [obj], "selected_editable_objects": [obj]}
    with context.temp_override(**here, **chosen):
        bpy.ops.object.bake(type=what, normal_space="TANGENT", margin=0, use_clear=False)


def stand_in(image, pixels):
    """A new image with what was painted on another one: (H, W, 4) bytes, or floats. Renderers take
    that only of an image that is in no file."""
    is_float = pixels.dtype != np.uint8
    values = pixels if is_float else pixels / np.float32(255.0)
    height, width = values.shape[:2]
    made = bpy.data.images.new(image.name, width, height, alpha=True, float_buffer=is_float)
    made.colorspace_settings.name = image.colorspace_settings.name
    made.alpha_mode = image.alpha_mode
    made.pixels.foreach_set(values.reshape(-1))
    made.update()
    return made


def _take_over(file):
    with np.load(file) as found:
        image = bpy.data.images.get((str(found["name"]), None))
        if image is not None:
            image.user_remap(stand_in(image, found["pixels"]))


def main(asked, name, frame, what, baked):
    with bpy.data.libraries.load(asked) as (_, loaded):
        loaded.objects = [name]
    [obj] = loaded.objects
    for file in Path(asked).parent.glob("*.npz"):
        _take_over(file)
    bake(bpy.context, obj, int(frame), what, lambda scene: None)
    image = obj.material_slots[0].material.node_tree.nodes.active.image
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    np.save(baked, values.reshape(image.size[1], image.size[0], -1))


if __name__ == "__main__":
    main(*sys.argv[-5:])
