"""Many morphs at once: what a file of jobs asks for."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pointmorph import __version__, formats
from pointmorph.base.errors import FileError
from pointmorph.base.option_table import options
from pointmorph.shapes.clouds import SIDES
from pointmorph.storage import files
from pointmorph.storage.file_checks import json_object
from pointmorph.storage.frame_records import file_checksum

MORPH, REPORT, RECORD, LOG, FRAMES = "pair.morph", "report.json", "job.json", "log.txt", "frames"
PICTURES, RENDERS, RENDERED = "pictures", "renders", "rendered"
_COMMON = {
    "frames": int, "resample": bool, "mesh": str, "samples": int, "settings": dict, "features": str
}  # fmt: skip
_GROUPS = ("pairs", "template", "folder")


@dataclass(frozen=True)
class PairJob:
    """One pair of a batch, with a folder of its own for what is made of it."""

    name: str
    source: Path
    target: Path
    folder: Path
    features: Path | None = None
    frames: int = 0
    resample: bool = False
    mesh: str | None = None
    samples: int | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def morph_file(self) -> Path:
        return self.folder / MORPH

    def morph_words(self) -> list[str]:
        """The command that finds the map and keeps it; without the number of threads."""
        words = ["morph", str(self.source), str(self.target), "--out", str(self.folder)]
        words += ["--save", str(self.morph_file)]
        words += ["--features", str(self.features)] if self.features else []
        words += ["--samples", str(self.samples)] if self.samples else []
        words += ["--resample"] if self.resample else []
        for name, value in sorted(self.settings.items()):
            words += [f"--{name.replace('_', '-')}", str(value)]
        return words

    def frames_words(self, part: slice = slice(None)) -> list[str]:
        """The command that makes frames of it: all, or those of one part."""
        words = ["frames", str(self.morph_file), "--out", str(self.folder / FRAMES)]
        words += ["--frames", str(self.frames)]
        words += ["--resample"] if self.resample else []
        words += ["--mesh", self.mesh] if self.mesh else []
        if part != slice(None):
            words += ["--range", f"{part.start}:{part.stop}"]
        return words

    def identity(self) -> str:
        """A hash of all that the map depends on. Raises FileError."""
        inputs = [self.source, self.target, *([self.features] if self.features else [])]
        sums = [file_checksum(path) for path in inputs]
        content = [__version__, sums, self.samples, self.resample, dict(self.settings)]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def bytes(self) -> int:
        """The size of both models' files."""
        return sum(p.stat().st_size for p in (self.source, self.target) if p.is_file())


@dataclass(frozen=True)
class Batch:
    """What a file of jobs asks for."""

    path: Path
    out: Path
    jobs: tuple[PairJob, ...]
    up: str
    """which axis is up in pictures: y or z; where the file says it, on the models as well"""
    render: tuple[str, ...] = ()
    """the command that renders frames of a pair; docs/farm.md has its placeholders"""
    render_every: int = 1
    """only frames whose number is a multiple of it are rendered"""

    def renders(self, frames: range) -> bool:
        """Whether any of these frames is to be rendered."""
        return any(number % self.render_every == 0 for number in frames)


def read_batch(path: Path, out: Path | None = None) -> Batch:
    """Reads a file of jobs; docs/batch.md says what is in it.

    Parameters
    ----------
    path : path
        Paths in the file are relative to it.
    out : path, optional
        The output folder, if it isn't that of the file.

    Raises
    ------
    FileError
        Saying what is wrong with the file.
    """
    content = json_object(path, "an object with pairs, template or folder", syntax="JSON")
    home = path.absolute().parent
    folder = out if out is not None else home / _value(path, content, "out", str, "batch")
    unknown = set(content) - {*_COMMON, *_GROUPS, "out", "up", "render", "render_every"}
    if unknown:
        raise _wrong(path, f"the keys {_listed(_GROUPS)}, {_listed(_COMMON)}", _listed(unknown))
    common = _common(path, content)
    entries = [
        *_pairs(path, home, content), *_template(path, home, content), *_folder(path, home, content)
    ]  # fmt: skip
    if not entries:
        raise _wrong(path, f"at least one pair, by {_listed(_GROUPS)}", "none")
    up = _value(path, content, "up", str, "z")
    if up not in ("y", "z"):
        raise _wrong(path, 'y or z as "up"', repr(up))
    taken = {PICTURES, "farm"}  # folders beside those of the pairs
    jobs = [
        _job(path, home, folder.absolute(), _stood_up({**common, **own}, content), taken)
        for own in entries
    ]
    render = _value(path, content, "render", list, [])
    if not all(isinstance(word, str) for word in render):
        raise _wrong(path, 'a command as "render", such as ["blender", "-b"]', repr(render))
    every = _value(path, content, "render_every", int, 1)
    if every < 1:
        raise _wrong(path, 'a number from 1 as "render_every"', repr(every))
    return Batch(path, folder.absolute(), tuple(jobs), up, tuple(render), every)


def _stood_up(entry: dict[str, Any], content: Mapping[str, Any]) -> dict[str, Any]:
    """An entry whose models stand as the file says, where it does and the entry doesn't."""
    if "up" not in content:
        return entry
    return {**entry, "settings": {"up": content["up"], **entry.get("settings", {})}}


def _wrong(path: Path, expected: str, found: str) -> FileError:
    return FileError(str(path), expected, found, "Correct the file.")


def _listed(names: Any) -> str:
    return ", ".join(f'"{name}"' for name in names)


def _value(path: Path, content: Mapping[str, Any], key: str, kind: type, default: Any) -> Any:
    value = content.get(key, default)
    if value is default:
        return value
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise _wrong(path, f'a value of type {kind.__name__} as "{key}"', repr(value))
    return value


def _common(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """What an entry says, or the whole file for all that don't."""
    found = {key: _value(path, content, key, kind, None) for key, kind in _COMMON.items()}
    return {key: value for key, value in found.items() if value is not None}


def _entry(path: Path, content: Any, keys: Sequence[str]) -> dict[str, Any]:
    if not isinstance(content, dict) or set(content) - {*keys, *_COMMON}:
        found = _listed(content) if isinstance(content, dict) else repr(content)
        raise _wrong(path, f"an object with {_listed(keys)}", found)
    return content


def _pairs(path: Path, home: Path, content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for given in _value(path, content, "pairs", list, []):
        entry = _entry(path, given, ("source", "target", "name"))
        for side in SIDES:
            if not isinstance(entry.get(side), str):
                raise _wrong(path, "a source and a target in each of the pairs", repr(given))
        yield {
            **_common(path, entry), "name": entry.get("name"),
            "source": home / entry["source"], "target": home / entry["target"],
        }  # fmt: skip


def _template(path: Path, home: Path, content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    if "template" not in content:
        return
    entry = _entry(path, content["template"], ("source", "targets"))
    targets = entry.get("targets")
    if not isinstance(entry.get("source"), str) or not isinstance(targets, list | str):
        raise _wrong(path, 'a source and targets in "template"', repr(entry))
    source = home / entry["source"]
    for pattern in [targets] if isinstance(targets, str) else targets:
        for target in _models(path, home, str(pattern)):
            if target != source:
                yield {**_common(path, entry), "source": source, "target": target}


def _folder(path: Path, home: Path, content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    if "folder" not in content:
        return
    given = content["folder"]
    entry = _entry(
        path, {"path": given} if isinstance(given, str) else given, ("path", "both_ways")
    )
    folder = home / _value(path, entry, "path", str, ".")
    models = [p for p in sorted(folder.glob("*")) if p.suffix.lower() in formats.SUFFIXES]
    if len(models) < 2:
        raise _wrong(path, f"at least two models in {folder}", str(len(models)))
    both = _value(path, entry, "both_ways", bool, False)
    for source, target in (itertools.permutations if both else itertools.combinations)(models, 2):
        yield {**_common(path, entry), "source": source, "target": target}


def _models(path: Path, home: Path, pattern: str) -> list[Path]:
    """The models that a pattern such as heads/*.obj names."""
    if not any(sign in pattern for sign in "*?["):
        return [home / pattern]
    relative = Path(pattern)
    start = Path(relative.anchor) if relative.is_absolute() else home
    within = relative.relative_to(relative.anchor) if relative.is_absolute() else relative
    found = [p for p in sorted(start.glob(str(within))) if p.suffix.lower() in formats.SUFFIXES]
    if not found:
        raise _wrong(path, f"models that match {pattern}", "none")
    return found


def _job(path: Path, home: Path, out: Path, entry: Mapping[str, Any], taken: set[str]) -> PairJob:
    given = dict(entry)
    name = given.pop("name", None) or f"{given['source'].stem}_to_{given['target'].stem}"
    plain = re.sub(r"[^\w.-]", "_", str(name)).lstrip(".") or "pair"
    unique = plain
    for number in itertools.count(2):
        if unique.lower() not in taken:
            break
        unique = f"{plain}_{number}"
    taken.add(unique.lower())
    if "features" in given:
        marks = given["features"]
        for side in SIDES:
            marks = marks.replace(f"{{{side}}}", given[side].stem)
        given["features"] = home / marks
    settings = {name.replace("-", "_"): value for name, value in given.get("settings", {}).items()}
    _check(path, {**given, "settings": settings})
    folder = files.reachable(out / unique)
    return PairJob(**{**given, "name": unique, "folder": folder, "settings": settings})


def _check(path: Path, entry: Mapping[str, Any]) -> None:
    """Raises FileError for what no morph could be made with."""
    known = {option.name for option in options()} - {"threads"}
    unknown = set(entry["settings"]) - known
    if unknown:
        raise _wrong(path, "settings that docs/options.md lists", _listed(unknown))
    for name, value in entry["settings"].items():
        if not isinstance(value, str | int | float) or isinstance(value, bool):
            raise _wrong(path, f'a number or a word as "{name}"', repr(value))
    if entry.get("frames", 0) < 0 or entry.get("frames", 0) == 1:
        raise _wrong(path, "0 or at least 2 frames", str(entry["frames"]))
    if entry.get("samples", 1) < 1:
        raise _wrong(path, 'at least 1 as "samples"', str(entry["samples"]))
    meshes = ("source", "target", *(suffix[1:] for suffix in formats.WRITTEN_MESH_SUFFIXES))
    if entry.get("mesh", "source") not in meshes:
        raise _wrong(path, f'{_listed(meshes)} as "mesh"', repr(entry["mesh"]))
