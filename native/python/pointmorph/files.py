"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from pointmorph.errors import FileError


def make_folder(folder: Path) -> None:
    """Makes a folder and its parents unless they exist. Raises FileError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
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
    try:
        file = tempfile.NamedTemporaryFile(  # noqa: SIM115  (renamed before it is closed)
            dir=path.parent, prefix=f".{path.name}.", suffix=".part", delete=False
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
            os.replace(file.name, path)
        except OSError as error:
            raise _unwritable(path, error) from error
    finally:
        if os.path.exists(file.name):
            os.unlink(file.name)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _unwritable(path: Path, error: OSError) -> FileError:
    return FileError(
        str(path),
        "a writable location",
        error.strerror or str(error),
        "Choose another folder or free some space.",
    )
