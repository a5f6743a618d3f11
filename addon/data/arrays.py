"""Arrays between Blender and numpy: the only file that moves them.

Everything is float32 or int32, as Blender keeps it.
"""

import hashlib

import numpy as np

from ..core.stepping import finish

SHAPE_TYPES = ("MESH", "POINTCLOUD")
"""Types of objects that can be morphed themselves."""

MADE_TYPES = ("CURVE", "FONT", "META", "SURFACE")
"""Types of objects of which a mesh is morphed that shows what they show."""

MORPHED_TYPES = SHAPE_TYPES + MADE_TYPES


def type_name(obj):
    """The type of an object as Blender's menus have it, such as "Point Cloud"."""
    return obj.bl_rna.properties["type"].enum_items[obj.type].name


# By type of attribute: the name of its values, and how many numbers each has.
_VALUES = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "INT8": ("value", 1),
    "INT32_2D": ("value", 2),
    "BOOLEAN": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
}
_NORMALS = "pointmorph_normals"
# Vertices whose groups are read at once where Blender must stay usable.
_PART = 4096


def _read(collection, key, width, dtype=np.float32):
    values = np.empty(len(collection) * width, dtype)
    collection.foreach_get(key, values)
    return values if width == 1 else values.reshape(-1, width)


def _read_kept(geometry, name, kind, elements, key):
    """What `elements` have as `key`, from the attribute in which Blender keeps it: a hundred times
    as quick. In Edit Mode attributes are empty."""
    value, width = _VALUES[kind]
    dtype = np.int32 if kind.startswith("INT") else np.float32
    kept = geometry.attributes.get(name)
    if kept is None or kept.data_type != kind or len(kept.data) != len(elements):
        return _read(elements, key, width, dtype)
    return _read(kept.data, value, width, dtype)


def _write(collection, key, values, dtype=np.float32):
    collection.foreach_set(key, np.ascontiguousarray(values, dtype).reshape(-1))


def digest(*parts):
    """A short string that tells arrays and bytes from others."""
    found = hashlib.blake2b(digest_size=8)
    for part in parts:
        if isinstance(part, np.ndarray):
            part = np.ascontiguousarray(part).tobytes()
        found.update(part)
    return found.hexdigest()


# --- Any geometry ---------------------------------------------------------------------------------


def points_of(geometry):
    """The vertices of a mesh, or the points of a point cloud."""
    return geometry.vertices if hasattr(geometry, "vertices") else geometry.points


def positions_of(geometry):
    """(N, 3): of the vertices or points."""
    return _read_kept(geometry, "position", "FLOAT_VECTOR", points_of(geometry), "co")


def is_read(attribute):
    """Whether `read_attribute` knows an attribute's type."""
    return attribute.data_type in _VALUES


def read_attribute(attribute):
    """(N,) or (N, 3 or 4) float32. Colors are linear, whether kept as bytes or floats."""
    key, width = _VALUES[attribute.data_type]
    if attribute.data_type == "BOOLEAN":
        return _read(attribute.data, key, width, bool).astype(np.float32)
    if attribute.data_type.startswith("INT"):
        return _read(attribute.data, key, width, np.int32).astype(np.float32)
    return _read(attribute.data, key, width)


def read_rows(geometry, name):
    """(N,) int32: a point attribute that `write_attribute` made from whole numbers."""
    return _read(geometry.attributes[name].data, "value", 1, np.int32)


def read_vectors(geometry, name):
    """(N, 3) float32: a point attribute of vectors."""
    return _read(geometry.attributes[name].data, "vector", 3)


def point_attribute(geometry, name, *types):
    """The point attribute `name` when it's one of `types`, else None."""
    attribute = geometry.attributes.get(name)
    if attribute is None or attribute.domain != "POINT" or attribute.data_type not in types:
        return None
    return attribute


def write_attribute(geometry, name, values, domain="POINT"):
    """An attribute of the type that the array's own type and width tell, in place of one of that
    name."""
    width = 1 if values.ndim == 1 else values.shape[1]
    whole = np.issubdtype(values.dtype, np.integer)
    kinds = {1: "FLOAT", 2: "FLOAT2", 3: "FLOAT_VECTOR", 4: "FLOAT_COLOR"}
    kind = "INT" if whole else kinds[width]
    attribute = geometry.attributes.get(name)
    if attribute is not None and (attribute.data_type, attribute.domain) != (kind, domain):
        geometry.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = geometry.attributes.new(name, kind, domain)
    _write(attribute.data, _VALUES[kind][0], values, np.int32 if whole else np.float32)


def write_corner_colors(mesh, name, colors):
    """A new attribute of 8 bits a channel at the corners of the faces, from (N, 4) linear colors
    of the vertices."""
    attribute = mesh.attributes.new(name, "BYTE_COLOR", "CORNER")
    _write(attribute.data, "color", colors[mesh_corners(mesh)])


def by_row(rows, values):
    """(N, …) from (M, …): what the pairs of a point say, which all say the same."""
    result = np.zeros((rows.max() + 1, *values.shape[1:]), values.dtype)
    result[rows] = values
    return result


# --- Meshes ---------------------------------------------------------------------------------------


def vertex_positions(mesh):
    """(N, 3)"""
    return positions_of(mesh)


def basis_positions(mesh):
    """(N, 3): the basis of the shape keys where there are any, else the vertices."""
    keys = mesh.shape_keys
    return vertex_positions(mesh) if keys is None else key_positions(keys.reference_key)


def mesh_edges(mesh):
    """(E, 2) int32"""
    return _read_kept(mesh, ".edge_verts", "INT32_2D", mesh.edges, "vertices")


def mesh_corners(mesh):
    """(C,) int32: the vertex of every face's corner, faces in order."""
    return _read_kept(mesh, ".corner_vert", "INT", mesh.loops, "vertex_index")


def corner_counts(mesh):
    """(F,) int32: of every face."""
    return _read(mesh.polygons, "loop_total", 1, np.int32)


def mesh_triangles(mesh):
    """(F, 3) int32, or None for a mesh without faces."""
    if not mesh.polygons:
        return None
    mesh.calc_loop_triangles()
    return _read(mesh.loop_triangles, "vertices", 3, np.int32)


def mesh_normals(mesh):
    """(N, 3) vertex normals from the faces, or None where a vertex has no face: it has none."""
    corners = mesh_corners(mesh)
    if not np.bincount(corners, minlength=len(mesh.vertices)).all():
        return None
    return _read(mesh.vertex_normals, "vector", 3)


def active_colors(mesh):
    """The active color attribute or, failing it, the first; else None."""
    return mesh.color_attributes.active_color or next(iter(mesh.color_attributes), None)


def activate_colors(mesh, name):
    """Makes a color attribute the active one, be it one that only modifiers make."""
    mesh.attributes.active_color_name = name


def mesh_colors(mesh):
    """(N, 4) from the active color attribute, or None. Corners of a vertex are averaged."""
    attribute = active_colors(mesh)
    return None if attribute is None else vertex_colors(mesh, attribute)


def vertex_colors(mesh, attribute):
    """(N, 4) from a color attribute; corners of a vertex are averaged."""
    colors = read_attribute(attribute)
    return colors if attribute.domain == "POINT" else mean_of_corners(mesh, colors)


def mean_of_corners(mesh, values):
    """(N, K) from a row a corner; 1 for a vertex without a face."""
    corners = mesh_corners(mesh)
    counts = np.bincount(corners, minlength=len(mesh.vertices))
    result = np.ones((len(mesh.vertices), values.shape[1]), np.float32)
    used = counts > 0
    for column in range(values.shape[1]):
        sums = np.bincount(corners, values[:, column], len(mesh.vertices))
        result[used, column] = sums[used] / counts[used]
    return result


def corner_colors(mesh, attribute):
    """(C, 4) from a color attribute."""
    colors = read_attribute(attribute)
    return colors[mesh_corners(mesh)] if attribute.domain == "POINT" else colors


def material_indices(mesh):
    """(F,) int32: the material slot of every face."""
    if "material_index" not in mesh.attributes and not mesh.is_editmode:
        return np.zeros(len(mesh.polygons), np.int32)
    return _read_kept(mesh, "material_index", "INT", mesh.polygons, "material_index")


def smooth_faces(mesh):
    """(F,) bool: whether a face is shaded smooth."""
    return _read(mesh.polygons, "use_smooth", 1, bool)


def triangle_faces(mesh):
    """(F,) int32: the face of each of `mesh_triangles`."""
    mesh.calc_loop_triangles()
    return _read(mesh.loop_triangles, "polygon_index", 1, np.int32)


def corner_normals(mesh):
    """(C, 3)"""
    return _read(mesh.corner_normals, "vector", 3)


def keep_normals(mesh):
    """Has the corners of a mesh take the normals that somebody gave them along, as new corners take
    what those around them have, until `give_normals_back`. Returns whether there are any."""
    if mesh.has_custom_normals:
        write_attribute(mesh, _NORMALS, corner_normals(mesh), "CORNER")
    return mesh.has_custom_normals


def give_normals_back(mesh, moved=lambda normals: normals):
    """Gives the corners of a mesh the normals that `keep_normals` had them take along. Blender
    keeps what they are beside those of the faces, which have others by now."""
    normals = moved(read_vectors(mesh, _NORMALS))
    forget_normals(mesh)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    # Without a length, Blender takes that of the face.
    mesh.normals_split_custom_set((normals / np.maximum(lengths, 1e-12)).tolist())


def forget_normals(mesh):
    """Takes away what `keep_normals` wrote."""
    if _NORMALS in mesh.attributes:
        mesh.attributes.remove(mesh.attributes[_NORMALS])


def write_uvs(mesh, name, uvs):
    """A UV map in place of one of that name, from (C, 2); or None where a mesh can't have more."""
    layer = mesh.uv_layers.get(name) or mesh.uv_layers.new(name=name, do_init=False)
    if layer is None:
        return None
    _write(layer.data, "uv", uvs)
    return layer


def corner_uvs(layer):
    """(C, 2) from a UV layer."""
    return _read(layer.uv, "vector", 2)


def first_of_corners(mesh, values):
    """(N, K) from a row a corner: a vertex on a seam has that of one side; 0 without a face."""
    corners = mesh_corners(mesh)
    result = np.zeros((len(mesh.vertices), values.shape[1]), np.float32)
    result[corners[::-1]] = values[::-1]
    return result


def triangle_loops(mesh):
    """(F, 3) int32: the corners of `mesh_triangles`."""
    mesh.calc_loop_triangles()
    return _read(mesh.loop_triangles, "loops", 3, np.int32)


def vertex_groups(mesh, names):
    """By name, the vertices of a group and their weights: int64 rows and float32 weights.

    `names` maps the index of a vertex group to the name under which it's wanted.
    """
    return finish(vertex_group_steps(mesh, names))


def vertex_group_steps(mesh, names):
    """The same as a generator, which takes long on a large mesh: it yields after every part, and
    returns what `vertex_groups` does. The mesh must not change meanwhile."""
    found = {name: ([], []) for name in names.values()}
    count = len(mesh.vertices) if names else 0
    for start in range(0, count, _PART):
        for row, vertex in enumerate(mesh.vertices[start : start + _PART], start):
            for element in vertex.groups:
                name = names.get(element.group)
                if name is not None:
                    found[name][0].append(row)
                    found[name][1].append(element.weight)
        yield
    return {
        name: (np.array(rows, np.int64), np.array(weights, np.float32))
        for name, (rows, weights) in found.items()
    }


def selected_vertices(mesh):
    """Rows of the vertices that are selected in Object Mode."""
    return np.flatnonzero(_read(mesh.vertices, "select", 1, bool))


def _write_vertices(mesh, positions):
    """Where the vertices are, into the attribute in which Blender keeps it: a hundred times as
    quick. In Edit Mode attributes are empty."""
    kept = point_attribute(mesh, "position", "FLOAT_VECTOR")
    if kept is None or len(kept.data) != len(mesh.vertices):
        _write(mesh.vertices, "co", positions)
    elif len(positions) > 0:
        _write(kept.data, "vector", positions)
        # So that Blender learns of it: what it knows of the old places, bounds too, is found anew.
        mesh.vertices[0].co = positions[0]


def fill_mesh(mesh, positions, triangles=None):
    """Gives an empty mesh these vertices and smooth faces, and nothing else."""
    mesh.vertices.add(len(positions))
    _write_vertices(mesh, positions)
    if triangles is not None:
        count = len(triangles)
        mesh.loops.add(3 * count)
        _write(mesh.loops, "vertex_index", triangles, np.int32)
        mesh.polygons.add(count)
        _write(mesh.polygons, "loop_start", np.arange(0, 3 * count, 3), np.int32)
        _write(mesh.polygons, "use_smooth", np.ones(count), bool)
    mesh.update(calc_edges=triangles is not None)


def move_vertices(mesh, positions):
    """Gives the vertices of a mesh other places."""
    _write_vertices(mesh, positions)
    mesh.update()


# --- Shape keys -----------------------------------------------------------------------------------


def key_positions(key):
    """(N, 3)"""
    return _read(key.points, "co", 3)


def write_key(key, positions):
    _write(key.points, "co", positions)


# --- Point clouds ---------------------------------------------------------------------------------


def cloud_positions(cloud):
    """(N, 3)"""
    return _read(cloud.points, "co", 3)


def cloud_colors(cloud):
    """(N, 4): the point attribute "Color" or, failing it, the first of colors; else None."""
    kinds = ("FLOAT_COLOR", "BYTE_COLOR")
    attribute = point_attribute(cloud, "Color", *kinds)
    if attribute is None:
        of_points = (point_attribute(cloud, a.name, *kinds) for a in cloud.attributes)
        attribute = next(filter(None, of_points), None)
    return None if attribute is None else read_attribute(attribute)


def mark_points(cloud, name, rows, weights=None):
    """A new point attribute that is 1 (or its weight) at these rows and 0 elsewhere."""
    values = np.zeros(len(cloud.points), np.float32)
    values[rows] = 1.0 if weights is None else weights
    write_attribute(cloud, name, values)


# --- Hair -----------------------------------------------------------------------------------------


def curve_points(curves):
    """(P, 3) positions, and (S + 1,) int32: where the points of each curve begin, and the last
    ones end."""
    offsets = _read(curves.curve_offset_data, "value", 1, np.int32)
    return _read(curves.position_data, "vector", 3), offsets


def move_curve_points(curves, positions):
    """Gives the points of curves other places."""
    _write(curves.position_data, "vector", positions)


def scale_radii(curves, scales):
    """Multiplies the radii that points of curves have, if they have any, by (P,)."""
    attribute = point_attribute(curves, "radius", "FLOAT")
    if attribute is not None:
        _write(attribute.data, "value", read_attribute(attribute) * scales)


# --- Images ---------------------------------------------------------------------------------------


def image_pixels(image):
    """(H, W, K) float32 of K channels as Blender has them: bytes encoded, floats linear; the
    lowest row first. None for an image that can't be loaded."""
    count = len(image.pixels)  # loads it
    width, height = image.size
    if not count or not width or not height:
        return None
    values = np.empty(count, np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(height, width, -1)


def write_pixels(image, values):
    """Gives an image of that size its pixels, (H, W, 4), and keeps them in the file."""
    image.pixels.foreach_set(np.ascontiguousarray(values, np.float32).reshape(-1))
    image.update()
    image.pack()


# --- Nodes ----------------------------------------------------------------------------------------


def place_nodes(tree, places):
    """(N, 2): where the nodes lie. One by one, Blender would go through the tree for each."""
    _write(tree.nodes, "location", places)
