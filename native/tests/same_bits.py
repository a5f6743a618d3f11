"""Digests of morphs, to be compared between systems, compilers and engines.

    python native/tests/same_bits.py --make FOLDER      small pairs of shapes, in FOLDER
    python native/tests/same_bits.py DIGESTS FOLDER…    of the pairs in these folders, as JSON

A pair is a folder with source.ply, target.ply and pair.json (`features`: rows of both files). Each
is morphed as it is, as bare points, without faces and normals, and in double precision, which hides
no last bit. The shapes are made once, not on each system: numpy's sine and cosine needn't have the
same bits everywhere.
"""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pointmorph
from pointmorph import formats

TIMES = (0.25, 0.5, 0.75)


def digest(*arrays: np.ndarray | None) -> str:
    hasher = hashlib.sha256()
    for array in arrays:
        if array is not None:
            hasher.update(f"{array.dtype.str} {array.shape}".encode())
            hasher.update(np.ascontiguousarray(array).tobytes())
    return hasher.hexdigest()


def digests_of(morph: pointmorph.Morph) -> dict[str, str]:
    result = {"pairs": digest(morph.pairs), "map": digest(morph.source_to_target)}
    for t in TIMES:
        frame = morph.frame(t)
        result[f"frame {t}"] = digest(frame.positions, frame.normals, frame.colors, frame.radii)
    frame = morph.resampled_frame(0.5)
    result["resampled"] = digest(frame.positions, frame.normals, frame.ids)
    if morph.has_mesh:
        result["wrapped"] = digest(morph.wrapped(0.5), morph.wrapped(1.0))
    return result


def run(folder: Path) -> dict[str, dict[str, str]]:
    """The digests of a pair: with everything that its files have, as bare points, and in double
    precision."""
    features = json.loads((folder / "pair.json").read_text())["features"]
    features = {name: tuple(rows) for name, rows in features.items()}
    shapes = [formats.read(folder / f"{side}.ply") for side in ("source", "target")]
    whole = [shape.cloud() for shape in shapes]
    bare = [pointmorph.Cloud(cloud.positions) for cloud in whole]
    double = [
        replace(shape, positions=shape.positions.astype(np.float64)).cloud() for shape in shapes
    ]
    kinds = {"": whole, ", bare points": bare, ", double precision": double}
    return {
        folder.name + kind: digests_of(pointmorph.morph(*clouds, features))
        for kind, clouds in kinds.items()
    }


def make(folder: Path) -> None:
    """A closed pair and an open one, with faces."""
    sys.path.insert(0, str(Path(__file__).parent / "python"))
    import shapes

    ball, other = shapes.ball(900), shapes.ball(1100)
    egg = other * (1.0 + 0.4 * np.exp(-2.0 * ((other - [0.6, 0.0, 0.8]) ** 2).sum(1)))[:, None]
    around = [shapes.around(points) for points in (ball, other)]
    _write(folder / "ball", ball, _hull(ball), egg, _hull(other))
    _mark(folder / "ball", {name: [side[name] for side in around] for name in around[0]})

    flat, bump = shapes.grid(31), shapes.grid(27, 0.8)
    _write(folder / "patch", flat, shapes.grid_faces(31), bump, shapes.grid_faces(27))
    _mark(folder / "patch", {"middle": [15 * 31 + 15, 13 * 27 + 13]})


def _hull(points: np.ndarray) -> np.ndarray:
    """Triangles between points on a sphere around the origin, normals outward."""
    from scipy.spatial import ConvexHull

    faces = ConvexHull(points).simplices
    inward = np.linalg.det(points[faces]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def _write(folder: Path, *arrays: np.ndarray) -> None:
    from plyfile import PlyData, PlyElement

    folder.mkdir(parents=True, exist_ok=True)
    for side, points, faces in zip(("source", "target"), arrays[::2], arrays[1::2], strict=True):
        rows = [tuple(point) for point in points.astype(np.float32)]
        vertices = np.array(rows, dtype=[(axis, "f4") for axis in "xyz"])
        triangles = np.array([(face,) for face in faces], dtype=[("vertex_indices", "i4", (3,))])
        elements = [PlyElement.describe(vertices, "vertex"), PlyElement.describe(triangles, "face")]
        PlyData(elements, byte_order="<").write(str(folder / f"{side}.ply"))


def _mark(folder: Path, features: dict[str, list[int]]) -> None:
    (folder / "pair.json").write_text(json.dumps({"features": features}))


if __name__ == "__main__":
    if sys.argv[1] == "--make":
        make(Path(sys.argv[2]))
    else:
        found = {}
        for name in sys.argv[2:]:
            found |= run(Path(name))
        Path(sys.argv[1]).write_text(json.dumps(found, indent=1))
