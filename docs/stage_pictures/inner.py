"""Stages that the package does not reach, compiled for the pictures of their pages."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "native"))

from build_tools.inner_modules import compiled  # noqa: E402

CORE = ROOT / "build" / "wheel" / "libpointmorph_core.a"
BUILT = ROOT / "build" / "pictures"


@cache
def stages() -> ModuleType:
    """The module of inner_stages.cpp, which is compiled first if it has changed."""
    if not CORE.is_file():
        raise SystemExit(f"expected {CORE}, found nothing; run: python3 build_addon.py setup")
    return compiled("inner_stages", Path(__file__).parent, BUILT, f"-DPOINTMORPH_CORE={CORE}")
