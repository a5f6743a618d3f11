"""Frames of a morph object, each with as many points as it takes: in the scene, and files.

In the scene each frame is a mesh without faces, all in one collection that isn't in the scene; an
object of its own shows the one of the present frame as a point cloud.
"""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import pointmorph
import pointmorph.sequences

from . import arrays, chains, display, result

COLLECTION = "Frames"

EASINGS = {
    "LINEAR": lambda x: x,
    "SMOOTH": lambda x: x * x * (3.0 - 2.0 * x),
}

SUFFIXES = {"USD": "usdc", "ALEMBIC": "abc"}
LOSSES = {
    "USD": "USD keeps positions, radius and colour: normals and material are lost",
    "ALEMBIC": "Alembic keeps positions only: colour, normal and radius are lost",
}

_USD_WITH_POINTS = (4, 5, 0)


@dataclass(frozen=True)
class Plan:
    """Which frames there are."""

    first: int
    last: int
    step: int
    easing: str
    resample: bool

    def numbers(self):
        return range(self.first, self.last + 1, self.step)

    def times(self):
        """t of every frame: 0 at the first, 1 at the last of the range, whole steps or not."""
        ease = EASINGS[self.easing]
        length = self.last - self.first
        return [float(ease((number - self.first) / length)) for number in self.numbers()]


def read_morph(obj, settings):
    """The morph that a morph object remembers, with settings of the library.

    Raises
    ------
    CloudError
        When the object lacks what it was made with, or follows shapes that move.
    """
    result.check_at_rest(obj, "frames")
    mesh = obj.data
    stages, keys = result.stages(obj), result.stage_keys(obj)
    rows = result.stage_rows(obj)
    clouds = []
    for stage, key, row, name in zip(stages, keys, rows, result.stage_names(obj), strict=True):
        values = {
            "positions": arrays.key_positions(key),
            "normals": arrays.read_vectors(mesh, f"{stage}_normal"),
            "colors": arrays.read_attribute(mesh.attributes[f"{stage}_color"]),
            "radii": arrays.read_attribute(mesh.attributes[f"{stage}_radius"]),
        }
        by_point = {what: arrays.by_row(row, array) for what, array in values.items()}
        clouds.append(pointmorph.Cloud(**by_point, name=name))
    morphs = []
    for number, (onward, back) in enumerate(result.map_names(obj)):
        maps = None
        if onward in mesh.attributes and back in mesh.attributes:
            maps = tuple(
                arrays.by_row(row, arrays.read_vectors(mesh, name))
                for row, name in zip(rows[number:], (onward, back), strict=False)
            )
        pairs = np.stack(rows[number : number + 2], axis=1)
        morphs.append(pointmorph.restore(*clouds[number : number + 2], pairs, maps, **settings))
    return morphs[0] if len(morphs) == 1 else chains.ChainedMorph(morphs)


def compute(morph, plan, progress):
    """All frames, for the scene: `ResampledFrame`s, or what stands for them without new points."""
    morph.inserted(progress)
    times = plan.times()
    frames = []
    for done, t in enumerate(times):
        if progress("frames", done / len(times)) is False:
            raise pointmorph.Cancelled("The frames were cancelled.")
        frames.append(_frame(morph, t, plan.resample))
    return frames


def _frame(morph, t, resample):
    frame = morph.resampled_frame(t)
    if resample:
        return frame
    pairs = len(morph.pairs)
    plain = {name: getattr(frame, name)[:pairs] for name in ("ids", "velocities")}
    return pointmorph.ResampledFrame(**vars(morph.frame(t)), **plain)


def write_files(morph, plan, folder, progress):
    """PLY files, as the command line writes them; an interrupted bake goes on."""
    return pointmorph.sequences.write_frames(
        morph,
        folder,
        plan.times(),
        first=plan.first,
        step=plan.step,
        resample=plan.resample,
        resume=True,
        progress=progress,
    )


def make_folder(path):
    """The folder of that name, made when it isn't there. Raises FileError."""
    folder = Path(bpy.path.abspath(path))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise pointmorph.FileError(
            str(folder),
            "a folder that can be made",
            error.strerror or str(error),
            "Choose another.",
        ) from error
    return folder


# --- In the scene ---------------------------------------------------------------------------------


def build(context, obj, plan, frames):
    """Makes the object that shows the frames; all of it or nothing. Returns the object."""
    name = f"{obj.name} {COLLECTION}"
    # Velocity by t, to that by frame.
    times = np.array(plan.times())
    grows = np.gradient(times) / plan.step if len(times) > 1 else np.zeros(1)
    with result.all_or_nothing() as created:
        collection = bpy.data.collections.new(name)
        created(collection)
        for number, (frame, grow) in enumerate(zip(frames, grows, strict=True)):
            # In the order of their names: that of the instances.
            mesh = bpy.data.meshes.new(f"{name} {number:06d}")
            created(mesh)
            arrays.fill_mesh(mesh, frame.positions)
            arrays.write_attribute(mesh, display.COLOR, frame.colors)
            arrays.write_attribute(mesh, display.NORMAL, frame.normals)
            arrays.write_attribute(mesh, display.RADIUS, frame.radii)
            arrays.write_attribute(mesh, display.VELOCITY, (frame.velocities * grow))
            arrays.write_attribute(mesh, "id", frame.ids)
            one = bpy.data.objects.new(mesh.name, mesh)
            created(one)
            collection.objects.link(one)
        cloud = bpy.data.pointclouds.new(name)
        created(cloud)
        player = bpy.data.objects.new(name, cloud)
        created(player)
        player.matrix_world = obj.matrix_world
        display.add_frames_modifier(player, collection, plan, created)
        context.collection.objects.link(player)
    return player


def check_format(kind):
    """Raises OptionError when this Blender can't write point clouds that way."""
    version = "Blender " + ".".join(map(str, bpy.app.version[:2]))
    if kind == "USD" and bpy.app.version < _USD_WITH_POINTS:
        raise pointmorph.OptionError(
            "format",
            "Blender 4.5 or later for USD",
            version,
            "Bake PLY, or Alembic without colours.",
        )
    if kind == "ALEMBIC" and "alembic_export" not in dir(bpy.ops.wm):
        raise pointmorph.OptionError(
            "format", "a Blender with Alembic", f"{version} built without it", "Bake PLY."
        )


def export(context, player, plan, path, kind):
    """Writes the frames that `player` shows as one USD or Alembic file. Raises FileError."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    scene = context.scene
    was = scene.frame_start, scene.frame_end, scene.frame_current
    selected = [o for o in context.view_layer.objects if o.select_get()]
    shown = display.frames_as_vertices(player) if kind == "ALEMBIC" else player
    if shown is not player:
        context.collection.objects.link(shown)
    try:
        for other in selected:
            other.select_set(False)
        shown.select_set(True)
        scene.frame_start, scene.frame_end = plan.first, plan.last
        if kind == "USD":
            bpy.ops.wm.usd_export(
                filepath=str(temporary), selected_objects_only=True, export_animation=True
            )
        else:
            bpy.ops.wm.alembic_export(
                filepath=str(temporary),
                start=plan.first,
                end=plan.last,
                selected=True,
                as_background_job=False,
            )
        if not temporary.is_file():
            raise pointmorph.FileError(
                str(path), "a place that can be written", "nothing written", "Choose another."
            )
        temporary.replace(path)
    except (OSError, RuntimeError) as error:
        raise pointmorph.FileError(
            str(path), "a place that can be written", str(error).strip(), "Choose another."
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
        scene.frame_start, scene.frame_end = was[:2]
        scene.frame_set(was[2])
        shown.select_set(False)
        if shown is not player:
            bpy.data.batch_remove([shown, shown.data])
        for other in selected:
            other.select_set(True)


def remove(player):
    """Takes the frames out of the file again."""
    collection = display.frames_collection(player)
    objects = list(collection.objects)
    meshes = [one.data for one in objects]
    bpy.data.batch_remove([player, player.data, *objects, *meshes, collection])
