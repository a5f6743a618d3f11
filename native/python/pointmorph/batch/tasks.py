"""The steps of a pair: its map, then its frames. Also as jobs of their own, for engines that run
many on many machines: each is a call of ``pointmorph batch`` for one pair, and can be ended at any
time and run again.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from pointmorph.base.errors import FileError, OptionError, PointmorphError
from pointmorph.batch.jobs import FRAMES, RECORD, RENDERS, REPORT, Batch, PairJob
from pointmorph.morphs.stored_morphs import open_morph
from pointmorph.sequences.frame_sequences import even_times
from pointmorph.sequences.stored_frames import missing_frames
from pointmorph.storage import files
from pointmorph.storage.frame_records import file_checksum

MAP_STEP, FRAMES_STEP = "map", "frames"

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


def _has_frames(job: PairJob) -> bool:
    try:
        times = even_times(job.frames)
        return not missing_frames(
            open_morph(job.morph_file), job.folder / FRAMES, times, job.resample, job.mesh
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


def _require_map(job: PairJob) -> None:
    if not job.morph_file.is_file():
        raise FileError(
            str(job.morph_file), "the map of the pair", "no file", "Find it first: batch --maps."
        )


def render(batch: Batch, job: PairJob, part: Part) -> int:
    """Has the file's own command render a part of a pair's frames; its exit status.

    Raises
    ------
    OptionError, FileError
        If the file has no command to render, the pair no frames, or the command isn't found.
    """
    if not batch.render:
        raise OptionError(
            "render",
            f"a command that renders, in {batch.path}",
            "none",
            'Add "render" to the file; docs/farm.md has an example.',
        )
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
    words = [_filled(word, places) for word in batch.render]
    try:
        return subprocess.run(words, stdin=subprocess.DEVNULL, check=False).returncode
    except OSError as error:
        raise FileError(
            words[0], "a program that can be run", error.strerror or str(error),
            f"Correct render in {batch.path}.",
        ) from error  # fmt: skip


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
    path = batch.path.absolute()
    return [sys.executable, "-m", "pointmorph", "batch", str(path), "--out", str(batch.out),
            *selection]  # fmt: skip
