"""Pixels of an image that faces cover, and layouts of faces on an image."""

from dataclasses import dataclass

import numpy as np

LARGEST = 4096
_LEAST_CELL = 4  # pixels, for two triangles
_OVERLAP = 0.02  # of the pixels


@dataclass(frozen=True)
class Texels:
    """Pixels on triangles.

    Attributes
    ----------
    rows : (T,) array of int
        The pixel: its row times the image's width, plus its column.
    triangles : (T,) array of int
    shares : (T, 3) array of float32
        Of the triangle's corners.
    """

    rows: np.ndarray
    triangles: np.ndarray
    shares: np.ndarray


def are_usable(uvs, size):
    """Whether one image can show all faces with these UVs: (F, 3, 2). Returns the reason why not,
    in words, or None; and the Texels."""
    if not np.isfinite(uvs).all() or (np.ptp(uvs, axis=1) > 1.0).any():
        return "faces are larger than the image in the source's UV map", None
    texels, count = cover(uvs, size)
    if len(texels.rows) == 0:
        return "the source's UV map has no area", None
    if count - len(texels.rows) > _OVERLAP * count:
        return "faces overlap in the source's UV map", None
    return None, texels


def cover(uvs, size):
    """The pixels whose centers lie in triangles with UVs: (F, 3, 2), each no larger than the unit
    square. Beyond that, the image repeats.

    Returns
    -------
    Texels
        Each pixel once.
    int
        How many there are if each triangle counts its own.
    """
    corners = uvs.astype(np.float64)
    corners = (corners - np.floor(corners.min(axis=1, keepdims=True))) * size - 0.5
    low = np.ceil(corners[:, :, 1].min(axis=1)).astype(np.int32)
    high = np.floor(corners[:, :, 1].max(axis=1)).astype(np.int32)
    of_line, y = _runs(low, np.maximum(high - low + 1, 0))
    left, right = _crossings(corners[of_line], y)
    first, last = np.ceil(left).astype(np.int32), np.ceil(right).astype(np.int32)
    line, x = _runs(first, np.maximum(last - first, 0))  # the last is the next triangle's
    rows = (y % size * size)[line] + np.where(x < size, x, x - size)
    owners = np.full(size * size, -1, np.int32)
    owners[rows] = np.arange(len(rows), dtype=np.int32)
    count = len(rows)
    kept = owners[owners >= 0]
    if len(kept) < count:  # else they stay in the order of faces
        line, x, rows = line[kept], x[kept], rows[kept]
    shares = np.empty((len(rows), 3), np.float32)
    across, up, start = _slopes(corners)
    for corner in (1, 2):
        base = (up[corner - 1][of_line] * y + start[corner - 1][of_line])[line]
        shares[:, corner] = across[corner - 1][of_line][line] * x + base
    shares[:, 0] = 1.0 - shares[:, 1] - shares[:, 2]
    return Texels(rows, of_line[line], _proper(shares)), count


def _runs(starts, lengths):
    """For runs of whole numbers: the run of each number, and the number."""
    run = np.repeat(np.arange(len(starts), dtype=np.int32), lengths)
    before = (np.cumsum(lengths) - lengths - starts).astype(np.int32)
    return run, np.arange(len(run), dtype=np.int32) - before[run]


def _crossings(corners, y):
    """Where a line of pixels enters and leaves a triangle each."""
    left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for side in range(3):
        a, b = corners[:, side], corners[:, (side + 1) % 3]
        # The same way round for both triangles at a side, so that they agree to the last bit.
        swap = (a[:, 1] > b[:, 1]) | ((a[:, 1] == b[:, 1]) & (a[:, 0] > b[:, 0]))
        a, b = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
        hit = (a[:, 1] <= y) & (y <= b[:, 1]) & (a[:, 1] < b[:, 1])
        height = np.where(hit, b[:, 1] - a[:, 1], 1.0)
        x = a[:, 0] + (y - a[:, 1]) / height * (b[:, 0] - a[:, 0])
        left = np.where(hit, np.minimum(left, x), left)
        right = np.where(hit, np.maximum(right, x), right)
    missed = ~np.isfinite(left)
    left[missed], right[missed] = 0.0, 0.0
    return left, right


def _slopes(corners):
    """How the second and the third corner's share grow by column and by row, and what they are at
    the origin."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    area[area == 0.0] = np.inf
    across = v[:, 1] / area, -u[:, 1] / area
    up = -v[:, 0] / area, u[:, 0] / area
    x, y = corners[:, 0].T
    start = [-(a * x + b * y) for a, b in zip(across, up, strict=True)]
    return across, up, start


def _proper(shares):
    shares = np.clip(shares, 0.0, 1.0)
    shares /= shares.sum(axis=1, keepdims=True)
    return shares.astype(np.float32)


# --- A layout of its own --------------------------------------------------------------------------


def lay_out(corners, size):
    """A place of its own on an image for every triangle, larger for larger ones: two of them on a
    square whose side is a power of two. Each has a border, so that neighbors don't shine through.

    Parameters
    ----------
    corners : (F, 3, 3) array
    size : int
        A power of two. The image gets larger where there are too many triangles for it.

    Returns
    -------
    (F, 3, 2) array of float32
        UVs.
    Texels
        All pixels of the squares: what lies in a border has the closest place of its triangle.
    int
        The image's size.
    """
    sides = np.linalg.norm(np.roll(corners, -1, 1) - np.roll(corners, -2, 1), axis=2)
    order = np.argsort(-sides.max(axis=1), kind="stable")
    lengths = sides.max(axis=1)[order[::2]]
    while size < LARGEST and len(lengths) * _LEAST_CELL**2 > size**2:
        size *= 2
    levels = _levels(lengths, size)
    places = _unwound(np.cumsum(4**levels) - 4**levels)
    square = np.arange(len(order)) // 2
    upper = np.arange(len(order)) % 2 == 1
    # The right angle is opposite the longest side.
    turned = (sides[order].argmax(axis=1)[:, None] + np.arange(3)) % 3
    cells = (2**levels)[square].astype(np.float64)
    border, legs = _measures(cells)
    local = np.tile(border[:, None, None], (1, 3, 2))
    local[:, 1, 0] += legs
    local[:, 2, 1] += legs
    local[upper] = cells[upper, None, None] - local[upper]
    uvs = np.empty((len(order), 3, 2))
    uvs[order[:, None], turned] = (places[square][:, None] + local) / size
    texels = _cell_texels(order, turned, levels, places, size)
    return uvs.astype(np.float32), texels, size


def _measures(cells):
    """Of squares of that many pixels: the border, and the shorter sides of its triangles."""
    return np.where(cells < 8, 0.5, 1.0), np.maximum(cells - 4, cells / 4)


def _levels(lengths, size):
    """By square, its side's logarithm, so that all have room; falling, as `lengths` do."""
    most = int(np.log2(size))
    least = int(np.log2(_LEAST_CELL))
    while least > 0 and len(lengths) * 4**least > size**2:
        least -= 1
    relative = np.log2(np.maximum(lengths / max(float(lengths[0]), 1e-300), 1e-9))
    low, high = 0.0, float(most) + 31.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        levels = np.clip(np.floor(middle + relative), least, most).astype(np.int64)
        if (4**levels).sum() <= size**2:
            low = middle
        else:
            high = middle
    return np.clip(np.floor(low + relative), least, most).astype(np.int64)


def _unwound(numbers):
    """(N, 2): columns and rows along the curve that fills one square after the other."""
    places = np.zeros((len(numbers), 2), np.int64)
    for bit in range(int(np.log2(LARGEST)) + 1):
        places[:, 0] |= ((numbers >> (2 * bit)) & 1) << bit
        places[:, 1] |= ((numbers >> (2 * bit + 1)) & 1) << bit
    return places


def _cell_texels(order, turned, levels, places, size):
    """The Texels of `lay_out`."""
    found = []
    count = len(order)
    for level in np.unique(levels).tolist():
        cell = 2**level
        squares = np.flatnonzero(levels == level)
        y, x = (part.reshape(-1) for part in np.mgrid[:cell, :cell])
        upper = (x + y + 1 > cell).astype(np.int64)
        order_within = np.argsort(upper, kind="stable")  # one triangle after the other
        y, x, upper = y[order_within], x[order_within], upper[order_within]
        border, leg = (float(part) for part in _measures(np.float64(cell)))
        mirrored = (
            np.where(upper, cell - x - 0.5, x + 0.5),
            np.where(upper, cell - y - 0.5, y + 0.5),
        )
        second, third = (np.maximum((part - border) / leg, 0.0) for part in mirrored)
        shares = _proper(np.stack([1.0 - second - third, second, third], axis=1))
        member = (2 * squares[:, None] + upper).reshape(-1)
        rows = (places[squares, 1][:, None] + y) * size + places[squares, 0][:, None] + x
        shown = member < count  # the last may be alone on its square
        member = member[shown]
        spread = np.empty((len(member), 3), np.float32)
        shares = np.tile(shares, (len(squares), 1))[shown]
        np.put_along_axis(spread, turned[member], shares, axis=1)
        found.append((rows.reshape(-1)[shown], order[member], spread))
    return Texels(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


# --- Filling --------------------------------------------------------------------------------------


def filled(values, known):
    """An image whose unknown pixels have the colors of those around, so that seams don't show.

    Parameters
    ----------
    values : (H, W, K) array of float32
        H and W are powers of two.
    known : (H, W) array of bool
    """
    values, known = values * known[..., None], known.astype(np.float32)
    for _ in range(2):
        values, known = _dilated(values, known)
    return _pulled(values, known)


def _dilated(values, known):
    """One pixel farther."""
    around = np.zeros_like(known)
    steps = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    height, width = known.shape
    for down, right in steps:
        to = _overlap(height, down), _overlap(width, right)
        around[to] += known[_overlap(height, -down), _overlap(width, -right)]
    rows, columns = np.nonzero((known == 0.0) & (around > 0.0))
    sums = np.zeros((len(rows), values.shape[2]), np.float32)
    for down, right in steps:
        y, x = rows + down, columns + right
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        y, x = y[inside], x[inside]
        sums[inside] += values[y, x] * known[y, x][:, None]
    values, known = values.copy(), known.copy()
    values[rows, columns] = sums / around[rows, columns][:, None]
    known[rows, columns] = 1.0
    return values, known


def _overlap(length, shift):
    return slice(max(shift, 0), length + min(shift, 0))


def _pulled(values, known):
    """Unknown pixels from the same image at half the size, and so on."""
    if known.all() or min(known.shape) < 2:
        return values
    parts = [np.s_[row::2, column::2] for row in (0, 1) for column in (0, 1)]
    sums = sum(values[part] for part in parts)
    counts = sum(known[part] for part in parts)
    coarse = sums / np.maximum(counts, 1.0)[..., None]
    coarse = _pulled(coarse, (counts > 0.0).astype(np.float32))
    unknown = known == 0.0
    result = values.copy()
    result[unknown] = coarse.repeat(2, axis=0).repeat(2, axis=1)[unknown]
    return result
