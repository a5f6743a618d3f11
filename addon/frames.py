"""Frames of a morph object, each with as many points as it takes: in the scene, and files.

In the scene each frame is a mesh, without faces unless they are asked for, all in one collection
that isn't in the scene; an object of its own shows the one of the present frame, points as a point
cloud.
"""

import contextlib
import os
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np
import pointmorph
import pointmorph.formats
import pointmorph.moving
import pointmorph.sequences

from . import arrays, chains, display, result
from .steps import finish

COLLECTION = "Frames"
_CACHE = "blendcache_"  # what Blender itself calls the folder

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


@dataclass(frozen=True)
class Held:
    """What a morph object holds of its morph, as plain arrays.

    `shapes` are what clouds are made of, `pairs` and `maps` are for each way from a shape to the
    next; no maps where the object has none.
    """

    shapes: list
    pairs: list
    maps: list


def read(obj):
    """What `read_steps` returns, at once."""
    return finish(read_steps(obj))


def read_steps(obj):
    """A generator that yields often and returns what a morph object holds.

    Raises
    ------
    CloudError
        When the object lacks what it was made with.
    """
    mesh = obj.data
    keys, rows = result.stage_keys(obj), result.stage_rows(obj)
    names = result.stage_names(obj)
    shapes, pairs, maps = [], [], []
    for stage, key, row, name in zip(result.stages(obj), keys, rows, names, strict=True):
        yield
        shapes.append({"name": name, **result.read_stage(obj, stage, key, row)})
    for number, (onward, back) in enumerate(result.map_names(obj)):
        yield
        known = onward in mesh.attributes and back in mesh.attributes
        of_ends = zip(rows[number:], (onward, back), strict=False)
        maps.append(
            tuple(arrays.by_row(row, arrays.read_vectors(mesh, name)) for row, name in of_ends)
            if known
            else None
        )
        pairs.append(np.stack(rows[number : number + 2], axis=1))
    return Held(shapes, pairs, maps)


def sequence_of(held, plan, settings, poses=None):
    """The frames of a plan, to be made.

    Parameters
    ----------
    held : Held
    plan : Plan
    settings : dict
        Of the library.
    poses : list, optional
        Of shapes that move: what `poses.read_steps` returned.
    """
    clouds = [pointmorph.Cloud(**shape) for shape in held.shapes]
    ways = zip(pairwise(clouds), held.pairs, held.maps, strict=True)
    morphs = [pointmorph.restore(*ends, pairs, maps, **settings) for ends, pairs, maps in ways]
    morph = morphs[0] if len(morphs) == 1 else chains.ChainedMorph(morphs)
    numbers = {"first": plan.first, "step": plan.step}
    if poses is not None:
        return pointmorph.moving.MovingSequence(
            morph, plan.times(), poses, settings, **numbers, resample=plan.resample
        )
    kind = pointmorph.sequences.FrameSequence if plan.resample else _Pairs
    return kind(morph, plan.times(), **numbers)


class _Pairs(pointmorph.sequences.FrameSequence):
    """Frames without new points, which have ids and velocities all the same."""

    def _at(self, t, stopped):
        resampled, frame = super()._at(t, stopped), self.morph.frame(t)
        own = resampled.ids < len(frame.positions)
        velocities = np.zeros_like(frame.positions)
        velocities[resampled.ids[own]] = resampled.velocities[own]
        ids = np.arange(len(frame.positions), dtype=np.int32)
        return pointmorph.ResampledFrame(**vars(frame), ids=ids, velocities=velocities)


def make_folder(path):
    """The folder of that name, made when it isn't there. Raises FileError."""
    folder = Path(bpy.path.abspath(path))
    pointmorph.formats.make_folder(folder)
    return folder


# --- Until all are there --------------------------------------------------------------------------


def file_path(folder, name, kind):
    """The file that frames of the object `name` go to."""
    return folder / f"{bpy.path.clean_name(name)}.{SUFFIXES[kind]}"


def store_folder(name, path=None):
    """Where frames wait until all are there: beside the file, or in the folder that Blender keeps
    caches of this file in.

    Where there is none, as for a file that was never saved, frames wait as long as Blender runs.
    """
    if path is not None:
        return path.with_name(f"{path.name}.frames")
    own = f"{bpy.path.clean_name(name)}.frames"
    if bpy.data.filepath:
        file = Path(bpy.data.filepath)
        folder = file.with_name(f"{_CACHE}{file.stem}")
        with contextlib.suppress(OSError):
            folder.mkdir(exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder / own
    return Path(bpy.app.tempdir) / own


def empty(store):
    """Removes a store of frames that are in the scene, or in their file, by now."""
    store.remove()
    if store.folder.parent.name.startswith(_CACHE):
        with contextlib.suppress(OSError):  # something else is there
            store.folder.parent.rmdir()


# --- In the scene ---------------------------------------------------------------------------------


def build(context, name, matrix, plan, frames, kind="SCENE"):
    """Makes the object that shows the frames of the object `name`, with the matrix that this had;
    all of it or nothing. Returns the object.

    `kind` is the format that it's for.
    """
    name = f"{name} {COLLECTION}"
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
            arrays.activate_colors(mesh, display.COLOR)
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
        player.matrix_world = matrix
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
