"""The main job on real models: two shapes in, a morph with shape keys, pictures and a film out.

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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # for the add-on

import bpy  # noqa: E402
import models  # noqa: E402
import paint  # noqa: E402
import scenery  # noqa: E402
import studio  # noqa: E402
from mathutils import Matrix  # noqa: E402
from pointmorph import Cloud, PointmorphError, formats, sampling  # noqa: E402

import addon  # noqa: E402

CACHE = ROOT / "build" / "cache"
TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)
AZIMUTH = 32.0
"""Degrees from the front, for the user's own models."""


@dataclass(frozen=True)
class Scale:
    """How much is made of it all."""

    points: tuple[int, int]
    """Of source and target, where there are faces to sample."""
    still: tuple[int, int]
    """Width and height of a picture of the contact sheet."""
    still_samples: int
    frames: int
    """Of the film, from source to target."""
    frame: tuple[int, int]
    frame_samples: int


FULL = Scale((100_000, 80_000), (560, 480), 24, 24, (420, 360), 8)
QUICK = Scale((10_000, 8_000), (210, 180), 4, 3, (105, 90), 2)


class Clock:
    """Says what is being done, and remembers how long it took."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, float]] = []

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        print(f"  {name} …", flush=True)
        start = time.perf_counter()
        yield
        self.rows.append((name, time.perf_counter() - start))

    def table(self, morph_report: dict[str, object]) -> str:
        lines = [f"{'stage':<34}{'seconds':>9}"]
        for name, seconds in self.rows:
            lines.append(f"{name:<34}{seconds:>9.2f}")
            if name == MORPH_STAGE:
                for stage, part in morph_report["stages"].items():
                    lines.append(f"    {stage.replace('_', ' '):<30}{part:>9.2f}")
        lines.append(f"{'in all':<34}{sum(seconds for _, seconds in self.rows):>9.2f}")
        return "\n".join(lines)


MORPH_STAGE = "morph (bpy.ops.pointmorph.morph)"


@dataclass(frozen=True)
class Subject:
    """What is morphed, and how it is looked at."""

    name: str
    source: formats.Shape
    target: formats.Shape
    features: models.Features
    azimuth: float
    loop: Sequence[str] = ()
    """Features through which a cut runs."""
    settings: Mapping[str, str] = field(default_factory=dict)


def obtain(files: Sequence[Path]) -> Iterator[Subject]:
    """The user's shapes and features, or Debian's, or, failing these, Blender's own."""
    try:
        cases = [_own(files)] if files else models.debian_cases(CACHE)
    except models.UnobtainableError as error:
        import blender_shapes

        print(f"  {error}.\n  {models.how_to_obtain(CACHE)}")
        print("  This time it morphs two heads that Blender makes by itself.")
        yield Subject("suzanne_to_bear", *blender_shapes.suzanne_and_bear(), AZIMUTH)
        return
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
    """`count` points on the faces, a bare cloud as it is; and the features' rows among them."""
    rows = {name: pair[side] for name, pair in features.items()}
    for name, row in rows.items():
        if not 0 <= row < len(shape.positions):
            raise ValueError(
                f'feature "{name}": expected a row of {shape.name}, 0 to '
                f"{len(shape.positions) - 1}, found {row}. Correct the features' file."
            )
    if shape.faces is None:
        return shape.cloud(), rows
    cloud, kept = sampling.sample(shape, count, keep=list(rows.values()))
    return cloud, dict(zip(rows, kept.tolist(), strict=True))


def run(files: Sequence[Path], out: Path, scale: Scale) -> None:
    out.mkdir(parents=True, exist_ok=True)
    addon.register()
    for number, subject in enumerate(obtain(files)):
        print(f"{subject.name.replace('_', ' ')}")
        morph(subject, out, scale, filmed=number == 0)
        print()


def morph(subject: Subject, out: Path, scale: Scale, *, filmed: bool) -> None:
    """Morphs, and leaves a contact sheet, a .blend and perhaps a film of that name in `out`."""
    clock = Clock()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    source, target, features = subject.source, subject.target, subject.features
    if source.name == target.name:
        source.name, target.name = f"{source.name} (source)", f"{target.name} (target)"
    with clock.stage("sampling"):
        clouds, marks = zip(
            sampled(paint.painted(source, paint.TERRACOTTA), scale.points[0], features, 0),
            sampled(paint.painted(target, paint.SAND), scale.points[1], features, 1),
            strict=True,
        )
    if subject.loop:
        with clock.stage("cuts, to colour both patches"):
            clouds = tuple(
                paint.show_patches(cloud, {name: rows[name] for name in subject.loop})
                for cloud, rows in zip(clouds, marks, strict=True)
            )
    with clock.stage("Blender objects"):
        objects = [
            scenery.add_cloud(scene, cloud, rows) for cloud, rows in zip(clouds, marks, strict=True)
        ]
        positions = [cloud.positions.astype(float) for cloud in clouds]
        matrix = scenery.placement(
            *positions,
            *(points[list(rows.values())] for points, rows in zip(positions, marks, strict=True)),
        )
        objects[1].matrix_world = Matrix(matrix.tolist())
        scene.pointmorph.source, scene.pointmorph.target = objects
        for name, value in subject.settings.items():
            setattr(scene.pointmorph, name, value)
        for name in subject.loop:
            scene.pointmorph.loop.add().name = name
    with clock.stage(MORPH_STAGE):
        bpy.ops.pointmorph.morph()
    result = bpy.context.object
    report = json.loads(result.pointmorph.report)
    for shown in objects:
        shown.hide_render = True
        shown.hide_set(True)
    with clock.stage("shape keys along the rigid path"):
        scene.frame_start, scene.frame_end = 1, scale.frames
        scenery.travel_rigidly(result, 1, scale.frames)

    scenery.show_as_solid(result)
    placed = positions[1] @ matrix[:3, :3].T + matrix[:3, 3]
    aspect = scale.still[0] / scale.still[1]
    studio.set_up(scene, [positions[0], placed], aspect, math.radians(subject.azimuth))
    folder = out / subject.name
    with clock.stage(f"contact sheet, {len(TIMES)} pictures"):
        studio.develop(scene, scale.still, scale.still_samples)
        stills = []
        for t in TIMES:
            scenery.go_to(scene, t, 1, scale.frames)
            stills.append(folder / f"t_{t:.2f}.png")
            studio.photograph(scene, stills[-1])
        sheet = out / f"{subject.name}.png"
        studio.contact_sheet(stills, [f"t = {t:g}" for t in TIMES], sheet)
    made = [sheet]
    if filmed:
        with clock.stage(f"film, {scale.frames} pictures"):
            made.append(out / f"{subject.name}.gif")
            studio.develop(scene, scale.frame, scale.frame_samples)
            frames = []
            for frame in range(1, scale.frames + 1):
                scene.frame_set(frame)
                frames.append(folder / f"frame_{frame:04d}.png")
                studio.photograph(scene, frames[-1])
            studio.film(frames, made[-1])
    with clock.stage("Blender file"):
        scene.frame_set(1)
        studio.develop(scene, scale.still, scale.still_samples)
        blend = out / f"{subject.name}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=True)

    print()
    print(clock.table(report))
    points = " and ".join(f"{len(cloud):,}" for cloud in clouds)
    marked = f"{len(features)} features" if features else "no mark at all"
    print(f"\n{points} points, {report['pairs']:,} pairs, {marked}")
    for warning in report["warnings"]:
        print(f"warning: {warning}")
    print("\n".join(map(str, made)) + f"\n{blend} (play it)")


@contextlib.contextmanager
def quiet_blender(log: Path) -> Iterator[None]:
    """Sends what Blender itself prints, line after line for every picture, to a file."""
    log.parent.mkdir(parents=True, exist_ok=True)
    sys.stdout.flush()
    terminal = os.dup(1)
    with log.open("wb") as file:
        os.dup2(file.fileno(), 1)
    ours, sys.stdout = sys.stdout, os.fdopen(terminal, "w", encoding="utf-8")
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(terminal, 1)
        sys.stdout.close()
        sys.stdout = ours


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path, metavar="SOURCE TARGET [FEATURES]")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "demo", metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="few points and small pictures")
    arguments = parser.parse_args()
    if len(arguments.files) not in (0, 2, 3):
        parser.error("expected SOURCE TARGET [FEATURES], or none of them")
    out = arguments.out.resolve()
    try:
        with quiet_blender(out / "blender.log"):
            run(arguments.files, out, QUICK if arguments.quick else FULL)
    except (PointmorphError, OSError, ValueError, RuntimeError) as error:
        # A Blender operator makes a RuntimeError of an error that it reports.
        print(f"demo: {str(error).removeprefix('Error: ').strip()}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
