"""Whole numbers as text that takes little room in a file."""

import base64
import zlib

import numpy as np


def pack(numbers):
    """Text for an array of int32 whose neighbors differ little, as rows of triangles do."""
    steps = np.diff(np.asarray(numbers, np.int32).reshape(-1), prepend=np.int32(0))
    # Bytes of the same weight together: most of them are alike.
    planes = steps.astype("<i4").view(np.uint8).reshape(-1, 4).T
    return base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode()


def unpack(text, most):
    """(N,) int32: the numbers that `pack` was given. Raises ValueError where there are more than
    `most`, or where something else was packed."""
    try:
        reader = zlib.decompressobj()
        unpacked = reader.decompress(base64.b64decode(text), 4 * most + 1)
    except (TypeError, zlib.error) as error:
        raise ValueError(str(error)) from error
    if len(unpacked) > 4 * most or not reader.eof:
        raise ValueError(f"more than {most} numbers, or half of them")
    planes = np.frombuffer(unpacked, np.uint8).reshape(4, -1)
    steps = np.ascontiguousarray(planes.T).view("<i4").reshape(-1)
    return np.cumsum(steps, dtype=np.int32)
