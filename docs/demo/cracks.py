"""The same frames before and after resampling, and a film of resampled ones: the pictures of
docs/resampling.md.

Runs in .venv, after the demo has downloaded its models: .venv/bin/python docs/demo/cracks.py

What is compared uses the published method with a small influence of the features, which tears
surfaces, as in figures 2 and 4 of the paper. The film shows a morph by default options.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path

import bpy
import demo
import numpy as np
import paint
import scenery
import studio
from mathutils import Matrix
from PIL import Image

import addon
from addon.data import versions

POINTS = (30_000, 24_000)
INFLUENCE = 0.6
DISC = 0.7
"""Radius of the discs in spacings: evenly spaced, they just overlap."""
FRAMES = 25
FILM_FRAMES, SHOWN, COLUMNS = 24, 2, 6
"""Frames of the film; of how many one is shown; pictures in a row."""
TIMES = (0.25, 0.5, 0.75)
STILL = studio.Exposure((460, 470), 12)
FRAME = studio.Exposure((240, 240), 64)


def morphed(scene: bpy.types.Scene, exposure: studio.Exposure, torn: bool) -> bpy.types.Object:
    """The mannequin's head to the lion's, in the studio."""
    subject = next(one for one in demo.obtain([]) if one.name == "mannequin_to_lion")
    clouds, marks = zip(
        demo.sampled(
            paint.painted(subject.source, paint.TERRACOTTA), POINTS[0], subject.features, 0
        ),
        demo.sampled(paint.painted(subject.target, paint.SAND), POINTS[1], subject.features, 1),
        strict=True,
    )
    objects = [
        scenery.add_cloud(scene, cloud, rows) for cloud, rows in zip(clouds, marks, strict=True)
    ]
    positions = [cloud.positions.astype(float) for cloud in clouds]
    matrix = scenery.placement(
        *positions,
        *(points[list(rows.values())] for points, rows in zip(positions, marks, strict=True)),
    )
    objects[1].matrix_world = Matrix(matrix.tolist())
    settings = scene.pointmorph
    settings.source, settings.target = objects
    if torn:
        settings.method, settings.influence = "paper", INFLUENCE
        settings.resample_spacing = DISC
    bpy.ops.pointmorph.morph()
    for shown in objects:
        shown.hide_render = True
    placed = positions[1] @ matrix[:3, :3].T + matrix[:3, 3]
    aspect = exposure.size[0] / exposure.size[1]
    studio.set_up(scene, [positions[0], placed], aspect, math.radians(subject.azimuth))
    return bpy.context.object


def player(
    morph: bpy.types.Object, count: int, resample: bool, easing: str = "LINEAR"
) -> bpy.types.Object:
    bpy.context.view_layer.objects.active = morph
    bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=count, resample=resample, easing=easing)
    baked = bpy.context.view_layer.objects.active
    made = baked.copy()  # the next bake doesn't replace it
    bpy.context.scene.collection.objects.link(made)
    baked.hide_render = True
    scenery.show_as_solid(made)
    return made


def emptied() -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def compared(out: Path) -> list[Path]:
    """Frames before and after, a row each."""
    scene = emptied()
    morph = morphed(scene, STILL, torn=True)
    players = {"before": player(morph, FRAMES, False), "after": player(morph, FRAMES, True)}
    for shown in players.values():
        versions.set_input(shown.modifiers["Points"], "Radius Scale", DISC)
    studio.develop(scene, STILL)
    made = []
    for name, shown in players.items():
        for other in players.values():
            other.hide_render = other != shown
        stills = []
        for t in TIMES:
            scene.frame_set(1 + round(t * (FRAMES - 1)))
            stills.append(out / f"{name}_{t:.2f}.png")
            studio.photograph(scene, stills[-1])
        made.append(out / f"resampling_{name}.png")
        studio.contact_sheet(stills, [f"{name}, t = {t:g}" for t in TIMES], made[-1])
    return made


def film(out: Path) -> list[Path]:
    """A film with motion blur, and a sheet of its frames; prints how much frames differ."""
    scene = emptied()
    morph = morphed(scene, FRAME, torn=False)
    player(morph, FILM_FRAMES, resample=True, easing="SMOOTH")
    studio.develop(scene, FRAME)
    scene.render.use_motion_blur = True
    frames = []
    for frame in range(1, FILM_FRAMES + 1):
        scene.frame_set(frame)
        frames.append(out / f"film_{frame:04d}.png")
        studio.photograph(scene, frames[-1])
    values = [np.asarray(Image.open(path).convert("RGB"), float) for path in frames]
    changes = [np.abs(b - a).mean() for a, b in itertools.pairwise(values)]
    print("Mean change of a pixel, of 255:", *(f"{change:.2f}" for change in changes))
    made = [out / "resampling.gif", out / "resampling_film.png"]
    studio.film(frames, made[0])
    shown = range(0, FILM_FRAMES - 1, SHOWN)
    captions = [f"frame {k + 1}" for k in shown]
    studio.contact_sheet([frames[k] for k in shown], captions, made[1], COLUMNS)
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=demo.ROOT / "build" / "cracks", metavar="DIR")
    parser.add_argument("--film", action="store_true", help="the film instead")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    addon.register()
    for path in film(out) if arguments.film else compared(out):
        print(path)


if __name__ == "__main__":
    main()
