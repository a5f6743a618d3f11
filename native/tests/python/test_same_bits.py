"""The same bits with OpenMP and with the pool of threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[1] / "same_bits.py"


def test_both_engines_give_the_same_bits(tmp_path: Path) -> None:
    def run(*arguments: str | Path, **more: str) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **more}
        subprocess.run([sys.executable, SCRIPT, *arguments], check=True, env=environment)

    run("--make", tmp_path)
    found = []
    for engine in ("openmp", "pool"):
        digests = tmp_path / f"{engine}.json"
        run(digests, tmp_path / "patch", POINTMORPH_THREADS=engine, OMP_NUM_THREADS="3")
        found.append(json.loads(digests.read_text()))
    assert found[0] == found[1]
    assert set(found[0]) == {"patch", "patch, bare points", "patch, double precision"}
    assert "wrapped" in found[0]["patch, double precision"]
