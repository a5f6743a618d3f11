"""Sequences of frames, and frames as files: one is written while others are computed."""

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
from typing import Any, Protocol, TypedDict, TypeVar, Unpack

import numpy as np
import numpy.typing as npt

from pointmorph import __version__, formats
from pointmorph.base.errors import Cancelled
from pointmorph.base.stages import Progress
from pointmorph.morphs.frames import Frame, ResampledFrame
from pointmorph.morphs.morphing import Morph
from pointmorph.sequences import surfaces
from pointmorph.storage import files
from pointmorph.storage.frame_records import FrameRecords

_AT_ONCE = 2
_POLL = 0.05  # seconds

_T = TypeVar("_T")


def in_order(
    make: Callable[[int, Callable[[], bool]], _T], count: int, progress: Progress | None = None
) -> Iterator[_T]:
    """Yields make(0, stopped), make(1, stopped) … in order, a few of which run at the same time.

    Parameters
    ----------
    make : callable
        Called on other threads. Should end soon once `stopped()` is True: `progress` returned
        False, the caller stopped iterating, or another call of `make` raised.
    count : int
    progress : callable, optional
        As for `pointmorph.morph`; the stage is "frames".

    Raises
    ------
    Cancelled
        If `progress` returned False.
    """
    waiting: deque[Future[_T]] = deque()
    stop = threading.Event()

    def ready(done: int) -> _T:
        while True:
            if progress is not None and progress("frames", done / count) is False:
                raise Cancelled("The frames were canceled.")
            with contextlib.suppress(FutureTimeout):
                return waiting[0].result(_POLL)
            if waiting[0].done():  # it raised a TimeoutError itself
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
    """Which of `count` morphs in a row, each with an equal share of t, is shown at t.

    Parameters
    ----------
    t : float
        0 to 1, over all of them.
    count : int

    Returns
    -------
    number : int
    t : float
        0 to 1, within that morph.
    """
    along = t * count
    number = min(int(along), count - 1)
    return number, along - number


def even_times(count: int) -> list[float]:
    """t of `count` frames from 0 to 1, both ends included."""
    return [number / (count - 1) for number in range(count)]


class Numbering(TypedDict, total=False):
    """The keyword arguments of `FrameSequence`, which explains them."""

    first: int
    step: int
    resample: bool


class FrameSequence:
    """The frames of a morph at given times. Thread-safe; frames can be made in any order.

    Parameters
    ----------
    morph : Morph
    times : sequence of float
        t of each frame, 0 to 1.
    first, step : int
        The number of the first frame, and the step from one frame to the next.
    resample : bool
        Fill cracks with new points; frames then have ids and velocities.

    Attributes
    ----------
    numbers : range
        The numbers of the frames.
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
        # Velocities are per t: this is by how much t grows from frame to frame.
        grows = np.gradient(np.asarray(times, np.float64)) if len(times) > 1 else np.zeros(1)
        self._grows = grows / step

    @cached_property
    def fingerprint(self) -> str:
        """A hash: sequences with the same one have the same bits in every frame."""
        digest = hashlib.sha256()
        for array in self._arrays():
            digest.update(np.ascontiguousarray(array).tobytes())
        options = self.morph._settings()
        numbers = self.numbers
        made = [type(self).__name__, self.times, numbers.start, numbers.step, self._resample]
        digest.update(json.dumps([__version__, *made, options], sort_keys=True).encode())
        return digest.hexdigest()

    def _arrays(self) -> Iterator[npt.NDArray[Any]]:
        """All arrays that the frames depend on."""
        for part in self.morph.parts:
            yield from part._content()

    def prepare(self, progress: Progress | None = None) -> None:
        """Computes what all frames share; otherwise the first call of `frame` does.

        Raises
        ------
        Cancelled
            If `progress` returned False.
        """
        for part in self.morph.parts:
            part._lay_out_paths(progress)
        if self._resample:
            self.morph.inserted(progress)

    def frame(self, k: int, stopped: Callable[[], bool] = lambda: False) -> Frame:
        """Frame k. If it is resampled, its velocities are per frame.

        Parameters
        ----------
        k : int
        stopped : callable, optional
            Asked again and again; the work ends when it returns True.

        Raises
        ------
        Cancelled
            If `stopped` returned True.
        """
        frame = self._at(self.times[k], stopped)
        if isinstance(frame, ResampledFrame):
            by_frame = (frame.velocities * self._grows[k]).astype(frame.positions.dtype)
            frame = replace(frame, velocities=by_frame)
        return frame

    def _at(self, t: float, stopped: Callable[[], bool]) -> Frame:
        if self._resample:
            return self.morph.resampled_frame(t, lambda *_: not stopped())
        return self.morph.frame(t, progress=lambda *_: not stopped())

    @cached_property
    def _surfaces(self) -> surfaces.Surfaces:
        return surfaces.Surfaces(self.morph)

    def surface(
        self, k: int, frame: Frame, stopped: Callable[[], bool] = lambda: False
    ) -> surfaces.Surface:
        """The surface through frame k; see `surfaces.Surfaces.through`.

        Raises
        ------
        OptionError
            If pymeshlab or scipy is missing.
        """
        return self._surfaces.through(frame, self.times[k], stopped)


class MeshWriter(Protocol):
    """Writes a mesh beside each frame of a sequence."""

    suffix: str
    """Of its files."""

    def write(self, path: Path, k: int, frame: Frame, stopped: Callable[[], bool]) -> None:
        """Writes the mesh of frame k, which has these points; on any thread."""


class SurfaceWriter:
    """Writes the surface through the points of each frame, with velocities per frame if the format
    holds them.

    Parameters
    ----------
    sequence : FrameSequence
    kind : str
        "ply" or another of `formats.WRITTEN_MESH_SUFFIXES` without the dot.

    Raises
    ------
    OptionError
        If pymeshlab or scipy is missing.
    """

    def __init__(self, sequence: FrameSequence, kind: str) -> None:
        surfaces.check_available()
        self.suffix = f".{kind}"
        self._sequence = sequence

    def write(self, path: Path, k: int, frame: Frame, stopped: Callable[[], bool]) -> None:
        formats.write_mesh(path, **vars(self._sequence.surface(k, frame, stopped)))


def write_frames(
    morph: Morph,
    folder: Path,
    times: Sequence[float],
    *,
    mesh: str | MeshWriter | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    **numbering: Unpack[Numbering],
) -> list[int]:
    """Writes `frame_0000.ply` … and removes other frames that an earlier run left.

    Parameters
    ----------
    morph : Morph
    folder : path
        Must exist.
    times : sequence of float
        t of each frame, 0 to 1.
    mesh : str or MeshWriter, optional
        "ply" or another of `formats.WRITTEN_MESH_SUFFIXES` without the dot: for each frame, also
        write the surface through its points, `mesh_0000.ply` …, with velocities per frame if the
        format holds them. Or what else writes these files.
    resume : bool
        Keep the frames of the very same morph that are there and whole. The folder `records` says,
        with checksums, which these are.
    progress : callable, optional
        As for `pointmorph.morph`; the stage is "frames".
    **numbering
        `first`, `step` and `resample`, as for `FrameSequence`. Resampled frames have `id` and
        `vx vy vz`, the offset to the next frame at the current speed.

    Returns
    -------
    list of int
        The number of points of each frame.

    Raises
    ------
    FileError
        If a file can't be written.
    OptionError
        If `mesh` is given and pymeshlab or scipy is missing.
    Cancelled
        If `progress` returned False. Complete frames stay.
    """
    sequence = FrameSequence(morph, times, **numbering)
    return write_sequence(sequence, folder, mesh=mesh, resume=resume, progress=progress)


def write_sequence(
    sequence: FrameSequence,
    folder: Path,
    *,
    mesh: str | MeshWriter | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> list[int]:
    """Writes the frames of a sequence, as `write_frames` does."""
    run = FrameRun(sequence, folder, mesh)
    files.remove_leftovers(folder)
    known = resume and all(run.records.mentions(number) for number in sequence.numbers)
    run.remove_others(keep_known=resume)
    if sequence.times and not known:
        sequence.prepare(progress)
    return run.make(range(len(sequence.times)), resume=resume, progress=progress)


class FrameRun:
    """The files of a sequence's frames in a folder: any of them, by any process, in any order.

    Parameters
    ----------
    sequence : FrameSequence
    folder : path
        Must exist.
    mesh : str or MeshWriter, optional
        As for `write_frames`.

    Attributes
    ----------
    records : FrameRecords
        Which frames are done.
    """

    def __init__(
        self, sequence: FrameSequence, folder: Path, mesh: str | MeshWriter | None = None
    ) -> None:
        self._sequence = sequence
        self._folder = files.reachable(folder)
        self._mesh = SurfaceWriter(sequence, mesh) if isinstance(mesh, str) else mesh

    @cached_property
    def records(self) -> FrameRecords:
        return FrameRecords(self._folder, self._sequence.fingerprint)

    def names(self, k: int) -> list[str]:
        """The files of frame k."""
        number = self._sequence.numbers[k]
        names = [f"frame_{number:04d}.ply"]
        return names if self._mesh is None else [*names, f"mesh_{number:04d}{self._mesh.suffix}"]

    def missing(self, which: Sequence[int]) -> list[int]:
        """Those of the frames `which` that aren't there, or aren't as they were written."""
        numbers = self._sequence.numbers
        return [
            k for k in which
            if self.records.whole(numbers[k], self.names(k))[0] != set(self.names(k))
        ]  # fmt: skip

    def remove_others(self, *, keep_known: bool) -> None:
        """Removes frames that aren't of this sequence; with `keep_known` also those that have its
        numbers but aren't on its records."""
        numbers = self._sequence.numbers
        own = {name: numbers[k] for k in range(len(numbers)) for name in self.names(k)}
        for path in [*self._folder.glob("frame_*.ply"), *_meshes(self._folder)]:
            known = path.name in own
            if not known or (keep_known and not self.records.mentions(own[path.name])):
                path.unlink()
        FrameRecords(self._folder, "").forget_others(numbers if keep_known else range(0))

    def make(
        self, which: Sequence[int], *, resume: bool = True, progress: Progress | None = None
    ) -> list[int]:
        """Makes the frames `which`, and returns their numbers of points.

        Parameters
        ----------
        which : sequence of int
            Of the sequence, counted from 0.
        resume : bool
            Keep what is done and whole, and put on record what is made.
        progress : callable, optional
            As for `pointmorph.morph`; the stage is "frames".

        Raises
        ------
        FileError
            If a file can't be written.
        Cancelled
            If `progress` returned False. Complete frames stay.
        """

        def write(n: int, stopped: Callable[[], bool]) -> int:
            return self._write(which[n], resume, stopped)

        return list(in_order(write, len(which), progress))

    def _write(self, k: int, resume: bool, stopped: Callable[[], bool]) -> int:
        number, names = self._sequence.numbers[k], self.names(k)
        done: set[str] = set()
        if resume:
            done, points = self.records.whole(number, names)
            if done == set(names):
                return points
            self.records.forget(number)
        frame = self._sequence.frame(k, stopped)
        if names[0] not in done:
            formats.write_ply(self._folder / names[0], **vars(frame))
        if self._mesh is not None:
            self._mesh.write(self._folder / names[1], k, frame, stopped)
        points = len(frame.radii)
        if resume:
            self.records.write(number, names, self._sequence.times[k], points)
        return points


def _meshes(folder: Path) -> list[Path]:
    """Meshes of this run or an earlier one."""
    return [
        path
        for suffix in formats.WRITTEN_MESH_SUFFIXES
        for path in folder.glob(f"mesh_[0-9]*{suffix}")
    ]
