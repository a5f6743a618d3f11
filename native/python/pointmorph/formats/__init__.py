"""Shapes from files and frames to files."""

from pointmorph.formats.table import (
    FORMATS,
    SUFFIXES,
    WRITTEN_MESH_SUFFIXES,
    Format,
    read,
    write_mesh,
    write_ply,
)
from pointmorph.meshes.shape import Shape

__all__ = [
    "FORMATS",
    "SUFFIXES",
    "WRITTEN_MESH_SUFFIXES",
    "Format",
    "Shape",
    "read",
    "write_mesh",
    "write_ply",
]
