"""Matrices on arrays of points, normals and radii."""

import numpy as np
import pointmorph

# A matrix flatter than this can't be inverted in a way that float32 positions survive.
_SMALLEST_ASPECT = 1e-7


def relative_to(matrix, origin):
    """(4, 4) float64: `matrix` as seen from a frame with the world's axes and the given origin."""
    result = np.array(matrix, dtype=np.float64)
    result[:3, 3] -= origin
    return result


def check_invertible(name, matrix):
    """Raises CloudError for the object `name` when its (4, 4) matrix is flat or not finite."""
    matrix = np.asarray(matrix, dtype=np.float64)
    if np.isfinite(matrix).all():
        scales = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if scales[-1] > _SMALLEST_ASPECT * scales[0]:
            return
        found = f"scales of {scales[0]:.3g}, {scales[1]:.3g} and {scales[2]:.3g}"
    else:
        found = "a transform with values that aren't finite"
    raise pointmorph.CloudError(
        name,
        "a scale other than 0 on every axis",
        found,
        "Correct the scale of the object or its parents.",
    )


def is_mirrored(matrix):
    """Whether a (4, 4) matrix makes left of right, as a negative scale does."""
    return np.linalg.det(np.asarray(matrix, np.float64)[:3, :3]) < 0.0


def keeps_angles(matrix):
    """Whether a (4, 4) matrix only turns, moves and scales, by as much on every axis."""
    linear = np.asarray(matrix, np.float64)[:3, :3]
    square = linear.T @ linear
    return not is_mirrored(matrix) and np.allclose(
        square, square[0, 0] * np.eye(3), rtol=1e-5, atol=1e-5 * square[0, 0]
    )


def move_faces(matrix, triangles):
    """(F, 3) from (F, 3): triangles, or corners of them, in the order in which they show the same
    side once their points were taken through a (4, 4) matrix."""
    return turned(triangles) if is_mirrored(matrix) else triangles


def turned(triangles):
    """(F, 3): triangles, or corners of them, that show their other side."""
    return triangles[:, [0, 2, 1]]


def apply(matrix, positions):
    """(N, 3) float64: positions taken through a (4, 4) matrix, the last row of which is ignored."""
    matrix = np.asarray(matrix)
    return positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def move_positions(matrix, positions):
    """(N, 3) float32: positions taken through a (4, 4) matrix; their own bits by the identity."""
    if np.array_equal(matrix, np.eye(4)):
        return positions
    return apply(matrix, positions).astype(np.float32)


def move_normals(matrix, normals):
    """(N, 3) float32 of length 1: normals taken through a (4, 4) matrix, by its inverse transpose.

    A mirror keeps outward normals outward.
    """
    if np.array_equal(matrix[:3, :3], np.eye(3)):
        return normals
    moved = normals.astype(np.float64) @ np.linalg.inv(matrix[:3, :3])
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    return moved.astype(np.float32)


def move_along(before, after, normals):
    """(F, 3, 3) float32: normals at the corners of triangles that were moved, turned with these.

    Parameters
    ----------
    before, after : (F, 3, 3) array
        The triangles' corners.
    normals : (F, 3, 3) array
    """
    turns = []
    for corners in (before, after):
        sides = corners[:, 1:].astype(np.float64) - corners[:, :1]
        up = np.cross(sides[:, 0], sides[:, 1])
        size = np.sqrt(np.linalg.norm(up, axis=1))[:, None]
        # As high as it is wide, so that what is stretched isn't bent.
        turns.append(np.concatenate([sides, (up / np.maximum(size, 1e-30))[:, None]], axis=1))
    good = np.abs(np.linalg.det(turns[1])) > 1e-30
    good &= np.abs(np.linalg.det(turns[0])) > 1e-30
    moved = normals.astype(np.float64)
    # Rows are the sides: normals go by the inverse transpose of what takes one to the other.
    back = np.linalg.inv(turns[1][good])
    moved[good] = np.einsum("fnc,fsc,fks->fnk", moved[good], turns[0][good], back)
    moved /= np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), 1e-30)
    return moved.astype(np.float32)


def move_radii(matrix, radii):
    """(N,) float32: radii of balls that keep their volume's share of a (4, 4) matrix's scale."""
    scale = abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)
    return radii if scale == 1.0 else (radii * scale).astype(np.float32)
