"""Frames as files: each whole or not at all, one written while the next is computed."""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pointmorph import __version__, formats
from pointmorph.errors import Cancelled
from pointmorph.morphing import Morph, Progress

MANIFEST = "frames.json"
_AT_ONCE = 2


def write_frames(
    morph: Morph,
    folder: Path,
    times: Sequence[float],
    *,
    first: int = 0,
    step: int = 1,
    resample: bool = True,
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
    Cancelled
        When `progress` returned False. Frames that are complete stay.
    """
    paths = [folder / f"frame_{first + step * k:04d}.ply" for k in range(len(times))]
    known = resume and _is_continued(morph, folder, times, first, step, resample)
    for stale in folder.glob("frame_*.ply"):
        if not known and (resume or stale not in paths):
            stale.unlink()
    if resume and not known:
        content = {"of": _fingerprint(morph, times, first, step, resample)}
        formats.write_bytes(folder / MANIFEST, json.dumps(content).encode())
    if resample:
        morph.inserted(progress)
    # Speed is by t; how much t grows to the next frame, to the one before at the end.
    grows = np.gradient(np.asarray(times, np.float64)) if len(times) > 1 else np.zeros(1)
    grows = grows / step

    def write(k: int) -> int:
        if known and paths[k].exists():
            return _count(paths[k])
        if not resample:
            frame = morph.frame(times[k])
            formats.write_ply(paths[k], frame.positions, frame.normals, frame.colors, frame.radii)
            return len(frame.radii)
        closed = morph.resampled_frame(times[k])
        formats.write_ply(
            paths[k],
            closed.positions,
            closed.normals,
            closed.colors,
            closed.radii,
            closed.ids,
            (closed.velocities * grows[k]).astype(closed.positions.dtype),
        )
        return len(closed.ids)

    counts: list[int] = []
    waiting: deque[Future[int]] = deque()
    with ThreadPoolExecutor(_AT_ONCE, "pointmorph-frames") as pool:
        try:
            for k in range(len(times)):
                if progress is not None and progress("frames", k / len(times)) is False:
                    raise Cancelled("The frames were cancelled.")
                waiting.append(pool.submit(write, k))
                if len(waiting) > _AT_ONCE:
                    counts.append(waiting.popleft().result())
            counts += [each.result() for each in waiting]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return counts


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
