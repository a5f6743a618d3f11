"""Which frames of a folder are done: a small file beside each says so, with checksums.

Frames are independent of one another, so that any process on any machine can make any of them; what
is done and whole is never made again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointmorph.base.errors import FileError
from pointmorph.storage import files
from pointmorph.storage.file_checks import parsed_json

FOLDER = "records"


def file_checksum(path: Path) -> str:
    """SHA-256 of a file. Raises FileError."""
    try:
        with files.reachable(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FileError(
            str(path), "a readable file", error.strerror or str(error), "Check the path."
        ) from error


@dataclass(frozen=True)
class FrameRecords:
    """The records of a folder's frames.

    Attributes
    ----------
    folder : path
        Where the frames are.
    of : str
        What they belong to: frames of anything else count as not done.
    """

    folder: Path
    of: str

    def whole(self, number: int, names: Sequence[str]) -> tuple[set[str], int]:
        """Which files of a frame are there as they were written, and its number of points.

        Parameters
        ----------
        number : int
            Of the frame.
        names : sequence of str
            Its files.
        """
        record = self._read(number)
        if record is None:
            return set(), 0
        return {name for name in names if self._is_whole(record, name)}, record["points"]

    def mentions(self, number: int) -> bool:
        """Whether a frame is on the records; its files aren't looked at."""
        return self._read(number) is not None

    def write(self, number: int, names: Sequence[str], t: float, points: int) -> None:
        """Records that a frame is done. Raises FileError."""
        files.make_folder(self.folder / FOLDER)
        sums = {name: file_checksum(self.folder / name) for name in names}
        content = {"of": self.of, "t": t, "points": points, "files": sums}
        files.write_bytes(self._path(number), (json.dumps(content, indent=1) + "\n").encode())

    def forget(self, number: int) -> None:
        """Takes a frame off the records."""
        self._path(number).unlink(missing_ok=True)

    def forget_others(self, numbers: range) -> None:
        """Takes frames with other numbers off the records."""
        folder = files.reachable(self.folder / FOLDER)
        for path in folder.glob("frame_*.json"):
            number = path.stem.removeprefix("frame_")
            if not number.isdigit() or int(number) not in numbers:
                path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            folder.rmdir()

    def _path(self, number: int) -> Path:
        return files.reachable(self.folder / FOLDER / f"frame_{number:04d}.json")

    def _is_whole(self, record: dict[str, Any], name: str) -> bool:
        with contextlib.suppress(FileError):
            return bool(file_checksum(self.folder / name) == record["files"].get(name))
        return False

    def _read(self, number: int) -> dict[str, Any] | None:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            record = parsed_json(self._path(number).read_text(encoding="utf-8"))
            if record["of"] == self.of and isinstance(record["files"], dict):
                return {"files": record["files"], "points": int(record["points"])}
        return None
