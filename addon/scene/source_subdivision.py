"""More vertices for a source where its faces are too large to show the shapes that it becomes."""

from contextlib import contextmanager
from dataclasses import dataclass

import bmesh
import numpy as np
import pointmorph
from mathutils import Vector

from ..core.features import PREFIX
from ..data import arrays, coverage
from . import morph_object, morph_paths, recipes

_ROUNDS = 6
_MOST = 50_000  # vertices, but for those that make steps from face to face even
_MUCH = 0.1  # of what a face has to show
_FEW = 4  # samples that could be missed by chance
_LONG = 0.6  # of a face's longest side: sides that are halved with it
_ORIGIN = ".origin"  # of every face: which of the source's it was


@dataclass(frozen=True)
class _Stop:
    """A shape that the source becomes: its faces, and where the source's vertices are then."""

    surface: coverage.Surface
    places: np.ndarray


def subdivide(obj):
    """Subdivides faces of the source of a morph object that are too large for what they are to show
    of the shapes after it. New vertices lie on the source's faces, so that it looks the same.

    Returns
    -------
    int, int
        The number of vertices before and after.

    Raises
    ------
    CloudError
        See `morph_paths.source_ways`; and when nothing has faces, or the source is linked.
    """
    source, places, *_ = morph_paths.source_ways(obj)
    mesh = source.data
    if not mesh.is_editable or mesh.override_library is not None:
        raise pointmorph.CloudError(
            source.name,
            "an editable mesh",
            "one linked from another file",
            "Make it local (Object > Relations > Make Local).",
        )
    if mesh.is_editmode or source.mode != "OBJECT":
        raise pointmorph.CloudError(
            source.name, "a mesh in Object Mode", "another mode", "Switch to Object Mode (Tab)."
        )
    surfaces = [_surface(obj, number) for number in range(1, len(places))]
    stops = [
        _Stop(surface, place)
        for surface, place in zip(surfaces, places[1:], strict=True)
        if surface is not None
    ]
    if not mesh.polygons or not stops:
        raise pointmorph.CloudError(
            obj.name,
            "a source and a target with faces",
            "none, or a morph from an earlier version",
            "Recompute the morph, or subdivide the source in Edit Mode.",
        )
    before = len(mesh.vertices)
    levels = _levels(mesh, stops)
    if not levels.any():
        return before, before
    with _edited(mesh) as (edited, origin):
        for level in range(1, levels.max() + 1):
            _halve(edited, origin, levels >= level)
        _keep_marks(edited, source, before)
        edited.faces.layers.int.remove(edited.faces.layers.int[_ORIGIN])
        edited.to_mesh(mesh)
    mesh.update()
    return before, len(mesh.vertices)


def _surface(obj, number):
    """The faces of a shape of the morph, in its frame; None without any."""
    triangles = recipes.faces_of(obj)[number]
    if triangles is None:
        return None
    stage = (part[number] for part in (morph_object.stages(obj), morph_object.stage_keys(obj)))
    row = morph_object.stage_rows(obj)[number]
    return coverage.surface(morph_object.read_stage(obj, *stage, row)["positions"], triangles)


@contextmanager
def _edited(mesh):
    """A BMesh of a mesh, and the layer of its faces that keeps which face of the mesh each was."""
    edited = bmesh.new()
    try:
        edited.from_mesh(mesh)
        origin = edited.faces.layers.int.new(_ORIGIN)
        for number, face in enumerate(edited.faces):
            face[origin] = number
        yield edited, origin
    finally:
        edited.free()


def _levels(mesh, stops):
    """By face of a mesh, how often its sides are to be halved."""
    levels = np.zeros(len(mesh.polygons), np.int32)
    with _edited(mesh) as (edited, origin):
        layers = [
            _add_layer(edited, f".place {number}", stop.places) for number, stop in enumerate(stops)
        ]
        trees = [stop.surface.tree() for stop in stops]
        for _ in range(_ROUNDS):
            too_large = np.zeros(len(levels), bool)
            for stop, layer in zip(stops, layers, strict=True):
                too_large |= _too_large(edited, origin, layer, stop.surface, len(levels))
            count = len(edited.verts)
            if not too_large.any():
                break
            _halve(edited, origin, too_large)
            if len(edited.verts) > _MOST:
                break
            levels += too_large
            for vertex in edited.verts[count:]:
                for layer, tree in zip(layers, trees, strict=True):
                    vertex[layer] = tree.find_nearest(vertex[layer])[0]
    return _evened(mesh, levels)


def _add_layer(edited, name, values):
    layer = edited.verts.layers.float_vector.new(name)
    for vertex, value in zip(edited.verts, values.tolist(), strict=True):
        vertex[layer] = Vector(value)
    return layer


def _too_large(edited, origin, layer, surface, count):
    """By face of the source, whether it misses much of what it has to show of a surface."""
    loops = edited.calc_loop_triangles()
    edited.verts.index_update()
    triangles = np.array([[loop.vert.index for loop in corners] for corners in loops], np.int32)
    places = np.array([vertex[layer] for vertex in edited.verts], np.float32)
    nearest, far = coverage.missed(places, triangles, surface)
    faces = np.array([corners[0].face[origin] for corners in loops])[nearest]
    whole = np.bincount(faces, surface.shares, count)
    lost = np.bincount(faces[far], surface.shares[far], count)
    return (lost > _MUCH * whole) & (np.bincount(faces[far], minlength=count) >= _FEW)


def _halve(edited, origin, chosen):
    """Halves the long sides of faces, by the source's faces that they were.

    Vertices can be taken by number then, the new ones last.
    """
    faces = [face for face in edited.faces if chosen[face[origin]]]
    polygons = [face for face in faces if len(face.verts) > 4]
    if polygons:
        bmesh.ops.poke(edited, faces=polygons)
        faces = [face for face in edited.faces if chosen[face[origin]]]
    edges = {}
    for face in faces:
        lengths = {edge: edge.calc_length() for edge in face.edges}
        least = _LONG * max(lengths.values())
        edges.update((edge, None) for edge, length in lengths.items() if length >= least)
    bmesh.ops.subdivide_edges(
        edited,
        edges=list(edges),
        cuts=1,
        use_grid_fill=True,
        use_single_edge=True,  # else its neighbors become polygons
        quad_corner_type="INNER_VERT",
    )
    edited.verts.ensure_lookup_table()


def _evened(mesh, levels):
    """With steps of one at most from a face to those around, so that they join well."""
    corners = arrays.mesh_corners(mesh)
    faces = np.repeat(np.arange(len(levels)), arrays.corner_counts(mesh))
    while True:
        at_vertices = np.zeros(len(mesh.vertices), np.int32)
        np.maximum.at(at_vertices, corners, levels[faces])
        raised = levels.copy()
        np.maximum.at(raised, faces, at_vertices[corners] - 1)
        if np.array_equal(raised, levels):
            return levels
        levels = raised


def _keep_marks(edited, source, before):
    """Takes new vertices out of the groups of features whose weights said which vertices are meant:
    beside those, they would be marked halfway."""
    layer = edited.verts.layers.deform.active
    if layer is None:
        return
    names = {
        group.index: group.name for group in source.vertex_groups if group.name.startswith(PREFIX)
    }
    found = arrays.vertex_groups(source.data, names)
    for index, name in names.items():
        weights = found[name][1]
        if not weights.size or np.ptp(weights) > 0.0:
            continue
        full = float(weights[0]) * (1.0 - 1e-4)
        for vertex in edited.verts[before:]:
            if vertex[layer].get(index, full) < full:
                del vertex[layer][index]
