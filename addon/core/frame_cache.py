"""Frames of points in one file that Blender itself reads frame by frame: its Mesh Cache modifier
takes places of vertices from it, and every attribute of a point is written as such a place.

The file is a point cache of version 2 (.pc2). Each frame has as many vertices:

    0                     how many points the frame has, 0, 0
    1 + k * rows + i      vector k of point i: position, normal, velocity, color, and
                          alpha, radius and ID

where `rows` is the number of points of the frame that has the most.
"""

import struct

import numpy as np
import pointmorph
from pointmorph.storage import files

POSITION, NORMAL, VELOCITY, COLOR, REST = range(5)
"""What the vectors of a point are, in this order."""
VECTORS = 5
MOST = (2**24 - 1) // VECTORS
"""Points of a frame: numbers of nodes, which count vertices, are whole up to 2²⁴."""
_LAST_ID = 2**24
_HEADER = "<12siiffi"


def vertex_count(rows):
    """Of each frame."""
    return 1 + VECTORS * rows


def size(rows, frames):
    """Of a file, in bytes."""
    return struct.calcsize(_HEADER) + 12 * vertex_count(rows) * frames


def check(name, rows):
    """Raises CloudError when a frame of the object `name` has more points than a file can hold."""
    if rows > MOST:
        raise pointmorph.CloudError(
            name,
            f"at most {MOST:,} points in a frame in the scene",
            f"{rows:,}",
            "Bake PLY files, or turn Fill Cracks off.",
        )


def write(path, name, store, progress):
    """Writes all frames of a store, each read when its turn comes; whole or not at all.

    Parameters
    ----------
    path : pathlib.Path
    name : str
        Of the object that is baked.
    store : pointmorph.sequences.FrameStore
        Of points, all of them there.
    progress : callable
        As for `pointmorph.morph`.

    Returns
    -------
    int
        `rows`.

    Raises
    ------
    CloudError
        If a frame has too many points, or too many have been added on the way.
    FileError
        If it can't be written.
    Cancelled
        If `progress` returned False.
    """
    counts = store.counts()
    rows = max(counts)
    check(name, rows)
    with files.whole_file(path) as file:
        file.write(_header(rows, len(counts)))
        for number, frame in enumerate(store.frames()):
            if progress("writing", number / len(counts)) is False:
                raise pointmorph.Cancelled("Writing the frames was canceled.")
            _check_ids(name, frame.ids)
            file.write(_vertices(frame, rows).tobytes())
    return rows


def _check_ids(name, ids):
    """They are kept as floats."""
    last = int(ids.max(initial=0))
    if last > _LAST_ID:
        raise pointmorph.CloudError(
            name,
            f"IDs of points up to {_LAST_ID:,} in the scene",
            f"{last:,}",
            "Bake PLY files, or turn Fill Cracks off.",
        )


def _header(rows, frames):
    return struct.pack(_HEADER, b"POINTCACHE2\0", 1, vertex_count(rows), 0.0, 1.0, frames)


def _vertices(frame, rows):
    """(V, 3) of one frame."""
    count = len(frame.positions)
    vertices = np.zeros((vertex_count(rows), 3), "<f4")
    vertices[0, 0] = count
    vectors = vertices[1:].reshape(VECTORS, rows, 3)[:, :count]
    vectors[POSITION] = frame.positions
    vectors[NORMAL] = frame.normals
    vectors[VELOCITY] = frame.velocities
    vectors[COLOR] = frame.colors[:, :3]
    vectors[REST] = np.column_stack([frame.colors[:, 3], frame.radii, frame.ids])
    return vertices
