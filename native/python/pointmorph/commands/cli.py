"""The command line: ``pointmorph morph …`` and other commands."""

from __future__ import annotations

import argparse
import difflib
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pointmorph import __version__, formats
from pointmorph.base.errors import FeatureError, FileError, OptionError, PointmorphError
from pointmorph.base.option_table import Option, options
from pointmorph.base.stages import Progress
from pointmorph.commands import (
    batch_command,
    farm_command,
    spared_inputs,
    stored_commands,
    terminal,
)
from pointmorph.commands.arguments import (
    Parser,
    distance,
    frame_count,
    number,
    positive,
    whole_number,
)
from pointmorph.meshes import sampling
from pointmorph.morphs import morphing, quality, run_words
from pointmorph.morphs.confidence import Confidence
from pointmorph.sequences import frame_sequences, source_meshes, surfaces
from pointmorph.sequences.own_meshes import OwnMeshWriter
from pointmorph.shapes.clouds import SIDES, Cloud, FloatArray
from pointmorph.shapes.features import Feature, feature_from_json, weights_from_json
from pointmorph.storage import files
from pointmorph.storage.file_checks import json_object

_T = TypeVar("_T")
_Result = TypeVar("_Result")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Returns
    -------
    int
        The exit status: 0, 1 (the run failed), 2 (wrong usage), 3 (part of it failed or is
        missing), 130 (Ctrl-C) or 143 (ended from outside).
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = _parser()
    if not words:
        parser.print_help(sys.stderr)
        return terminal.WRONG_CALL
    chosen = parser.parse_args(words)
    chosen.words = words
    try:
        with terminal.lasting_output(), terminal.orderly_end():
            status: int | None = chosen.run(chosen)
            return status or 0
    except OptionError as error:
        return terminal.fail(str(error), terminal.WRONG_CALL)
    except PointmorphError as error:
        return terminal.fail(str(error), terminal.FAILED)
    except MemoryError:
        return terminal.fail("Out of memory. Use fewer points: --samples N.", terminal.FAILED)
    except terminal.Terminated:
        return terminal.fail("Terminated. Run the same command again.", terminal.TERMINATED)
    except KeyboardInterrupt:
        return terminal.fail(
            "Interrupted. Run the same command again to start over.", terminal.INTERRUPTED
        )


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="pointmorph", description="Morphs one sampled shape into another.")
    parser.add_argument("--version", action="version", version=f"pointmorph {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    morph = commands.add_parser(
        "morph",
        usage=_usage("morph", "--out DIR"),
        help="match the points of two files and write in-between clouds",
        description="Writes pairs.npy, source.ply, target.ply, frame_0000.ply … and report.json.",
    )
    morph.set_defaults(run=_morph)
    morph.add_argument("--out", metavar="DIR", type=Path, help="output folder")
    morph.add_argument(
        "--save",
        metavar="FILE",
        type=Path,
        help="save the morph as one file that the frames command can use on any machine",
    )
    morph.add_argument(
        "--frames",
        metavar="N",
        type=frame_count,
        default=0,
        help="number of frames to write, both ends included: 0 or at least 2 (default: 0)",
    )
    morph.add_argument(
        "--resample",
        action="store_true",
        help="fill cracks in frames with new points, and write ids and velocities",
    )
    morph.add_argument(
        "--mesh",
        choices=["source", "target", *(suffix[1:] for suffix in formats.WRITTEN_MESH_SUFFIXES)],
        help="for each frame, also write a mesh, mesh_0000 … source: SOURCE itself with its "
        "vertices moved, at the last frame wrapped onto TARGET; keeps the file's format, faces and "
        "UVs (ply, obj, glb; others become ply). target: the same of TARGET, at the first frame "
        "wrapped onto SOURCE. A format: the surface through the frame's points"
        f"{_losses()}; needs pymeshlab and scipy",
    )
    morph.add_argument(
        "--denser",
        metavar="DISTANCE",
        nargs="?",
        type=distance,
        const=0.002,
        help="with --mesh source or target: cut faces into triangles where they would lie farther "
        "than this from the other model, in √area, once they are wrapped onto it (without a "
        "number: 0.002)",
    )
    propose = commands.add_parser(
        "propose",
        usage=_usage("propose", "--out FEATURES.json"),
        help="suggest pairs of places to mark as features",
        description="Writes a features file for the morph command, with confidences.",
    )
    propose.set_defaults(run=_propose)
    propose.add_argument(
        "--out", required=True, metavar="FILE", type=Path, help="features file to write"
    )
    for command in (morph, propose):
        _add_common(command)
    stored_commands.add(commands)
    for module in (batch_command, farm_command):
        module.add(commands, main)
    return parser


def _usage(command: str, out: str) -> str:
    return f"pointmorph {command} SOURCE TARGET {out} [--OPTION VALUE ...]"


def _losses() -> str:
    """What each format of meshes loses, for the help text."""
    return "".join(
        f"; {format.suffix[1:]} loses {format.loses}" for format in formats.FORMATS if format.loses
    )


def _add_common(command: argparse.ArgumentParser) -> None:
    kinds = " ".join(formats.SUFFIXES)
    command.add_argument("source", metavar="SOURCE", help=f"shape at t = 0: {kinds}")
    command.add_argument("target", metavar="TARGET", help="shape at t = 1")
    command.add_argument(
        "--features",
        metavar="FILE",
        type=Path,
        help='JSON: {"features": {"nose": [source row, target row], …}}; also curves and regions',
    )
    command.add_argument(
        "--samples",
        metavar="N",
        type=positive,
        help="morph N points sampled from each model's faces, and write those (default: write "
        "the vertices, although samples are matched)",
    )
    settings = command.add_argument_group("settings")
    for option in options():
        is_used = command.get_default("run") is _morph or option.affects in ("map", "nothing")
        _add_option(settings, option, is_used)


def _add_option(group: argparse._ArgumentGroup, option: Option, is_listed: bool) -> None:
    default = (
        "automatic"
        if option.default is None
        else f"{option.default:g}"
        if isinstance(option.default, float)
        else str(option.default)
    )
    names = list(dict.fromkeys([f"--{option.name.replace('_', '-')}", f"--{option.name}"]))
    unit = f" {option.unit}" if option.unit else ""
    limits = ""
    if option.kind != "choice":
        limits = f", {option.minimum:,.10g} to {option.maximum:,.10g}{unit}"
    # argparse reads % as a format
    text = f"{option.help} (default: {default}{limits})".replace("%", "%%")
    text = text if is_listed else argparse.SUPPRESS
    if option.kind == "choice":
        group.add_argument(*names, dest=option.name, choices=option.choices, help=text)
    else:
        reader = whole_number if option.kind == "int" else number
        group.add_argument(*names, dest=option.name, metavar="VALUE", type=reader, help=text)


def _settings(chosen: argparse.Namespace) -> dict[str, Any]:
    return {
        option.name: getattr(chosen, option.name)
        for option in options()
        if getattr(chosen, option.name) is not None
    }


def _at_once(
    chosen: argparse.Namespace, work: Callable[[_T], _Result], items: Sequence[_T]
) -> list[_Result]:
    """work(item) of each, on threads of their own unless one is wanted. Raises what the first that
    failed has raised."""
    if getattr(chosen, "threads", None) == 1:
        return [work(item) for item in items]
    with ThreadPoolExecutor(len(items), "pointmorph-files") as pool:
        return list(pool.map(work, items))


def _read_shapes(chosen: argparse.Namespace) -> list[formats.Shape]:
    paths: list[str] = [chosen.source, chosen.target]
    # Only PLY files are read as whole blocks, which leave the interpreter to another thread.
    if all(Path(path).suffix.lower() == ".ply" for path in paths):
        shapes = _at_once(chosen, formats.read, paths)
    else:
        shapes = [formats.read(path) for path in paths]
    if shapes[0].name == shapes[1].name:
        shapes[0].name, shapes[1].name = str(chosen.source), str(chosen.target)
    return shapes


def _clouds(
    chosen: argparse.Namespace,
    shapes: Sequence[formats.Shape],
    features: dict[str, Feature],
    progress: Progress,
) -> tuple[list[Cloud], dict[str, Feature]]:
    """The clouds to morph, sampled if the user wants that, and features with their rows."""
    if chosen.samples is None:
        return [shape.cloud() for shape in shapes], features
    check_rows(shapes, features)
    return sampling.sample_pair(shapes, features, chosen.samples, progress)


def _propose(chosen: argparse.Namespace) -> None:
    spared_inputs.check_file("out", chosen.out, [chosen.source, chosen.target])
    given, _ = read_features(chosen.features) if chosen.features else ({}, [])
    content = json_object(chosen.features, _FEATURES) if chosen.features else {}
    shapes = _read_shapes(chosen)
    with terminal.bars() as progress:
        clouds, features = _clouds(chosen, shapes, given, progress)
        proposals = morphing.propose_features(
            clouds[0], clouds[1], features, progress=progress, **_settings(chosen)
        )
    # Points may lie in a region, but not on a curve or on another point.
    taken = [
        {row for f in given.values() if f.kind != "region" for row in f.rows(side)}
        for side in (0, 1)
    ]
    found: dict[str, list[int]] = {}
    confidence: dict[str, float] = {}
    for proposal in proposals:
        rows = [
            _nearest_row(shape.positions, cloud.positions[row])
            for shape, cloud, row in zip(
                shapes, clouds, (proposal.source, proposal.target), strict=True
            )
        ]
        if any(rows[side] in taken[side] for side in (0, 1)):
            continue  # that vertex is taken
        for side in (0, 1):
            taken[side].add(rows[side])
        name = proposal.name
        while name in given:
            name += "_"
        found[name] = rows
        confidence[name] = round(proposal.confidence, 3)
    content["features"] = {**content.get("features", {}), **found}
    content["confidence"] = confidence
    files.write_bytes(chosen.out, (json.dumps(content, indent=1) + "\n").encode())
    if found:
        print(f"  {'vertices':<11}{'source':>8}{'target':>8}")
    for name, rows in found.items():
        print(f"  {name:<11}{rows[0]:>8}{rows[1]:>8}   {100 * confidence[name]:.0f} % sure")
    print(f"{len(found)} suggestions, written to {chosen.out}")


def _nearest_row(positions: FloatArray, place: FloatArray) -> int:
    return int(np.argmin(((positions - place) ** 2).sum(axis=1)))


def _morph(chosen: argparse.Namespace) -> None:
    if chosen.mesh not in (None, *SIDES):
        surfaces.check_available()
    features, loop = read_features(chosen.features) if chosen.features else ({}, [])
    shapes = _read_shapes(chosen)
    if chosen.features:
        _read_weights(chosen.features, shapes)
    own = _own_mesh(chosen, shapes) if chosen.mesh in SIDES else None
    if chosen.denser is not None and own is None:
        raise OptionError("denser", "--mesh source or target", f"--mesh {chosen.mesh}", "Add it.")
    if chosen.out is None and chosen.save is None:
        raise OptionError("out", "--out DIR or --save FILE", "neither", "Add one or both.")
    _check_frames(chosen)
    _check_stagger(chosen)
    inputs = [chosen.source, chosen.target, chosen.features]
    if chosen.save is not None:
        spared_inputs.check_file("save", chosen.save, inputs)
    if chosen.out is not None:
        spared_inputs.check_folder(chosen.out, inputs)
        files.make_folder(chosen.out)

    with terminal.bars() as progress:
        clouds, features = _clouds(chosen, shapes, features, progress)
        result = morphing.morph(
            clouds[0],
            clouds[1],
            features,
            loop=loop,
            frames=chosen.frames > 0,
            progress=progress,
            **_settings(chosen),
        )
        confidence = result.measure_confidence(progress)
        counts, mesh = _write(chosen, result, confidence, own, progress)
        if result.has_mesh:
            result.measure_mesh_quality(progress)
        report = dict(result.report)
        if chosen.save is not None:
            origin = _origin(chosen)
            result.save(chosen.save, resample=chosen.resample, origin=origin, progress=progress)
    if chosen.resample:
        report["resampled"] = {"inserted": result.inserted(), "frames": counts}
    if mesh is not None and mesh.denser is not None:
        denser = mesh.denser
        report["denser"] = {"vertices": len(denser.positions), "faces": len(denser.faces)}
    for warning in report["warnings"]:
        terminal.say(f"pointmorph: warning: {warning}", sys.stderr)
    if chosen.out is not None:
        text = json.dumps(report, indent=1) + "\n"
        files.write_bytes(chosen.out / "report.json", text.encode())
    written = " and ".join(str(path) for path in (chosen.out, chosen.save) if path is not None)
    print(
        f"{report['pairs']} pairs from {len(clouds[0])} and {len(clouds[1])} points "
        f"in {report['seconds']:.2f} s, written to {written}"
    )
    for line in _said(chosen, report, clouds):
        terminal.say(line)


def _check_frames(chosen: argparse.Namespace) -> None:
    """Refuses frames that nobody would get."""
    if chosen.frames and chosen.out is None:
        raise OptionError(
            "frames", "--out DIR, where the frames go", "--save alone",
            "Add it, or make frames of the saved morph: pointmorph frames.",
        )  # fmt: skip
    if chosen.mesh and not chosen.frames:
        raise OptionError(
            "mesh", "--frames N, as there is a mesh for each frame", "no frames",
            "Add it: 2 for both ends.",
        )  # fmt: skip


def _check_stagger(chosen: argparse.Namespace) -> None:
    """Refuses settings of a stagger that there isn't."""
    how = [name for name in _settings(chosen) if name.startswith("stagger_")]
    if how and chosen.stagger in (None, "none"):
        raise OptionError(
            how[0], "--stagger KIND, which it is about", "none", "Add it, or leave this out."
        )


def _said(
    chosen: argparse.Namespace, report: Mapping[str, Any], clouds: Sequence[Cloud]
) -> list[str]:
    """How good the result is, in figures and in words."""
    names, positions = [cloud.name for cloud in clouds], [cloud.positions for cloud in clouds]
    densify = "add --denser" if chosen.mesh in SIDES else "add --mesh source --denser"
    if chosen.denser is not None or "mesh" not in report:
        densify = ""
    return [
        f"  {_shapes_in_words(report, names)}",
        *(f"  {line}" for line in run_words.figure_lines(report)),
        *(f"  {name}: {value}" for name, value in quality.feature_summary(report)),
        run_words.verdict_line(report, names)
        + (" (Measured before --denser.)" if chosen.denser is not None else ""),
        *run_words.listed_advice(report, run_words.advice_lines(report, positions, names, densify)),
    ]


def _shapes_in_words(report: Mapping[str, Any], names: Sequence[str]) -> str:
    """What both models are, and the domain if it isn't the default."""
    words = [report["topology"][side]["words"] for side in SIDES]
    text = f"{names[0]}: {words[0]}; {names[1]}: {words[1]}"
    if words[0] == words[1]:
        text = f"{names[0]} and {names[1]}: {words[0]} each"
    return text if report["domain"] == "product" else f"{text} (domain {report['domain']})"


def _read_weights(path: Path, shapes: Sequence[formats.Shape]) -> None:
    """Takes what vertices keep when their mesh is wrapped, and when they go, from a features file
    into the shapes."""
    content = json_object(path, _FEATURES)
    for name in ("rigid", "fixed", "delay"):
        for side, shape in zip(SIDES, shapes, strict=True):
            if name not in content:
                continue
            weights = weights_from_json(name, content[name], side, len(shape.positions))
            if weights is not None:
                setattr(shape, name, weights)


def check_rows(shapes: Sequence[formats.Shape], features: Mapping[str, Feature]) -> None:
    """Raises FeatureError if a feature has rows that its shape doesn't have."""
    for side, shape in enumerate(shapes):
        for name, feature in features.items():
            for row in feature.rows(side):
                if not 0 <= row < len(shape.positions):
                    raise FeatureError(
                        f'feature "{name}"',
                        f"rows of {shape.name}, 0 to {len(shape.positions) - 1}",
                        str(row),
                        "Correct the row in the features file.",
                    )


_KEYS = ("features", "loop", "rigid", "fixed", "delay")
_FEATURES = 'JSON like {"features": {"nose": [source row, target row], …}, "loop": ["nose", …]}'


def _not_features(path: Path, found: str) -> FileError:
    return FileError(str(path), _FEATURES, found, "Correct the file.")


def read_features(
    path: Path, key: str = "features"
) -> tuple[dict[str, Feature], list[str] | list[list[str]]]:
    """The features under `key` of a features file, by name, and its loop or loops.

    Raises
    ------
    FileError, FeatureError
        Saying what is wrong with the file, or with which feature.
    """
    content = json_object(path, _FEATURES)
    for name in content:  # others may say what they like
        meant = difflib.get_close_matches(name.lower(), _KEYS, 1, 0.75)
        if meant and name not in (*_KEYS, key):
            raise FileError(str(path), f'"{meant[0]}"', f'"{name}"', "Correct that word.")
    if content and not {*_KEYS, key} & set(content):
        raise _not_features(path, f'no "{key}"')
    features, loop = content.get(key, {}), content.get("loop", [])
    if not isinstance(features, dict):
        raise _not_features(path, "something else")
    loops = loop if isinstance(loop, list) and loop and isinstance(loop[0], list) else [loop]
    if not all(isinstance(one, list) and all(isinstance(n, str) for n in one) for one in loops):
        raise FileError(
            str(path),
            'a list of feature names as "loop", or several lists',
            repr(loop),
            "Correct the loop.",
        )
    return {name: feature_from_json(name, value) for name, value in features.items()}, loop


def _own_mesh(
    chosen: argparse.Namespace, shapes: Sequence[formats.Shape]
) -> source_meshes.SourceMesh:
    """The file of one side, to write again with its vertices moved. Raises OptionError."""
    shape = shapes[SIDES.index(chosen.mesh)]
    found = (
        "no faces"
        if shape.faces is None
        else "--samples"
        if chosen.samples is not None
        else "--method paper"
        if chosen.method == "paper"
        else None
    )
    if found is not None:
        raise OptionError(
            "mesh",
            f"the faces of {shape.name}, morphed with method auto and without --samples",
            found,
            f"Change that, or choose a mesh format instead of {chosen.mesh}.",
        )
    return source_meshes.SourceMesh(getattr(chosen, chosen.mesh), shape)


def _origin(chosen: argparse.Namespace) -> dict[str, Any]:
    """Where a morph comes from, for its file."""
    return {
        "command": chosen.words,
        "samples": chosen.samples,
        **{side: stored_commands.origin_of(getattr(chosen, side)) for side in SIDES},
        "features": json_object(chosen.features, _FEATURES) if chosen.features else {},
    }


def _write(
    chosen: argparse.Namespace,
    result: morphing.Morph,
    confidence: Confidence,
    own: source_meshes.SourceMesh | None,
    progress: Progress,
) -> tuple[list[int], OwnMeshWriter | None]:
    """Writes pairs, both clouds and the frames, and returns the number of points of each frame,
    and what wrote the mesh of one side.

    Frames left by an earlier, longer run are removed.
    """
    if chosen.out is None:
        return [], None
    folder: Path = chosen.out
    with files.whole_file(folder / "pairs.npy") as file:
        np.save(file, result.pairs)
    ends = {side: result._end(side) for side in SIDES}

    def write_end(side: str) -> None:
        sure = getattr(confidence, side)
        formats.write_ply(folder / f"{side}.ply", **vars(ends[side]), confidence=sure)

    _at_once(chosen, write_end, SIDES)

    times = frame_sequences.even_times(chosen.frames)
    mesh = None if own is None else OwnMeshWriter(result, own, chosen.mesh, times)
    if mesh is not None:
        mesh.prepare(chosen.denser, progress)
    counts = frame_sequences.write_frames(
        result, folder, times, resample=chosen.resample, mesh=mesh or chosen.mesh, progress=progress
    )
    return counts, mesh
