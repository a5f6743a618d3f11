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
from pathlib import Path
from typing import TypeVar

import numpy as np

from pointmorph import __version__, formats, surfaces
from pointmorph.errors import Cancelled
from pointmorph.morphing import Morph, Progress, ResampledFrame

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
    through = None if mesh is None else surfaces.Surfaces(morph).through
    numbers = [first + step * k for k in range(len(times))]
    paths = [folder / f"frame_{number:04d}.ply" for number in numbers]
    meshes = [folder / f"mesh_{number:04d}.{mesh}" for number in numbers]
    known = resume and _is_continued(morph, folder, times, first, step, resample)
    wanted = {*paths, *(meshes if mesh is not None else ())}
    for stale in [*folder.glob("frame_*.ply"), *_meshes(folder)]:
        if stale not in wanted or (resume and not known):
            stale.unlink()
    if resume and not known:
        content = {"of": _fingerprint(morph, times, first, step, resample)}
        formats.write_bytes(folder / MANIFEST, json.dumps(content).encode())
    if resample:
        morph.inserted(progress)
    # Speed is by t; how much t grows to the next frame, to the one before at the end.
    grows = np.gradient(np.asarray(times, np.float64)) if len(times) > 1 else np.zeros(1)
    grows = grows / step

    def write(k: int, stopped: Callable[[], bool]) -> int:
        has_frame = known and paths[k].exists()
        if has_frame and (mesh is None or meshes[k].exists()):
            return _count(paths[k])
        frame = (
            morph.resampled_frame(times[k], lambda *_: not stopped())
            if resample
            else morph.frame(times[k])
        )
        if isinstance(frame, ResampledFrame):
            by_frame = (frame.velocities * grows[k]).astype(frame.positions.dtype)
            frame = replace(frame, velocities=by_frame)
        if not has_frame:
            formats.write_ply(paths[k], **vars(frame))
        if through is not None:
            formats.write_mesh(meshes[k], **vars(through(frame, times[k], stopped)))
        return len(frame.radii)

    return list(in_order(write, len(times), progress))


def _meshes(folder: Path) -> list[Path]:
    """Those of this or an earlier run."""
    return [
        path
        for suffix in formats.WRITTEN_MESH_SUFFIXES
        for path in folder.glob(f"mesh_[0-9]*{suffix}")
    ]


def _fingerprint(
    morph: Morph, times: Sequence[float], first: int, step: int, resample: bool
) -> str:
    """Tells morphs and their settings apart."""
    ends = [morph.frame(t) for t in (0.0, 0.5, 1.0)]
    digest = hashlib.sha256()
    for array in (
        np.asarray(morph.pairs),
        *(getattr(end, name) for end in ends for name in ("positions", "normals", "colors")),
        *(end.radii for end in ends),
    ):
        digest.update(np.ascontiguousarray(array).tobytes())
    options = morph._native.report()["options"]
    options.pop("threads")
    settings = [__version__, list(map(float, times)), first, step, resample, options]
    digest.update(json.dumps(settings, sort_keys=True).encode())
    return digest.hexdigest()


def _is_continued(
    morph: Morph, folder: Path, times: Sequence[float], first: int, step: int, resample: bool
) -> bool:
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        return bool(content["of"] == _fingerprint(morph, times, first, step, resample))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _count(path: Path) -> int:
    """Points of a frame, from its header."""
    with path.open("rb") as file:
        for line in file:
            if line.startswith(b"element vertex"):
                return int(line.split()[-1])
    return 0
