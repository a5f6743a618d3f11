"""Sequences of frames, and frames as files: one is written while others are computed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypedDict, TypeVar, Unpack

import numpy as np
import numpy.typing as npt

from pointmorph import __version__, files, formats, surfaces
from pointmorph.errors import Cancelled, FileError
from pointmorph.file_checks import parsed_json
from pointmorph.morphing import Frame, Morph, Progress, ResampledFrame

MANIFEST = "frames.json"
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
                raise Cancelled("Frames cancelled.")
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
        options = self.morph._native.report()["options"]
        options.pop("threads")
        numbers = self.numbers
        made = [type(self).__name__, self.times, numbers.start, numbers.step, self._resample]
        digest.update(json.dumps([__version__, *made, options], sort_keys=True).encode())
        return digest.hexdigest()

    def _arrays(self) -> Iterator[npt.NDArray[Any]]:
        """All arrays that the frames depend on."""
        for part in self.morph.parts:
            yield np.asarray(part.pairs)
            yield from (part.source_to_target, part.target_to_source)
            if part.source.delay is not None:
                yield part.source.delay
            for t in (0.0, 1.0):
                yield from vars(part.frame(t)).values()

    def prepare(self, progress: Progress | None = None) -> None:
        """Computes what all frames share; otherwise the first call of `frame` does.

        Raises
        ------
        Cancelled
            If `progress` returned False.
        """
        for part in self.morph.parts:
            part._native.lay_out_paths(progress)
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


def write_frames(
    morph: Morph,
    folder: Path,
    times: Sequence[float],
    *,
    mesh: str | None = None,
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
    mesh : str, optional
        "ply" or another of `formats.WRITTEN_MESH_SUFFIXES` without the dot: for each frame, also
        write the surface through its points, `mesh_0000.ply` …, with velocities per frame if the
        format holds them.
    resume : bool
        Keep the frames that an interrupted run of the very same morph left. `frames.json` says
        what a folder's frames belong to.
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
    mesh: str | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> list[int]:
    """Writes the frames of a sequence, as `write_frames` does."""
    if mesh is not None:
        surfaces.check_available()
    paths = [folder / f"frame_{number:04d}.ply" for number in sequence.numbers]
    meshes = [folder / f"mesh_{number:04d}.{mesh}" for number in sequence.numbers]
    files.remove_leftovers(folder)
    known = resume and manifest_matches(folder, sequence.fingerprint)
    wanted = {*paths, *(meshes if mesh is not None else ())}
    for stale in [*folder.glob("frame_*.ply"), *_meshes(folder)]:
        if stale not in wanted or (resume and not known):
            stale.unlink()
    if resume and not known:
        write_manifest(folder, sequence.fingerprint)
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
    """Meshes of this run or an earlier one."""
    return [
        path
        for suffix in formats.WRITTEN_MESH_SUFFIXES
        for path in folder.glob(f"mesh_[0-9]*{suffix}")
    ]


def write_manifest(folder: Path, content: str) -> None:
    """Records what the frames in a folder belong to. Raises FileError."""
    files.write_bytes(folder / MANIFEST, json.dumps({"of": content}).encode())


def manifest_matches(folder: Path, content: str) -> bool:
    """Whether the frames in a folder belong to what `write_manifest` recorded there."""
    try:
        recorded = parsed_json((folder / MANIFEST).read_text(encoding="utf-8"))
        return bool(recorded["of"] == content)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _count(path: Path) -> int:
    """The number of points of a frame, from its header. Raises FileError."""
    with path.open("rb") as file:
        found = re.search(rb"^element vertex (\d{1,10})\s*$", file.read(4096), re.MULTILINE)
    if found is None:
        raise FileError(
            str(path), "a frame that an earlier run wrote", "another file", "Remove it, or choose "
            "another folder.",
        )  # fmt: skip
    return int(found[1])
