"""Marks of features in the 3D viewports: numbered, coloured, on both objects.

Looking into all vertices for the members of a group takes long, so that is done in slices between
redraws and remembered; what is remembered counts as long as the vertex still is in the group.
"""

import itertools
import math
from dataclasses import dataclass

import blf
import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from . import arrays
from .features import PREFIX, feature_row
from .properties import color_of, feature_groups, feature_names

_SLICE = 8192  # vertices looked at between redraws
_SHOWN = 100  # dots for a curve or region, at the most
_RADIUS, _DOT, _RING = 9.0, 2.5, 13.0  # pixels
_BEHIND = 0.3  # opacity of a mark on the far side


@dataclass(frozen=True)
class Mark:
    """What a group of a feature holds: how many points, some of them, and the one that counts."""

    count: int
    row: int
    rows: tuple


hint = ""
"""What to click next; drawn in the viewports while it isn't empty."""

hover = None
"""(3,) the place in the world that a click would mark, or None."""

_known = {}  # name of an object: {name of a feature: Mark or None}
_queue = []  # names of objects to look into
_partial = None  # (name of an object, number of points, members so far)
_handle = None


# --- Which points are marked ----------------------------------------------------------------------


def forget():
    """Has all marks looked up again."""
    _known.clear()


def note(obj, name, row):
    """Tells what has just been marked, so that nothing must be looked up."""
    _known.setdefault(obj.name, {})[name] = Mark(1, row, (row,))


def marks_of(obj, wait=False):
    """By feature, its Mark on an object, or None where it isn't known yet or holds no point.

    `wait` looks up at once what isn't known.
    """
    names = feature_names(obj)
    known = _known.setdefault(obj.name, {})
    stale = [name for name in names if name not in known or not _holds(obj, name, known[name])]
    if stale and wait:
        _learn(obj, _members(obj, 0, size_of(obj)))
        known = _known[obj.name]
    elif stale and obj.name not in _queue and obj.mode != "EDIT":
        _queue.append(obj.name)
        if not bpy.app.timers.is_registered(_look):
            bpy.app.timers.register(_look, first_interval=0.0)
    return {name: known.get(name) if name not in stale or wait else None for name in names}


def count_of(obj, name):
    """How many points a feature marks on an object, 0 for none, or None where it isn't known."""
    known = _known.get(obj.name, {}) if obj is not None else {}
    if name not in known:
        return None
    return 0 if known[name] is None else known[name].count


def size_of(obj):
    """How many points an object has by itself."""
    return len(arrays.points_of(obj.data))


def _holds(obj, name, mark):
    """Whether a point is still marked. Nothing tells whether an empty group still is empty."""
    if mark is None:
        return True
    if mark.row >= size_of(obj):
        return False
    if obj.type == "POINTCLOUD":
        attribute = arrays.point_attribute(obj.data, PREFIX + name, "FLOAT", "INT", "BOOLEAN")
        return attribute is not None and bool(attribute.data[mark.row].value)
    index = obj.vertex_groups[PREFIX + name].index
    return any(e.group == index and e.weight > 0 for e in obj.data.vertices[mark.row].groups)


def _members(obj, first, last):
    """By feature, the points of a range that are marked: rows and weights."""
    if obj.type == "POINTCLOUD":
        found = {}
        for name in feature_names(obj):
            values = arrays.read_attribute(obj.data.attributes[PREFIX + name])
            rows = np.flatnonzero(values > 0)
            found[name] = list(zip(rows.tolist(), values[rows].tolist(), strict=True))
        return found
    groups = feature_groups(obj)
    found = {name: [] for name in groups.values()}
    for row, vertex in enumerate(obj.data.vertices[first:last], first):
        for element in vertex.groups:
            if element.group in groups and element.weight > 0:
                found[groups[element.group]].append((row, element.weight))
    return found


def _learn(obj, members):
    positions = None
    marks = {}
    for name, pairs in members.items():
        if not pairs:
            marks[name] = None
            continue
        rows, weights = (np.array(side) for side in zip(*pairs, strict=True))
        row = int(rows[0])
        if len(rows) > 1:
            if positions is None:
                positions = arrays.positions_of(obj.data)
            row = feature_row(positions, rows, weights)
        some = rows[:: math.ceil(len(rows) / _SHOWN)]
        marks[name] = Mark(len(rows), row, tuple(int(r) for r in some))
    _known[obj.name] = marks


def _look():
    """A timer: one slice of one object. Objects are asked for by name, since undo moves them."""
    global _partial
    obj = bpy.data.objects.get(_queue[0]) if _queue else None
    if obj is None or obj.type not in {"MESH", "POINTCLOUD"} or obj.mode == "EDIT":
        del _queue[:1]
        _partial = None
        return 0.0 if _queue else None
    size = size_of(obj)
    if _partial is None or _partial[:2] != (obj.name, size):
        _partial = (obj.name, size, 0, {})
    first, members = _partial[2:]
    last = size if obj.type == "POINTCLOUD" else min(first + _SLICE, size)
    found = _members(obj, first, last)
    members = {name: members.get(name, []) + pairs for name, pairs in found.items()}
    _partial = (obj.name, size, last, members)
    if last < size:
        return 0.0
    _learn(obj, members)
    _queue.pop(0)
    _partial = None
    redraw()
    return 0.0 if _queue else None


def redraw():
    """Has all 3D viewports drawn anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


# --- Where they are -------------------------------------------------------------------------------


def shown_data(obj, depsgraph):
    """What the viewport shows of an object, when it has the object's own points; else those."""
    data = obj.evaluated_get(depsgraph).data
    kind = "vertices" if obj.type == "MESH" else "points"
    same = len(getattr(data, kind, ())) == len(getattr(obj.data, kind))
    return data if same else obj.data


def place_of(obj, row, depsgraph):
    """(3,) of a row, in the world, as the viewport shows it."""
    points = arrays.points_of(shown_data(obj, depsgraph))
    return obj.matrix_world @ Vector(points[row].co)


def normal_of(obj, row, depsgraph):
    """(3,) in the world, or None where the object has none."""
    if obj.type != "MESH" or not obj.data.polygons:
        return None
    data = shown_data(obj, depsgraph)
    inverse = obj.matrix_world.to_3x3()
    if abs(inverse.determinant()) < 1e-30:
        return None
    return inverse.inverted().transposed() @ Vector(data.vertices[row].normal)


# --- Drawing --------------------------------------------------------------------------------------


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
        name = "FLAT_COLOR" if bpy.app.version >= (4, 0, 0) else "2D_FLAT_COLOR"
        shader = gpu.shader.from_builtin(name)
        content = {"pos": self._points, "color": self._colors}
        if bpy.app.version >= (4, 0, 0):
            content["pos"] = [(*point, 0.0) for point in self._points]
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
    marks = marks_of(obj)
    for number, feature in enumerate(settings.features):
        mark = marks.get(feature.marked_name)
        if mark is None or not feature.use:
            continue
        place = place_of(obj, mark.row, depsgraph)
        spot = location_3d_to_region_2d(context.region, context.region_data, place)
        if spot is None:
            continue
        opacity = _BEHIND if _faces_away(context, obj, mark.row, place, depsgraph) else 1.0
        color = (*color_of(number), opacity)
        for row in mark.rows if mark.count > 1 else ():
            at = place_of(obj, row, depsgraph)
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


def _faces_away(context, obj, row, place, depsgraph):
    normal = normal_of(obj, row, depsgraph)
    if normal is None:
        return False
    back = context.region_data.view_matrix.inverted()
    to_viewer = back.to_3x3() @ Vector((0.0, 0.0, 1.0))
    if context.region_data.is_perspective:
        to_viewer = back.translation - place
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


def register():
    global _handle
    if not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister():
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    forget()
