"""The look of a target on the faces of a source: drawn on images in the source's UV layout, along
the map from one to the other."""

from dataclasses import dataclass, replace

import numpy as np
import pointmorph
from pointmorph import meshes

from . import texels, transforms
from .looks import Constant, Look, constant_of, reduced
from .tangents import frames_of_corners, from_tangent_space, to_tangent_space

STAGE = "blending textures"
_PART = 1 << 20  # texels that are drawn at once


@dataclass(frozen=True)
class Skin:
    """What the faces of a mesh have besides their form.

    Attributes
    ----------
    corners : (F, 3) array of int
        Of its triangles: corners of the mesh's faces, of which there are C.
    look : looks.Look or None
    uvs : (C, 2) array or None
        The UV map that renderers take by default.
    uv_name : str
    is_smooth : (F,) array of bool
    normals : (C, 3) array or None
        In the frame of the morph; only where they are wanted.
    """

    corners: np.ndarray
    look: Look | None
    uvs: np.ndarray | None
    uv_name: str
    is_smooth: np.ndarray
    normals: np.ndarray | None = None

    def moved(self, matrix):
        """Taken through a (4, 4) matrix."""
        corners = transforms.move_faces(matrix, self.corners)
        if self.normals is None:
            return replace(self, corners=corners)
        normals = transforms.move_normals(matrix, self.normals)
        return replace(self, corners=corners, normals=normals)


@dataclass(frozen=True)
class Canvas:
    """The faces that are drawn on: (F, 3) vertices, their skin, and (N, 3) where the vertices are
    on the model."""

    triangles: np.ndarray
    skin: Skin
    places: np.ndarray


@dataclass(frozen=True)
class Model:
    """What is drawn: faces with a look, or points with colors.

    Attributes
    ----------
    positions : (M, 3) array
    triangles : (G, 3) array of int or None
    skin : Skin or None
    colors : (M, 4) array or None
        Of the points.
    """

    positions: np.ndarray
    triangles: np.ndarray | None
    skin: Skin | None
    colors: np.ndarray | None

    @property
    def look(self):
        return None if self.skin is None else self.skin.look

    @property
    def has_look(self):
        return self.look is not None or self.colors is not None

    def at(self, positions):
        """The same with its vertices elsewhere, as in another pose: what was seen of each face goes
        along with it."""
        skin = self.skin
        if (
            skin is not None
            and skin.normals is not None
            and not np.array_equal(positions, self.positions)
        ):
            moved = [places[self.triangles] for places in (self.positions, positions)]
            normals = transforms.move_along(*moved, skin.normals[skin.corners])
            skin = replace(skin, normals=skin.normals.copy())
            skin.normals[skin.corners] = normals
        return replace(self, positions=positions, skin=skin)


@dataclass(frozen=True)
class Options:
    """What is wanted.

    Attributes
    ----------
    size : int
        Pixels along a side of the images, a power of two.
    roughness, normal : bool
        Draws these as well. Without it, roughness and metalness are those of most of the target.
    """

    size: int = 1024
    roughness: bool = False
    normal: bool = False


@dataclass(frozen=True)
class Drawn:
    """The target's look on the source's faces.

    Attributes
    ----------
    color : (H, W, 4) array or tuple
        Linear, with alpha; a tuple of four where it's the same everywhere.
    roughness, metallic : (H, W) arrays or float
    normal : (H, W, 3) array or None
        In the tangent space of the UV map, from 0 to 1.
    mean : tuple of float
        The mean color.
    is_lit : bool
        Whether it reflects light, or glows.
    uvs : (C, 2) array or None
        A UV map of its own, where the source's can't be drawn on.
    uv_name : str
        The source's UV map; "" where it has one of its own.
    layout : (C, 2) array or None
        The UVs that the images were drawn for; None without images.
    remarks, unread : tuples of str
        In words for the user: how it was drawn, and what of the model couldn't be read.
    options : Options
    """

    color: object
    roughness: object
    metallic: object
    normal: np.ndarray | None
    mean: tuple
    is_lit: bool
    uvs: np.ndarray | None
    uv_name: str
    layout: np.ndarray | None
    remarks: tuple
    unread: tuple
    options: Options

    @property
    def has_images(self):
        return any(isinstance(part, np.ndarray) for part in (self.color, self.roughness))


def draw(canvas, model, options, progress):
    """Draws a model's look on a canvas.

    Parameters
    ----------
    canvas : Canvas
    model : Model
    options : Options
    progress : function
        Of a stage and a fraction; returns whether to go on.

    Returns
    -------
    Drawn

    Raises
    ------
    Cancelled
    """
    plain = None if options.normal else _plain(model, options)
    if plain is not None:
        return plain
    _tell(progress, 0.0)
    skin = canvas.skin
    own, found, owners, remarks = _laid_out(canvas, options.size)
    uvs = (skin.uvs if own is None else own)[skin.corners]
    _tell(progress, 0.1)
    values = _values(canvas, model, options, found, progress)
    if "normal" in values:
        normals = _corner_normals(canvas.places, canvas.triangles, skin.is_smooth)
        frames = frames_of_corners(canvas.places, canvas.triangles, normals, uvs)
        values["normal"] = to_tangent_space(frames, found.triangles, found.shares, values["normal"])
    images = _images(values, found, owners)
    _tell(progress, 1.0)
    surfaces = model.look.used() if model.look is not None else []
    return Drawn(
        images["color"],
        images.get("roughness", _typical(model.look, "roughness", 0.5)),
        images.get("metallic", _typical(model.look, "metallic", 0.0)),
        images.get("normal"),
        tuple(float(x) for x in values["color"].mean(axis=0)),
        not surfaces or any(surface.is_lit for surface in surfaces),
        own,
        "" if own is not None else skin.uv_name,
        skin.uvs if own is None else own,
        tuple(remarks),
        () if model.look is None else model.look.remarks,
        options,
    )


def _tell(progress, fraction):
    if not progress(STAGE, fraction):
        raise pointmorph.Cancelled("Blending textures was canceled.")


def _plain(model, options):
    """A Drawn without images, where all of a model looks the same; else None."""
    if model.look is None:
        return None
    wanted = ("color", "alpha", "roughness", "metallic")[: 4 if options.roughness else 2]
    values = {name: constant_of(model.look, _getter(name)) for name in wanted}
    if None in values.values():
        return None
    color = (*values["color"][:3], values["alpha"][0])
    numbers = [
        values[name][0] if name in values else _typical(model.look, name, default)
        for name, default in (("roughness", 0.5), ("metallic", 0.0))
    ]
    is_lit = any(surface.is_lit for surface in model.look.used())
    unread = model.look.remarks
    return Drawn(color, *numbers, None, color, is_lit, None, "", None, (), unread, options)


def _getter(name):
    return lambda surface: getattr(surface, name)


def _typical(look, name, default):
    """What most corners have that have a number."""
    if look is None:
        return default
    counts = np.bincount(look.of_corners, minlength=len(look.surfaces))
    for number in np.argsort(-counts, kind="stable").tolist():
        value = getattr(look.surfaces[number], name)
        if counts[number] and isinstance(value, Constant):
            return float(value.value[0])
    return default


def _laid_out(canvas, size):
    """UVs of the corners if they get some of their own, else None; the Texels; the face that each
    pixel belongs to, -1 for any; and why, in words."""
    skin = canvas.skin
    reason = "the source has none"
    if skin.uvs is not None:
        reason, found = texels.are_usable(skin.uvs[skin.corners], size)
        if reason is None:
            return None, found, np.full((size, size), -1, np.int32), []
    counts = _corner_counts(skin.corners)
    vertices = np.zeros(counts.sum(), np.int64)
    vertices[skin.corners] = canvas.triangles
    uvs, owners = texels.lay_out(counts, texels.extents(canvas.places[vertices], counts), size)
    found, _ = texels.cover(uvs[skin.corners], len(owners))
    remark = f"The images have a UV map of their own, because {reason}"
    return uvs, found, owners, [remark]


def _corner_counts(triangles):
    """How many corners each face has, from the corners of its triangles: faces are in order, and
    each corner shares a triangle with the next one of its face."""
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    count = int(high.max()) + 1
    inside = np.bincount(low, minlength=count) - np.bincount(high, minlength=count)
    ends = np.flatnonzero(np.cumsum(inside) == 0)
    return np.diff(ends, prepend=-1)


def _values(canvas, model, options, found, progress):
    """By name, what the model has at the texels: (T, K) arrays."""
    parts = {}
    count = len(found.rows)
    look = _as_coarse(model, count)
    closest = frames = None
    if look is not None:
        closest = meshes.ClosestPlaces(model.positions, model.triangles)
        if options.normal:
            frames = _model_frames(model)
    for start in range(0, count, _PART):
        part = slice(start, start + _PART)
        corners = canvas.triangles[found.triangles[part]]
        shares = found.shares[part]
        spots = np.zeros((len(corners), 3), np.float32)
        for vertex, share in zip(corners.T, shares.T, strict=True):
            spots += share[:, None] * canvas.places.take(vertex, axis=0)
        taken = (
            {"color": _between_points(model, spots)}
            if closest is None
            else _taken(model, look, options, frames, *closest.of(spots))
        )
        for name, values in taken.items():
            parts.setdefault(name, []).append(values)
        _tell(progress, 0.1 + 0.8 * min(start + _PART, count) / count)
    return {name: np.concatenate(values) for name, values in parts.items()}


def _taken(model, look, options, frames, triangles, shares):
    corners = model.skin.corners[triangles]
    values = {"color": look.color_values(corners, shares)}
    if options.roughness:
        for name in ("roughness", "metallic"):
            values[name] = look.values(_getter(name), corners, shares)[:, :1]
    if options.normal:
        values["normal"] = _normals(model, look, frames, triangles, shares)
    return values


def _between_points(model, places):
    """(T, 4): colors of the three points around each place, by nearness."""
    count = min(3, len(model.positions))
    members = meshes.nearest_rows(model.positions, places, count)
    apart = np.linalg.norm(model.positions[members] - places[:, None], axis=2)
    scale = max(float(np.ptp(model.positions, axis=0).max()), 1e-30)
    shares = 1.0 / np.maximum(apart, 1e-9 * scale) ** 2
    shares /= shares.sum(axis=1, keepdims=True)
    return np.einsum("tk,tkc->tc", shares, model.colors[members]).astype(np.float32)


def _as_coarse(model, count):
    """The model's look, with textures no finer than so many samples can show."""
    look = model.look
    if look is None:
        return None
    areas = {}

    def pixels(image):
        if image.uv not in areas:
            sides = look.uvs[image.uv][model.skin.corners]
            u, v = (sides[:, k] - sides[:, 0] for k in (1, 2))
            areas[image.uv] = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum()
        tile = image.texture
        if tile.tiles:
            tile = next(iter(tile.tiles.values()))
        height, width = tile.values.shape[:2]
        scale = 1.0 if image.matrix is None else abs(np.linalg.det(image.matrix[:, :2]))
        return float(np.sqrt(areas[image.uv] * scale * height * width / max(count, 1)))

    known = {}

    def coarse(expression):
        key = id(expression)
        if key not in known:
            known[key] = reduced(expression, pixels)
        return known[key]

    surfaces = tuple(
        replace(
            surface,
            **{name: coarse(getattr(surface, name)) for name in ("color", "alpha", "roughness")},
        )
        for surface in look.surfaces
    )
    return replace(look, surfaces=surfaces)


def _images(values, found, owners):
    """By name, the images of values at texels; (H, W) for numbers."""
    known = np.zeros(owners.size, bool)
    known[found.rows] = True
    images = {}
    for name, part in values.items():
        image = np.zeros((owners.size, part.shape[1]), np.float32)
        image[found.rows] = part
        image = image.reshape(*owners.shape, -1)
        image = texels.filled(image, known.reshape(owners.shape), owners)
        images[name] = image[..., 0] if part.shape[1] == 1 else image
    return images


# --- Normals --------------------------------------------------------------------------------------


def _corner_normals(positions, triangles, is_smooth):
    """(F, 3, 3): of the faces where these are flat, else of the vertices."""
    corners = positions[triangles].astype(np.float64)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
    sums = np.zeros((len(positions), 3))
    for k in range(3):
        ahead, back = (corners[:, (k + j) % 3] - corners[:, k] for j in (1, 2))
        lengths = np.linalg.norm(ahead, axis=1) * np.linalg.norm(back, axis=1)
        cosine = np.einsum("fi,fi->f", ahead, back) / np.maximum(lengths, 1e-300)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        for axis in range(3):
            sums[:, axis] += np.bincount(
                triangles[:, k], angle * flat[:, axis], minlength=len(positions)
            )
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300)
    return np.where(is_smooth[:, None, None], sums[triangles], flat[:, None])


def _model_frames(model):
    """By UV map of a normal map in use, the model's tangent frames; under "" one without."""
    normals = model.skin.normals[model.skin.corners].astype(np.float64)
    names = {s.relief.uv for s in model.look.used() if s.relief is not None}
    frames = {
        name: frames_of_corners(
            model.positions, model.triangles, normals, model.look.uvs[name][model.skin.corners]
        )
        for name in names
    }
    frames[""] = normals
    return frames


def _normals(model, look, frames, triangles, shares):
    """(T, 3): which way the model's surface faces, normal maps included."""
    result = np.einsum("tk,tki->ti", shares, frames[""][triangles])
    numbers = look.of_corners[model.skin.corners[triangles, 0]]
    for number in np.unique(numbers).tolist():
        relief = look.surfaces[number].relief
        if relief is None:
            continue
        rows = np.flatnonzero(numbers == number)
        corners = model.skin.corners[triangles[rows]]
        bent = look.values(lambda surface: surface.relief.color, corners, shares[rows])[:, :3]
        strength = look.values(lambda surface: surface.relief.strength, corners, shares[rows])
        bent = 2.0 * bent - 1.0
        bent[:, :2] *= strength[:, :1]
        result[rows] = from_tangent_space(frames[relief.uv], triangles[rows], shares[rows], bent)
    return result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-300)


def is_worth_it(skin, model):
    """Whether a source and a model both look like something, and not the same."""
    if skin is None or skin.look is None or not model.has_look:
        return False
    plain = [_plain(part, Options()) for part in (Model(None, None, skin, None), model)]
    return None in plain or plain[0].color != plain[1].color
