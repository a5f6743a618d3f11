"""The models that the demo morphs: the user's, or those of a Debian package."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import subprocess
import tarfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGE = "libcgal-demo"
ARCHIVE = "./usr/share/doc/libcgal-dev/data.tar.gz"
# The rows of the features and the rotations are for exactly these files.
FILES = {
    "cow.off": "1c5a25c3047fc6b14dd0c962d3562b1796671422ab4634f9d46f9f23814cd54a",
    "camel.off": "9ac960a9fee27e6fcc6baaa2340260834625084ee20f4a97194212404e650a22",
    "diplodocus.off": "661fdac29eca4b205e354da112b3cbfd08dcfae07df989234b71421e62521c96",
    "bull.off": "5c7b9631f8c278c12b30c0eea0b72da871504674516daf7d7eaaf5fa4154224a",
    "bear.off": "058f6ce62635e5f86958adea9706a8dca3ebe4fae76a0d32b8318d107d40bda6",
    "mannequin-devil.off": "9424b7132b58766984051fb7757543e88972f91fe7e9565d4e5b715b204f74a5",
    "lion-head.off": "cf159eeb12a3f3f345e57448693e9f0d115f3f6f38fd1d4519b336cede849289",
}

Features = dict[str, tuple[int, int]]


@dataclass(frozen=True)
class Case:
    """A morph that the demo makes."""

    name: str
    source: Path
    target: Path
    features: Path | None
    """None: no features."""
    turns: tuple[float, float] = (0.0, 0.0)
    """Degrees by which source and target are rotated about the vertical, to face -y."""
    upright: bool = False
    """Whether the files' y axis points up."""
    azimuth: float = 32.0
    """Degrees from the front: where the camera stands."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Settings of the panel, if not the defaults."""


class UnobtainableError(Exception):
    """The models can't be downloaded; the message says why."""


def read_loop(path: Path) -> list[str]:
    """The `loop` of a features file: names of features in order along the cut."""
    return [str(name) for name in json.loads(path.read_text(encoding="utf-8")).get("loop", [])]


def read_features(path: Path) -> Features:
    """The `features` of a features file: name -> (source row, target row)."""
    try:
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        return {str(name): (int(rows[0]), int(rows[1])) for name, rows in features.items()}
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(
            f'{path}: expected {{"features": {{"nose": [source_row, target_row], …}}}}, '
            f"found something else ({error})"
        ) from error


# ---------------------------------------------------------------- Debian's models


def debian_cases(cache: Path) -> list[Case]:
    """The morphs of Debian's models, which the first call downloads into `cache`."""
    folder = cache / PACKAGE
    if not all(_is_intact(folder / name) for name in FILES):
        folder.mkdir(parents=True, exist_ok=True)
        _unpack(_download(folder), folder)
    for name in FILES:
        if not _is_intact(folder / name):
            raise UnobtainableError(f"{folder / name} is not the file that the demo needs")
    bear_to_bull = {
        "source": folder / "bear.off",
        "target": folder / "bull.off",
        "features": HERE / "bear_to_bull.json",
        "turns": (0.0, 90.0),
        "upright": True,
        "azimuth": 50.0,
    }
    return [
        Case(
            "camel_to_diplodocus",
            folder / "camel.off",
            folder / "diplodocus.off",
            None,
            turns=(0.0, -90.0),
            upright=True,
            azimuth=68.0,
        ),
        Case(
            "bull_to_cow",
            folder / "bull.off",
            folder / "cow.off",
            None,
            turns=(90.0, -90.0),
            upright=True,
            azimuth=60.0,
        ),
        Case(
            "mannequin_to_lion",
            folder / "mannequin-devil.off",
            folder / "lion-head.off",
            HERE / "mannequin_to_lion.json",
        ),
        Case("bear_to_bull", **bear_to_bull),
        Case(
            "bear_to_bull_by_a_cut",
            **bear_to_bull,
            settings={"method": "paper", "domain": "cut"},
        ),
        Case(
            "bear_to_bull_on_a_sphere",
            **bear_to_bull,
            settings={"method": "paper", "domain": "sphere"},
        ),
    ]


def how_to_obtain(cache: Path) -> str:
    return (
        f"The demo's models are {', '.join(FILES)}, from data.tar.gz in Debian's package "
        f"{PACKAGE}. To use them, put these files into {cache / PACKAGE} and run the demo again."
    )


def _is_intact(path: Path) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == FILES[path.name]


def _download(folder: Path) -> Path:
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        raise UnobtainableError("The models can't be downloaded, because this system has no apt")
    for refresh in (False, True):
        if refresh:  # a new system has no package lists yet
            prefix = [] if os.geteuid() == 0 else ["sudo", "-n"]
            _run([*prefix, "apt-get", "update", "-q"], folder)
        error = _run(["apt-get", "download", "-q", PACKAGE], folder)
        packages = sorted(folder.glob(f"{PACKAGE}_*.deb"))
        if packages and not error:
            return packages[-1]
    raise UnobtainableError(f"apt-get download {PACKAGE} failed: {error}")


def _run(command: list[str], folder: Path) -> str:
    """Runs a command quietly; returns the last line of its error message, or nothing."""
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        return str(error)
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]


def _unpack(package: Path, folder: Path) -> None:
    # Other versions of the package may have the same files: checksums decide, not the version.
    with subprocess.Popen(
        ["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE
    ) as process:
        with tarfile.open(fileobj=process.stdout, mode="r|") as outer:
            for member in outer:
                if member.name == ARCHIVE:
                    data = outer.extractfile(member).read()
                    break
            else:
                raise UnobtainableError(f"{package.name} holds no {ARCHIVE}")
        process.stdout.read()  # let dpkg-deb finish
    with tarfile.open(fileobj=io.BytesIO(data)) as inner:
        for name in FILES:
            try:
                text = inner.extractfile(f"data/meshes/{name}").read()
            except KeyError as error:
                raise UnobtainableError(f"{package.name} holds no {name}") from error
            partial = folder / f"{name}.part"
            partial.write_bytes(text)
            partial.replace(folder / name)
    package.unlink()
