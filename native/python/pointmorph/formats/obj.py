"""Wavefront OBJ, as most programs write it: vertices and faces, in one piece.

A file that is anything else is left to trimesh, whose import takes longer than a small morph. Both
give the same rows.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

_Rows = npt.NDArray[np.int64]

_WITHOUT_DIGITS = str.maketrans("", "", "0123456789")
_READ = ("v ", "f ")
# What says nothing about vertices and faces.
_SKIPPED = ("#", "vt ", "vn ", "o ", "g ", "s ", "mtllib ", "usemtl ")


def read(path: Path) -> tuple[npt.NDArray[np.float64], _Rows] | None:
    """Positions and triangles of a file, or None if it isn't a plain one.

    Raises
    ------
    OSError
        If it can't be read.
    """
    try:
        text = path.read_bytes().decode().replace("\r\n", "\n").strip()
    except UnicodeDecodeError:
        return None
    lines = text.split("\n")
    if "\r" in text or "\\\n" in text or not all(map(_is_known, lines)):
        return None
    faces = [line for line in lines if line.startswith("f ")]
    if not faces or _has_parts(lines):
        return None
    positions = _positions([line[2:] for line in lines if line.startswith("v ")])
    triangles = _triangles([" ".join(line.split()[1:]) for line in faces])
    if positions is None or triangles is None or triangles.max() >= len(positions):
        return None
    # With more than one number in a corner, trimesh leaves the last rows out if no face has them.
    is_whole = "/" not in faces[0] or triangles.max() == len(positions) - 1
    return (positions, triangles) if is_whole else None


def _is_known(line: str) -> bool:
    return not line or line.startswith(_READ) or line.startswith(_SKIPPED)


def _has_parts(lines: Sequence[str]) -> bool:
    """Whether there is another material than the first for some of the faces."""
    chosen = [number for number, line in enumerate(lines) if "usemtl " in line]
    return bool(chosen) and any(line.startswith("f ") for line in lines[: chosen[-1]])


def _positions(rows: Sequence[str]) -> npt.NDArray[np.float64] | None:
    if not rows or len(rows[0].split()) != 3:
        return None
    text = " ".join(rows)
    if "+e" in text or "-e" in text:  # not a number, but for trimesh
        return None
    numbers = _numbers(text, np.float64)
    if numbers is None or len(numbers) != 3 * len(rows):
        return None
    return numbers.reshape(-1, 3)


def _numbers(text: str, kind: type) -> npt.NDArray[Any] | None:
    """All numbers of a text, or None where it has something else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, kind, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _triangles(faces: Sequence[str]) -> _Rows | None:
    """Triangles of faces such as "1 2 3" or "1/1/1 2/2/1 3/3/1 4/4/1", in trimesh's order."""
    patterns = [face.translate(_WITHOUT_DIGITS) for face in faces]
    known = {pattern: pattern.split(" ") for pattern in set(patterns)}
    corners = {corner for split in known.values() for corner in split}
    if len(corners) != 1 or corners - {"", "/", "//"}:
        return None
    [corner] = corners
    sizes = np.array([len(known[pattern]) for pattern in patterns])
    text = " ".join(faces)
    empty = text.count("//")
    if sizes.min() < 3 or empty not in (0, sizes.sum()) or (empty and corner == "/"):
        return None
    each = 1 + len(corner) - (1 if empty else 0)
    rows = _numbers(text.replace("/", " "), np.int64)
    if rows is None or len(rows) != each * sizes.sum() or rows.min() < 1:
        return None
    rows = rows[::each] - 1
    if len(known) == 1:
        return _of_equal_faces(rows.reshape(len(faces), -1))
    return _of_mixed_faces(rows, sizes)


def _of_equal_faces(rows: _Rows) -> _Rows | None:
    if rows.shape[1] == 3:
        return rows
    if rows.shape[1] == 4:
        halves: _Rows = np.concatenate([rows[:, [0, 1, 2]], rows[:, [2, 3, 0]]])
        return halves
    return None


def _of_mixed_faces(rows: _Rows, sizes: _Rows) -> _Rows:
    """Face by face: fans, but for quads, whose second triangle begins at their third corner."""
    count = sizes - 2
    first = np.repeat(np.cumsum(sizes) - sizes, count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    fans = np.stack([first, first + number + 1, first + number + 2], axis=1)
    turned = (np.repeat(sizes, count) == 4) & (number == 1)
    fans[turned] = fans[turned][:, [1, 2, 0]]
    triangles: _Rows = rows[fans]
    return triangles
