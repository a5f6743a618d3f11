"""The main job on real models: two heads in, a morph with shape keys, pictures and a film out.

Runs in .venv, which holds Blender as a Python package: python3 build_addon.py demo
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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

TIMES = (0.0, 0.25, 0.5, 0.75, 1.0)


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


FULL = Scale((100_000, 80_000), (480, 600), 24, 24, (320, 400), 8)
QUICK = Scale((10_000, 8_000), (160, 200), 4, 3, (80, 100), 2)


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


def obtain(files: Sequence[Path]) -> tuple[formats.Shape, formats.Shape, models.Features]:
    """The user's shapes and features, or Debian's, or, failing these, Blender's own."""
    if not files:
        cache = ROOT / "build" / "cache"
        try:
            files = models.debian_models(cache)
        except models.UnobtainableError as error:
            import blender_shapes

            print(f"  {error}.\n  {models.how_to_obtain(cache)}")
            print("  This time it morphs two heads that Blender makes by itself.")
            return blender_shapes.suzanne_and_bear()
    source, target, features = files
    return formats.read(source), formats.read(target), models.read_features(features)


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
    clock = Clock()
    out.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    addon.register()

    with clock.stage("models"):
        source, target, features = obtain(files)
        if source.name == target.name:
            source.name, target.name = f"{source.name} (source)", f"{target.name} (target)"
        source = paint.painted(source, paint.TERRACOTTA)
        target = paint.painted(target, paint.SAND)
    with clock.stage("sampling"):
        clouds, marks = zip(
            sampled(source, scale.points[0], features, 0),
            sampled(target, scale.points[1], features, 1),
            strict=True,
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
    with clock.stage(MORPH_STAGE):
        bpy.ops.pointmorph.morph()
    morph = bpy.context.object
    key = morph.data.shape_keys.key_blocks["Morph"]
    report = json.loads(morph.pointmorph.report)
    for shown in objects:
        shown.hide_render = True
        shown.hide_set(True)

    scenery.show_as_solid(morph)
    placed = positions[1] @ matrix[:3, :3].T + matrix[:3, 3]
    studio.set_up(scene, [positions[0], placed], aspect=scale.still[0] / scale.still[1])
    pictures = out / "pictures"
    with clock.stage(f"contact sheet, {len(TIMES)} pictures"):
        studio.develop(scene, scale.still, scale.still_samples)
        stills = []
        for t in TIMES:
            key.value = t
            stills.append(pictures / f"t_{t:.2f}.png")
            studio.photograph(scene, stills[-1])
        sheet = out / "contact_sheet.png"
        studio.contact_sheet(stills, [f"t = {t:g}" for t in TIMES], sheet)
    with clock.stage(f"film, {scale.frames} pictures"):
        scene.frame_start, scene.frame_end = 1, scale.frames
        scenery.animate(key, 1, scale.frames)
        studio.develop(scene, scale.frame, scale.frame_samples)
        frames = []
        for frame in range(1, scale.frames + 1):
            scene.frame_set(frame)
            frames.append(pictures / f"frame_{frame:04d}.png")
            studio.photograph(scene, frames[-1])
        film = out / "morph.gif"
        studio.film(frames, film)
    with clock.stage("Blender file"):
        scene.frame_set(1)
        studio.develop(scene, scale.still, scale.still_samples)
        blend = out / "morph.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=True)

    print()
    print(clock.table(report))
    points = " and ".join(f"{len(cloud):,}" for cloud in clouds)
    print(f"\n{points} points, {report['pairs']:,} pairs, {len(features)} features")
    for warning in report["warnings"]:
        print(f"warning: {warning}")
    print(f"{sheet}\n{film}\n{blend} (play it, or drag the shape key Morph)")


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
    parser.add_argument("files", nargs="*", type=Path, metavar="SOURCE TARGET FEATURES")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "demo", metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="few points and small pictures")
    arguments = parser.parse_args()
    if len(arguments.files) not in (0, 3):
        parser.error("expected SOURCE TARGET FEATURES, or none of them")
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
