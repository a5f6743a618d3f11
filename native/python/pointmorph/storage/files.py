"""Files that are written whole or not at all, and what Windows asks for besides."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from pointmorph.base.errors import FileError

if sys.platform != "win32":
    import fcntl

_PART = ".pointmorph-part"

# Windows takes longer names only if they begin with \\?\, and folders need room for files.
_LONGEST_NAME = 200
# Seconds between tries to replace a file that something else has open, such as a virus scanner.
_PATIENCE = (0.05, 0.1, 0.2, 0.4, 0.8)
# Seconds that a file there may be closed before it gets its name.
_SETTLING = 10.0


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

    Raises
    ------
    FileError
        If it can't be read. plyfile is stricter than `ply`, which reads shapes.
    """
    from plyfile import PlyData, PlyParseError

    try:
        return PlyData.read(str(reachable(path)), mmap=sys.platform != "win32")
    except (OSError, PlyParseError, ValueError) as error:
        raise FileError(
            str(path), "an intact PLY file", str(error), "Export the file again."
        ) from error


def make_folder(folder: Path) -> None:
    """Makes a folder and its parents unless they exist, and removes what a run that was killed has
    left of files there. Raises FileError."""
    try:
        reachable(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            str(folder),
            "a folder that can be created",
            error.strerror or str(error),
            "Choose another folder.",
        ) from error
    remove_leftovers(folder)


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Writes a file whole or not at all. Raises FileError."""
    with whole_file(path) as file:
        file.write(content)


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Opens a file that gets its name only once it is complete and on disk.

    Until then it is called ``.NAME.0.pointmorph-part``. What a killed process left of one goes when
    a file of that name is written again, or with `remove_leftovers`.

    Raises
    ------
    FileError
        If it can't be created, written or renamed.
    """
    path = Path(path)
    destination = reachable(path)
    file, named = None, False
    try:
        part, file = _new_part(destination)
        yield file
        file.flush()
        os.fsync(file.fileno())
        if sys.platform == "win32":  # where nothing that is open gets another name
            file.close()
        else:
            os.chmod(part, 0o666 & ~_umask())
        replace(part, destination)
        named = True
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        # What fails here was said before: a full disk, a folder that is gone.
        if file is None:  # Ctrl-C may have come when it was made, but not yet known here
            _remove_parts(destination)
        else:
            with suppress(OSError):
                if not named and sys.platform != "win32":  # before another process takes the lock
                    os.unlink(part)
            with suppress(OSError):
                file.close()
            with suppress(OSError):
                if not named and sys.platform == "win32":
                    os.unlink(part)


def remove_leftovers(folder: str | os.PathLike[str]) -> None:
    """Removes what processes that were killed have left of files that they were writing there.

    Files that another process is writing right now stay.
    """
    with suppress(OSError):
        for entry in list(os.scandir(reachable(folder))):
            if entry.name.startswith(".") and entry.name.endswith(_PART):
                _remove_if_left(Path(entry.path))


def _new_part(destination: Path) -> tuple[Path, IO[bytes]]:
    """A new file beside its destination, locked for as long as it is open. Raises OSError.

    Leftovers of its name are removed; where another process or thread is writing such a file, this
    one gets another number.
    """
    number = 0
    while True:
        part = _part(destination, number)
        file: IO[bytes] | None = None
        try:
            try:
                file = open(part, "xb")  # noqa: SIM115  (whole_file closes it)
            except FileExistsError:
                number += not _remove_if_left(part)
                continue
            if not _locked(file, wait=True) or _is_named(part, file):
                return part, file
            file.close()  # it was taken for a leftover in between
        except BaseException:
            if file is not None:
                file.close()
            raise


def _part(destination: Path, number: int) -> Path:
    return destination.with_name(f".{destination.name}.{number}{_PART}")


def _remove_parts(destination: Path) -> None:
    """Removes what nothing is writing of the parts of a file."""
    number = 0
    while (part := _part(destination, number)).exists():
        _remove_if_left(part)
        number += 1


def _remove_if_left(part: Path) -> bool:
    """Removes a file unless it is being written; whether it is gone."""
    try:
        if sys.platform != "win32":
            # Who writes it holds the lock; it is free once that process has ended, however.
            with open(os.open(part, os.O_RDWR | os.O_NOFOLLOW), "rb") as file:
                # By now another file may have the name.
                if not _locked(file, wait=False) or not _is_named(part, file):
                    return False
                os.unlink(part)
        elif time.time() - part.stat().st_mtime < _SETTLING:
            return False
        else:
            os.unlink(part)  # Windows removes none that is open
    except FileNotFoundError:
        pass
    except OSError:
        return False
    return True


def _is_named(part: Path, file: IO[bytes]) -> bool:
    """Whether an open file has that name."""
    try:
        return os.path.samestat(os.stat(part, follow_symlinks=False), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _locked(file: IO[bytes], *, wait: bool) -> bool:
    """Whether the file could be locked: not where another one has it, or the disk has no locks."""
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


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
        remedy = "Close it in other programs, or choose another name."
    return FileError(str(path), "a writable location", error.strerror or str(error), remedy)
