"""Morphs as files: computed once, then opened in no time, and its frames made on any machine.

The file is a zip archive of .npy files (see `array_files`); docs/morph_file.md lists them.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pointmorph import __version__, _pointmorph
from pointmorph.base.errors import CloudError, FileError, OptionError
from pointmorph.base.option_table import is_straight, native_options
from pointmorph.base.stages import Progress
from pointmorph.morphs.confidence import Confidence
from pointmorph.morphs.morphing import Morph
from pointmorph.shapes.clouds import SIDES, Cloud
from pointmorph.storage import array_files
from pointmorph.storage.array_files import Array, ArrayFile

FORMAT, VERSION = "pointmorph morph", 1
SUFFIX = ".morph"
_FRAME = {"positions": 3, "normals": 3, "colors": 4, "radii": None}
_PLAN = {
    "pairs": 3, "weights": 3, "times": 4, "hidden": None, "hidden_times": 4,
    "spacing": 2, "density": 2, "sizes": None,
}  # fmt: skip
_OPTIONAL = {"colors": 4, "delay": None, "ends": 3, "confidence": None}
_FLOATS = (np.float32, np.float64)


def write(
    morph: Morph, path: Path, resample: bool, origin: dict[str, Any], progress: Progress | None
) -> None:
    """Writes all that a morph's frames need: what `Morph.save` does."""
    if morph.parts != (morph,):
        raise OptionError(
            "morph", "one morph", f"a chain of {len(morph.parts)}", "Save each of its parts."
        )
    confidence = morph.measure_confidence(progress) if morph.has_confidence else None
    header = {
        "format": FORMAT,
        "version": VERSION,
        "made_by": __version__,
        "names": [morph.source.name, morph.target.name],
        "options": {name: value for name, value in morph._settings().items() if value is not None},
        "report": morph._known_report(),
        "origin": origin,
    }
    arrays = dict(_arrays(morph, resample, progress))
    if confidence is not None:
        header["confidence"] = confidence.words()
        for side in SIDES:
            arrays[f"{side}/confidence"] = getattr(confidence, side)
    array_files.write(path, header, arrays)


def _arrays(morph: Morph, resample: bool, progress: Progress | None) -> Iterator[tuple[str, Array]]:
    native = morph._native
    yield "pairs", morph.pairs
    completed = native.completed_source(), native.completed_target()
    has_colors = any(len(one["colors"]) for one in completed)
    for t in (0, 1):
        for name, values in vars(morph.frame(t)).items():
            if name != "colors" or has_colors:
                yield f"frame_{t}/{name}", values
    ends: tuple[Array | None, Array | None] = (
        native.wrapped(1.0, progress) if morph.has_mesh else None,
        native.wrapped_target(0.0, progress) if morph.has_target_mesh else None,
    )
    images = native.source_to_target(progress), native.target_to_source(progress)
    for number, (side, cloud) in enumerate(zip(SIDES, (morph.source, morph.target), strict=True)):
        yield f"{side}/positions", cloud.positions
        for name in ("normals", "colors", "radii"):
            if len(completed[number][name]):
                yield f"{side}/{name}", _narrowed(completed[number][name])
        yield f"{side}/images", _narrowed(images[number])
        if cloud.delay is not None:
            yield f"{side}/delay", cloud.delay.astype(np.float64)
        places = ends[number]
        if places is not None and cloud.faces is not None:
            yield f"{side}/ends", _narrowed(places)
            yield f"{side}/face_offsets", cloud.faces[0]
            yield f"{side}/corners", cloud.faces[1]
    if resample:
        for name, values in native.resampling_plan(progress).items():
            yield f"resampling/{name}", values


def _narrowed(values: Array) -> Array:
    """In float32 where that loses nothing."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    return single if np.array_equal(single, values) else values


def open_morph(path: str | os.PathLike[str], *, threads: int | None = None) -> StoredMorph:
    """Opens a morph that `Morph.save` wrote, in no time: the file is mapped into memory.

    Parameters
    ----------
    path : path
        Must not be changed while the morph is in use. Replacing it with another file is fine, but
        on Windows, where it can't be done.
    threads : int, optional
        As the setting of that name; the number that the morph was computed with doesn't count.

    Returns
    -------
    StoredMorph

    Raises
    ------
    FileError
        If it can't be read, is no such file, isn't whole, or has been written by a later version.
        Damaged numbers are noticed by `StoredMorph.check`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import pointmorph
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    >>> plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    >>> result = pointmorph.morph(pointmorph.Cloud(plane), pointmorph.Cloud(2 * plane))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result.save(f"{folder}/plane.morph")
    ...     frame = pointmorph.open_morph(f"{folder}/plane.morph").frame(0.4)
    >>> bool(np.array_equal(frame.positions, result.frame(0.4).positions))
    True
    """
    return StoredMorph(ArrayFile(path, "a morph saved by pointmorph"), threads)


class StoredMorph(Morph):
    """A morph that was opened by `open_morph`: its frames have the bits of the one that was saved.

    Frames, resampled frames, wrapped meshes, `vertex_times`, `quality`, `cracks`, `carrier` and
    `updated` work as for any `Morph`; `report` is that of the saved one. What it doesn't have is
    what the map was found with: `denser` and `mesh_quality` raise CloudError, and domains and
    boundaries are empty. Its confidence was measured when it was saved.

    Attributes
    ----------
    header : dict
        What the file says of itself: `options`, `report`, `origin` and more.
    """

    def __init__(self, file: ArrayFile, threads: int | None = None) -> None:
        self._file = file
        self._threads = threads
        self.header = file.header
        _check_header(file)
        _check_arrays(file)
        self.pairs = file.arrays["pairs"]
        self.source, self.target = (_cloud(file, side) for side in (0, 1))
        self._dtype = file.arrays["frame_0/positions"].dtype.type
        self._options = {
            name: value for name, value in self.header["options"].items() if name != "threads"
        }
        try:
            straight = is_straight(**self._options)
        except (OptionError, TypeError) as error:
            raise file.refused(f"unknown settings ({error})") from error
        self._is_straight = straight and self._options.get("stagger", "none") == "none"

    def check(self) -> None:
        """Compares all numbers with their checksums, which takes as long as reading the file.

        Raises
        ------
        FileError
            Naming what is damaged.
        """
        self._file.check()

    @property
    def has_mesh(self) -> bool:
        """Whether the source's faces were wrapped; see `Morph.has_mesh`."""
        return "source/ends" in self._file.arrays

    @property
    def has_target_mesh(self) -> bool:
        """The same of the target."""
        return "target/ends" in self._file.arrays

    @property
    def has_plan(self) -> bool:
        """Whether the file says which points resampled frames get."""
        return "resampling/pairs" in self._file.arrays

    @property
    def has_confidence(self) -> bool:
        """Whether the file has it; those of earlier versions don't."""
        return all(f"{side}/confidence" in self._file.arrays for side in SIDES)

    def measure_confidence(self, progress: Progress | None = None) -> Confidence:
        """That of the morph when it was saved; see `Morph.measure_confidence`."""
        if not self.has_confidence:
            raise CloudError(
                str(self._file.path), "the confidence of its points", "none", "Morph again."
            )
        source, target = (self._file.arrays[f"{side}/confidence"] for side in SIDES)
        try:
            return Confidence.of(source, target, self.header["confidence"])
        except (KeyError, TypeError) as error:
            raise self._file.refused("an incomplete confidence") from error

    @property
    def identity(self) -> str:
        """A hash: files with the same one have the same bits in every frame."""
        listed = {name: about["sha256"] for name, about in self.header["arrays"].items()}
        text = json.dumps([VERSION, listed, self._options], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def report(self) -> dict[str, Any]:
        """That of the morph when it was saved; see `Morph.report`."""
        return dict(self.header["report"])

    @cached_property
    def _native(self) -> _pointmorph.Morph:  # type: ignore[override]
        """What frames need that aren't straight ones, and all else."""
        arrays = self._file.arrays
        kept: dict[str, Any] = {
            f"{side}_{name}": arrays.get(f"{side}/{name}")
            for side in SIDES
            for name in ("images", "ends")
        }
        kept["resampling"] = None
        if self.has_plan:
            kept["resampling"] = {name: arrays[f"resampling/{name}"] for name in _PLAN}
        for side in (0, 1):
            _check_faces(self._file, side)
        pairs = np.clip(self.pairs, -1, 2**31 - 1)
        settings = native_options({**self._options, "threads": self._threads or 0})
        return _pointmorph.Morph.restore(
            self.source._fields(), self.target._fields(), pairs, kept, settings
        )

    @cached_property
    def _straight(self) -> _pointmorph.StraightPathSingle | _pointmorph.StraightPathDouble:
        make = (
            _pointmorph.StraightPathSingle
            if self._dtype is np.float32
            else _pointmorph.StraightPathDouble
        )
        none = np.empty(0, self._dtype)
        ends = [f"frame_{t}/{name}" for t in (0, 1) for name in _FRAME]
        return make(*(self._file.arrays.get(name, none) for name in ends))

    def _write_frame(self, t: float, arrays: tuple[Array, ...], progress: Progress | None) -> None:
        if self._is_straight or t in (0.0, 1.0):
            self._straight.frame(t, self._threads, *arrays)
        else:
            super()._write_frame(t, arrays, progress)

    def _lay_out_paths(self, progress: Progress | None) -> None:
        if not self._is_straight:
            super()._lay_out_paths(progress)

    def _content(self) -> Iterator[Array]:
        yield np.frombuffer(self.identity.encode(), np.uint8)

    def _settings(self) -> dict[str, Any]:
        return dict(self._options)

    def _known_report(self) -> dict[str, Any]:
        return self.report


def _cloud(file: ArrayFile, side: int) -> Cloud:
    given = {
        name.partition("/")[2]: array
        for name, array in file.arrays.items()
        if name.startswith(f"{SIDES[side]}/")
    }
    cloud = Cloud(
        given["positions"],
        given["normals"],
        given.get("colors"),
        given["radii"],
        delay=given.get("delay"),
        name=file.header["names"][side],
    )
    if "corners" in given:
        cloud.faces = given["face_offsets"], given["corners"]
    return cloud


def _check_header(file: ArrayFile) -> None:
    header = file.header
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise file.refused("a file of another kind")
    version = header.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise FileError(
            str(file.path),
            f"a morph of version {VERSION} of the format or earlier",
            f"version {version}, written by pointmorph {header.get('made_by')}",
            "Install that version.",
        )
    names = header.get("names")
    whole = (
        isinstance(names, list)
        and [type(name) for name in names] == [str, str]
        and all(isinstance(header.get(part), dict) for part in ("options", "report", "origin"))
    )
    if not whole:
        raise file.refused("an incomplete header")


def _check_arrays(file: ArrayFile) -> None:
    """Raises FileError unless all arrays are there, of fitting shapes and types."""
    arrays = file.arrays

    def check(name: str, rows: int | None, columns: int | None, *types: type) -> int:
        array = arrays.get(name)
        if array is None:
            raise file.refused(f"no {name}")
        shape = (len(array) if array.ndim else 0,) + (() if columns is None else (columns,))
        if array.shape != shape or rows not in (None, shape[0]) or array.dtype.type not in types:
            raise file.refused(f"{name} of shape {array.shape} and type {array.dtype}")
        return shape[0]

    pairs = check("pairs", None, 2, np.int64)
    first = arrays.get("frame_0/positions")
    single = first is not None and first.dtype == np.float32
    for t in (0, 1):
        for name, columns in _FRAME.items():
            if name != "colors" or {"frame_0/colors", "frame_1/colors"} & set(arrays):
                check(f"frame_{t}/{name}", pairs, columns, np.float32 if single else np.float64)
    for side in SIDES:
        count = check(f"{side}/positions", None, 3, *_FLOATS)
        for name, columns in (("normals", 3), ("radii", None), ("images", 3)):
            check(f"{side}/{name}", count, columns, *_FLOATS)
        for name, columns in _OPTIONAL.items():
            if f"{side}/{name}" in arrays:
                check(f"{side}/{name}", count, columns, *_FLOATS)
        if f"{side}/ends" in arrays:
            check(f"{side}/face_offsets", None, None, np.int64)
            check(f"{side}/corners", None, None, np.int32)
    if any(name.startswith("resampling/") for name in arrays):
        _check_plan(check, pairs)


def _check_plan(check: Any, pairs: int) -> None:
    inserted = check("resampling/pairs", None, 3, np.int32)
    hidden = check("resampling/hidden", None, None, np.int32)
    rows = {
        "weights": inserted, "times": inserted, "hidden_times": hidden,
        "spacing": pairs, "density": pairs, "sizes": 2,
    }  # fmt: skip
    for name, count in rows.items():
        check(f"resampling/{name}", count, _PLAN[name], np.float64)


def _check_faces(file: ArrayFile, side: int) -> None:
    """Raises FileError unless faces are rows of their cloud: the library trusts them."""
    offsets = file.arrays.get(f"{SIDES[side]}/face_offsets")
    corners = file.arrays.get(f"{SIDES[side]}/corners")
    if offsets is None or corners is None:
        return
    count = len(file.arrays[f"{SIDES[side]}/positions"])
    in_order = (
        len(offsets) > 0
        and offsets[0] == 0
        and offsets[-1] == len(corners)
        and bool((np.diff(offsets) >= 0).all())
    )
    if not in_order or (len(corners) and not 0 <= corners.min() <= corners.max() < count):
        raise file.refused(f"faces that aren't rows of {SIDES[side]}")
