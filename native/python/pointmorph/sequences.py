"""Frames as files: each whole or not at all, one written while others are computed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from pointmorph import __version__, formats, surfaces
from pointmorph.errors import Cancelled
from pointmorph.morphing import Frame, Morph, Progress, ResampledFrame

MANIFEST = "frames.json"
_AT_ONCE = 2
_POLL = 0.05  # seconds

_T = TypeVar("_T")


def in_order(
    make: Callable[[int, Callable[[], bool]], _T], count: int, progress: Progress | None = None
) -> Iterator[_T]:
    """Yields make(0, stopped) … in order, of which a few are made at a time and none far ahead.

    `progress` is told "frames" again and again. When it returns False, the caller stops, or `make`
    raises, `stopped` returns True, and nothing more is begun.

    Raises
    ------
    Cancelled
        When `progress` returned False.
    """
    waiting: deque[Future[_T]] = deque()
    stop = threading.Event()

    def ready(done: int) -> _T:
        while True:
            if progress is not None and progress("frames", done / count) is False:
                raise Cancelled("The frames were cancelled.")
            with contextlib.suppress(FutureTimeout):
                return waiting[0].result(_POLL)
            if waiting[0].done():  # the timeout was its own
                return waiting[0].result()

    with ThreadPoolExecutor(_AT_ONCE, "pointmorph-frames") as pool:
        try:
            for k in range(count):
                waiting.append(pool.submit(make, k, stop.is_set))
                if len(waiting) > _AT_ONCE:
                    yield ready(k - _AT_ONCE)
                    waiting.popleft()
            while waiting:
                yield ready(count - len(waiting))
                waiting.popleft()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def part_at(t: float, count: int) -> tuple[int, float]:
    """Which of `count` morphs one after the other, with equal shares of t, is shown at t from 0 to
    1: its number, and t there."""
    along = t * count
    number = min(int(along), count - 1)
    return number, along - number


class FrameSequence:
    """The frames of a morph at certain times, to be made in any order and from several threads.

    Parameters
    ----------
    morph : Morph
    times : sequence of float
        t of each frame, 0 to 1.
    first, step : int
        The number of the first frame, and how much it grows from one to the next.
    resample : bool
        Frames without cracks, with ids and velocities.

    Attributes
    ----------
    numbers : range
        Of the frames.
    """

    def __init__(
        self,
        morph: Morph,
        times: Sequence[float],
        *,
        first: int = 0,
        step: int = 1,
        resample: bool = True,
    ) -> None:
        self.morph = morph
        self.times = [float(t) for t in times]
        self.numbers = range(first, first + step * len(times), step)
        self._resample = resample
        # Speed is by t; how much t grows to the next frame, to the one before at the end.
        grows = np.gradient(np.asarray(times, np.float64)) if len(times) > 1 else np.zeros(1)
        self._grows = grows / step

    @cached_property
    def fingerprint(self) -> str:
        """Tells sequences apart: equal ones have the same bits in every frame."""
        digest = hashlib.sha256()
        for array in self._arrays():
            digest.update(np.ascontiguousarray(array).tobytes())
        options = self.morph._native.report()["options"]
        options.pop("threads")
        numbers = self.numbers
        made = [type(self).__name__, self.times, numbers.start, numbers.step, self._resample]
        digest.update(json.dumps([__version__, *made, options], sort_keys=True).encode())
        return digest.hexdigest()

    def _arrays(self) -> Iterator[npt.NDArray[Any]]:
        """All that says what the frames are of."""
        for part in self.morph.parts:
            yield np.asarray(part.pairs)
            for t in (0.0, 0.5, 1.0):
                yield from vars(part.frame(t)).values()

    def prepare(self, progress: Progress | None = None) -> None:
        """What all frames need; `frame` does it where it wasn't done before."""
        if self._resample:
            self.morph.inserted(progress)

    def frame(self, k: int, stopped: Callable[[], bool] = lambda: False) -> Frame:
        """Frame k, with velocities by frame where it's re-sampled. Raises Cancelled."""
        frame = self._at(self.times[k], stopped)
        if isinstance(frame, ResampledFrame):
            by_frame = (frame.velocities * self._grows[k]).astype(frame.positions.dtype)
            frame = replace(frame, velocities=by_frame)
        return frame

    def _at(self, t: float, stopped: Callable[[], bool]) -> Frame:
        if self._resample:
            return self.morph.resampled_frame(t, lambda *_: not stopped())
        return self.morph.frame(t)

    @cached_property
    def _surfaces(self) -> surfaces.Surfaces:
        return surfaces.Surfaces(self.morph)

    def surface(
        self, k: int, frame: Frame, stopped: Callable[[], bool] = lambda: False
    ) -> surfaces.Surface:
        """The surface through frame k. Raises OptionError where what makes it is missing."""
        return self._surfaces.through(frame, self.times[k], stopped)


def write_frames(
    morph: Morph,
    folder: Path,
    times: Sequence[float],
    *,
    first: int = 0,
    step: int = 1,
    resample: bool = True,
    mesh: str | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> list[int]:
    """Writes `frame_0000.ply` … and removes frames of an earlier run that aren't among them.

    Parameters
    ----------
    morph : Morph
    folder : path
        Exists.
    times : sequence of float
        t of each frame, 0 to 1.
    first, step : int
        The number of the first frame, and how much it grows from one to the next.
    resample : bool
        Frames without cracks, with `id` and `vx vy vz`: the way to the next frame at the present
        speed.
    mesh : str, optional
        "ply", "obj", "stl" or "glb": for each frame also a `mesh_0000` of that kind, the surface
        through its points (see `surfaces.Surfaces`), with velocities by frame in .ply.
    resume : bool
        Frames that an interrupted run of the very same morph has left are kept. What they are of
        stands in `frames.json`.
    progress : callable, optional
        As for `morph`; the stage is "frames".

    Returns
    -------
    list of int
        How many points each frame has.

    Raises
    ------
    FileError
        When a file can't be written.
    OptionError
        When a mesh is asked for and what makes it is missing.
    Cancelled
        When `progress` returned False. Frames that are complete stay.
    """
    sequence = FrameSequence(morph, times, first=first, step=step, resample=resample)
    return write_sequence(sequence, folder, mesh=mesh, resume=resume, progress=progress)


def write_sequence(
    sequence: FrameSequence,
    folder: Path,
    *,
    mesh: str | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> list[int]:
    """Writes the frames of a sequence; see `write_frames`."""
    if mesh is not None:
        surfaces.check_available()
    paths = [folder / f"frame_{number:04d}.ply" for number in sequence.numbers]
    meshes = [folder / f"mesh_{number:04d}.{mesh}" for number in sequence.numbers]
    known = resume and is_of(folder, sequence.fingerprint)
    wanted = {*paths, *(meshes if mesh is not None else ())}
    for stale in [*folder.glob("frame_*.ply"), *_meshes(folder)]:
        if stale not in wanted or (resume and not known):
            stale.unlink()
    if resume and not known:
        mark(folder, sequence.fingerprint)
    sequence.prepare(progress)

    def write(k: int, stopped: Callable[[], bool]) -> int:
        has_frame = known and paths[k].exists()
        if has_frame and (mesh is None or meshes[k].exists()):
            return _count(paths[k])
        frame = sequence.frame(k, stopped)
        if not has_frame:
            formats.write_ply(paths[k], **vars(frame))
        if mesh is not None:
            formats.write_mesh(meshes[k], **vars(sequence.surface(k, frame, stopped)))
        return len(frame.radii)

    return list(in_order(write, len(paths), progress))


def _meshes(folder: Path) -> list[Path]:
    """Those of this or an earlier run."""
    return [
        path
        for suffix in formats.WRITTEN_MESH_SUFFIXES
        for path in folder.glob(f"mesh_[0-9]*{suffix}")
    ]


def mark(folder: Path, of: str) -> None:
    """Writes down which frames are in a folder. Raises FileError."""
    formats.write_bytes(folder / MANIFEST, json.dumps({"of": of}).encode())


def is_of(folder: Path, of: str) -> bool:
    """Whether that is what `mark` wrote down there."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        return bool(content["of"] == of)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _count(path: Path) -> int:
    """Points of a frame, from its header."""
    with path.open("rb") as file:
        for line in file:
            if line.startswith(b"element vertex"):
                return int(line.split()[-1])
    return 0
