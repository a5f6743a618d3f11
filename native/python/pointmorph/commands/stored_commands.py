"""The commands ``pointmorph frames`` and ``pointmorph info``, for morphs as files."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

from pointmorph import formats
from pointmorph.base.errors import OptionError
from pointmorph.base.option_table import options
from pointmorph.commands import spared_inputs, terminal
from pointmorph.commands.arguments import part_of, positive, some_frames
from pointmorph.morphs import run_words
from pointmorph.morphs.stored_morphs import StoredMorph, open_morph
from pointmorph.sequences.frame_sequences import FrameRun, FrameSequence, even_times
from pointmorph.sequences.stored_frames import mesh_writer
from pointmorph.shapes.clouds import SIDES
from pointmorph.storage import files
from pointmorph.storage.frame_records import file_checksum


def add(commands: Any) -> None:
    """Adds the commands to the parser's."""
    frames = commands.add_parser(
        "frames",
        help="make any frames of a saved morph, on any machine",
        description="Writes frame_0000.ply …, and records which are done. Frames that are "
        "done and intact are not made again.",
    )
    frames.set_defaults(run=_frames)
    frames.add_argument("file", metavar="FILE", type=Path, help="a file from morph --save")
    frames.add_argument("--out", required=True, metavar="DIR", type=Path, help="output folder")
    frames.add_argument(
        "--frames",
        required=True,
        metavar="N",
        type=some_frames,
        help="number of frames of the whole run, both ends included: at least 2",
    )
    frames.add_argument(
        "--range",
        metavar="A:B",
        type=part_of,
        default=slice(None),
        help="only frames A to B - 1 of them, counted from 0; either may be left out. A alone: "
        "only that one",
    )
    frames.add_argument(
        "--resample",
        action="store_true",
        help="fill cracks in frames with new points, and write ids and velocities",
    )
    frames.add_argument(
        "--mesh",
        choices=[*SIDES, *(suffix[1:] for suffix in formats.WRITTEN_MESH_SUFFIXES)],
        help="for each frame, also write a mesh, as the morph command does",
    )
    for side in SIDES:
        frames.add_argument(
            f"--{side}",
            metavar="FILE",
            type=Path,
            help=f"for --mesh {side}: the model's file, if it has moved",
        )
    frames.add_argument("--threads", metavar="N", type=positive, help="threads (default: all)")
    frames.add_argument(
        "--check",
        action="store_true",
        help="make nothing: say which frames are missing or broken; exit status 3 if any are",
    )
    info = commands.add_parser(
        "info",
        help="describe a saved morph, and check that it is intact",
        description="Compares all checksums. Exit status 1 if the file is damaged.",
    )
    info.set_defaults(run=_info)
    info.add_argument("file", metavar="FILE", type=Path, help="a file from morph --save")
    info.add_argument("--json", action="store_true", help="print the file's whole header")


def origin_of(path: str | os.PathLike[str]) -> dict[str, str]:
    """A file as the origin of a morph: where it lies, and its checksum."""
    return {"path": str(Path(path).absolute()), "sha256": file_checksum(Path(path))}


def _frames(chosen: argparse.Namespace) -> int:
    morph = open_morph(chosen.file, threads=chosen.threads)
    which = range(chosen.frames)[chosen.range]
    if not which:
        raise OptionError(
            "range", f"some of the frames 0 to {chosen.frames - 1}", "none", "Correct A:B."
        )
    sequence = FrameSequence(morph, even_times(chosen.frames), resample=chosen.resample)
    model = getattr(chosen, chosen.mesh) if chosen.mesh in SIDES else None
    run = FrameRun(sequence, chosen.out, mesh_writer(chosen.mesh, model, morph, sequence))
    missing = run.missing(which)
    if chosen.check:
        for k in missing:
            print(f"frame {k} is missing or broken")
        print(f"{len(which) - len(missing)} of {len(which)} frames are done, in {chosen.out}")
        return terminal.INCOMPLETE if missing else 0
    origins = [morph.header["origin"].get(side) for side in SIDES]
    named = [origin.get("path") for origin in origins if isinstance(origin, dict)]
    spared_inputs.check_folder(chosen.out, [chosen.source, chosen.target, *named])
    files.make_folder(chosen.out)
    if missing:
        morph.check()
        with terminal.bars() as progress:
            sequence.prepare(progress)
            run.make(missing, progress=progress)
    print(f"{len(missing)} frames made, {len(which) - len(missing)} already done, in {chosen.out}")
    return 0


def _info(chosen: argparse.Namespace) -> int:
    morph = open_morph(chosen.file)
    if chosen.json:
        print(json.dumps(morph.header, indent=1))
    else:
        for line in _lines(morph):
            print(line)
    morph.check()
    if not chosen.json:
        print("All checksums match.")
    return 0


def _lines(morph: StoredMorph) -> list[str]:
    """What a file is, in words."""
    header = morph.header
    names = [morph.source.name, morph.target.name]
    rows = [
        ("Morph", " to ".join(names)),
        ("Pairs", f"{len(morph.pairs)} from {len(morph.source)} and {len(morph.target)} points"),
        ("Frames", f"{morph._dtype.__name__}{', straight' if morph._is_straight else ''}"),
        ("Meshes", _one_of(("source", morph.has_mesh), ("target", morph.has_target_mesh))),
        ("Resampling", "kept" if morph.has_plan else "computed on demand"),
        ("Settings", _changed_settings(morph) or "the defaults"),
        (
            "Written by",
            f"pointmorph {header['made_by']}, format {header['version']}",
        ),
    ]
    for side in SIDES:
        if isinstance(header["origin"].get(side), dict):
            rows.append((side.capitalize(), str(header["origin"][side].get("path", "unknown"))))
    figures = run_words.figure_lines(morph.report) if "quality" in morph.report else []
    return [*(f"{name:<18}{value}" for name, value in rows), *figures]


def _one_of(*present: tuple[str, bool]) -> str:
    return " and ".join(name for name, is_there in present if is_there) or "none"


def _changed_settings(morph: StoredMorph) -> str:
    defaults = {option.name: option.default for option in options()}
    settings = morph._settings().items()
    return ", ".join(f"{name} {value}" for name, value in settings if defaults[name] != value)
