"""The command line: ``pointmorph morph …`` and ``pointmorph propose …``."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pointmorph import __version__, formats, morphing, quality, sampling, sequences, surfaces
from pointmorph.clouds import Cloud, FloatArray
from pointmorph.errors import FeatureError, FileError, OptionError, PointmorphError
from pointmorph.features import Feature, feature_from_json

FAILED, WRONG_CALL, INTERRUPTED = 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line and returns the exit status: 0, 1 (failed) or 2 (wrong call)."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    try:
        chosen.run(chosen)
    except OptionError as error:
        return _complain(str(error), WRONG_CALL)
    except PointmorphError as error:
        return _complain(str(error), FAILED)
    except MemoryError:
        return _complain("Out of memory: sample the models with fewer points.", FAILED)
    except KeyboardInterrupt:
        return _complain("Interrupted. Run the same command again to start over.", INTERRUPTED)
    return 0


def _complain(message: str, status: int) -> int:
    print(f"pointmorph: {message}", file=sys.stderr)
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="pointmorph", description="Morphs one sampled shape into another.", allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"pointmorph {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    morph = commands.add_parser(
        "morph",
        allow_abbrev=False,
        help="compute the correspondence and the in-between clouds of two files",
        description="Writes pairs.npy, source.ply, target.ply, frame_0000.ply … and report.json.",
    )
    morph.set_defaults(run=_morph)
    morph.add_argument("--out", required=True, metavar="DIR", type=Path, help="folder to write to")
    morph.add_argument(
        "--frames",
        metavar="N",
        type=_frame_count,
        default=0,
        help="in-between clouds to write, both ends included: 0 or at least 2 (default: 0)",
    )
    morph.add_argument(
        "--resample",
        action="store_true",
        help="write frames without cracks, with new points where some are missing, id and velocity",
    )
    morph.add_argument(
        "--mesh",
        choices=[suffix[1:] for suffix in formats.WRITTEN_MESH_SUFFIXES],
        help="write for every frame also a mesh of this kind, mesh_0000 …: a surface through the "
        "points. Needs pymeshlab and scipy",
    )
    propose = commands.add_parser(
        "propose",
        allow_abbrev=False,
        help="find places of two files that belong together, to mark as features",
        description="Writes a features file, which morph takes, with a confidence for each.",
    )
    propose.set_defaults(run=_propose)
    propose.add_argument(
        "--out", required=True, metavar="FILE", type=Path, help="features' file to write"
    )
    for command in (morph, propose):
        _add_common(command)
    return parser


def _add_common(command: argparse.ArgumentParser) -> None:
    kinds = " ".join(formats.SUFFIXES)
    command.add_argument("source", metavar="SOURCE", help=f"the shape at t = 0: {kinds}")
    command.add_argument("target", metavar="TARGET", help="the shape at t = 1")
    command.add_argument(
        "--features",
        metavar="FILE",
        type=Path,
        help='JSON: {"features": {"nose": [source row, target row], …}}, and curves and regions',
    )
    command.add_argument(
        "--samples",
        metavar="N",
        type=_positive,
        help="sample both models' faces with N points (default: morph the vertices)",
    )
    settings = command.add_argument_group("settings of the method")
    for option in morphing.options():
        _add_option(settings, option)


def _add_option(group: argparse._ArgumentGroup, option: morphing.Option) -> None:
    default = (
        "automatic"
        if option.default is None
        else f"{option.default:g}"
        if isinstance(option.default, float)
        else str(option.default)
    )
    names = list(dict.fromkeys([f"--{option.name.replace('_', '-')}", f"--{option.name}"]))
    unit = f", in {option.unit}" if option.unit else ""
    # argparse reads % as a format
    text = f"{option.help}{unit} (default: {default})".replace("%", "%%")
    if option.kind == "choice":
        group.add_argument(*names, dest=option.name, choices=option.choices, help=text)
    else:
        reader = int if option.kind == "int" else float
        group.add_argument(*names, dest=option.name, metavar="VALUE", type=reader, help=text)


def _frame_count(text: str) -> int:
    count = int(text)
    if count < 0 or count == 1:
        raise argparse.ArgumentTypeError("expected 0 or at least 2")
    return count


def _positive(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError("expected at least 1")
    return count


def _settings(chosen: argparse.Namespace) -> dict[str, Any]:
    return {
        option.name: getattr(chosen, option.name)
        for option in morphing.options()
        if getattr(chosen, option.name) is not None
    }


def _read_shapes(chosen: argparse.Namespace) -> list[formats.Shape]:
    shapes = [formats.read(chosen.source), formats.read(chosen.target)]
    if shapes[0].name == shapes[1].name:
        shapes[0].name, shapes[1].name = str(chosen.source), str(chosen.target)
    return shapes


def _clouds(
    chosen: argparse.Namespace,
    shapes: Sequence[formats.Shape],
    features: dict[str, Feature],
    progress: morphing.Progress,
) -> tuple[list[Cloud], dict[str, Feature]]:
    """The clouds to morph, sampled where that is asked for, and the features' rows of them."""
    if chosen.samples is None:
        return [shape.cloud() for shape in shapes], features
    check_rows(shapes, features)
    return sampling.sample_pair(shapes, features, chosen.samples, progress)


def _propose(chosen: argparse.Namespace) -> None:
    given, _ = read_features(chosen.features) if chosen.features else ({}, [])
    content = _read_json(chosen.features) if chosen.features else {}
    shapes = _read_shapes(chosen)
    with _bars() as progress:
        clouds, features = _clouds(chosen, shapes, given, progress)
        proposals = morphing.propose_features(
            clouds[0], clouds[1], features, progress=progress, **_settings(chosen)
        )
    # A region may hold points, a curve and a point share none.
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
            continue  # the model has no vertex of its own there
        for side in (0, 1):
            taken[side].add(rows[side])
        name = proposal.name
        while name in given:
            name += "_"
        found[name] = rows
        confidence[name] = round(proposal.confidence, 3)
    content["features"] = {**content.get("features", {}), **found}
    content["confidence"] = confidence
    formats.write_bytes(chosen.out, (json.dumps(content, indent=1) + "\n").encode())
    for name, rows in found.items():
        print(f"  {name:<11}{rows[0]:>8}{rows[1]:>8}   {100 * confidence[name]:.0f} % sure")
    print(f"{len(found)} proposals: {chosen.out}")


def _nearest_row(positions: FloatArray, place: FloatArray) -> int:
    return int(np.argmin(((positions - place) ** 2).sum(axis=1)))


def _morph(chosen: argparse.Namespace) -> None:
    if chosen.mesh is not None:
        surfaces.check_available()
    features, loop = read_features(chosen.features) if chosen.features else ({}, [])
    shapes = _read_shapes(chosen)
    formats.make_folder(chosen.out)

    with _bars() as progress:
        clouds, features = _clouds(chosen, shapes, features, progress)
        result = morphing.morph(
            clouds[0], clouds[1], features, loop=loop, progress=progress, **_settings(chosen)
        )
        counts = _write(chosen, result, progress)
        result.measure_quality(progress)
    report = dict(result.report)
    if chosen.resample:
        report["resampled"] = {"inserted": result.inserted(), "frames": counts}
    for warning in report["warnings"]:
        print(f"pointmorph: warning: {warning}", file=sys.stderr)
    formats.write_bytes(chosen.out / "report.json", (json.dumps(report, indent=1) + "\n").encode())
    print(
        f"{report['pairs']} pairs of {len(clouds[0])} and {len(clouds[1])} points "
        f"in {report['seconds']:.2f} s: {chosen.out}"
    )
    print(f"  {report['choice']}")
    for name, value in quality.quality_summary(report):
        print(f"  {name:<11}{value}")
    for name, value in quality.feature_summary(report):
        print(f"  {name}: {value}")
    for place in report["worst"]:
        print(f"  {place['advice']}")


def check_rows(shapes: Sequence[formats.Shape], features: Mapping[str, Feature]) -> None:
    """Raises FeatureError where a feature has what is no row of its shape."""
    for side, shape in enumerate(shapes):
        for name, feature in features.items():
            for row in feature.rows(side):
                if not 0 <= row < len(shape.positions):
                    raise FeatureError(
                        f'feature "{name}"',
                        f"a row of {shape.name}, 0 to {len(shape.positions) - 1}",
                        str(row),
                        "Correct it in the features' file.",
                    )


_SHAPE = '{"features": {"nose": [source row, target row], …}, "loop": ["nose", …]}'


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(
            str(path), "a readable file", error.strerror or str(error), "Check the path."
        ) from error
    except ValueError as error:
        raise FileError(str(path), f"JSON like {_SHAPE}", str(error), "Correct it.") from error
    if not isinstance(content, dict):
        raise FileError(str(path), f"JSON like {_SHAPE}", "something else", "Correct it.")
    return content


def read_features(
    path: Path, key: str = "features"
) -> tuple[dict[str, Feature], list[str] | list[list[str]]]:
    """The features that FEATURES.json has under `key`, by name, and its loop or loops."""
    content = _read_json(path)
    features, loop = content.get(key, {}), content.get("loop", [])
    if not isinstance(features, dict):
        raise FileError(str(path), f"JSON like {_SHAPE}", "something else", "Correct it.")
    loops = loop if isinstance(loop, list) and loop and isinstance(loop[0], list) else [loop]
    if not all(isinstance(one, list) and all(isinstance(n, str) for n in one) for one in loops):
        raise FileError(
            str(path), "a loop that lists features' names, or several", repr(loop), "Correct it."
        )
    return {name: feature_from_json(name, value) for name, value in features.items()}, loop


def _write(
    chosen: argparse.Namespace, result: morphing.Morph, progress: morphing.Progress
) -> list[int]:
    """Pairs, both clouds and the frames; returns how many points these have.

    Frames of an earlier run that had more are removed.
    """
    folder: Path = chosen.out
    with formats.whole_file(folder / "pairs.npy") as file:
        np.save(file, result.pairs)
    frame = result.empty_frame()
    for side, (name, cloud) in enumerate((("source", result.source), ("target", result.target))):
        result.frame(float(side), out=frame)
        rows = result.pairs[:, side]
        normals, colors, radii = (
            _by_point(values, rows, len(cloud))
            for values in (frame.normals, frame.colors, frame.radii)
        )
        positions = cloud.positions.astype(frame.positions.dtype, copy=False)
        formats.write_ply(folder / f"{name}.ply", positions, normals, colors, radii)

    times = [number / (chosen.frames - 1) for number in range(chosen.frames)]
    return sequences.write_frames(
        result, folder, times, resample=chosen.resample, mesh=chosen.mesh, progress=progress
    )


def _by_point(values: FloatArray, rows: npt.NDArray[np.int64], count: int) -> FloatArray:
    """What pairs have of one side, for its points: `rows` are those of the pairs."""
    result: FloatArray = np.empty((count, *values.shape[1:]), values.dtype)
    result[rows] = values
    return result


@contextlib.contextmanager
def _bars() -> Iterator[morphing.Progress]:
    """A progress function: one bar a stage on a terminal, nothing in a pipe."""
    from tqdm import tqdm

    bars: dict[str, Any] = {}

    def progress(stage: str, fraction: float) -> bool:
        if stage not in bars:
            finish()
            bars[stage] = tqdm(
                total=100,
                desc=f"{stage:<17}",
                disable=None,
                leave=False,
                bar_format="{desc} {bar:40} {percentage:3.0f}%",
            )
        bar = bars[stage]
        bar.update(max(0.0, round(100 * fraction) - bar.n))
        return True

    def finish() -> None:
        for bar in bars.values():
            bar.close()
        bars.clear()

    try:
        yield progress
    finally:
        finish()
