"""Batches for engines that run jobs on many machines: Slurm, and Open Job Description.

Both get the same tasks: calls of ``pointmorph batch`` for one pair each (`batch_tasks`).
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pointmorph import files
from pointmorph.batch_jobs import Batch
from pointmorph.batch_tasks import command_line, part_count, render_command
from pointmorph.errors import FileError, OptionError

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
    echo "Task $SLURM_ARRAY_TASK_ID was killed; it is run again."
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}" && sleep 60
fi
exit $status
"""


@dataclass
class SlurmRun:
    """A batch as array jobs, each of which waits for what it needs.

    Parameters
    ----------
    batch : Batch
    chunk : int
        Frames in a task.
    options : sequence of str
        For sbatch, such as --mem=4G.
    """

    batch: Batch
    chunk: int
    options: Sequence[str] = ()
    submitted: list[str] = field(default_factory=list)
    """Slurm's numbers of all array jobs"""

    def submit(self) -> str:
        """Writes the scripts and submits them; the number of the job that reports when all is over.

        Raises
        ------
        OptionError, FileError
            If there is no Slurm, it refuses, or the files can't be written. Then what was
            submitted already is canceled.
        """
        check_slurm()
        files.make_folder(self.batch.out / FOLDER / "logs")
        try:
            return self._submit()
        except BaseException:
            if self.submitted:
                subprocess.run(["scancel", *self.submitted], check=False)
            raise

    def _submit(self) -> str:
        jobs = self.batch.jobs
        maps = self._arrays("maps", [
            command_line(self.batch, "--range", str(number), "--maps")
            for number in range(len(jobs))
        ])  # fmt: skip
        parts = part_count(self.batch, self.chunk)
        last = [array for array, _ in maps]
        for number, job in enumerate(jobs):
            if not job.frames:
                continue
            array, place = maps[number // _MOST_IN_ARRAY][0], number % _MOST_IN_ARRAY
            after = f"afterok:{array}_{place}"
            for kind in ("part", *(["render"] if self.batch.render else [])):
                tasks = [
                    command_line(self.batch, "--range", str(number), f"--{kind}", f"{k}/{parts}")
                    for k in range(parts)
                ]
                arrays = self._arrays(f"{kind}s_{number}", tasks, after)
                after = ":".join(["afterok", *(one for one, _ in arrays)])
                last += [one for one, _ in arrays]
        report = command_line(self.batch, "--report")
        return self._arrays("report", [report], ":".join(["afterany", *last]))[0][0]

    def _arrays(
        self, name: str, tasks: Sequence[Sequence[str]], after: str | None = None
    ) -> list[tuple[str, int]]:
        """Submits tasks; of each array its number and how many tasks it has."""
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
            words += [f"--dependency={after}", "--kill-on-invalid-dep=yes"] if after else []
            number = _slurm([*words, str(path)]).partition(";")[0]
            self.submitted.append(number)
            submitted.append((number, count))
        return submitted


def check_slurm() -> None:
    """Raises OptionError if there is no Slurm here."""
    missing = [name for name in ("sbatch", "scontrol", "scancel") if shutil.which(name) is None]
    if missing:
        raise OptionError(
            "slurm",
            "Slurm's commands",
            f"no {', '.join(missing)}",
            "Run it where jobs are submitted from, or use batch or farm openjd.",
        )


def _slurm(words: Sequence[str]) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise OptionError(
            "slurm",
            "a job that Slurm accepts",
            done.stderr.strip() or f"status {done.returncode}",
            "Correct the options for sbatch, or look at sinfo.",
        )
    return done.stdout.strip()


# --- Open Job Description -------------------------------------------------------------------------


def openjd_template(batch: Batch, chunk: int, home: Path) -> dict[str, Any]:
    """The batch as a job template of Open Job Description, version 2023-09.

    Its parameters are the file of jobs, the output folder, and the command that starts Python where
    pointmorph is installed. Default paths are relative to `home`, where the template is going to be.
    """
    last = len(batch.jobs) - 1
    pairs = {"name": "Pair", "type": "INT", "range": f"0-{last}"}
    parts = {"name": "Part", "type": "INT", "range": f"0-{part_count(batch, chunk) - 1}"}
    count = part_count(batch, chunk)
    steps = [_step("Maps", [], [pairs], ["--range", "{{Task.Param.Pair}}", "--maps"])]
    if any(job.frames for job in batch.jobs):
        kinds = [("Frames", "--part")]
        if batch.render:
            render_command(batch)
            kinds.append(("Renders", "--render"))
        for name, option in kinds:
            selection = [
                "--range",
                "{{Task.Param.Pair}}",
                option,
                f"{{{{Task.Param.Part}}}}/{count}",
            ]
            steps.append(_step(name, [steps[-1]["name"]], [pairs, parts], selection))
    steps.append(_step("Report", [steps[-1]["name"]], [], ["--report"]))
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "name": f"Pointmorph {batch.path.stem}",
        "parameterDefinitions": [
            _path("Jobs", "FILE", "IN", os.path.relpath(batch.path, home), "What to morph"),
            _path(
                "Out", "DIRECTORY", "OUT", os.path.relpath(batch.out, home), "Where everything goes"
            ),
            {
                "name": "Python",
                "type": "STRING",
                "default": "python3",
                "description": "Starts the Python that pointmorph is installed in",
            },
        ],
        "steps": steps,
    }


def _path(name: str, kind: str, flow: str, default: str, description: str) -> dict[str, Any]:
    return {
        "name": name,
        "type": "PATH",
        "objectType": kind,
        "dataFlow": flow,
        "default": default,
        "description": description,
    }


def _step(
    name: str, after: Sequence[str], parameters: Sequence[dict[str, Any]], selection: Sequence[str]
) -> dict[str, Any]:
    arguments = ["-m", "pointmorph", "batch", "{{Param.Jobs}}", "--out", "{{Param.Out}}"]
    run = {"command": "{{Param.Python}}", "args": [*arguments, *selection]}
    run["cancelation"] = {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": 15}  # type: ignore[assignment]
    step: dict[str, Any] = {"name": name, "script": {"actions": {"onRun": run}}}
    if parameters:
        step["parameterSpace"] = {"taskParameterDefinitions": list(parameters)}
    if after:
        step["dependencies"] = [{"dependsOn": one} for one in after]
    return step


def write_openjd(batch: Batch, chunk: int, path: Path) -> None:
    """Writes the template as JSON. Raises FileError."""
    if path.suffix.lower() != ".json":
        raise FileError(str(path), "a name that ends in .json", path.suffix or "none", "Rename it.")
    text = json.dumps(openjd_template(batch, chunk, path.absolute().parent), indent=1) + "\n"
    files.write_bytes(path, text.encode())
