"""A batch as a job template of Open Job Description, which render farms take as it is."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pointmorph.base.errors import FileError
from pointmorph.batch.jobs import Batch
from pointmorph.batch.tasks import part_count
from pointmorph.storage import files


def openjd_template(batch: Batch, chunk: int, home: Path) -> dict[str, Any]:
    """The batch as a job template of Open Job Description, version 2023-09.

    Its parameters are the file of jobs, the output folder, and the command that starts Python where
    pointmorph is installed. Default paths are relative to `home`, where the template will be.
    """
    count = part_count(batch, chunk)
    pairs, parts = _numbers("Pair", len(batch.jobs)), _numbers("Part", count)
    pair = ["--range", "{{Task.Param.Pair}}"]
    part = f"{{{{Task.Param.Part}}}}/{count}"
    steps = [_step("Maps", [], [pairs], [*pair, "--maps"])]
    if any(job.frames for job in batch.jobs):
        steps.append(_step("Frames", ["Maps"], [pairs, parts], [*pair, "--part", part]))
        if batch.render:
            steps.append(_step("Renders", ["Frames"], [pairs, parts], [*pair, "--render", part]))
    steps.append(_step("Report", [steps[-1]["name"]], [], ["--report"]))
    out = os.path.relpath(batch.out, home)
    return {
        "specificationVersion": "jobtemplate-2023-09",
        "name": f"Pointmorph {batch.path.stem}",
        "parameterDefinitions": [
            _path("Jobs", "FILE", "IN", os.path.relpath(batch.path, home), "What to morph"),
            _path("Out", "DIRECTORY", "OUT", out, "Where everything goes"),
            {
                "name": "Python",
                "type": "STRING",
                "default": "python3",
                "description": "Starts the Python that pointmorph is installed in",
            },
        ],
        "steps": steps,
    }


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
    name: str, after: Sequence[str], parameters: Sequence[dict[str, Any]], selection: Sequence[str]
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
        step["dependencies"] = [{"dependsOn": one} for one in after]
    return step


def write_openjd(batch: Batch, chunk: int, path: Path) -> None:
    """Writes the template as JSON. Raises FileError."""
    if path.suffix.lower() != ".json":
        raise FileError(str(path), "a name that ends in .json", path.suffix or "none", "Rename it.")
    text = json.dumps(openjd_template(batch, chunk, path.absolute().parent), indent=1) + "\n"
    files.write_bytes(path, text.encode())
