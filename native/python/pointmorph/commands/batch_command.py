"""The command ``pointmorph batch``: many pairs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pointmorph.base.errors import FileError, OptionError, PointmorphError
from pointmorph.batch import reports
from pointmorph.batch.jobs import Batch, PairJob, read_batch
from pointmorph.batch.runs import FAILED, KEPT, PENDING, BatchRun, PairOutcome
from pointmorph.batch.tasks import (
    RENDERS_STEP,
    Part,
    find_map,
    has_renders,
    make_frames,
    render,
    steps_to_do,
)
from pointmorph.commands import terminal
from pointmorph.commands.arguments import part_of, positive
from pointmorph.storage import files


def add(commands: Any, main: Callable[[Sequence[str]], int]) -> None:
    """Adds the command to the parser's. It runs other commands by `main`."""
    batch = commands.add_parser(
        "batch",
        help="morph many pairs: a list, one template to many targets, or all pairs of a folder",
        description="Pairs that are done are kept, and one that fails doesn't stop the others. "
        "Exit status: 0 if all are done, 3 if some aren't, 1 if none is.",
    )
    batch.set_defaults(run=_batch, main=main)
    batch.add_argument("file", metavar="JOBS.json", type=Path, help="file that lists what to morph")
    batch.add_argument("--out", metavar="DIR", type=Path, help="output folder, if not the file's")
    batch.add_argument(
        "--jobs",
        metavar="N",
        type=positive,
        help="most processes to run at once (default: as many as cores and memory allow)",
    )
    batch.add_argument(
        "--range",
        metavar="A:B",
        type=_some_pairs,
        default=slice(None),
        help="only pairs A to B - 1, counted from 0, and no report; either may be left out. K/N: "
        "part K of N equal parts of the pairs",
    )
    only = batch.add_mutually_exclusive_group()
    only.add_argument("--maps", action="store_true", help="only compute the maps, make no frames")
    only.add_argument(
        "--part",
        metavar="K/N",
        type=_part,
        help="only part K of N equal parts of each pair's frames, counted from 0",
    )
    only.add_argument(
        "--render", metavar="K/N", type=_part, help="only render that part of the frames"
    )
    only.add_argument(
        "--report", action="store_true", help="morph nothing: report what is done and what isn't"
    )
    batch.add_argument(
        "--renders", action="store_true", help="with --report: only what is rendered counts as done"
    )


def _some_pairs(text: str) -> slice | Part:
    return _part(text) if "/" in text else part_of(text)


def _part(text: str) -> Part:
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and int(number) < int(count)):
        raise argparse.ArgumentTypeError("expected K/N, such as 0/8, with K less than N")
    return Part(int(number), int(count))


def _batch(chosen: argparse.Namespace) -> int:
    batch = read_batch(chosen.file, chosen.out)
    is_task = isinstance(chosen.range, Part)
    jobs = batch.jobs[chosen.range.of(len(batch.jobs)) if is_task else chosen.range]
    if not jobs and not is_task:  # there can be more tasks than pairs
        raise OptionError(
            "range", f"some of the pairs 0 to {len(batch.jobs) - 1}", "none", "Correct A:B."
        )
    if chosen.renders and not (chosen.report and batch.render):
        raise OptionError(
            "renders", f'--report, and a "render" command in {batch.path}', "not both",
            "Leave --renders out, or add what is missing.",
        )  # fmt: skip
    files.make_folder(batch.out)
    if chosen.report:
        return _tell(batch, [_found(job, chosen.renders) for job in batch.jobs])
    if chosen.part or chosen.render or (chosen.maps and (is_task or len(jobs) == 1)):
        return _tasks(chosen, batch, jobs)
    run = BatchRun(jobs, chosen.jobs, with_frames=not chosen.maps)
    ended = 0

    def tell(outcome: PairOutcome) -> None:
        nonlocal ended
        ended += 1
        words = f": {outcome.message}" if outcome.message else f", {outcome.seconds:.1f} s"
        print(f"{ended}/{len(jobs)} {outcome.job.name}: {outcome.state}{words}", flush=True)

    run.run(tell)
    if len(jobs) < len(batch.jobs):
        return _status(run.outcomes)
    return _tell(batch, run.outcomes)


def _tasks(chosen: argparse.Namespace, batch: Batch, jobs: Sequence[PairJob]) -> int:
    """Maps, a part of the frames or of the renders in this very process, which an engine may end;
    the worst of the exit statuses. A pair that fails doesn't keep others from being made."""
    worst = 0
    for job in jobs:
        try:
            if chosen.render:
                status = render(batch, job, chosen.render)
            elif chosen.part:
                status = make_frames(job, chosen.part, chosen.main)
            else:
                status = find_map(job, chosen.main)
        except PointmorphError as error:
            if len(jobs) == 1 or isinstance(error, OptionError):
                raise
            status = terminal.fail(f"{job.name}: {error}", terminal.FAILED)
        if status in (terminal.INTERRUPTED, terminal.TERMINATED):
            return status
        worst = max(worst, status)
    return worst


def _found(job: PairJob, with_renders: bool) -> PairOutcome:
    """What is there of a pair."""
    try:
        missing = steps_to_do(job)
        if with_renders and job.frames and not has_renders(job):
            missing.append(RENDERS_STEP)
    except FileError as error:
        return PairOutcome(job, FAILED, message=str(error))
    *others, last = [f"the {step}" for step in missing] or [""]
    words = f"{' and '.join(filter(None, [', '.join(others), last]))} to do" if missing else ""
    return PairOutcome(job, PENDING if missing else KEPT, message=words)


def _tell(batch: Batch, outcomes: list[PairOutcome]) -> int:
    for line in reports.table(reports.write(batch, outcomes)):
        print(line)
    print(f"{reports.summary(outcomes)}; see {batch.out / reports.PAGE}")
    return _status(outcomes)


def _status(outcomes: list[PairOutcome]) -> int:
    missing = sum(outcome.state in (FAILED, PENDING) for outcome in outcomes)
    if missing == 0:
        return 0
    return terminal.FAILED if missing == len(outcomes) else terminal.INCOMPLETE
