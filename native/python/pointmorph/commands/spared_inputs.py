"""What a command reads must not be what it writes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from pointmorph.base.errors import OptionError

# What morph and frames write into their folder, or remove from it if an earlier run has left it.
_WRITTEN = re.compile(r"(source|target|frame_\d+)\.ply|mesh_\d+\.\w+|pairs\.npy|report\.json")


def check_folder(folder: Path, inputs: Iterable[str | os.PathLike[str] | None]) -> None:
    """Raises OptionError where output in `folder` would replace one of the inputs."""
    for path in [Path(name) for name in inputs if name]:
        is_there = path.exists() and folder.is_dir() and path.parent.samefile(folder)
        if is_there and _WRITTEN.fullmatch(path.name.lower()):
            raise OptionError(
                "out",
                f"a folder where nothing replaces {path.name}, which is read",
                f"{folder}, which it lies in",
                "Choose another folder, or rename the file.",
            )


def check_file(option: str, path: Path, inputs: Iterable[str | os.PathLike[str] | None]) -> None:
    """Raises OptionError if the file to be written is one of the inputs."""
    for read in [Path(name) for name in inputs if name]:
        if path.exists() and read.exists() and path.samefile(read):
            raise OptionError(
                option, "a file of its own", f"{path}, which is read", "Choose another name."
            )
