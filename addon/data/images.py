"""Blender's images as textures."""

import pathlib
import tempfile

import bpy
import numpy as np

from ..core.textures import Texture, to_srgb
from . import arrays

_LINES = 64  # that are encoded at once


def read(image):
    """The Texture of an image, and what is to be said about it in words.

    Returns
    -------
    Texture or None
        None where it can't be read.
    str
        Why, or what is missing; "" where all is well.
    """
    if image.source == "TILED":
        return _read_tiles(image)
    if image.source in ("MOVIE", "SEQUENCE", "VIEWER"):
        return None, f'the image "{image.name}" changes with time'
    texture = _read_plain(image)
    if texture is None:
        return None, f'the image "{image.name}" is missing'
    return texture, ""


def without_pixels(image):
    """What `read` returns, but for the pixels: names of what is there."""
    words = image.name, image.filepath_raw, image.colorspace_settings.name, image.alpha_mode
    return Texture(" ".join(words), None), ""


def _read_plain(image):
    values = arrays.image_pixels(image)
    if values is None:
        return None
    values = _with_four_channels(values)
    is_solid = image.alpha_mode in ("CHANNEL_PACKED", "NONE")
    if image.alpha_mode == "NONE":
        values[..., 3] = 1.0
    if image.is_float:
        if not is_solid:  # Blender keeps them weighted
            alpha = values[..., 3:]
            values[..., :3] /= np.where(alpha > 0.0, alpha, 1.0)
        return Texture(image.name, values, is_solid=is_solid)
    space = image.colorspace_settings
    is_linear = space.is_data or "Linear" in space.name
    return Texture(image.name, _as_bytes(values), not is_linear, is_solid)


def _with_four_channels(values):
    channels = values.shape[2]
    if channels == 4:
        return values
    solid = np.ones((*values.shape[:2], 4), np.float32)
    solid[..., :3] = values[..., :3] if channels >= 3 else values[..., :1]
    return solid


def _as_bytes(values):
    """Of floats from 0 to 1, which are overwritten."""
    values *= 255.0
    values += 0.5
    return values.astype(np.uint8)


def _read_tiles(image):
    """Pixels of the image itself are those of one tile: all are read from their files, or from what
    was packed of these."""
    path = image.filepath_raw or image.filepath
    tiles, missing = {}, []
    with tempfile.TemporaryDirectory() as folder:
        packed = _unpacked(image, folder)
        for tile in image.tiles:
            texture = None
            if image.packed_files:
                texture = _read_file(packed.get(tile.number, ""), image)
            elif "<UDIM>" in path:
                texture = _read_file(path.replace("<UDIM>", str(tile.number)), image)
            if texture is None and len(image.tiles) == 1:
                texture = _read_plain(image)
            if texture is None:
                missing.append(str(tile.number))
            else:
                tiles[tile.number] = texture
    if not tiles:
        return None, f'the UDIM image "{image.name}" is missing'
    said = f'tiles {", ".join(missing)} of the image "{image.name}" are missing' if missing else ""
    return Texture(image.name, None, tiles=tiles), said


def _unpacked(image, folder):
    """By number, paths of files in a folder with what is packed of an image's tiles."""
    found = {}
    for item in image.packed_files:
        name = pathlib.PurePath(bpy.path.basename(item.filepath))
        found[item.tile_number] = str(pathlib.Path(folder, f"{item.tile_number}{name.suffix}"))
        pathlib.Path(found[item.tile_number]).write_bytes(item.packed_file.data)
    return found


def _read_file(path, like):
    try:
        image = bpy.data.images.load(bpy.path.abspath(path, library=like.library))
    except RuntimeError:
        return None
    try:
        image.colorspace_settings.name = like.colorspace_settings.name
        image.alpha_mode = like.alpha_mode
        return _read_plain(image)
    finally:
        bpy.data.images.remove(image)


def is_whole(image):
    """Whether `painted` gives all there is of an image, and its name is enough to find it in a file
    with what a scene has of this one."""
    return image.source in ("FILE", "GENERATED") and image.library is None


def painted(image):
    """(H, W, 4): what an image shows, saved or not, as Blender keeps it: bytes, or floats. None
    where there is nothing."""
    values = arrays.image_pixels(image)
    if values is None:
        return None
    values = _with_four_channels(values)
    return values if image.is_float else _as_bytes(values)


def write(name, values, created, is_color, known=None):
    """A packed image of 8 bits a channel.

    Parameters
    ----------
    values : (H, W), (H, W, 3) or (H, W, 4) array
        Linear.
    created : function
        Called with a new one.
    is_color : bool
        Whether it's encoded as colors are, or holds other data.
    known : Image or None
        One to be written anew.
    """
    pixels = np.ones((*values.shape[:2], 4), np.float32)
    if values.ndim == 2:
        values = values[..., None]
    for start in range(0, len(values), _LINES):
        part = slice(start, start + _LINES)
        pixels[part, :, :3] = to_srgb(values[part, :, :3]) if is_color else values[part, :, :3]
    if values.shape[2] == 4:
        pixels[..., 3] = values[..., 3]
    size = values.shape[1], values.shape[0]
    image = known
    if image is None:
        image = bpy.data.images.new(name, *size, alpha=True, is_data=not is_color)
        created(image)
    elif tuple(image.size) != size:
        image.scale(*size)
    arrays.write_pixels(image, pixels)
    return image
