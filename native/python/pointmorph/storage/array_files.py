"""Files of named arrays: zip archives of .npy files, which numpy.load opens.

Entries aren't compressed and begin at multiples of 64 bytes, so that they are mapped into memory
instead of read. An entry `header` says in JSON what the file is, and of each array its shape, type
and SHA-256.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import mmap
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from pointmorph.base.errors import FileError
from pointmorph.storage import files
from pointmorph.storage.file_checks import parsed_json

Array = npt.NDArray[Any]
_format: Any = np.lib.format
_BYTES = np.dtype(np.uint8)

_ALIGNMENT = 64
_LOCAL_HEADER = 30  # bytes, before the name and the extra field
_PADDING_ID = 0xD935  # the extra field by which other tools align entries, too
_ZIP64_EXTRA = 20
_ZIP64_FROM = 1 << 31
_BEFORE_1980 = (1980, 1, 1, 0, 0, 0)
_CHUNK = 1 << 24
# What a file that isn't whole, or isn't one of these, may raise when it is opened.
_BROKEN = (
    zipfile.BadZipFile, OSError, EOFError, KeyError, ValueError, TypeError, AttributeError,
    struct.error, zlib.error, NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


def write(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Writes arrays and what they are, whole or not at all. The same arrays make the same bytes.

    Raises
    ------
    FileError
        If the file can't be written.
    """
    ready = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    listed = {
        name: {"shape": array.shape, "type": array.dtype.str, "sha256": checksum(array)}
        for name, array in ready.items()
    }
    text = json.dumps({**header, "arrays": listed}, indent=1, sort_keys=True).encode()
    with files.whole_file(path) as file, zipfile.ZipFile(file, "w") as archive:
        _add(archive, file, "header", np.frombuffer(text, np.uint8))
        for name, array in ready.items():
            _add(archive, file, name, array)


def checksum(array: Array) -> str:
    """SHA-256 of an array's numbers, in C order."""
    digest = hashlib.sha256()
    for chunk in _chunks(array):
        digest.update(chunk)
    return digest.hexdigest()


def _chunks(array: Array) -> Iterator[memoryview]:
    """The array's bytes, some at a time."""
    flat: Any = array.reshape(-1).view(np.uint8)
    for first in range(0, len(flat), _CHUNK):
        yield memoryview(flat[first : first + _CHUNK])


def _preamble(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    """What a .npy file of such an array begins with."""
    content = io.BytesIO()
    about = {"shape": shape, "fortran_order": False, "descr": dtype.str}
    _format.write_array_header_1_0(content, about)
    return content.getvalue()


def _add(archive: zipfile.ZipFile, file: IO[bytes], name: str, array: Array) -> None:
    preamble = _preamble(array.shape, array.dtype)
    entry = zipfile.ZipInfo(f"{name}.npy", _BEFORE_1980)
    entry.file_size = len(preamble) + array.nbytes
    is_large = entry.file_size >= _ZIP64_FROM
    used = _LOCAL_HEADER + len(entry.filename) + (_ZIP64_EXTRA if is_large else 0)
    padding = -(file.tell() + used + 4) % _ALIGNMENT
    entry.extra = struct.pack("<HH", _PADDING_ID, padding) + bytes(padding)
    with archive.open(entry, "w", force_zip64=is_large) as out:
        out.write(preamble)
        for chunk in _chunks(array):
            out.write(chunk)


class ArrayFile:
    """An opened file of arrays. Its arrays are read where they are asked for, and can't be changed.

    Parameters
    ----------
    path : path
    what : str
        What the file should be, for error messages.

    Raises
    ------
    FileError
        If it can't be read or is no such file. The arrays' numbers aren't looked at: see `check`.

    Attributes
    ----------
    header : dict
    arrays : mapping of str to array
    """

    def __init__(self, path: str | os.PathLike[str], what: str) -> None:
        self.path = Path(path)
        self.what = what
        try:
            with files.reachable(self.path).open("rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
                try:
                    self.arrays: Mapping[str, Array] = dict(self._read(file))
                except _BROKEN:
                    # Until then, Windows lets nobody make the file again.
                    with suppress(BufferError):
                        self._map.close()
                    raise
        except _BROKEN as error:
            raise self.refused(_in_words(error)) from error

    def refused(self, found: str) -> FileError:
        """The error for a file that isn't what it should be."""
        return FileError(str(self.path), self.what, found, "Make the file again.")

    def check(self) -> None:
        """Compares all numbers with their checksums, which takes as long as reading the file.

        Raises
        ------
        FileError
            Naming what is damaged.
        """
        broken = [
            name
            for name, array in self.arrays.items()
            if checksum(array) != self.header["arrays"][name]["sha256"]
        ]
        if broken:
            raise self.refused(f"numbers that differ from those written in {', '.join(broken)}")

    def _read(self, file: IO[bytes]) -> Iterator[tuple[str, Array]]:
        with zipfile.ZipFile(file) as archive:
            # Through the archive: its checksum is compared.
            content = archive.read("header.npy")
            size = len(content) - len(_preamble((len(content),), _BYTES))
            self._expect(content, _preamble((size,), _BYTES), "header")
            self.header: dict[str, Any] = parsed_json(content[-size:])
            listed = self.header["arrays"]
            entries = {entry.filename: entry for entry in archive.infolist()}
            if set(entries) != {f"{name}.npy" for name in ("header", *listed)}:
                raise ValueError("arrays that differ from the header's list")
            for name, about in listed.items():
                yield name, self._mapped(name, entries[f"{name}.npy"], about)

    @staticmethod
    def _expect(content: bytes, preamble: bytes, name: str) -> None:
        if not content.startswith(preamble):
            raise ValueError(f"{name} of a shape or type that differs from the header's")

    def _mapped(self, name: str, entry: zipfile.ZipInfo, about: Mapping[str, Any]) -> Array:
        if entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1:
            raise ValueError("compressed or encrypted arrays")
        shape, dtype = tuple(int(length) for length in about["shape"]), np.dtype(about["type"])
        if dtype.hasobject or dtype.str != about["type"] or min(shape, default=0) < 0:
            raise ValueError(f"{name} of type {about['type']}")
        start = entry.header_offset
        lengths = struct.unpack_from("<HH", self._map, start + _LOCAL_HEADER - 4)
        start += _LOCAL_HEADER + sum(lengths)
        preamble = _preamble(shape, dtype)
        self._expect(self._map[start : start + len(preamble)], preamble, name)
        count = math.prod(shape)
        if len(preamble) + count * dtype.itemsize != entry.file_size:
            raise ValueError(f"{name} of a size that doesn't fit its shape")
        array = np.frombuffer(self._map, dtype, count, start + len(preamble))
        return array.reshape(shape)


def _in_words(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, zipfile.BadZipFile):
        return f"a damaged file or another kind of file ({error})"
    return str(error) or type(error).__name__
