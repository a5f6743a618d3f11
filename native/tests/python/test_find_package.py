"""The C++ library in somebody else's project: found by CMake, compiled and run."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pointmorph
import pytest
from shapes import grid

ROOT = Path(__file__).resolve().parents[3]
BUILD = ROOT / "build" / "wheel"

pytestmark = pytest.mark.skipif(
    not (BUILD / "libpointmorph_core.a").is_file() or shutil.which("cmake") is None,
    reason="the library wasn't compiled here by build_addon.py",
)


def run(*words: object) -> str:
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_example_finds_the_library_and_gets_what_python_gets(tmp_path: Path) -> None:
    prefix = tmp_path / "prefix"
    run("cmake", "--install", BUILD, "--prefix", prefix, "--component", "cpp")
    run("cmake", "-S", ROOT / "docs" / "examples" / "cpp", "-B", tmp_path / "build", "-G", "Ninja",
        f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_CXX_FLAGS=-O0")  # fmt: skip
    # Nothing of this checkout is needed but what was installed.
    targets = [*prefix.rglob("*.cmake")]
    assert targets
    assert not [path for path in targets if str(ROOT) in path.read_text()]
    run("cmake", "--build", tmp_path / "build")
    clouds = [grid(8, 0.0, np.float64), grid(7, 0.5, np.float64)]
    paths = []
    for name, points in zip(("a", "b"), clouds, strict=True):
        paths.append(tmp_path / f"{name}.xyz")
        np.savetxt(paths[-1], points, fmt="%.17g")
    found = np.loadtxt(run(tmp_path / "build" / "morph_example", *paths).splitlines())
    morph = pointmorph.morph(*(pointmorph.Cloud(points) for points in clouds))
    # The library calls the system's own exp and its kin, the module the project's.
    np.testing.assert_allclose(found, morph.frame(0.5).positions, rtol=0.0, atol=1e-12)
