"""The curves along which models would be cut, drawn on both objects."""

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..core import transforms
from ..data.registration import Registration

_COLOR = (1.0, 0.55, 0.1, 1.0)
shown = {}
"""By the name of an object, the curve that was last looked at: (K, 3) in its own space."""


def _draw():
    context = bpy.context
    settings, space = context.scene.pointmorph, context.space_data
    if not shown or not space.overlay.show_overlays:
        return
    for obj in (settings.source, settings.target):
        if obj is None or obj.name not in shown or not obj.visible_get(viewport=space):
            continue
        world = transforms.apply(obj.matrix_world, shown[obj.name])
        _draw_line(np.concatenate([world, world[:1]]))


def _draw_line(points):
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINE_STRIP", {"pos": points.astype(np.float32).tolist()})
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    gpu.state.blend_set("ALPHA")
    # What is behind the model shines through.
    for test, color, width in (("NONE", (*_COLOR[:3], 0.3), 2.0), ("LESS_EQUAL", _COLOR, 4.0)):
        gpu.state.depth_test_set(test)
        shader.uniform_float("lineWidth", width)
        shader.uniform_float("color", color)
        batch.draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


registration = Registration(stop=shown.clear, drawings=((_draw, "POST_VIEW"),))
