"""Frames of a morph object, each with as many points as it takes: in the scene, and files.

In the scene each frame is a mesh, without faces unless they are asked for, all in one collection
that isn't in the scene; an object of its own shows the one of the present frame, points as a point
cloud.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
import pointmorph
import pointmorph.sequences
import pointmorph.surfaces

from . import arrays, chains, display, result

COLLECTION = "Frames"

EASINGS = {
    "LINEAR": lambda x: x,
    "SMOOTH": lambda x: x * x * (3.0 - 2.0 * x),
}

SUFFIXES = {"USD": "usdc", "ALEMBIC": "abc"}
# By format and whether there are faces.
_LOSSES = {
    ("USD", False): f'the material and the attribute id, which stands under "{display.FILE_ID}"',
    ("USD", True): "nothing but custom names of the material's nodes",
    ("ALEMBIC", False): "colour, normal, radius and id",
    ("ALEMBIC", True): "the material; colours have 8 bits a channel",
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
    faces: bool

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
    """All frames, for the scene: `ResampledFrame`s, what stands for them without new points, or
    `Surface`s; velocities are by frame."""
    morph.inserted(progress)
    through = pointmorph.surfaces.Surfaces(morph).through if plan.faces else None
    times = plan.times()
    grows = np.gradient(np.array(times)) / plan.step if len(times) > 1 else np.zeros(1)

    def make(k, stopped):
        frame = _frame(morph, times[k], plan.resample, stopped)
        by_frame = (frame.velocities * grows[k]).astype(frame.positions.dtype)
        frame = replace(frame, velocities=by_frame)
        return through(frame, times[k], stopped) if through else frame

    return list(pointmorph.sequences.in_order(make, len(times), progress))


def _frame(morph, t, resample, stopped):
    frame = morph.resampled_frame(t, lambda *_: not stopped())
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
        mesh="ply" if plan.faces else None,
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


def build(context, obj, plan, frames, kind="SCENE"):
    """Makes the object that shows the frames; all of it or nothing. Returns the object.

    `kind` is the format that it's for.
    """
    name = f"{obj.name} {COLLECTION}"
    with result.all_or_nothing() as created:
        collection = bpy.data.collections.new(name)
        created(collection)
        for number, frame in enumerate(frames):
            # In the order of their names: that of the instances.
            mesh = bpy.data.meshes.new(f"{name} {number:06d}")
            created(mesh)
            arrays.fill_mesh(mesh, frame.positions, frame.faces if plan.faces else None)
            arrays.write_attribute(mesh, display.VELOCITY, frame.velocities)
            if plan.faces and kind == "ALEMBIC":
                arrays.write_corner_colors(mesh, display.COLOR, frame.colors)
            else:
                arrays.write_attribute(mesh, display.COLOR, frame.colors)
            if not plan.faces:
                arrays.write_attribute(mesh, display.NORMAL, frame.normals)
                arrays.write_attribute(mesh, display.RADIUS, frame.radii)
                # Blender's USD loses an attribute "id".
                id_name = display.FILE_ID if kind == "USD" else "id"
                arrays.write_attribute(mesh, id_name, frame.ids)
            one = bpy.data.objects.new(mesh.name, mesh)
            created(one)
            collection.objects.link(one)
        data = (bpy.data.meshes if plan.faces else bpy.data.pointclouds).new(name)
        created(data)
        player = bpy.data.objects.new(name, data)
        created(player)
        player.matrix_world = obj.matrix_world
        display.add_frames_modifier(player, collection, plan, created)
        context.collection.objects.link(player)
    return player


def losses(kind, faces):
    """What a file of that kind doesn't keep, in words."""
    return f"{kind.capitalize() if kind == 'ALEMBIC' else kind} loses {_LOSSES[kind, faces]}"


def check_format(kind, faces):
    """Raises OptionError when this Blender can't write points, or meshes, that way."""
    version = "Blender " + ".".join(map(str, bpy.app.version[:2]))
    if kind == "USD" and not faces and bpy.app.version < _USD_WITH_POINTS:
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
    as_vertices = kind == "ALEMBIC" and not plan.faces
    shown = display.frames_as_vertices(player) if as_vertices else player
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
                vcolors=True,
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
