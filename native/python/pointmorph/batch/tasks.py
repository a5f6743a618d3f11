"""The steps of a pair: its map, then its frames. Also as tasks, for engines that run many on many
machines: each is a call of ``pointmorph batch`` for some pairs or a part of one, and can be ended
at any time and run again.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from pointmorph.base.errors import FileError, OptionError, PointmorphError
from pointmorph.batch.jobs import FRAMES, RECORD, RENDERED, RENDERS, REPORT, Batch, PairJob
from pointmorph.morphs.stored_morphs import open_morph
from pointmorph.sequences.frame_sequences import even_times
from pointmorph.sequences.stored_frames import missing_frames
from pointmorph.storage import files
from pointmorph.storage.frame_records import file_checksum

MAP_STEP, FRAMES_STEP, RENDERS_STEP = "map", "frames", "renders"
RENDERS_IN_TASK = 24
"""pictures, each of which takes a second at the least"""

_TASK_SECONDS = 60.0
"""What a task is to take: two hundred times as long as its start; and a scheduler takes a second or
more from the end of one to the start of the next. Of a task that is killed, only the pair or the
frame in hand is lost."""
_BYTES_PER_POINT = 40.0
_LEAST_SECONDS, _PLAIN, _RESAMPLED = 1e-3, 4e-7, 1.5e-6
"""What a frame takes on one core, roughly: at the least, and for each point."""
_LEAST_MAP_SECONDS, _MAP = 2.0, 3e-4
"""What a map takes on one core, in the same way."""
_OPENING_SECONDS = 0.1
"""What a task takes for each pair besides its frames."""

Command = Callable[[Sequence[str]], int]
"""Runs a command line in this process, and returns its exit status."""


@dataclass(frozen=True)
class Part:
    """Part number `number` of `count` equal ones, counted from 0."""

    number: int
    count: int

    def of(self, total: int) -> slice:
        """Which of so many it has.

        >>> [Part(k, 3).of(7) for k in range(3)]
        [slice(0, 2, None), slice(2, 4, None), slice(4, 7, None)]
        """
        return slice(total * self.number // self.count, total * (self.number + 1) // self.count)

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


@dataclass(frozen=True)
class FarmStep:
    """Tasks of one kind. Each has one of `groups` equal parts of the pairs, and of the frames of
    each of these one of `parts` equal parts."""

    name: str
    option: str
    """of `pointmorph batch`"""
    groups: int
    parts: int | None = None
    """None where it isn't about frames"""

    def words(self, group: object, part: object) -> list[str]:
        """How `pointmorph batch` is asked for a task, by its numbers."""
        which = [] if self.parts is None else [f"{part}/{self.parts}"]
        return ["--range", f"{group}/{self.groups}", self.option, *which]


def steps_to_do(job: PairJob, *, with_frames: bool = True) -> list[str]:
    """Which steps of a pair aren't done yet, by records and checksums. Raises FileError."""
    with_frames = with_frames and job.frames > 0
    if not has_map(job):
        return [MAP_STEP, FRAMES_STEP] if with_frames else [MAP_STEP]
    return [FRAMES_STEP] if with_frames and not _has_frames(job) else []


def has_map(job: PairJob) -> bool:
    """Whether a pair's map has been found by an earlier run, and is whole. Raises FileError."""
    identity = job.identity()
    try:
        record = json.loads((job.folder / RECORD).read_text(encoding="utf-8"))
        return bool(
            record["of"] == identity
            and record["morph"] == file_checksum(job.morph_file)
            and (job.folder / REPORT).is_file()
        )
    except (OSError, ValueError, KeyError, TypeError, FileError):
        return False


def _has_frames(job: PairJob, which: slice = slice(None)) -> bool:
    """Whether these frames of a pair are there, and of this very map."""
    try:
        morph, times = open_morph(job.morph_file), even_times(job.frames)
        numbers = range(job.frames)[which]
        return not missing_frames(
            morph, job.folder / FRAMES, times, job.resample, job.mesh, numbers
        )
    except PointmorphError:  # the step itself says what is wrong
        return False


def put_on_record(job: PairJob, identity: str) -> None:
    """Records that the map of a pair is found. Raises FileError."""
    record = {"of": identity, "morph": file_checksum(job.morph_file)}
    files.write_bytes(job.folder / RECORD, (json.dumps(record) + "\n").encode())


def find_map(job: PairJob, command: Command) -> int:
    """Finds the map of a pair in this process unless it is there; the exit status.

    Raises
    ------
    FileError
        If one of its files can't be read, or the folder not be written.
    """
    files.make_folder(job.folder)
    if has_map(job):
        print(f"{job.name}: the map is already there")
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


def _require_map(job: PairJob) -> None:
    if not job.morph_file.is_file():
        raise FileError(
            str(job.morph_file), "the map of the pair", "no file", "Compute it first: batch --maps."
        )


def render(batch: Batch, job: PairJob, part: Part) -> int:
    """Has the file's own command render a part of a pair's frames.

    Returns
    -------
    int
        The exit status: 0, 1 if the command failed, and where a signal has ended it, 128 and the
        signal's number, as a shell says, so that an engine sees that it was killed.

    Raises
    ------
    OptionError, FileError
        If the file has no command to render, the pair's frames aren't there, or the command isn't
        found.
    """
    if not batch.render:
        raise OptionError(
            "render",
            f'a "render" command in {batch.path}',
            "none",
            'Add "render" to the file; docs/farm.md has an example.',
        )
    which = part.of(job.frames)
    if which.start == which.stop:
        return 0
    _require_map(job)
    if not _has_frames(job, which):
        raise FileError(
            str(job.folder / FRAMES), f"intact frames {which.start} to {which.stop - 1}",
            "missing or broken ones", "Make them first: batch --part.",
        )  # fmt: skip
    places = {
        "python": sys.executable,
        "home": str(batch.path.absolute().parent),
        "pair": job.name,
        "morph": str(job.morph_file),
        "frames": str(job.folder / FRAMES),
        "out": str(job.folder / RENDERS),
        "first": str(which.start),
        "last": str(which.stop - 1),
        "every": str(batch.render_every),
    }
    words = [_filled(word, places) for word in batch.render]
    status = _ended(batch, words) if batch.renders(range(which.start, which.stop)) else 0
    if status == 0:
        record = {"of": file_checksum(job.morph_file), "frames": [which.start, which.stop]}
        files.make_folder(job.folder / RENDERED)
        path = job.folder / RENDERED / f"{which.start}_{which.stop}.json"
        files.write_bytes(path, (json.dumps(record) + "\n").encode())
        return 0
    ended = f"signal {-status}" if status < 0 else f"status {status}"
    sys.stderr.write(f"pointmorph: {job.name}: the render command ended with {ended}\n")
    return 128 - status if status < 0 else 1


def _ended(batch: Batch, words: Sequence[str]) -> int:
    """The exit status of the command that renders; negative where a signal has ended it."""
    try:
        return subprocess.run(words, stdin=subprocess.DEVNULL, check=False).returncode
    except OSError as error:
        raise FileError(
            words[0], "a program that can be run", error.strerror or str(error),
            f"Correct render in {batch.path}.",
        ) from error  # fmt: skip


def has_renders(job: PairJob) -> bool:
    """Whether the command that renders has ended well for all frames of this very map."""
    rendered: set[int] = set()
    try:
        morph = file_checksum(job.morph_file)
        for path in sorted((job.folder / RENDERED).glob("*.json")):
            record = json.loads(path.read_text(encoding="utf-8"))
            if record["of"] == morph:
                rendered.update(range(*record["frames"]))
    except (OSError, ValueError, KeyError, TypeError, FileError):
        return False
    return rendered >= set(range(job.frames))


def _filled(word: str, places: Mapping[str, str]) -> str:
    for name, value in places.items():
        word = word.replace(f"{{{name}}}", value)
    return word


def farm_steps(batch: Batch, chunk: int | None) -> list[FarmStep]:
    """The tasks of a whole batch, step after step.

    Parameters
    ----------
    batch : Batch
    chunk : int, optional
        Frames in a task at the most. Otherwise it has so many pairs or frames that it takes long,
        next to the start of a process.
    """
    steps = [FarmStep("Maps", "--maps", _groups(batch, maps_in_task(batch)))]
    most = max(job.frames for job in batch.jobs)
    if most == 0:
        return steps
    kinds = [("Frames", "--part", frames_in_task(batch))]
    if batch.render:
        kinds.append(("Renders", "--render", RENDERS_IN_TASK * batch.render_every))
    for name, option, frames in kinds:
        in_task = chunk or frames
        pairs = min(in_task // most, math.floor(_TASK_SECONDS / _OPENING_SECONDS))
        steps.append(FarmStep(name, option, _groups(batch, pairs), -(-most // in_task)))
    return steps


def _groups(batch: Batch, pairs: int) -> int:
    """Into how many groups the pairs are split for so many of them in one at the most."""
    return -(-len(batch.jobs) // max(1, pairs))


def report_words(batch: Batch) -> list[str]:
    """How `pointmorph batch` is asked what a farm has done."""
    return ["--report", "--renders"] if batch.render else ["--report"]


def frames_in_task(batch: Batch) -> int:
    """So many frames that a task of them takes long, next to the start of a process: it is chosen
    by the size of the models' files, since nothing has been read yet."""
    rates = [_RESAMPLED if job.resample else _PLAIN for job in batch.jobs]
    return _in_task(batch, _LEAST_SECONDS, rates)


def maps_in_task(batch: Batch) -> int:
    """The same of maps."""
    return _in_task(batch, _LEAST_MAP_SECONDS, [_MAP] * len(batch.jobs))


def _in_task(batch: Batch, least: float, rates: Sequence[float]) -> int:
    """How many a task has, if one takes that many seconds at the least and for each point."""
    points = [job.samples or max(1.0, job.bytes() / _BYTES_PER_POINT) for job in batch.jobs]
    longest = max(count * rate for count, rate in zip(points, rates, strict=True))
    return max(1, math.ceil(_TASK_SECONDS / (least + longest)))


def command_line(batch: Batch, *selection: str) -> list[str]:
    """A call for some of the batch, with absolute paths."""
    path = batch.path.absolute()
    return [sys.executable, "-m", "pointmorph", "batch", str(path), "--out", str(batch.out),
            *selection]  # fmt: skip
