"""Damaged files of every format: read, or refused in words. `long_runs` tries more."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path

import damage
import pytest


def test_valid_files_are_read(tmp_path: Path) -> None:
    for path in damage.valid_files(tmp_path):
        if path.suffix == ".3mf":  # needs packages that the tests do without
            continue
        assert damage.use(path) == "read", path


PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\n%selement face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
FINDS = {
    "name.ply": PLY % b'property float {"a":\n' + b"0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n",
    "lines.ply": PLY % b"" + b"0 0\n0 1 0 0\n0 1 0\n3 0 1 2\n",
    "short.obj": b"v 0\nv 1\nv 2\nf 1 2 3\n",
    "latin.obj": b"o \xf8\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "torn.obj": b"v 0 0 0\nv 1 0 \\\n0\nv 0 1 0\n v 1 1 1 \\\nv 2 2 2\nf 1 2 3\n",
}
"""What damaging has found: each ended in a traceback once."""


@pytest.mark.parametrize("name", FINDS)
def test_what_was_found_stays_mended(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FINDS[name])
    damage.use(tmp_path / name)


def test_bytes_of_names_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(FINDS["latin.obj"])
    assert damage.use(tmp_path / "a.obj") == "read"
    assert (tmp_path / "moved.obj").read_bytes().startswith(b"o \xf8\n")


@pytest.mark.parametrize("seed", range(3))
def test_damaged_files_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    found: Counter[tuple[str, str]] = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for path, content, said in damage.cases(tmp_path, seed, 400):
            if isinstance(said, Exception):
                kept = tmp_path / f"find{path.suffix}"
                kept.write_bytes(content)
                raise AssertionError(f"see {kept}") from said
            found[path.suffix, said] += 1
    # Both happen to most formats: else nothing but the first bytes would be tried.
    assert sum(found[suffix, "read"] > 0 for suffix, _ in found) > len(found) / 2
