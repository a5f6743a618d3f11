"""Marks of features in the 3D viewports: numbered, colored, on both objects."""

import itertools
import math

import blf
import bpy
import gpu
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..data.feature_list import color_of
from ..data.registration import Registration
from ..scene import marked_points

_RADIUS, _DOT, _RING = 9.0, 2.5, 13.0  # pixels
_GRIP = 8.0  # pixels from a mark, within which it is taken hold of
_BEHIND = 0.3  # opacity of a mark on the far side
hint = ""
"""What to click next; drawn in the viewports while it isn't empty."""
dragged = None
"""(name of an object, name of a feature, row) of the mark that is being dragged, or None."""
hover = None
"""(3,) the place in the world that a click would mark, or None."""


class _Canvas:
    """Filled shapes, in pixels, that are drawn together."""

    def __init__(self):
        self._points, self._colors = [], []

    def disc(self, center, radius, color, corners=20):
        turns = [2 * math.pi * k / corners for k in range(corners + 1)]
        rim = [(center.x + radius * math.cos(a), center.y + radius * math.sin(a)) for a in turns]
        for a, b in itertools.pairwise(rim):
            self._points += [tuple(center), a, b]
            self._colors += [color] * 3

    def draw(self):
        if not self._points:
            return
        shader = gpu.shader.from_builtin("FLAT_COLOR")
        places = [(*point, 0.0) for point in self._points]
        content = {"pos": places, "color": self._colors}
        gpu.state.blend_set("ALPHA")
        batch_for_shader(shader, "TRIS", content).draw(shader)
        gpu.state.blend_set("NONE")


def _draw():
    context = bpy.context
    space, region, view = context.space_data, context.region, context.region_data
    scale = context.preferences.system.ui_scale
    if space is None or view is None:
        return
    if hint and _is_first(context):
        _text(hint, 20 * scale + _left(context), region.height - 110 * scale, 14 * scale)
    settings = context.scene.pointmorph
    canvas, texts = _Canvas(), []
    if settings.show_markers and space.overlay.show_overlays:
        for obj in (settings.source, settings.target):
            # The object of another scene, or one that is hidden here.
            if obj is not None and obj.visible_get(viewport=space):
                _add(context, obj, canvas, texts, scale)
    if hover is not None:
        spot = location_3d_to_region_2d(region, view, Vector(hover))
        if spot is not None:
            canvas.disc(spot, 5 * scale, (0.0, 0.0, 0.0, 0.8))
            canvas.disc(spot, 3.5 * scale, (1.0, 1.0, 1.0, 0.9))
    canvas.draw()
    for text, center, size, opacity in texts:
        _text(text, center.x, center.y, size, opacity, centered=True)


def _add(context, obj, canvas, texts, scale):
    settings = context.scene.pointmorph
    depsgraph = context.evaluated_depsgraph_get()
    marks = marked_points.marks_of(obj)
    for number, feature in enumerate(settings.features):
        mark = marks.get(feature.marked_name)
        if mark is None or not feature.use:
            continue
        is_dragged = dragged is not None and dragged[:2] == (obj.name, feature.marked_name)
        shown = dragged[2] if is_dragged else mark.row
        place = marked_points.place_of(obj, shown, depsgraph)
        spot = location_3d_to_region_2d(context.region, context.region_data, place)
        if spot is None:
            continue
        opacity = _BEHIND if _faces_away(context.region_data, obj, shown, depsgraph) else 1.0
        color = (*color_of(number), opacity)
        for row in mark.rows if mark.count > 1 else ():
            at = marked_points.place_of(obj, row, depsgraph)
            dot = location_3d_to_region_2d(context.region, context.region_data, at)
            if dot is not None:
                canvas.disc(dot, _DOT * scale, color, corners=6)
        if number == settings.active_feature:
            canvas.disc(spot, _RING * scale, (1.0, 1.0, 1.0, 0.5 * opacity))
            name = Vector((spot.x, spot.y + (_RING + 9) * scale))
            texts.append((feature.name, name, 12 * scale, opacity))
        canvas.disc(spot, (_RADIUS + 1.5) * scale, (0.0, 0.0, 0.0, 0.8 * opacity))
        canvas.disc(spot, _RADIUS * scale, color)
        texts.append((str(number + 1), spot, 11 * scale, opacity))


def mark_at(context, area, region, view, at):
    """The object and the name of the point feature whose mark is drawn under a pixel of a region,
    on the side that is seen; or None."""
    settings = context.scene.pointmorph
    space = area.spaces.active
    if not (settings.show_markers and space.overlay.show_overlays):
        return None
    depsgraph = context.evaluated_depsgraph_get()
    best, found = _GRIP * context.preferences.system.ui_scale, None
    for obj in (settings.source, settings.target):
        if not obj.visible_get(viewport=space):
            continue
        used = {feature.marked_name for feature in settings.features if feature.use}
        for name, mark in marked_points.marks_of(obj).items():
            if mark is None or mark.count > 1 or name not in used:
                continue
            place = marked_points.place_of(obj, mark.row, depsgraph)
            spot = location_3d_to_region_2d(region, view, place)
            if spot is None or _faces_away(view, obj, mark.row, depsgraph):
                continue
            apart = (spot - Vector(at)).length
            if apart < best:
                best, found = apart, (obj, name)
    return found


def _faces_away(view, obj, row, depsgraph):
    normal = marked_points.normal_of(obj, row, depsgraph)
    if normal is None:
        return False
    back = view.view_matrix.inverted()
    to_viewer = back.to_3x3() @ Vector((0.0, 0.0, 1.0))
    if view.is_perspective:
        to_viewer = back.translation - marked_points.place_of(obj, row, depsgraph)
    return normal.normalized().dot(to_viewer.normalized()) < -0.1


def _is_first(context):
    """Whether the region is the left upper one of four views, or the only one."""
    views = [region for region in context.area.regions if region.type == "WINDOW"]
    return context.region == min(views, key=lambda region: (region.x, -region.y))


def _left(context):
    """Width of the toolbar, which lies over the viewport."""
    return sum(region.width for region in context.area.regions if region.type == "TOOLS")


def _text(text, x, y, size, opacity=1.0, centered=False):
    blf.size(0, round(size))
    if centered:
        width, height = blf.dimensions(0, text)
        x, y = x - width / 2, y - height / 2
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.9 * opacity)
    blf.shadow_offset(0, 1, -1)
    blf.position(0, round(x), round(y), 0)
    blf.color(0, 1.0, 1.0, 1.0, opacity)
    blf.draw(0, text)
    blf.disable(0, blf.SHADOW)


registration = Registration(drawings=((_draw, "POST_PIXEL"),))


registration = Registration(drawings=((_draw, "POST_PIXEL"),))
