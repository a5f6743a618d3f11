"""More vertices for a source where its faces are too large to show the shapes that it becomes."""

from dataclasses import replace

import bmesh
import numpy as np
import pointmorph

from ..core import transforms
from ..core.features import PREFIX
from ..data import arrays, surfaces
from ..data.denser_source import Stop, are_same
from . import morph_object, morph_paths

_ORIGIN = ".origin"  # of every face: which of the source's it was


def check(obj):
    """The source of a morph object, which can be subdivided.

    Raises
    ------
    CloudError
        See `morph_paths.source_ways`; and when the source is linked, or not in Object Mode.
    """
    source = morph_paths.source_ways(obj)[0]
    _check_editable(source)
    return source


def stops_of(obj, requests):
    """What `denser_source.compute` starts from: the shapes that a morph object leads through.

    Parameters
    ----------
    obj : Object
        A morph object.
    requests : sequence of computation.Request
        What it takes to compute it again.

    Raises
    ------
    CloudError
        See `morph_paths.source_ways`; and when no shape has faces, or one of a chain has changed.
    """
    places = morph_paths.source_ways(obj)[1]
    shapes = [request.target for request in requests]
    if requests[0].source.triangles is None or all(one.triangles is None for one in shapes):
        raise pointmorph.CloudError(
            obj.name,
            "shapes with faces",
            "one without, or a morph from an earlier version",
            "Recompute the morph, or subdivide the source in Edit Mode.",
        )
    if not _are_stored(obj, [requests[0].source, *shapes]):
        if len(shapes) > 1:
            raise pointmorph.CloudError(
                obj.name,
                "the shapes it was made from",
                "others that have changed",
                "Recompute first.",
            )
        return [Stop(shapes[0], None, None)]  # found anew
    backs = _backs(obj, shapes)
    return [Stop(*stop) for stop in zip(shapes, places[1:], backs, strict=True)]


def _are_stored(obj, shapes):
    """Whether shapes lie where they lay when they were morphed: the maps are about these."""
    stages = zip(morph_object.stage_keys(obj), morph_object.stage_rows(obj), strict=True)
    stored = [arrays.by_row(rows, arrays.key_positions(key)) for key, rows in stages]
    pairs = zip((shape.positions for shape in shapes), stored, strict=True)
    return all(are_same(*pair) for pair in pairs)


def _check_editable(source):
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


def _backs(obj, shapes):
    """Of every shape after the first, where its points are on the first; None where an earlier
    version didn't keep it."""
    stages = zip(morph_object.map_names(obj), morph_object.stage_rows(obj)[1:], strict=True)
    backs, on_first = [], None
    for number, ((_, name), rows) in enumerate(stages):
        if name not in obj.data.attributes:
            return [None] * len(shapes)
        places = arrays.by_row(rows, arrays.read_vectors(obj.data, name))
        if number > 0:  # these are on the shape before, whose points have theirs
            before = shapes[number - 1]
            _, members, shares = surfaces.around(before.positions, before.triangles, places)
            places = surfaces.mean(on_first, members, shares)
        backs.append(places)
        on_first = places
    return backs


def write(source, finer, triangles):
    """Cuts the faces of a source as a `denser_source.Finer` of its triangles says. New vertices lie
    on its faces, so that it looks the same, and have what those around them have.

    Returns
    -------
    int, int
        The number of vertices before and after.

    Raises
    ------
    CloudError
        When the mesh isn't the one of those triangles any more.
    """
    mesh = source.data
    before = len(mesh.vertices)
    now = arrays.mesh_triangles(mesh)
    if now is not None and np.array_equal(
        transforms.turned(now), triangles
    ):  # of a mirrored object
        finer = replace(finer, triangles=transforms.turned(finer.triangles))
    elif now is None or not np.array_equal(now, triangles):
        raise pointmorph.CloudError(
            source.name, "a mesh that doesn't change", "changes in the meantime", "Try again."
        )
    if not len(finer.ends):
        return before, before
    has_normals = arrays.keep_normals(mesh)
    edited = bmesh.new()
    try:
        edited.from_mesh(mesh)
        _cut(edited, source.name, finer, arrays.triangle_faces(mesh)[finer.parents])
        _keep_marks(edited, source, before)
        edited.to_mesh(mesh)
    except BaseException:
        arrays.forget_normals(mesh)
        raise
    finally:
        edited.free()
    if has_normals:
        arrays.give_normals_back(mesh)
    mesh.update()
    return before, len(mesh.vertices)


def _cut(edited, name, finer, polygons):
    """Halves edges of a BMesh, and cuts the faces that have new vertices into triangles. Blender
    gives new vertices and corners what those have that they lie between.

    Parameters
    ----------
    edited : BMesh
    name : str
        The source's.
    finer : denser_source.Finer
    polygons : (F,) array of int
        The face of the BMesh that each of its triangles is a piece of.

    Raises
    ------
    CloudError
        When it has no such face.
    """
    origin = edited.faces.layers.int.new(_ORIGIN)
    for number, face in enumerate(edited.faces):
        face[origin] = number
    vertices, keys = list(edited.verts), edited.verts.layers.shape.values()
    own = len(vertices)
    owner = np.zeros(own + len(finer.ends), np.int64)  # of what lies within a face
    owner[finer.triangles] = polygons[:, None]

    def own_edge(start, end, polygon):
        """That of a piece of the polygon; others may be between the same vertices."""
        for edge in start.link_edges:
            if edge.other_vert(start) == end and any(f[origin] == polygon for f in edge.link_faces):
                return edge
        return None

    def edge_between(a, b, polygon):
        ends = vertices[a], vertices[b]
        edge = own_edge(*ends, polygon)
        if edge is None:
            others = set(ends[1].link_faces)
            shared = (face for face in ends[0].link_faces if face in others)
            face = next((one for one in shared if one[origin] == polygon), None)
            if face is None:
                return None
            bmesh.utils.face_split(face, *ends)
            edge = own_edge(*ends, polygon)
        return edge

    for (a, b), polygon in zip(finer.ends.tolist(), owner[own:].tolist(), strict=True):
        edge = edge_between(a, b, polygon)
        if edge is None:
            raise pointmorph.CloudError(
                name,
                "faces that can be cut in two",
                f"face {polygon}, which can't",
                "Remove doubled faces and edges (Mesh > Clean Up), or subdivide it in Edit Mode.",
            )
        vertices.append(bmesh.utils.edge_split(edge, vertices[a], 0.5)[1])
        _put_between(vertices[-1], vertices[a], vertices[b], keys)
    is_cut = (finer.triangles >= own).any(axis=1)
    is_cut = np.isin(polygons, polygons[is_cut])
    for triangle, polygon in zip(
        finer.triangles[is_cut].tolist(), polygons[is_cut].tolist(), strict=True
    ):
        for a, b in zip(triangle, [*triangle[1:], triangle[0]], strict=True):
            edge_between(a, b, polygon)
    edited.faces.layers.int.remove(origin)


def _put_between(vertex, start, end, keys):
    """Puts a vertex in the middle of two, also in shape keys, whichever comes first: on the other
    side of a seam it has the same bits."""
    vertex.co = (start.co + end.co) / 2
    for key in keys:
        vertex[key] = (start[key] + end[key]) / 2


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
