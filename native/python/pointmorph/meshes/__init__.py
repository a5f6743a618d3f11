"""Faces as surfaces: their places, edges and borders, and even samples of them."""

from pointmorph.meshes.geometry import (
    ClosestPlaces,
    boundary_loops,
    face_edges,
    nearest_rows,
    parts,
    triangulate,
    vertex_normals,
)
from pointmorph.meshes.sampling import sample, sample_pair
from pointmorph.meshes.shape import Shape

__all__ = [
    "ClosestPlaces",
    "Shape",
    "boundary_loops",
    "face_edges",
    "nearest_rows",
    "parts",
    "sample",
    "sample_pair",
    "triangulate",
    "vertex_normals",
]
