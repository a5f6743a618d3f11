"""A batch on Slurm: array jobs, each of which waits for what it needs."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from pointmorph.base.errors import OptionError
from pointmorph.batch.jobs import Batch
from pointmorph.batch.tasks import FarmStep, Part, command_line, farm_steps, report_words
from pointmorph.storage import files

FOLDER = "farm"
_MOST_IN_ARRAY = 1000  # Slurm's MaxArraySize is 1001 unless somebody has changed it
_TRIES = 3

# A task may be killed alone, when memory runs out for instance: Slurm is told to run it again. One
# that was asked to end (SIGTERM, as by scancel) isn't.
_SCRIPT = """#!/bin/sh
# Task $SLURM_ARRAY_TASK_ID is that line of {tasks}, counted from {first}.
export OMP_NUM_THREADS="${{SLURM_CPUS_PER_TASK:-1}}"
line=$((SLURM_ARRAY_TASK_ID + {first} + 1))
task=$(sed -n "${{line}}p" {tasks})
sh -c "exec $task" &
child=$!
trap 'kill -TERM $child' TERM
wait $child
status=$?
if [ $status -eq 143 ]; then wait $child; fi
if [ $status -eq 137 ] && [ "${{SLURM_RESTART_COUNT:-0}}" -lt {tries} ]; then
    echo "Task $SLURM_ARRAY_TASK_ID was killed and runs again."
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}" && exec sleep 60
fi
exit $status
"""


@dataclass
class SlurmRun:
    """A batch as array jobs, each of which waits for what it needs.

    Parameters
    ----------
    batch : Batch
    chunk : int or None
        Frames in a task at the most, if another number than the usual ones.
    options : sequence of str
        For sbatch, such as --mem=4G.
    """

    batch: Batch
    chunk: int | None
    options: Sequence[str] = ()
    submitted: list[str] = field(default_factory=list)
    """Slurm's numbers of all array jobs"""

    def submit(self) -> None:
        """Writes the scripts and submits them. The last job reports when all is over.

        Raises
        ------
        OptionError, FileError
            If there is no Slurm, it refuses, or the files can't be written. Then what was
            submitted already is canceled.
        """
        check_slurm()
        files.make_folder(self.batch.out / FOLDER / "logs")
        try:
            self._submit()
        except BaseException:
            if self.submitted:
                subprocess.run(["scancel", *self.submitted], check=False)
            raise

    def wait(self, every: float = 2.0) -> None:
        """Waits until all that was submitted is over, and asks every so many seconds."""
        while _is_queued(self.submitted):
            time.sleep(every)

    def _submit(self) -> None:
        maps, *others = farm_steps(self.batch, self.chunk)
        words = [command_line(self.batch, *maps.words(k, 0)) for k in range(maps.groups)]
        arrays = self._arrays("maps", words)
        before = [
            [f"{arrays[k // _MOST_IN_ARRAY]}_{k % _MOST_IN_ARRAY}"] for k in range(maps.groups)
        ]
        for step in others:
            before = self._step(step, before)
        report = command_line(self.batch, *report_words(self.batch))
        self._arrays("report", [report], self.submitted)

    def _step(self, step: FarmStep, before: Sequence[Sequence[str]]) -> list[list[str]]:
        """Submits the tasks of a step, each group after what its pairs need: `before` has what to
        wait for, of each group of the step before. The same of this step.

        They wait until that is over, not until it is all done: a pair that fails doesn't keep
        others of its group from being made, and tasks refuse what isn't there."""
        total = len(self.batch.jobs)
        arrays: list[list[str]] = []
        for number in range(step.groups):
            pairs = Part(number, step.groups).of(total)
            after: list[str] = []
            for k, names in enumerate(before):
                earlier = Part(k, len(before)).of(total)
                if max(pairs.start, earlier.start) < min(pairs.stop, earlier.stop):
                    after += names
            tasks = [
                command_line(self.batch, *step.words(number, k)) for k in range(step.parts or 1)
            ]
            arrays.append(self._arrays(f"{step.name.lower()}_{number}", tasks, after))
        return arrays

    def _arrays(
        self, name: str, tasks: Sequence[Sequence[str]], after: Sequence[str] = ()
    ) -> list[str]:
        """Submits tasks that begin once others are over; the numbers of their arrays."""
        folder = self.batch.out / FOLDER
        lines = "".join(f"{shlex.join(task)}\n" for task in tasks)
        files.write_bytes(folder / f"{name}.tasks", lines.encode())
        submitted = []
        for first in range(0, len(tasks), _MOST_IN_ARRAY):
            count = min(_MOST_IN_ARRAY, len(tasks) - first)
            script = _SCRIPT.format(
                tasks=shlex.quote(str(folder / f"{name}.tasks")), first=first, tries=_TRIES
            )
            path = folder / f"{name}_{first}.sh"
            files.write_bytes(path, script.encode())
            words = [
                "sbatch", "--parsable", "--requeue", "--open-mode=append",
                f"--job-name=pointmorph-{name}", f"--array=0-{count - 1}",
                f"--output={folder / 'logs' / name}_%a.log", *self.options,
            ]  # fmt: skip
            words += [f"--dependency=afterany:{':'.join(after)}"] if after else []
            submitted.append(_sbatch([*words, str(path)]))
            self.submitted.append(submitted[-1])
        return submitted


def check_slurm() -> None:
    """Raises OptionError if there is no Slurm here."""
    missing = [
        name for name in ("sbatch", "squeue", "scontrol", "scancel") if shutil.which(name) is None
    ]
    if missing:
        raise OptionError(
            "slurm",
            "Slurm's commands",
            f"no {', '.join(missing)}",
            "Run it on a machine that submits jobs, or use batch or farm openjd.",
        )


def _sbatch(words: Sequence[str]) -> str:
    """Submits a job, and returns its number. Raises OptionError."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise OptionError(
            "slurm",
            "a job that Slurm accepts",
            done.stderr.strip() or f"status {done.returncode}",
            "Correct the options for sbatch, or look at sinfo.",
        )
    return done.stdout.strip().partition(";")[0]


def _is_queued(numbers: Sequence[str]) -> bool:
    """Whether any of these jobs waits or runs. Where Slurm doesn't answer, they may."""
    words = ["squeue", "--noheader", f"--jobs={','.join(numbers)}"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:  # what is over for a while is forgotten
        return "Invalid job id" not in done.stderr
    return bool(done.stdout.strip())
