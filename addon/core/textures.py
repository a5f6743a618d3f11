"""Images as textures: sampled where UVs point, decoded to linear values."""

from dataclasses import dataclass, field, replace

import numpy as np

REPEAT, EXTEND, CLIP, MIRROR = "REPEAT", "EXTEND", "CLIP", "MIRROR"
_PART = 1 << 17  # samples that are taken at once
_MANY = 4  # pixels for each sample, up to which all of them are decoded first
_FIRST_TILE = 1001


def to_linear(values):
    """sRGB to linear."""
    values = np.asarray(values, np.float32)
    return np.where(
        values <= 0.04045, values / 12.92, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4
    ).astype(np.float32)


def to_srgb(values):
    """Linear to sRGB, from 0 to 1."""
    values = np.clip(np.asarray(values, np.float32), 0.0, 1.0)
    result = values ** (1 / 2.4)  # in place from here on: images are large
    result *= 1.055
    result -= 0.055
    dark = values <= 0.0031308
    values *= 12.92
    np.copyto(result, values, where=dark)
    return result


_STEPS = np.arange(256, dtype=np.float32) / 255.0
_LINEAR_STEPS = to_linear(_STEPS)


@dataclass(frozen=True)
class Texture:
    """An image.

    Attributes
    ----------
    name : str
    values : (H, W, 4) array of uint8 or float32
        The lowest row first. Floats are linear.
    is_srgb : bool
        Whether bytes are encoded as sRGB.
    is_solid : bool
        Whether alpha is a channel like the others, by which colors aren't weighted.
    tiles : dict of int to Texture
        Of a UDIM image: by number, in place of `values`.
    """

    name: str
    values: np.ndarray | None
    is_srgb: bool = False
    is_solid: bool = False
    tiles: dict = field(default_factory=dict)

    def linear(self, part=...):
        """(..., 4) float32: values, linear, color weighted with alpha."""
        return self.decoded(self.values[part])

    def decoded(self, values):
        """The same of some of `values`."""
        if values.dtype == np.uint8:
            table = _LINEAR_STEPS if self.is_srgb else _STEPS
            colors = table.take(values)
            if self.is_srgb:
                colors[..., 3] = _STEPS.take(values[..., 3])
        else:
            colors = values.astype(np.float32)
        if not self.is_solid and (colors[..., 3] != 1.0).any():
            colors[..., :3] *= colors[..., 3:]
        return colors

    def reduced(self, times):
        """The same at half the size, so often: for samples that are so far apart."""
        if self.tiles:
            tiles = {number: tile.reduced(times) for number, tile in self.tiles.items()}
            return replace(self, tiles=tiles)
        height, width = self.values.shape[:2]
        step = 1
        while times > 0 and height % (2 * step) == 0 and width % (2 * step) == 0:
            step, times = 2 * step, times - 1
        if step == 1:
            return self
        colors = np.zeros((height // step, width // step, 4), np.float32)
        for row in range(step):
            for column in range(step):
                colors += self.linear(np.s_[row::step, column::step])
        colors /= step * step
        if not self.is_solid:
            colors[..., :3] = unassociated(colors)[..., :3]
        return replace(self, values=colors, is_srgb=False)


def unassociated(colors):
    """Colors that were weighted with their alpha, as they were before."""
    alpha = colors[..., 3:]
    result = colors / np.where(alpha > 0.0, alpha, 1.0)
    result[..., 3:] = alpha
    return result


def sample(texture, uvs, extension=REPEAT, closest=False):
    """(N, 4) float32: what a texture has at UVs, linear, color weighted with alpha.

    Parameters
    ----------
    uvs : (N, 2) array
    extension : str
        REPEAT, EXTEND, CLIP or MIRROR: what there is outside the unit square.
    closest : bool
        Takes the closest pixel, instead of mixing the four around.
    """
    if texture.tiles:
        return _sample_tiles(texture, uvs, closest)
    height, width = texture.values.shape[:2]
    if height * width <= _MANY * len(uvs):
        pixels = texture.linear().reshape(-1, 4)

        def at(numbers):
            return pixels.take(numbers, axis=0)
    else:
        pixels = texture.values.reshape(-1, texture.values.shape[2])

        def at(numbers):
            return texture.decoded(pixels.take(numbers, axis=0))

    result = np.empty((len(uvs), 4), np.float32)
    for start in range(0, len(uvs), _PART):
        part = slice(start, start + _PART)
        places = _inside(np.asarray(uvs[part], np.float64), extension)
        if closest:
            x, y = (
                _index(np.floor(p * n), n, extension)
                for p, n in zip(places.T, (width, height), strict=True)
            )
            result[part] = at(y * width + x)
        else:
            result[part] = _mixed(at, places, (width, height), extension)
        if extension == CLIP:
            result[part][((uvs[part] < 0.0) | (uvs[part] > 1.0)).any(axis=1)] = 0.0
    return result


def _sample_tiles(texture, uvs, closest):
    result = np.zeros((len(uvs), 4), np.float32)
    corner = np.floor(uvs)
    numbers = _FIRST_TILE + corner[:, 0] + 10 * corner[:, 1]
    for number, tile in texture.tiles.items():
        rows = np.flatnonzero((numbers == number) & (corner[:, 0] >= 0) & (corner[:, 0] < 10))
        result[rows] = sample(tile, uvs[rows] - corner[rows], EXTEND, closest)
    return result


def _inside(uvs, extension):
    """UVs within the unit square, as far as it repeats."""
    uvs = np.nan_to_num(uvs, posinf=0.0, neginf=0.0)
    if extension == REPEAT:
        return uvs - np.floor(uvs)
    if extension == MIRROR:
        return 1.0 - np.abs(uvs - 2.0 * np.floor(0.5 * uvs) - 1.0)
    return uvs.clip(-1.0, 2.0)


def _index(number, count, extension):
    """Of a pixel along one side, which may be the next beyond an end."""
    number = number.astype(np.int32)
    if extension == REPEAT:
        return np.where(number < 0, count - 1, np.where(number >= count, 0, number))
    return number.clip(0, count - 1)


def _mixed(at, places, size, extension):
    """The four pixels around each place."""
    (x, right), (y, up) = (
        _between(place * count - 0.5) for place, count in zip(places.T, size, strict=True)
    )
    columns, rows = (
        [_index(first + step, count, extension) for step in (0, 1)]
        for first, count in zip((x, y), size, strict=True)
    )
    result = np.zeros((len(places), 4), np.float32)
    for column, across in zip(columns, (1.0 - right, right), strict=True):
        for row, along in zip(rows, (1.0 - up, up), strict=True):
            result += (across * along)[:, None] * at(row * size[0] + column)
    return result


def _between(place):
    """Whole numbers below, and how far above them."""
    first = np.floor(place)
    return first, (place - first).astype(np.float32)
