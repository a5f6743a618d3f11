"""The same bits with OpenMP and with the pool of threads, on newer processors and on older ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[1] / "same_bits.py"


# glibc then computes as on processors without fused multiply-add, to other last bits.
OLDER_PROCESSOR = "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA_Usable,-AVX2_Usable"


def test_engines_and_processors_give_the_same_bits(tmp_path: Path) -> None:
    def run(*arguments: str | Path, **more: str) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **more}
        subprocess.run([sys.executable, SCRIPT, *arguments], check=True, env=environment)

    run("--make", tmp_path)
    found = []
    for engine, processor in (("openmp", ""), ("pool", OLDER_PROCESSOR)):
        digests = tmp_path / f"{engine}.json"
        more = {"POINTMORPH_THREADS": engine, "GLIBC_TUNABLES": processor}
        run(digests, tmp_path / "patch", **more, OMP_NUM_THREADS="3")
        found.append(json.loads(digests.read_text()))
    assert found[0] == found[1]
    assert set(found[0]) == {"patch", "patch, bare points", "patch, double precision"}
    assert "wrapped" in found[0]["patch, double precision"]
