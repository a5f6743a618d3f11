"""Shapes that the pictures are made from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pointmorph
import pointmorph.meshes
from matplotlib.tri import Triangulation

Array = npt.NDArray[np.float64]


Rows = npt.NDArray[np.int64]


def unit(rows: Array) -> Array:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def icosphere(levels: int) -> tuple[Array, Rows]:
    """Directions and triangles: an icosahedron whose triangles are cut in four."""
    g = (1 + 5**0.5) / 2
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = unit(np.array(corners, float))
    faces = "0b5 051 017 07a 0ab 159 5b4 ba2 a76 718 394 342 326 368 389 495 24b 62a 867 981"
    triangles = np.array([[int(c, 16) for c in face] for face in faces.split()])
    for _ in range(levels):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        ends, which = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        ab, bc, ca = (len(points) + which.reshape(-1, 3)).T
        points = np.concatenate([points, unit(points[ends].sum(axis=1))])
        a, b, c = triangles.T
        triangles = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )
    return points, triangles


Pull = tuple[tuple[float, float, float], tuple[float, float, float], float]


# Where a rounded body is pulled out, by how much, and how wide the pull is.
STANDING: dict[str, Pull] = {
    "left fore": ((0.7, 0.5, -0.6), (0.05, 0.1, -0.85), 0.05),
    "right fore": ((0.7, -0.5, -0.6), (0.05, -0.1, -0.85), 0.05),
    "left hind": ((-0.7, 0.5, -0.6), (-0.05, 0.1, -0.85), 0.05),
    "right hind": ((-0.7, -0.5, -0.6), (-0.05, -0.1, -0.85), 0.05),
    "head": ((0.95, 0.0, 0.55), (0.65, 0.0, 0.6), 0.07),
    "tail": ((-1.0, 0.0, 0.35), (-0.75, 0.0, 0.35), 0.025),
}


# The same animal: one fore leg lifted, head lowered, tail up.
WALKING: dict[str, Pull] = {
    **STANDING,
    "left fore": ((0.7, 0.5, -0.6), (0.7, 0.1, -0.45), 0.05),
    "left hind": ((-0.7, 0.5, -0.6), (-0.4, 0.1, -0.7), 0.05),
    "head": ((0.95, 0.0, 0.55), (0.95, 0.0, 0.1), 0.07),
    "tail": ((-1.0, 0.0, 0.35), (-0.3, 0.0, 0.8), 0.025),
}


def animal(directions: Array, pulls: dict[str, Pull], body: Sequence[float]) -> Array:
    places = directions * np.array(body)
    for axis, by, width in pulls.values():
        near = np.exp((directions @ unit(np.array(axis)) - 1) / width)
        places = places + near[:, None] * np.array(by)
    return places


def end_of(limb: str, directions: Array) -> int:
    return int(np.argmax(directions @ unit(np.array(STANDING[limb][0]))))


class Animals:
    """An animal and the same one in another pose, of other proportions and with other points."""

    def __init__(self, levels: int = 5) -> None:
        self.source_directions, self.source_triangles = icosphere(levels)
        turned, self.target_triangles = icosphere(levels)
        self.target_directions = turned @ rotation(2, 0.4) @ rotation(0, 0.5)
        self.source = animal(self.source_directions, STANDING, (1.0, 0.5, 0.5))
        self.target = animal(self.target_directions, WALKING, (1.1, 0.6, 0.55))

    def clouds(self) -> tuple[pointmorph.Cloud, pointmorph.Cloud]:
        return pointmorph.Cloud(self.source), pointmorph.Cloud(self.target)

    def ends(self, *limbs: str) -> dict[str, tuple[int, int]]:
        return {
            limb: (end_of(limb, self.source_directions), end_of(limb, self.target_directions))
            for limb in limbs
        }


def torus(around: int, across: int, bump: float = 0.0, tube: float = 0.4) -> tuple[Array, Rows]:
    """Points of a ring and its triangles; row i · across + j is at the i-th and j-th angle."""
    a, b = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    u, v = 2 * np.pi * a / around, 2 * np.pi * b / across
    thick = tube * (1 + bump * np.cos(3 * u))
    r = 1 + thick * np.cos(v)
    points = np.stack([r * np.cos(u), r * np.sin(u), thick * np.sin(v)], axis=-1).reshape(-1, 3)

    def row(i: Rows, j: Rows) -> Rows:
        return (i % around) * across + j % across

    a, b = a.ravel(), b.ravel()
    first = np.stack([row(a, b), row(a + 1, b), row(a + 1, b + 1)], axis=1)
    second = np.stack([row(a, b), row(a + 1, b + 1), row(a, b + 1)], axis=1)
    return points, np.concatenate([first, second])


def bar(along: int, across: int, length: float, thick: float) -> tuple[Array, Rows]:
    """A square bar along x: points, `along` times around it, and triangles."""
    turn = np.arange(4 * across) / across
    side, share = turn.astype(int), turn % 1
    corners = thick * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    section = corners[side] + share[:, None] * (corners[(side + 1) % 4] - corners[side])
    x = np.linspace(-length, length, along)
    points = np.column_stack([np.repeat(x, len(turn)), np.tile(section, (along, 1))])
    i, j = (
        g.ravel() for g in np.meshgrid(np.arange(along - 1), np.arange(len(turn)), indexing="ij")
    )
    k = (j + 1) % len(turn)
    a, b, c, d = (r * len(turn) + q for r, q in ((i, j), (i, k), (i + 1, k), (i + 1, j)))
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def rings(count: int) -> tuple[Array, Rows]:
    """Even points of the unit disk on `count` rings, and triangles between them."""
    rows = [np.zeros((1, 2))]
    for k in range(1, count + 1):
        angle = 2 * np.pi * np.arange(6 * k) / (6 * k)
        rows.append(k / count * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    points = np.concatenate(rows)
    return points, np.asarray(Triangulation(*points.T).triangles, dtype=np.int64)


def bowls() -> tuple[Array, Array, Array]:
    """Points of a bowl, of the same broken in two, and its normals."""
    disk, _ = rings(24)
    x, y = disk.T
    source = np.column_stack([disk, 0.5 * (x**2 + y**2)])
    target = source + np.where(x > 0.15 * np.sin(5 * y), 0.28, -0.28)[:, None] * (1, 0, 0)
    return source, target, unit(np.column_stack([-x, -y, np.ones(len(x))]))


def rotation(axis: int, angle: float) -> Array:
    """Rows times this are turned about an axis."""
    matrix = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = np.sin(angle), -np.sin(angle)
    return matrix
