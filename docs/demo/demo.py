"""Morphs real models in a headless Blender, and leaves pictures, a film and .blend files.

Runs in .venv, which holds Blender as a Python package: python3 build_addon.py demo
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # for the add-on

import bpy  # noqa: E402
import models  # noqa: E402
import numpy as np  # noqa: E402
import numpy.typing as npt  # noqa: E402
import paint  # noqa: E402
import pointmorph  # noqa: E402
import scenery  # noqa: E402
import studio  # noqa: E402
from mathutils import Matrix  # noqa: E402
from pointmorph import (  # noqa: E402
    Cloud,
    PointmorphError,
    formats,
    meshes,
)

import addon  # noqa: E402

CACHE = ROOT / "build" / "cache"
TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)
AZIMUTH = 32.0
"""Degrees from the front, for the user's own models."""


@dataclass(frozen=True)
class Scale:
    """Numbers of points, and sizes of pictures."""

    points: tuple[int, int]
    """Samples of source and target, if they have faces."""
    still: studio.Exposure
    """For the pictures of the contact sheet."""
    frames: int
    """Of the film, from source to target."""
    frame: studio.Exposure


# A picture costs 3 s of processor time for the geometry; the rest is samples and denoising. The
# film, where no picture is looked at for long, uses the fast denoiser, at half the cost.
FULL = Scale(
    (100_000, 80_000),
    studio.Exposure((480, 412), 12),
    24,
    studio.Exposure((320, 274), 4, fast_denoising=True),
)
QUICK = Scale((10_000, 8_000), studio.Exposure((210, 180), 3), 4, studio.Exposure((105, 90), 2))


class Console:
    """Says what is being done, and how long it took once it is done."""

    WIDTH = 46

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def say(self, text: str = "", end: str = "\n") -> None:
        print(text, end=end, file=self._stream, flush=True)

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.say(f"  {name:<{self.WIDTH}}", end="")
        start = time.perf_counter()
        try:
            yield
        except BaseException:
            self.say()
            raise
        self.say(f"{time.perf_counter() - start:7.1f} s")

    def stages(self, seconds: Mapping[str, float]) -> None:
        """Those of a morph that took long enough to matter."""
        for stage, part in seconds.items():
            if part >= 0.05:
                self.say(f"      {pointmorph.stage_label(stage):<{self.WIDTH - 4}}{part:7.1f} s")


@dataclass(frozen=True)
class Subject:
    """A pair of shapes, and how to look at it."""

    name: str
    source: formats.Shape
    target: formats.Shape
    features: models.Features
    azimuth: float
    loop: Sequence[str] = ()
    """Features along which the shapes are cut."""
    settings: Mapping[str, str] = field(default_factory=dict)


def obtain(
    files: Sequence[Path], everything: bool = True, say: Callable[[str], object] = print
) -> Iterator[Subject]:
    """The user's shapes; without any, Debian's (only the first pair unless `everything`); if these
    can't be downloaded, Blender's own."""
    try:
        cases = [_own(files)] if files else models.debian_cases(CACHE)
    except models.UnobtainableError as error:
        import blender_shapes

        say(f"{error}.\n{models.how_to_obtain(CACHE)}")
        say("For now, the demo morphs two heads made in Blender.\n")
        yield Subject("suzanne_to_bear", *blender_shapes.suzanne_and_bear(), AZIMUTH)
        return
    if not everything:
        cases = cases[:1]
    for case in cases:
        shapes = [
            scenery.staged(formats.read(path), turn, case.upright)
            for path, turn in zip((case.source, case.target), case.turns, strict=True)
        ]
        features = models.read_features(case.features) if case.features else {}
        cut = case.settings.get("domain") == "cut"
        loop = models.read_loop(case.features) if case.features and cut else []
        yield Subject(case.name, *shapes, features, case.azimuth, loop, case.settings)


def _own(files: Sequence[Path]) -> models.Case:
    source, target, *features = files
    return models.Case(
        f"{source.stem}_to_{target.stem}",
        source,
        target,
        features[0] if features else None,
        azimuth=AZIMUTH,
    )


def sampled(
    shape: formats.Shape, count: int, features: models.Features, side: int
) -> tuple[Cloud, dict[str, int]]:
    """`count` samples of a mesh, or all points of a point cloud; and the rows of the features."""
    rows = {name: pair[side] for name, pair in features.items()}
    for name, row in rows.items():
        if not 0 <= row < len(shape.positions):
            raise ValueError(
                f'feature "{name}": expected a row of {shape.name}, 0 to '
                f"{len(shape.positions) - 1}, found {row}. Correct the features file."
            )
    if shape.faces is None:
        return shape.cloud(), rows
    cloud, kept = meshes.sample(shape, count, keep=list(rows.values()))
    return cloud, dict(zip(rows, kept.tolist(), strict=True))


def run(files: Sequence[Path], out: Path, scale: Scale, everything: bool, console: Console) -> None:
    out.mkdir(parents=True, exist_ok=True)
    addon.register()
    for number, subject in enumerate(obtain(files, everything, console.say)):
        morph(subject, out, scale, console, filmed=number == 0)
        console.say()
    if not (files or everything):
        console.say(
            "More pairs, with features, a cut and a sphere:  python3 build_addon.py demo --all"
        )


def morph(subject: Subject, out: Path, scale: Scale, console: Console, *, filmed: bool) -> None:
    """Makes a morph, and leaves its contact sheet, .blend file and perhaps a film in `out`."""
    marked = f"{len(subject.features)} features" if subject.features else "no features marked"
    console.say(f"{subject.name.replace('_', ' ').capitalize()}, {marked}")
    start = time.perf_counter()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    clouds, marks = _clouds(subject, scale, console)
    with console.stage("Creating Blender objects"):
        objects, everywhere = _objects(scene, subject, clouds, marks)
    with console.stage("Morphing (bpy.ops.pointmorph.morph)"):
        bpy.ops.pointmorph.morph()
    result = bpy.context.object
    report = json.loads(result.pointmorph.report)
    console.stages(report["stages"])
    points = " and ".join(f"{len(cloud):,}" for cloud in clouds)
    console.say(f"      {points} points, {report['pairs']:,} pairs")
    for warning in report["warnings"]:
        console.say(f"      Warning: {warning}")
    for shown in objects:
        shown.hide_render = True
        shown.hide_set(True)
    with console.stage("Baking and keying shape keys"):
        scene.frame_start, scene.frame_end = 1, scale.frames
        scenery.travel_rigidly(result, 1, scale.frames)
    scenery.show_as_solid(result)
    aspect = scale.still.size[0] / scale.still.size[1]
    studio.set_up(scene, everywhere, aspect, math.radians(subject.azimuth))
    blend = out / f"{subject.name}.blend"
    with console.stage("Saving the Blender file"):
        scene.frame_set(1)
        studio.develop(scene, scale.still)
        bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=True)
    made = {"Pictures": _contact_sheet(scene, subject, out, scale, console)}
    if filmed:
        made["Film"] = _film(scene, subject, out, scale, console)
    made["Blender"] = blend
    console.say(f"  {'Total':<{console.WIDTH}}{time.perf_counter() - start:7.1f} s")
    for what, path in made.items():
        console.say(f"  {what:<10}{path}")


def _clouds(
    subject: Subject, scale: Scale, console: Console
) -> tuple[tuple[Cloud, ...], tuple[dict[str, int], ...]]:
    """Samples of both shapes, with colors, and the rows of the features among them."""
    source, target = subject.source, subject.target
    if source.name == target.name:
        source.name, target.name = f"{source.name} (source)", f"{target.name} (target)"
    with console.stage("Sampling the models"):
        clouds, marks = zip(
            sampled(paint.painted(source, paint.TERRACOTTA), scale.points[0], subject.features, 0),
            sampled(paint.painted(target, paint.SAND), scale.points[1], subject.features, 1),
            strict=True,
        )
    if subject.loop:
        with console.stage("Cutting them to color both patches"):
            clouds = tuple(
                paint.show_patches(cloud, {name: rows[name] for name in subject.loop})
                for cloud, rows in zip(clouds, marks, strict=True)
            )
    return clouds, marks


def _objects(
    scene: bpy.types.Scene,
    subject: Subject,
    clouds: Sequence[Cloud],
    marks: Sequence[Mapping[str, int]],
) -> tuple[list[bpy.types.Object], list[npt.NDArray[np.float64]]]:
    """The clouds as objects, set up for the morph, and their points in world space."""
    objects = [
        scenery.add_cloud(scene, cloud, rows) for cloud, rows in zip(clouds, marks, strict=True)
    ]
    source, target = (cloud.positions.astype(float) for cloud in clouds)
    features = (
        points[list(rows.values())] for points, rows in zip((source, target), marks, strict=True)
    )
    matrix = scenery.placement(source, target, *features)
    objects[1].matrix_world = Matrix(matrix.tolist())
    scene.pointmorph.source, scene.pointmorph.target = objects
    for name, value in subject.settings.items():
        setattr(scene.pointmorph, name, value)
    for name in subject.loop:
        scene.pointmorph.loop.add().name = name
    return objects, [source, target @ matrix[:3, :3].T + matrix[:3, 3]]


def _contact_sheet(
    scene: bpy.types.Scene, subject: Subject, out: Path, scale: Scale, console: Console
) -> Path:
    stills = []
    studio.develop(scene, scale.still)
    for number, t in enumerate(TIMES, 1):
        with console.stage(f"Rendering picture {number} of {len(TIMES)}, t = {t:g}"):
            scenery.go_to(scene, t, 1, scale.frames)
            stills.append(out / subject.name / f"t_{t:.2f}.png")
            studio.photograph(scene, stills[-1])
        if number == 1:
            console.say(f"      First picture: {stills[0]}")
    sheet = out / f"{subject.name}.png"
    studio.contact_sheet(stills, [f"t = {t:g}" for t in TIMES], sheet)
    return sheet


def _film(
    scene: bpy.types.Scene, subject: Subject, out: Path, scale: Scale, console: Console
) -> Path:
    film = out / f"{subject.name}.gif"
    studio.develop(scene, scale.frame)
    with console.stage(f"Rendering a film of {scale.frames} frames"):
        frames = []
        for frame in range(1, scale.frames + 1):
            scene.frame_set(frame)
            frames.append(out / subject.name / f"frame_{frame:04d}.png")
            studio.photograph(scene, frames[-1])
        studio.film(frames, film)
    return film


@contextlib.contextmanager
def quiet_blender(log: Path) -> Iterator[TextIO]:
    """Sends what Blender prints, several lines per picture, to a file; yields the terminal."""
    log.parent.mkdir(parents=True, exist_ok=True)
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(descriptor) for descriptor in (1, 2)]
    with log.open("wb") as file:
        for descriptor in (1, 2):
            os.dup2(file.fileno(), descriptor)
    try:
        with os.fdopen(kept[0], "w", encoding="utf-8", closefd=False) as terminal:
            yield terminal
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for descriptor, old in zip((1, 2), kept, strict=True):
            os.dup2(old, descriptor)
            os.close(old)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path, metavar="SOURCE TARGET [FEATURES]")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "demo", metavar="DIR")
    parser.add_argument("--all", action="store_true", help="all pairs, not only the first")
    parser.add_argument("--quick", action="store_true", help="few points and small pictures")
    arguments = parser.parse_args()
    if len(arguments.files) not in (0, 2, 3):
        parser.error("expected SOURCE TARGET [FEATURES], or no files")
    out = arguments.out.resolve()
    try:
        with quiet_blender(out / "blender.log") as terminal:
            scale = QUICK if arguments.quick else FULL
            run(arguments.files, out, scale, arguments.all, Console(terminal))
    except (PointmorphError, OSError, ValueError, RuntimeError) as error:
        # Blender turns an error that an operator reports into a RuntimeError.
        print(f"demo: {str(error).removeprefix('Error: ').strip()}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
