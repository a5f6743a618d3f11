"""Files that are written whole or not at all, and what Windows asks for besides."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from pointmorph.errors import FileError

# Windows takes longer names only if they begin with \\?\, and folders need room for files.
_LONGEST_NAME = 200
# Seconds between tries to replace a file that something else has open, such as a virus scanner.
_PATIENCE = (0.05, 0.1, 0.2, 0.4, 0.8)


def reachable(path: str | os.PathLike[str]) -> Path:
    """A path as the system opens it, however long it is."""
    if sys.platform != "win32":
        return Path(path)
    whole = os.path.abspath(path)
    if len(whole) <= _LONGEST_NAME or whole.startswith("\\\\?\\"):
        return Path(path)
    if whole.startswith("\\\\"):
        return Path("\\\\?\\UNC" + whole[1:])
    return Path("\\\\?\\" + whole)


def read_ply(path: str | os.PathLike[str]) -> Any:
    """What a PLY file holds, as plyfile's PlyData.

    On Windows it's read at once: a file that is mapped can't be replaced or removed there.
    """
    from plyfile import PlyData

    return PlyData.read(str(reachable(path)), mmap=sys.platform != "win32")


def make_folder(folder: Path) -> None:
    """Makes a folder and its parents unless they exist. Raises FileError."""
    try:
        reachable(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            str(folder),
            "a folder that can be created",
            error.strerror or str(error),
            "Choose another folder.",
        ) from error


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Writes a file whole or not at all. Raises FileError."""
    with whole_file(path) as file:
        file.write(content)


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Opens a file that gets its name only once it is complete and on disk.

    Raises
    ------
    FileError
        If it can't be created, written or renamed.
    """
    path = Path(path)
    destination = reachable(path)
    try:
        file = tempfile.NamedTemporaryFile(  # noqa: SIM115  (renamed before it is closed)
            dir=destination.parent, prefix=f".{path.name}.", suffix=".part", delete=False
        )
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        try:
            with file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.chmod(file.name, 0o666 & ~_umask())
            replace(file.name, destination)
        except OSError as error:
            raise _unwritable(path, error) from error
    finally:
        if os.path.exists(file.name):
            os.unlink(file.name)


def replace(source: str | os.PathLike[str], destination: str | os.PathLike[str]) -> None:
    """Gives a file the name of another one, which it replaces. Raises OSError.

    Windows replaces no file that is open. Virus scanners open new files for a moment, so that it
    tries again for a while.
    """
    for pause in _PATIENCE if sys.platform == "win32" else ():
        try:
            return os.replace(source, destination)
        except PermissionError:
            time.sleep(pause)
    return os.replace(source, destination)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _unwritable(path: Path, error: OSError) -> FileError:
    remedy = "Choose another folder or free some space."
    if sys.platform == "win32" and isinstance(error, PermissionError) and path.exists():
        remedy = "Close it where it is open, or choose another name."
    return FileError(str(path), "a writable location", error.strerror or str(error), remedy)
