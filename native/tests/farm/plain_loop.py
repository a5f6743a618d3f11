"""All of a batch in one process, one pair after another: what engines are measured against.

python native/tests/farm/plain_loop.py JOBS.json OUT
"""

from __future__ import annotations

import sys
from pathlib import Path

from pointmorph.batch import reports
from pointmorph.batch.jobs import read_batch
from pointmorph.batch.runs import DONE, PairOutcome
from pointmorph.batch.tasks import Part, render
from pointmorph.commands import cli


def main(path: Path, out: Path) -> int:
    batch = read_batch(path, out)
    outcomes = []
    for job in batch.jobs:
        words = [job.morph_words(), *([job.frames_words()] if job.frames else [])]
        for command in words:
            if (status := cli.main(command)) != 0:
                return status
        if batch.render and (status := render(batch, job, Part(0, 1))) != 0:
            return status
        outcomes.append(PairOutcome(job, DONE))
    reports.write(batch, outcomes)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
