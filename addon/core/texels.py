"""Pixels of an image that faces cover, and layouts of faces on an image."""

from dataclasses import dataclass

import numpy as np

LARGEST = 4096
_LEAST_CELL = 4  # pixels
_OVERLAP = 0.02  # of the pixels
_PART = 1 << 16  # pixels that are filled at once: what these take stays in the processor's cache


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
    low, high = _bounds(uvs)
    if not np.isfinite(uvs).all() or (high - low > 1.0).any():
        return "faces are larger than the image in the source's UV map", None
    pixels = _pixels(uvs, size)
    if len(pixels.rows) == 0:
        return "the source's UV map has no area", None
    if pixels.count - len(pixels.rows) > _OVERLAP * pixels.count:
        return "faces overlap in the source's UV map", None
    return None, _texels(pixels)


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
    pixels = _pixels(uvs, size)
    return _texels(pixels), pixels.count


@dataclass(frozen=True)
class _Pixels:
    """Pixels on triangles: their columns, and the triangle and row of the lines that they are on.

    Attributes
    ----------
    corners : (F, 3, 2) array
        Of the triangles, in pixels.
    of_line, y : (L,) arrays of int
        The triangle of each line of pixels, and its row.
    line, x, rows : (T,) arrays of int
        Each pixel once; `rows` as in Texels.
    count : int
        How many there are if each triangle counts its own.
    """

    corners: np.ndarray
    of_line: np.ndarray
    y: np.ndarray
    line: np.ndarray
    x: np.ndarray
    rows: np.ndarray
    count: int


def _bounds(corners):
    """The least and the largest of each triangle's three: twice as quick as along an axis."""
    a, b, c = (corners[:, k] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _pixels(uvs, size):
    corners = uvs.astype(np.float64)
    corners = (corners - np.floor(_bounds(corners)[0])[:, None]) * size - 0.5
    low, high = _bounds(corners[:, :, 1])
    low, high = np.ceil(low).astype(np.int32), np.floor(high).astype(np.int32)
    of_line, y = _runs(low, np.maximum(high - low + 1, 0))
    left, right = _crossings(corners, of_line, y)
    first, last = np.ceil(left).astype(np.int32), np.ceil(right).astype(np.int32)
    line, x = _runs(first, np.maximum(last - first, 0))  # the last is the next triangle's
    rows = (y % size * size)[line] + np.where(x < size, x, x - size)
    owners = np.full(size * size, -1, np.int32)
    owners[rows] = np.arange(len(rows), dtype=np.int32)
    count = len(rows)
    kept = owners[owners >= 0]
    if len(kept) < count:  # else they stay in the order of faces
        line, x, rows = line[kept], x[kept], rows[kept]
    return _Pixels(corners, of_line, y, line, x, rows, count)


def _texels(pixels):
    triangles = pixels.of_line[pixels.line]
    shares = np.empty((len(pixels.rows), 3), np.float32)
    for corner, (across, up, start) in enumerate(_slopes(pixels.corners), 1):
        base = (up[pixels.of_line] * pixels.y + start[pixels.of_line])[pixels.line]
        shares[:, corner] = across[triangles] * pixels.x + base
    shares[:, 0] = 1.0 - shares[:, 1] - shares[:, 2]
    return Texels(pixels.rows, triangles, _proper(shares))


def _runs(starts, lengths):
    """For runs of whole numbers: the run of each number, and the number."""
    run = np.repeat(np.arange(len(starts), dtype=np.int32), lengths)
    before = (np.cumsum(lengths) - lengths - starts).astype(np.int32)
    return run, np.arange(len(run), dtype=np.int32) - before[run]


def _crossings(corners, of_line, y):
    """Where a line of pixels enters and leaves its triangle."""
    left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for side in range(3):
        a, b = corners[:, side], corners[:, (side + 1) % 3]
        # The same way round for both triangles at a side, so that they agree to the last bit.
        swap = (a[:, 1] > b[:, 1]) | ((a[:, 1] == b[:, 1]) & (a[:, 0] > b[:, 0]))
        from_x, from_y, to_x, to_y = (
            np.where(swap, one[:, axis], other[:, axis]).take(of_line)
            for one, other in ((b, a), (a, b))
            for axis in (0, 1)
        )
        hit = (from_y <= y) & (y <= to_y) & (from_y < to_y)
        height = np.where(hit, to_y - from_y, 1.0)
        x = from_x + (y - from_y) / height * (to_x - from_x)
        left = np.where(hit, np.minimum(left, x), left)
        right = np.where(hit, np.maximum(right, x), right)
    missed = ~np.isfinite(left)
    left[missed], right[missed] = 0.0, 0.0
    return left, right


def _slopes(corners):
    """For the second and the third corner's share, how it grows by column and by row, and what it
    is at the origin."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    area[area == 0.0] = np.inf
    x, y = corners[:, 0].T
    for across, up in (
        (v[:, 1] / area, -v[:, 0] / area),
        (-u[:, 1] / area, u[:, 0] / area),
    ):
        yield across, up, -(across * x + up * y)


def _proper(shares):
    shares = np.clip(shares, 0.0, 1.0)
    shares /= shares.sum(axis=1, keepdims=True)
    return shares.astype(np.float32)


# --- A layout of its own --------------------------------------------------------------------------


def extents(positions, counts):
    """(F,): how long faces of so many corners are, whose positions are (C, K)."""
    positions = np.asarray(positions, np.float64)  # a square of a large one isn't single precision
    starts = np.cumsum(counts) - counts
    sizes = np.maximum.reduceat(positions, starts) - np.minimum.reduceat(positions, starts)
    return np.linalg.norm(sizes, axis=1)


def lay_out(counts, lengths, size):
    """A place of its own on an image for every face, larger for larger ones: a square whose side is
    a power of two, in which nothing of its neighbors is seen.

    Parameters
    ----------
    counts : (F,) array of int
        How many corners each face has.
    lengths : (F,) array
        How long each is.
    size : int
        A power of two. The image gets larger where there are too many faces for it.

    Returns
    -------
    (C, 2) array of float32
        The UVs of the faces' corners, which make a convex polygon of each.
    (H, W) array of int32
        The face that each pixel belongs to; -1 for none.
    """
    while size < LARGEST and len(counts) * _LEAST_CELL**2 > size**2:
        size *= 2
    order = np.argsort(-lengths, kind="stable")
    levels = np.empty(len(counts), np.int64)
    levels[order] = _levels(lengths[order], size)
    places = np.empty((len(counts), 2), np.int64)
    areas = 4 ** levels[order]
    places[order] = _unwound(np.cumsum(areas) - areas)
    cells = (2**levels).astype(np.float64)
    face = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    angle = 2.0 * np.pi * (number + 0.5) / np.maximum(counts, 4)[face]
    round_ = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # Three corners are those of half a square.
    local = np.where((counts[face] <= 4)[:, None], np.sign(round_), round_)
    reach = 0.5 * cells - np.minimum(0.25 * cells, 1.0)
    middle = places + 0.5 * cells[:, None]
    uvs = (middle[face] + reach[face, None] * local) / size
    return uvs.astype(np.float32), _owners(levels, places, size)


def _owners(levels, places, size):
    """(H, W): the square that each pixel lies in, of squares at these places."""
    owners = np.full((size, size), -1, np.int32)
    for level in np.unique(levels).tolist():
        squares = np.flatnonzero(levels == level)
        steps = np.arange(2**level)
        rows = places[squares, 1][:, None, None] + steps[:, None]
        owners[rows, places[squares, 0][:, None, None] + steps] = squares[:, None, None]
    return owners


def _levels(lengths, size):
    """By square, its side's logarithm, so that all have room; falling, as `lengths` do."""
    most = int(np.log2(size))
    least = int(np.log2(_LEAST_CELL))
    while least > 0 and len(lengths) * 4**least > size**2:
        least -= 1
    with np.errstate(invalid="ignore"):  # a vertex may lie at infinity, or nowhere
        shares = lengths / max(float(lengths[0]), 1e-300)
    relative = np.log2(np.fmax(shares, 1e-9))
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


# --- Filling --------------------------------------------------------------------------------------


def filled(values, known, owners):
    """An image whose unknown pixels have the colors of those around, so that seams don't show.

    Parameters
    ----------
    values : (H, W, K) array of float32
        H and W are powers of two.
    known : (H, W) array of bool
    owners : (H, W) array of int
        The face that each pixel belongs to, at whose border nothing of others is to be seen: see
        `lay_out`. The same everywhere for a layout in which faces lie side by side.
    """
    height, width, depth = values.shape
    inner = (slice(1, -1), slice(1, -1))
    is_known, of_pixels = np.pad(known, 1), np.pad(owners, 1)
    colors = np.zeros((height + 2, width + 2, depth), np.float32)
    np.multiply(values, known[..., None], out=colors[inner])
    for _ in range(3):  # as far as a corner's pixels are from what is known
        _dilate(colors, is_known, of_pixels)
    return _pulled(colors[inner], is_known[inner].astype(np.float32))


def _dilate(colors, known, owners):
    """Gives unknown pixels the mean of those around that are known and of the same owner, in place.
    There is a ring of pixels around, which stay as they are."""
    width = known.shape[1]
    beside = known.copy()
    beside[:, 1:] |= known[:, :-1]
    beside[:, :-1] |= known[:, 1:]
    near = beside.copy()
    near[1:] |= beside[:-1]
    near[:-1] |= beside[1:]
    near &= ~known
    near[[0, -1]] = near[:, [0, -1]] = False
    near = np.flatnonzero(near)
    # Views of the arrays, one pixel after the other.
    colors, known, owners = colors.reshape(-1, colors.shape[2]), known.reshape(-1), owners.ravel()
    found = []
    for start in range(0, len(near), _PART):
        rows = near[start : start + _PART]
        own = owners.take(rows)
        sums = np.zeros((len(rows), colors.shape[1]), np.float32)
        counts = np.zeros(len(rows), np.float32)
        for step in (down * width + right for down in (-1, 0, 1) for right in (-1, 0, 1)):
            there = rows + step
            counted = known.take(there) & (owners.take(there) == own)
            sums += colors.take(np.where(counted, there, 0), axis=0)  # that of the ring is 0
            counts += counted
        is_found = counts > 0.0
        found.append((rows[is_found], sums[is_found] / counts[is_found, None]))
    for rows, means in found:
        colors[rows] = means
        known[rows] = True


def _pulled(values, known):
    """Unknown pixels from the same image at half the size, and so on."""
    height, width = known.shape
    if known.all() or min(height, width) < 2:
        return values
    parts = [np.s_[row::2, column::2] for row in (0, 1) for column in (0, 1)]
    sums = sum(values[part] for part in parts)
    counts = sum(known[part] for part in parts)
    coarse = sums / np.maximum(counts, 1.0)[..., None]
    coarse = _pulled(coarse, (counts > 0.0).astype(np.float32))
    result = values.copy()
    rows, columns = np.nonzero(known == 0.0)
    result[rows, columns] = coarse[rows // 2, columns // 2]
    return result
