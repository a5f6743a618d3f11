"""Frames kept on the disk until all are there, for files that are written in one go."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from pointmorph import formats
from pointmorph.errors import FileError
from pointmorph.morphing import Frame, Progress, ResampledFrame
from pointmorph.sequences import MANIFEST, FrameSequence, in_order, is_of, mark
from pointmorph.surfaces import Surface


class FrameStore:
    """The frames of one sequence in a folder, a file each, whole or not at all.

    Frames that an interrupted run left are kept if they are of the very same sequence; others are
    removed.

    Parameters
    ----------
    folder : path
        Made when it isn't there; its parent exists. `remove` takes it away again.
    sequence : FrameSequence
    faces : bool
        Surfaces through the points instead of points.

    Raises
    ------
    FileError
        When the folder can't be made or written.

    Attributes
    ----------
    folder : path
    """

    def __init__(self, folder: Path, sequence: FrameSequence, *, faces: bool = False) -> None:
        self.folder = folder
        self._sequence = sequence
        self._faces = faces
        of = f"{'surfaces' if faces else 'points'} {sequence.fingerprint}"
        try:
            folder.mkdir(exist_ok=True)
            if not is_of(folder, of):
                for stale in self._files():
                    stale.unlink()
                mark(folder, of)
        except OSError as error:
            raise _unusable(folder, error) from error

    def fill(self, progress: Progress | None = None) -> int:
        """Makes the frames that are missing, a few at a time; returns how many there are in all.

        Raises
        ------
        FileError, PointmorphError
        Cancelled
            When `progress` returned False. Frames that are complete stay.
        """
        missing = [k for k, path in enumerate(self._paths()) if not path.exists()]
        if missing:
            self._sequence.prepare(progress)

        def make(n: int, stopped: Callable[[], bool]) -> None:
            k = missing[n]
            frame = self._sequence.frame(k, stopped)
            made = self._sequence.surface(k, frame, stopped) if self._faces else frame
            self._write(self._paths()[k], made)

        for _ in in_order(make, len(missing), progress):
            pass
        return len(self._paths())

    def frames(self) -> Iterator[ResampledFrame | Surface]:
        """All frames in order, each read when it's asked for. Raises FileError."""
        for path in self._paths():
            try:
                with np.load(path) as file:
                    arrays = {name: file[name] for name in file.files}
            except (OSError, ValueError) as error:
                raise _unusable(path, error) from error
            yield Surface(**arrays) if self._faces else ResampledFrame(**arrays)

    def remove(self) -> None:
        """Takes the frames and the folder away, but for what others have put there."""
        with contextlib.suppress(OSError):
            for path in self._files():
                path.unlink()
            (self.folder / MANIFEST).unlink()
            self.folder.rmdir()

    def _paths(self) -> list[Path]:
        return [self.folder / f"frame_{number:04d}.npz" for number in self._sequence.numbers]

    def _files(self) -> list[Path]:
        """With what a process that was killed has left half done."""
        return [*self.folder.glob("frame_*.npz"), *self.folder.glob(".*.part")]

    @staticmethod
    def _write(path: Path, frame: Frame | Surface) -> None:
        arrays = {name: value for name, value in vars(frame).items() if value is not None}
        with formats.whole_file(path) as file:
            np.savez(file, **arrays)


def _unusable(path: Path, error: Exception) -> FileError:
    detail = getattr(error, "strerror", None) or str(error)
    return FileError(
        str(path), "a place where frames can be kept", detail, "Free it, or choose another folder."
    )
