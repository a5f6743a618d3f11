"""A batch as a job template of Open Job Description, which render farms take as it is."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pointmorph.base.errors import FileError
from pointmorph.batch.jobs import Batch
from pointmorph.batch.tasks import farm_steps, report_words
from pointmorph.storage import files


def openjd_template(batch: Batch, chunk: int | None, home: Path) -> dict[str, Any]:
    """The batch as a job template of Open Job Description, version 2023-09.

    Its parameters are the file of jobs, the output folder, and the command that starts Python where
    pointmorph is installed. Default paths are relative to `home`, where the template will be.

    Raises
    ------
    FileError
        If these aren't in that folder: runners refuse paths that lead out of it.
    """
    group, part = "{{Task.Param.Pairs}}", "{{Task.Param.Part}}"
    steps: list[dict[str, Any]] = []
    for kind in farm_steps(batch, chunk):
        parameters = [_numbers("Pairs", kind.groups)]
        parameters += [] if kind.parts is None else [_numbers("Part", kind.parts)]
        steps.append(_step(kind.name, steps[-1:], parameters, kind.words(group, part)))
    steps.append(_step("Report", steps[-1:], [], report_words(batch)))
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "name": f"Pointmorph {batch.path.stem}",
        "parameterDefinitions": [
            _path("Jobs", "FILE", "IN", _within(home, batch.path), "What to morph"),
            _path("Out", "DIRECTORY", "OUT", _within(home, batch.out), "Where everything goes"),
            {
                "name": "Python",
                "type": "STRING",
                "default": "python3",
                "description": "Starts the Python that pointmorph is installed in",
            },
        ],
        "steps": steps,
    }


def _within(home: Path, path: Path) -> str:
    """A path relative to the folder that it is in. Raises FileError."""
    whole = Path(os.path.abspath(path))
    if not whole.is_relative_to(home):
        raise FileError(
            str(path), f"a path in {home}, where the template goes", "another folder",
            "Put the template in a folder that contains the file of jobs and the output folder.",
        )  # fmt: skip
    return str(whole.relative_to(home))


def _numbers(name: str, count: int) -> dict[str, Any]:
    """A parameter of tasks: 0 to count - 1."""
    return {"name": name, "type": "INT", "range": f"0-{count - 1}"}


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
    name: str,
    after: Sequence[dict[str, Any]],
    parameters: Sequence[dict[str, Any]],
    selection: Sequence[str],
) -> dict[str, Any]:
    arguments = ["-m", "pointmorph", "batch", "{{Param.Jobs}}", "--out", "{{Param.Out}}"]
    run = {
        "command": "{{Param.Python}}",
        "args": [*arguments, *selection],
        "cancelation": {"mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": 15},
    }
    step: dict[str, Any] = {"name": name, "script": {"actions": {"onRun": run}}}
    if parameters:
        step["parameterSpace"] = {"taskParameterDefinitions": list(parameters)}
    if after:
        step["dependencies"] = [{"dependsOn": one["name"]} for one in after]
    return step


def write_openjd(batch: Batch, chunk: int | None, path: Path) -> None:
    """Writes the template as JSON; `chunk` is how many frames a task has at the most, if it is to
    be another number than the usual ones. Raises FileError."""
    if path.suffix.lower() != ".json":
        raise FileError(str(path), "a name that ends in .json", path.suffix or "none", "Rename it.")
    template = openjd_template(batch, chunk, Path(os.path.abspath(path)).parent)
    files.write_bytes(path, (json.dumps(template, indent=1) + "\n").encode())
