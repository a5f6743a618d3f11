"""The command ``pointmorph farm``: a batch on many machines."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pointmorph.batch.jobs import read_batch
from pointmorph.batch.openjd_jobs import write_openjd
from pointmorph.batch.slurm_jobs import SlurmRun
from pointmorph.batch.tasks import RENDERS_IN_TASK, report_words
from pointmorph.commands.arguments import positive


def add(commands: Any, main: Callable[[Sequence[str]], int]) -> None:
    """Adds the command to the parser's. It runs other commands by `main`."""
    farm = commands.add_parser(
        "farm",
        help="run a batch on many machines, with Slurm or any farm that takes Open Job Description",
        description="Maps, frames and renders become tasks of their own, in that order.",
    )
    engines = farm.add_subparsers(dest="engine", required=True, metavar="ENGINE")
    slurm = engines.add_parser("slurm", help="submit array jobs that wait for one another")
    slurm.set_defaults(run=_slurm, main=main)
    slurm.add_argument(
        "--sbatch",
        metavar="OPTION",
        action="append",
        default=[],
        help="an option for sbatch, such as --sbatch=--mem=4G; can be repeated",
    )
    slurm.add_argument(
        "--wait",
        action="store_true",
        help="wait until all tasks have ended, and report the outcome",
    )
    openjd = engines.add_parser("openjd", help="write a job template of Open Job Description")
    openjd.set_defaults(run=_openjd)
    openjd.add_argument(
        "--template", required=True, metavar="FILE.json", type=Path, help="the template to write"
    )
    for engine in (slurm, openjd):
        engine.add_argument("file", metavar="JOBS.json", type=Path, help="as for batch")
        engine.add_argument("--out", metavar="DIR", type=Path, help="output folder")
        engine.add_argument(
            "--chunk",
            metavar="N",
            type=positive,
            help="most frames in a task (default: enough for about a minute; "
            f"{RENDERS_IN_TASK} pictures where they are rendered)",
        )


def _slurm(chosen: argparse.Namespace) -> int:
    batch = read_batch(chosen.file, chosen.out)
    run = SlurmRun(batch, chosen.chunk, chosen.sbatch)
    run.submit()
    print(f"{len(run.submitted)} array jobs submitted: {' '.join(run.submitted)}")
    print(f"To cancel all of them: scancel {' '.join(run.submitted)}")
    if not chosen.wait:
        return 0
    run.wait()
    words = ["batch", str(batch.path), "--out", str(batch.out), *report_words(batch)]
    status: int = chosen.main(words)
    return status


def _openjd(chosen: argparse.Namespace) -> int:
    batch = read_batch(chosen.file, chosen.out)
    write_openjd(batch, chosen.chunk, chosen.template)
    print(f"{len(batch.jobs)} pairs, written to {chosen.template}")
    return 0
