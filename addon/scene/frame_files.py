"""Where frames wait until all are there, and the files that they go to."""

import contextlib
import os
from pathlib import Path

import bpy
import pointmorph
import pointmorph.formats
import pointmorph.moving
import pointmorph.sequences

from ..data import attribute_names, versions
from . import frames_display

_CACHE = "blendcache_"  # what Blender itself calls the folder
SUFFIXES = {"USD": "usdc", "ALEMBIC": "abc"}
# By format and whether there are faces.
_LOSSES = {
    (
        "USD",
        False,
    ): f'the material and the attribute id, which stands under "{attribute_names.FILE_ID}"',
    ("USD", True): "nothing but custom names of the material's nodes",
    ("ALEMBIC", False): "colour, normal, radius and id",
    ("ALEMBIC", True): "the material; colours have 8 bits a channel",
}
_USD_WITH_POINTS = (4, 5)


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


def losses(kind, faces):
    """What a file of that kind doesn't keep, in words."""
    return f"{kind.capitalize() if kind == 'ALEMBIC' else kind} loses {_LOSSES[kind, faces]}"


def check_format(kind, faces):
    """Raises OptionError when this Blender can't write points, or meshes, that way."""
    if kind == "USD" and not faces and not versions.is_at_least(*_USD_WITH_POINTS):
        raise pointmorph.OptionError(
            "format",
            "Blender 4.5 or later for USD",
            versions.name(),
            "Bake PLY, or Alembic without colours.",
        )
    if kind == "ALEMBIC" and "alembic_export" not in dir(bpy.ops.wm):
        raise pointmorph.OptionError(
            "format", "a Blender with Alembic", f"{versions.name()} built without it", "Bake PLY."
        )


def export(context, player, plan, path, kind):
    """Writes the frames that `player` shows as one USD or Alembic file. Raises FileError."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    scene = context.scene
    was = scene.frame_start, scene.frame_end, scene.frame_current
    selected = [o for o in context.view_layer.objects if o.select_get()]
    as_vertices = kind == "ALEMBIC" and not plan.faces
    shown = frames_display.frames_as_vertices(player) if as_vertices else player
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
