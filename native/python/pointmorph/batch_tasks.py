"""The parts of a batch as jobs of their own, for engines that run many on many machines.

Each is a call of ``pointmorph batch`` for one pair: its map, a part of its frames, or a part of its
renders. Any can be ended at any time and run again.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointmorph.batch_jobs import FRAMES, Batch, PairJob
from pointmorph.batch_runs import put_on_record
from pointmorph.errors import FileError, OptionError

RENDERS = "renders"
Command = Callable[[Sequence[str]], int]


@dataclass(frozen=True)
class Part:
    """Part number `number` of `count` equal ones, counted from 0."""

    number: int
    count: int

    def of(self, total: int) -> slice:
        """Which of so many it has."""
        return slice(total * self.number // self.count, total * (self.number + 1) // self.count)


def find_map(job: PairJob, command: Command) -> int:
    """Finds the map of a pair in this process unless it is there; the exit status.

    Parameters
    ----------
    job : PairJob
    command : callable
        Runs a command line.
    """
    if job.is_matched():
        print(f"{job.name}: the map was there")
        return 0
    identity = job.identity()
    status = command(job.morph_words())
    if status == 0:
        put_on_record(job, identity)
    return status


def make_frames(job: PairJob, part: Part, command: Command) -> int:
    """Makes a part of a pair's frames in this process; the exit status. Raises FileError."""
    which = part.of(job.frames)
    if which.start == which.stop:
        return 0
    _require_map(job)
    return command(job.frames_words(which))


def render(batch: Batch, job: PairJob, part: Part) -> int:
    """Has the file's own command render a part of a pair's frames; its exit status.

    Raises
    ------
    OptionError, FileError
        If the file has no command to render, the pair no frames, or the command isn't found.
    """
    command = render_command(batch)
    which = part.of(job.frames)
    if which.start == which.stop:
        return 0
    _require_map(job)
    places = {
        "python": sys.executable,
        "home": str(batch.path.absolute().parent),
        "pair": job.name,
        "morph": str(job.morph_file),
        "frames": str(job.folder / FRAMES),
        "out": str(job.folder / RENDERS),
        "first": str(which.start),
        "last": str(which.stop - 1),
    }
    words = [_filled(word, places) for word in command]
    try:
        return subprocess.run(words, stdin=subprocess.DEVNULL, check=False).returncode
    except OSError as error:
        raise FileError(
            words[0], "a program that can be run", error.strerror or str(error),
            f"Correct render in {batch.path}.",
        ) from error  # fmt: skip


def render_command(batch: Batch) -> list[str]:
    """The words of the file's command to render. Raises OptionError."""
    given: Any = (batch.render or {}).get("command")
    if not isinstance(given, list) or not given or not all(isinstance(w, str) for w in given):
        raise OptionError(
            "render",
            f'"render": {{"command": ["blender", …]}} in {batch.path}',
            "none",
            "Add it; docs/farm.md has an example.",
        )
    return list(given)


def _require_map(job: PairJob) -> None:
    if not job.morph_file.is_file():
        raise FileError(
            str(job.morph_file), "the map of the pair", "no file",
            "Find it first: batch --maps.",
        )  # fmt: skip


def _filled(word: str, places: Mapping[str, str]) -> str:
    for name, value in places.items():
        word = word.replace(f"{{{name}}}", value)
    return word


def part_count(batch: Batch, chunk: int) -> int:
    """Into how many parts each pair's frames are split for so many frames in one at the most."""
    most = max(job.frames for job in batch.jobs)
    return max(1, -(-most // chunk))


def command_line(batch: Batch, *selection: str) -> list[str]:
    """A call for some of the batch, with absolute paths."""
    path = Path(batch.path).absolute()
    return [sys.executable, "-m", "pointmorph", "batch", str(path), "--out", str(batch.out),
            *selection]  # fmt: skip
