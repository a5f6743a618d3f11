"""Frames kept on disk until all are there, for formats that hold all frames in one file."""

from __future__ import annotations

import contextlib
import json
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from pointmorph.base.errors import FileError
from pointmorph.base.stages import Progress
from pointmorph.morphs.frames import Frame, ResampledFrame
from pointmorph.sequences.frame_sequences import FrameSequence, in_order
from pointmorph.sequences.surfaces import Surface
from pointmorph.storage import files
from pointmorph.storage.file_checks import parsed_json

MANIFEST = "frames.json"
# What NumPy raises when a frame isn't as it was written.
_DAMAGED = (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error)


class FrameStore:
    """The frames of a sequence in a folder, one file each, written whole or not at all.

    Frames that an interrupted run left are kept if they belong to the very same sequence, and
    removed if not.

    Parameters
    ----------
    folder : path
        Created if necessary; its parent must exist. `remove` deletes it.
    sequence : FrameSequence
    faces : bool
        Store surfaces through the points instead of points.

    Raises
    ------
    FileError
        If the folder can't be created or written.

    Attributes
    ----------
    folder : path
    """

    def __init__(self, folder: Path, sequence: FrameSequence, *, faces: bool = False) -> None:
        self.folder = folder = files.reachable(folder)
        self._sequence = sequence
        self._faces = faces
        content = f"{'surfaces' if faces else 'points'} {sequence.fingerprint}"
        try:
            folder.mkdir(exist_ok=True)
            files.remove_leftovers(folder)
            if not _manifest_matches(folder, content):
                for stale in self._files():
                    stale.unlink()
                _write_manifest(folder, content)
        except OSError as error:
            raise _unusable(folder, error) from error

    def fill(self, progress: Progress | None = None) -> int:
        """Makes the missing frames, a few at a time, and returns the number of all frames.

        Raises
        ------
        FileError
            If a frame can't be written.
        Cancelled
            If `progress` returned False. Complete frames stay.
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
        """Yields all frames in order, each read when its turn comes. Raises FileError."""
        for path in self._paths():
            try:
                with np.load(path) as file:
                    arrays = {name: file[name] for name in file.files}
            except _DAMAGED as error:
                raise _unusable(path, error) from error
            yield Surface(**arrays) if self._faces else ResampledFrame(**arrays)

    def counts(self) -> list[int]:
        """How many points, or vertices, each frame has. Raises FileError."""
        found = []
        for path in self._paths():
            try:
                with np.load(path) as file:
                    found.append(len(file["colors" if self._faces else "radii"]))
            except _DAMAGED as error:
                raise _unusable(path, error) from error
        return found

    def remove(self) -> None:
        """Deletes the frames, and the folder unless it holds other files."""
        files.remove_leftovers(self.folder)
        with contextlib.suppress(OSError):
            for path in self._files():
                path.unlink()
            (self.folder / MANIFEST).unlink()
            self.folder.rmdir()

    def _paths(self) -> list[Path]:
        return [self.folder / f"frame_{number:04d}.npz" for number in self._sequence.numbers]

    def _files(self) -> list[Path]:
        return list(self.folder.glob("frame_*.npz"))

    @staticmethod
    def _write(path: Path, frame: Frame | Surface) -> None:
        arrays = {name: value for name, value in vars(frame).items() if value is not None}
        with files.whole_file(path) as file:
            np.savez(file, **arrays)


def _write_manifest(folder: Path, content: str) -> None:
    """Records what the frames in a folder belong to. Raises FileError."""
    files.write_bytes(folder / MANIFEST, json.dumps({"of": content}).encode())


def _manifest_matches(folder: Path, content: str) -> bool:
    """Whether the frames in a folder belong to what `_write_manifest` recorded there."""
    try:
        recorded = parsed_json((folder / MANIFEST).read_text(encoding="utf-8"))
        return bool(recorded["of"] == content)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _unusable(path: Path, error: Exception) -> FileError:
    detail = getattr(error, "strerror", None) or str(error)
    return FileError(
        str(path), "a folder for frames", detail, "Free some space or choose another folder."
    )
