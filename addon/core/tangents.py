"""Tangent space, in which normal maps are: along U, along V, and straight up."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Frames:
    """At the corners of triangles: (F, 3, 3) normals and tangents, both not quite unit or square
    between corners; (F,) 1 where the UV map isn't mirrored, else -1."""

    normals: np.ndarray
    tangents: np.ndarray
    signs: np.ndarray

    def at(self, triangles, shares):
        """Three (T, 3) arrays: along U, along V, up."""
        up = np.einsum("tk,tki->ti", shares, self.normals[triangles])
        along = np.einsum("tk,tki->ti", shares, self.tangents[triangles])
        return along, self.signs[triangles, None] * np.cross(up, along), up


def frames_of_corners(positions, triangles, normals, uvs):
    """The Frames of a UV map.

    Parameters
    ----------
    positions : (N, 3) array
    triangles : (F, 3) array of int
    normals : (F, 3, 3) array
        Of the corners.
    uvs : (F, 3, 2) array
    """
    corners = positions[triangles].astype(np.float64)
    uvs = uvs.astype(np.float64)
    (first, second), (u, v) = (
        (part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]) for part in (corners, uvs)
    )
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    signs = np.where(area < 0.0, -1.0, 1.0)
    along = (first * v[:, 1:] - second * u[:, 1:]) * signs[:, None]
    tangents = _unit(along[:, None] - normals * np.einsum("fi,fki->fk", along, normals)[..., None])
    tangents *= _angles(corners)[..., None]
    # Corners in one place, with one normal, on one side of seams, share a tangent.
    keys = np.concatenate(
        [
            triangles.reshape(-1, 1).astype(np.float64),
            np.round(normals.reshape(-1, 3), 3),
            np.round(uvs.reshape(-1, 2), 6),
            np.repeat(signs, 3)[:, None],
        ],
        axis=1,
    )
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    sums = np.stack([np.bincount(group, part) for part in tangents.reshape(-1, 3).T], axis=1)
    return Frames(normals, _unit(sums)[group].reshape(-1, 3, 3), signs)


def to_tangent_space(frames, triangles, shares, directions):
    """(T, 3): directions as a normal map has them, from 0 to 1."""
    along, across, up = frames.at(triangles, shares)
    rows = np.cross(across, up), np.cross(up, along), np.cross(along, across)
    volume = np.einsum("ti,ti->t", along, rows[0])
    # What is seen from behind can't be said in a normal map.
    found = np.stack([np.einsum("ti,ti->t", row, directions) for row in rows], axis=1)
    found *= np.where(volume < 0.0, -1.0, 1.0)[:, None]
    found[:, 2] = np.maximum(found[:, 2], 0.05 * np.linalg.norm(found, axis=1))
    found[(found == 0.0).all(axis=1)] = (0.0, 0.0, 1.0)
    return (0.5 + 0.5 * _unit(found)).astype(np.float32)


def from_tangent_space(frames, triangles, shares, bent):
    """(T, 3): directions that are given along U, along V and up."""
    return sum(bent[:, k : k + 1] * axis for k, axis in enumerate(frames.at(triangles, shares)))


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _angles(corners):
    """(F, 3)"""
    found = np.empty(corners.shape[:2])
    for k in range(3):
        ahead, back = (_unit(corners[:, (k + j) % 3] - corners[:, k]) for j in (1, 2))
        found[:, k] = np.arccos(np.clip(np.einsum("fi,fi->f", ahead, back), -1.0, 1.0))
    return found
