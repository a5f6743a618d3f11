"""Stages that the package does not reach, compiled for the pictures of their pages."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "build" / "wheel" / "libpointmorph_core.a"
BUILT = ROOT / "build" / "pictures"


@cache
def stages() -> ModuleType:
    """The module of inner_stages.cpp, which is compiled first if it has changed."""
    if not CORE.is_file():
        raise SystemExit(f"expected {CORE}, found nothing; run: python3 build_addon.py setup")
    packages = sysconfig.get_path("platlib")
    configure = ("cmake", "-S", Path(__file__).parent, "-B", BUILT, "-G", "Ninja")
    found = (f"-DPOINTMORPH_CORE={CORE}", f"-DPython_EXECUTABLE={sys.executable}")
    prefix = f"-DCMAKE_PREFIX_PATH={packages}/pybind11;{packages}/cmeel.prefix"
    release = "-DCMAKE_BUILD_TYPE=Release"
    for command in ((*configure, *found, prefix, release), ("cmake", "--build", BUILT)):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stdout + done.stderr)
    [path] = BUILT.glob("inner_stages*.so")
    spec = importlib.util.spec_from_file_location("inner_stages", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
