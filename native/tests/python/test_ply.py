"""PLY files as whole blocks, against plyfile, which reads them row by row."""

from __future__ import annotations

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plyfile import PlyData, PlyElement
from pointmorph.formats import ply

ORDERS = {"text": (True, "="), "little endian": (False, "<"), "big endian": (False, ">")}


def table(name: str, count: int, lengths: dict[str, list[int]]) -> PlyElement:
    """A table with numbers of every kind, and lists of these lengths."""
    rng = np.random.default_rng(count)
    kinds = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
    fields: list[tuple[Any, ...]] = [(f"a{kind}", kind) for kind in kinds[:4]]
    fields += [(list_name, "O") for list_name in lengths]
    fields += [(f"b{kind}", kind) for kind in kinds[4:]]
    rows = np.empty(count, fields)
    for field, kind in fields:
        if kind == "O":
            rows[field] = [
                rng.integers(0, 100, lengths[field][i % len(lengths[field])]).astype("i4")
                for i in range(count)
            ]
        else:
            rows[field] = (200 * rng.random(count)).astype(kind)
    len_types, val_types = dict.fromkeys(lengths, "u1"), dict.fromkeys(lengths, "i4")
    return PlyElement.describe(rows, name, len_types=len_types, val_types=val_types)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    "lengths",
    [
        {},
        {"one": [3]},
        {"one": [3], "two": [6]},
        {"one": [3, 4, 0, 5]},
        {"one": [0], "two": [1, 2]},
    ],
)
@pytest.mark.parametrize("count", [0, 1, 40])
def test_tables_are_those_that_plyfile_reads(
    tmp_path: Path, order: str, lengths: dict[str, list[int]], count: int
) -> None:
    text, byte_order = ORDERS[order]
    tables = [table("first", 3, {}), table("middle", count, lengths), table("last", 5, {})]
    path = tmp_path / "a.ply"
    PlyData(tables, text, byte_order, comments=["property of  nobody"]).write(str(path))
    read = ply.read(path)
    assert list(read) == ["first", "middle", "last"]
    for expected in PlyData.read(str(path)).elements:
        found = read[expected.name]
        assert found.count == expected.count
        for p in expected.properties:
            rows = expected.data[p.name]
            if hasattr(p, "len_dtype"):
                offsets, values = found.lists[p.name].offsets, found.lists[p.name].values
                assert len(offsets) == found.count + 1
                pieces = [values[a:b] for a, b in itertools.pairwise(offsets)]
                assert [list(row) for row in rows] == [list(piece) for piece in pieces]
                kind = values.dtype
            else:
                np.testing.assert_array_equal(found.columns[p.name], rows)
                kind = found.columns[p.name].dtype
            assert kind == np.dtype(p.val_dtype if hasattr(p, "len_dtype") else p.dtype())


def test_written_files_have_the_bytes_that_plyfile_writes() -> None:
    rng = np.random.default_rng(1)
    vertices = np.empty(9, [("x", "f4"), ("y", "f8"), ("red", "u1"), ("id", "i4")])
    for name in vertices.dtype.names or ():
        vertices[name] = 100 * rng.random(9)
    corners = rng.integers(0, 9, (4, 3), np.int32)
    faces = np.empty(4, [("vertex_indices", "i4", (3,))])
    faces["vertex_indices"] = corners
    for given, elements in ((None, []), (corners, [PlyElement.describe(faces, "face")])):
        expected, found = io.BytesIO(), io.BytesIO()
        data = PlyData([PlyElement.describe(vertices, "vertex"), *elements], byte_order="<")
        data.write(expected)
        ply.write(found, vertices, given)
        assert found.getvalue() == expected.getvalue()


@pytest.mark.parametrize("order", ORDERS)
def test_every_file_that_ends_early_is_refused(tmp_path: Path, order: str) -> None:
    text, byte_order = ORDERS[order]
    path = tmp_path / "a.ply"
    PlyData([table("rows", 3, {"one": [2, 3]})], text, byte_order).write(str(path))
    whole = path.read_bytes()
    # of a text all up to the last number, which may be shorter
    for size in range(whole.rindex(b" ") if text else len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"early end|no PLY header|numbers"):
            ply.read(path)


@pytest.mark.parametrize(
    "lines",
    [
        "nothing",
        "ply\nformat ascii 2\nelement vertex 1\nend_header\n",
        "ply\nformat binary_middle_endian 1.0\nend_header\n",
        "ply\nformat ascii 1.0\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty complex x\nend_header\n1\n",
        "ply\nformat ascii 1.0\nelement vertex -1\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nz\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1 2\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty uchar x\nend_header\n256\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list char int x\nend_header\n-1\n",
    ],
)
def test_what_is_no_ply_file_is_refused(tmp_path: Path, lines: str) -> None:
    (tmp_path / "a.ply").write_text(lines)
    with pytest.raises(ValueError, match=r"header|numbers|table|no rows"):
        ply.read(tmp_path / "a.ply")


@pytest.mark.parametrize("order", ["little endian", "big endian"])
def test_columns_are_replaced_and_nothing_else(tmp_path: Path, order: str) -> None:
    tables = [table("first", 3, {}), table("middle", 7, {}), table("last", 5, {"one": [3, 4]})]
    path, moved = tmp_path / "a.ply", tmp_path / "b.ply"
    PlyData(tables, *ORDERS[order], comments=["of nobody"]).write(str(path))
    content = ply.with_columns(path, "middle", {"bf4": np.arange(7.0), "nowhere": np.arange(7.0)})
    assert content is not None
    tables[1].data["bf4"] = np.arange(7.0)
    PlyData(tables, *ORDERS[order], comments=["of nobody"]).write(str(moved))
    assert content == moved.read_bytes()
    assert ply.with_columns(path, "last", {}) is None
    assert ply.with_columns(path, "nowhere", {}) is None
