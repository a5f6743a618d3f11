"""Valid files of every format, and ways to damage them."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pointmorph
from pointmorph import formats, meshes
from pointmorph.batch import jobs
from pointmorph.commands import cli
from pointmorph.meshes import Shape
from pointmorph.sequences import source_meshes
from shapes import grid, grid_faces

SIDE = 5
WORDS = (
    *(b"-1", b"0", b"1e999", b"-nan", b"4294967296", b"1000000000000", b"1e-320", b"0x10", b"\xff"),
    *(b"3 0 1", b"\n", b" ", b"f 1//1 2/2/2 -1", b"end_header\n", b"[[[[", b'{"a":', b"null", b'"'),
)
NUMBERS = (
    *(struct.pack("<i", n) for n in (0, -1, 2**31 - 1, -(2**31), 255, 65536)),
    *(struct.pack("<f", n) for n in (float("nan"), float("inf"), 1e38, 1e-45, -0.0)),
    *(struct.pack("<d", n) for n in (float("nan"), 1e308, 5e-324)),
)


def valid_files(folder: Path) -> list[Path]:
    """Small meshes and clouds in every format, as this package and others write them."""
    positions, faces = grid(SIDE, 0.5), grid_faces(SIDE)
    count = len(positions)
    normals = np.tile(np.array([0, 0, 1], np.float32), (count, 1))
    colors = np.linspace(0, 1, 4 * count).reshape(count, 4)
    for suffix in formats.WRITTEN_MESH_SUFFIXES:
        written = (positions, normals, colors, faces.astype(np.int32))
        formats.write_mesh(folder / f"written{suffix}", *written)
    formats.write_ply(folder / "cloud.ply", positions, normals, colors, np.ones(count, np.float32))
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in positions)
    corners = "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
    (folder / "plain.off").write_text(f"OFF\n{count} {len(faces)} 0\n{rows}{corners}")
    header = f"ply\nformat ascii 1.0\nelement vertex {count}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_index\nend_header\n"
    (folder / "text.ply").write_text(header + rows + corners)
    lines = "".join(f"v {x} {y} {z}\nvt {x} {y}\n" for x, y, z in positions)
    lines += "".join("f " + " ".join(f"{v + 1}/{v + 1}" for v in face) + "\n" for face in faces)
    (folder / "uvs.obj").write_text("g sheet\n" + lines)
    for suffix in ("xyz", "asc"):
        (folder / f"points.{suffix}").write_text("# x y z\n" + rows)
    _write_scene(folder, positions, faces)
    _write_3mf(folder / "model.3mf", positions, faces)
    cap = {"kind": "region", "source": {"rows": [1, 2], "weights": [0.5, 1]}, "target": [3]}
    rim = {"kind": "curve", "source": [0, 1], "target": [2], "weight": 2.0}
    marks = {
        "features": {"nose": [3, 4], "rim": rim, "cap": cap},
        "loop": ["nose", "nose", "nose"],
        "rigid": {"source": [1, 2]},
    }
    (folder / "features.json").write_text(json.dumps(marks))
    _write_jobs(folder / "pairs.jobs")
    _write_morph(folder / "kept.morph", positions, faces)
    return sorted(path for path in folder.iterdir() if path.suffix != ".bin")


def _write_scene(folder: Path, positions: np.ndarray, faces: np.ndarray) -> None:
    points, corners = positions.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    (folder / "scene.bin").write_bytes(points + corners)
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(positions), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"uri": "scene.bin", "byteLength": len(points) + len(corners)}],
    }  # fmt: skip
    (folder / "scene.gltf").write_text(json.dumps(scene))


def _write_3mf(path: Path, positions: np.ndarray, faces: np.ndarray) -> None:
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in positions)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    model = (
        '<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles>'
        '</mesh></object></resources><build><item objectid="1"/></build></model>'
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    path.write_bytes(content.getvalue())


def _write_jobs(path: Path) -> None:
    """What `pointmorph batch` reads; the name is for `use` to know it by."""
    pair = {"source": "cloud.ply", "target": "text.ply", "name": "a", "settings": {"path": "rigid"}}
    content = {
        "pairs": [pair, {"source": "uvs.obj", "target": "cloud.ply", "samples": 100}],
        "template": {"source": "plain.off", "targets": "*.ply"}, "folder": {"path": "."},
        "frames": 4, "resample": True, "out": "out", "up": "y", "render": ["true", "{frame}"],
    }  # fmt: skip
    path.write_text(json.dumps(content))


def _write_morph(path: Path, positions: np.ndarray, faces: np.ndarray) -> None:
    moved = positions * np.float32([1, 2, -1])
    clouds = [pointmorph.Cloud(rows, faces=faces) for rows in (positions, moved)]
    pointmorph.morph(*clouds, path="rigid").save(path, resample=True)


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """The same bytes with a few things wrong, or none of them but as many."""
    if rng.random() < 0.02:
        return bytes(rng.integers(0, 256, len(content), np.uint8))
    data = bytearray(content)
    for _ in range(1 if rng.random() < 0.6 else rng.integers(2, 5)):
        if not data:
            break
        # What says how the rest is to be read stands first.
        at = int(len(data) * rng.random() ** (3 if rng.random() < 0.5 else 1))
        size = int(rng.integers(1, 1 + min(32, len(data))))
        kind = rng.integers(8)
        if kind == 0:
            data[at] ^= 1 << rng.integers(8)
        elif kind == 1:
            data[at] = rng.integers(256)
        elif kind == 2:
            del data[at:]
        elif kind == 3:
            del data[at : at + size]
        elif kind == 4:
            data[at:at] = data[at : at + size] * int(rng.integers(1, 4))
        elif kind == 5:
            word = WORDS[rng.integers(len(WORDS))]
            data[at : at + len(word)] = word
        elif kind == 6:
            _replace_word(data, at, rng)
        else:
            number = NUMBERS[rng.integers(len(NUMBERS))]
            data[at : at + len(number)] = number
    return bytes(data)


def _replace_word(data: bytearray, at: int, rng: np.random.Generator) -> None:
    """Another word or number in place of that which begins after a place."""
    ends = b" \n\r\t,:/"
    first = next((k for k in range(at, len(data)) if data[k] in ends), len(data)) + 1
    last = next((k for k in range(first, len(data)) if data[k] in ends), len(data))
    data[first:last] = WORDS[rng.integers(len(WORDS))]


def use(path: Path) -> str:
    """Reads a file and does with it what the command line does; "read" or "refused".

    Only the package's own errors may come of it, and no shape that isn't in order.
    """
    try:
        if path.suffix == ".json":
            shape = Shape("sheet", grid(SIDE))
            features, _ = cli.read_features(path)
            with suppress(pointmorph.FeatureError):
                cli.check_rows([shape, shape], features)
            cli._read_weights(path, [shape, shape])
            return "read"
        if path.suffix == ".jobs":
            jobs.read_batch(path)
            return "read"
        if path.suffix == ".morph":
            _use_morph(path)
            return "read"
        shape = formats.read(path)
        _check(shape)
        shape.cloud()
        if shape.faces is not None:
            mesh = source_meshes.SourceMesh(path, shape)
            out = path.with_name(f"moved{mesh.suffix}")
            mesh.write(out, shape.positions + 1.0)
            meshes.vertex_normals(shape.positions, shape.faces)
    except pointmorph.PointmorphError:
        return "refused"
    return "read"


def _use_morph(path: Path) -> None:
    """Every number that comes of it is finite, or its checksums tell."""
    morph = pointmorph.open_morph(path)
    json.dumps(morph.report)
    for t in (0.0, 0.4, 1.0):
        frames = morph.frame(t), morph.resampled_frame(t)
        meshes_at = morph.wrapped(t), morph.wrapped_target(t)
        numbers = [values for f in frames for values in (f.positions, f.normals, f.radii)]
        if not all(np.isfinite(values).all() for values in (*numbers, *meshes_at)):
            morph.check()
            raise AssertionError("not finite, though the file is whole")


def _check(shape: Shape) -> None:
    count = len(shape.positions)
    assert shape.positions.shape == (count, 3)
    for values, width in ((shape.normals, 3), (shape.colors, 4)):
        assert values is None or values.shape == (count, width)
    for values in (shape.radii, shape.rigid, shape.fixed, shape.delay):
        assert values is None or values.shape == (count,)
    if shape.faces is not None:
        assert shape.faces.ndim == 2
        assert shape.faces.shape[1] == 3


def cases(
    folder: Path, seed: int, count: int, use: Callable[[Path], str] = use
) -> Iterator[tuple[Path, bytes, str | Exception]]:
    """Damages valid files, uses each, and yields what came of it."""
    rng = np.random.default_rng(seed)
    given = folder / "valid"
    given.mkdir(exist_ok=True)
    whole = {path: path.read_bytes() for path in valid_files(given)}
    (folder / "scene.bin").write_bytes((given / "scene.bin").read_bytes())
    paths = list(whole)
    for number in range(count):
        path = paths[number % len(paths)]
        content = damaged(whole[path], rng)
        tried = folder / f"damaged{path.suffix}"
        tried.write_bytes(content)
        try:
            found: str | Exception = use(tried)
        except Exception as error:
            found = error
        yield tried, content, found
