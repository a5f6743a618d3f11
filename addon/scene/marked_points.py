"""Which points of an object are marked, and where they are.

Looking into all vertices for the members of a group takes long, so that is done in slices between
redraws and remembered; what is remembered counts as long as the vertex still is in the group.
"""

import math
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ..core.features import PREFIX, feature_row
from ..data import areas, arrays
from ..data.feature_list import feature_groups, feature_names
from ..data.registration import Registration, stop_timer

_SLICE = 8192  # vertices looked at between redraws
_SHOWN = 100  # dots for a curve or region, at the most


@dataclass(frozen=True)
class Mark:
    """What a group of a feature holds: how many points, some of them, and the one that counts."""

    count: int
    row: int
    rows: tuple


_known = {}  # name of an object: {name of a feature: Mark or None}
_queue = []  # names of objects to look into
_partial = None  # (name of an object, number of points, members so far)


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
    if obj is None or obj.type not in arrays.SHAPE_TYPES or obj.mode == "EDIT":
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
    areas.redraw_viewports()
    return 0.0 if _queue else None


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


def _stop():
    stop_timer(_look)
    forget()


registration = Registration(stop=_stop)
