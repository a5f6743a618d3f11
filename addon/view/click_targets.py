"""What lies under the mouse in a 3D viewport."""

import bpy
import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from mathutils import Vector

from ..core import transforms
from ..data import arrays
from ..scene import marked_points

_REACH = 14.0  # pixels from the mouse to a point without faces, at the most
_COVER = 0.01  # of an object's extent, by which a face lies before what it covers
_LAYER = 0.12  # of the extent: so much deeper is as bad as so far away


def nearest_on_surface(obj, origin, direction, depsgraph):
    """The vertex nearest to where a ray meets an object, of the face that it meets: none of the
    other side of a thin part, nor of another part behind.

    Parameters
    ----------
    origin, direction : (3,)
        In the world.

    Returns
    -------
    (float, int) or None
        Distance from the origin to where it meets the surface, and the row.
    """
    inverse = obj.matrix_world.inverted_safe()
    start = inverse @ origin
    along = inverse @ (origin + direction) - start
    hit, place, _, face = obj.ray_cast(start, along, depsgraph=depsgraph)
    if not hit:
        return None
    met = obj.matrix_world @ place
    shown = marked_points.shown_data(obj, depsgraph)
    if shown != obj.data and face < len(shown.polygons):
        rows = shown.polygons[face].vertices
        world = [obj.matrix_world @ shown.vertices[row].co for row in rows]
        nearest = min(range(len(rows)), key=lambda corner: (world[corner] - met).length)
        return (met - origin).length, int(rows[nearest])
    # Of other vertices than those that are seen.
    world = transforms.apply(obj.matrix_world, arrays.vertex_positions(shown))
    row = int(np.argmin(((world - np.array(met)) ** 2).sum(axis=1)))
    return (met - origin).length, row


def nearest_projected(places, matrix, size, at):
    """A point that is drawn near a pixel and not behind others: on a slope the nearest, on a thin
    part one of the front.

    Parameters
    ----------
    places : (N, 3) array
        In the world.
    matrix : (4, 4) array
        From the world to the view's cube.
    size, at : (2,)
        Of the region, and the pixel in it.

    Returns
    -------
    int or None
    """
    if not len(places):
        return None
    flat = transforms.apply(matrix, places)
    depth = places @ matrix[3, :3] + matrix[3, 3]
    front = depth > 1e-9
    pixels = np.full((len(places), 2), np.inf)
    pixels[front] = (flat[front, :2] / depth[front, None] + 1) / 2 * np.array(size)
    apart = np.hypot(*(pixels - np.array(at)).T)
    near = np.flatnonzero(apart <= _REACH)
    if not near.size:
        return None
    # Depth in the world's units: w of a perspective, else z, which is scaled.
    deep = depth if matrix[3, :3].any() else flat[:, 2] / np.linalg.norm(matrix[2, :3])
    extent = max(float(np.ptp(places, axis=0).max()), 1e-30)
    behind = (deep[near] - deep[near].min()) / extent
    return int(near[np.argmin(apart[near] / _REACH + behind / _LAYER)])


def pick(context, area, region, view, at):
    """The object, source or target, and the row that lie under a pixel of a region; or None."""
    settings = context.scene.pointmorph
    depsgraph = context.evaluated_depsgraph_get()
    origin = region_2d_to_origin_3d(region, view, at)
    direction = region_2d_to_vector_3d(region, view, at)
    best = None
    for obj in (settings.source, settings.target):
        if not obj.visible_get(viewport=area.spaces.active) or obj.type in arrays.MADE_TYPES:
            continue
        if obj.type == "MESH" and obj.data.polygons:
            found = nearest_on_surface(obj, origin, direction, depsgraph)
        else:
            data = marked_points.shown_data(obj, depsgraph)
            places = transforms.apply(obj.matrix_world, arrays.positions_of(data))
            matrix = np.array(view.perspective_matrix)
            row = nearest_projected(places, matrix, (region.width, region.height), at)
            along = None if row is None else np.dot(places[row] - np.array(origin), direction)
            found = None if row is None else (along, row)
        if found is not None and (best is None or found[0] < best[0]):
            best = (*found, obj)
    return None if best is None else (best[2], best[1])


def is_covered(context, area, view, place):
    """Whether a place in the world is hidden behind faces of the source or the target."""
    settings = context.scene.pointmorph
    objects = [
        obj
        for obj in (settings.source, settings.target)
        if obj.type == "MESH" and obj.data.polygons and obj.visible_get(viewport=area.spaces.active)
    ]
    depsgraph = context.evaluated_depsgraph_get()
    back = view.view_matrix.inverted()
    viewer = back.translation
    if not view.is_perspective:  # as seen from beyond all that may cover it
        away = [o.dimensions.length + (o.matrix_world.translation - place).length for o in objects]
        viewer = place + back.to_3x3() @ Vector((0.0, 0.0, 2.0 * max(away, default=1.0)))
    for obj in objects:
        inverse = obj.matrix_world.inverted_safe()
        start, end = inverse @ viewer, inverse @ place
        if start == end:
            continue
        hit, met, *_ = obj.ray_cast(start, end - start, depsgraph=depsgraph)
        before = (place - viewer).length - (obj.matrix_world @ met - viewer).length
        if hit and before > _COVER * max(obj.dimensions):
            return True
    return False


def viewport_at(window, x, y):
    """Area, region, view and place of a pixel of a window that lies on a 3D viewport; or None."""
    for area in window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        over = [r for r in area.regions if _inside(r, x, y)]
        if any(region.type != "WINDOW" for region in over):
            return None  # a bar that lies over it
        if not over:
            continue
        space = area.spaces.active
        views = [space.region_3d]
        windows = [region for region in area.regions if region.type == "WINDOW"]
        if len(windows) > 1:
            views = list(space.region_quadviews)
        region = over[0]
        return area, region, views[windows.index(region)], (x - region.x, y - region.y)
    return None


def _inside(region, x, y):
    wide = region.width > 1 and region.height > 1  # else it's hidden
    beside = 0 <= x - region.x < region.width and 0 <= y - region.y < region.height
    # The bar of tools is as high as the viewport, wherever its buttons end.
    return wide and beside and region.type != "TOOLS"


def navigates(event, where):
    """Whether a click is for the view: beside a viewport, on its gizmos, or an emulated button."""
    if where is None:
        return True
    preferences = bpy.context.preferences
    if event.alt and preferences.inputs.use_mouse_emulate_3_button:
        return True
    area, region, _, (x, y) = where
    if not area.spaces.active.show_gizmo or not area.spaces.active.show_gizmo_navigate:
        return False
    scale = preferences.system.ui_scale
    right = region.x + region.width
    for other in area.regions:
        if other.type == "UI" and other.width > 1 and region.x < other.x < right:
            right = other.x  # the sidebar lies over it
    from_right = right - region.x - x
    size = preferences.view.gizmo_size_navigate_v3d * scale
    # The turning gizmo, and a column of buttons under it.
    wide, high = size * 1.25, size * 1.5
    top = region.height - y
    return (from_right < wide and top < high + 30 * scale) or (
        from_right < 45 * scale and top < high + 170 * scale
    )
