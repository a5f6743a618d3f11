"""Frames of a morph, one after another: in memory, in files, as surfaces."""

from pointmorph.sequences.chains import Chain
from pointmorph.sequences.frame_sequences import (
    FrameRun,
    FrameSequence,
    MeshWriter,
    even_times,
    part_at,
    write_frames,
    write_sequence,
)
from pointmorph.sequences.frame_stores import FrameStore
from pointmorph.sequences.moving_shapes import MovingSequence, ShapeState
from pointmorph.sequences.source_meshes import SourceMesh
from pointmorph.sequences.surfaces import Surface, Surfaces

__all__ = [
    "Chain",
    "FrameRun",
    "FrameSequence",
    "FrameStore",
    "MeshWriter",
    "MovingSequence",
    "ShapeState",
    "SourceMesh",
    "Surface",
    "Surfaces",
    "even_times",
    "part_at",
    "write_frames",
    "write_sequence",
]
