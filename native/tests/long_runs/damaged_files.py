"""Reads a great many damaged files of every format; what it finds is kept, and fails the run.

python native/tests/long_runs/damaged_files.py --cases 100000 --report FILE.json
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "python")]

import damage  # noqa: E402
from reporting import Report  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--finds", type=Path, default=Path("build/finds"))
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    report = Report("Damaged files of every format")
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for path, content, said in damage.cases(Path(folder), chosen.seed, chosen.cases):
            if isinstance(said, Exception):
                chosen.finds.mkdir(parents=True, exist_ok=True)
                (chosen.finds / f"{len(report.finds)}{path.suffix}").write_bytes(content)
                report.finds.append(f"{path.suffix}: {type(said).__name__}: {str(said)[:100]}")
            else:
                counts[said] += 1
    report.tried = {"files": chosen.cases, "read": counts["read"], "refused": counts["refused"]}
    return report.end(chosen.report)


if __name__ == "__main__":
    sys.exit(main())
