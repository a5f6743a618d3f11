"""Where frames wait until all are there, and the files that they go to."""

import contextlib
import os
from pathlib import Path

import bpy
import pointmorph
import pointmorph.storage.files

from ..data import creation
from . import frames_display

_CACHE = "blendcache_"  # what Blender itself calls the folder


def make_folder(path):
    """The folder of that name, made when it isn't there. Raises FileError, OptionError."""
    if path.startswith("//") and not bpy.data.filepath:
        raise pointmorph.OptionError(
            "Folder",
            "a folder beside the saved file",
            f"{path} in a file that was never saved",
            "Save the file, or choose another folder.",
        )
    folder = Path(bpy.path.abspath(path))
    pointmorph.storage.files.make_folder(folder)
    return folder


# --- Until all are there --------------------------------------------------------------------------


def file_path(folder, name, suffix):
    """The file that frames of the object `name` go to."""
    return folder / f"{bpy.path.clean_name(name)}.{suffix}"


def store_folder(name, path=None):
    """Where frames wait until all are there: beside the file, or in the folder that Blender keeps
    caches of this file in.

    Where there is none, as for a file that was never saved, frames wait as long as Blender runs.
    """
    if path is not None:
        return path.with_name(f"{path.name}.frames")
    own = f"{bpy.path.clean_name(name)}.frames"
    if bpy.data.filepath:
        folder = cache_folder(bpy.data.filepath)
        with contextlib.suppress(OSError):
            folder.mkdir(exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder / own
    return Path(bpy.app.tempdir) / own


def cache_path(name):
    """The file that Blender reads the frames of the object `name` from. For a file that was never
    saved, it's where it stays until that is saved: see `cache_files`."""
    file = f"{bpy.path.clean_name(name)}.pc2"
    if bpy.data.filepath:
        folder = cache_folder(bpy.data.filepath)
        pointmorph.storage.files.make_folder(folder)
        return folder / file
    return Path(bpy.app.tempdir) / file


def cache_folder(path):
    """Where Blender keeps the caches of a file."""
    return Path(path).with_name(f"{_CACHE}{Path(path).stem}")


def empty(store):
    """Removes a store of frames that are in the scene, or in their file, by now."""
    store.remove()
    if is_cache_folder(store.folder.parent):
        remove_empty(store.folder.parent)


def is_cache_folder(folder):
    """Whether Blender keeps the caches of some file there."""
    return folder.name.startswith(_CACHE)


def remove_empty(folder):
    """Removes a folder unless something is there."""
    with contextlib.suppress(OSError):
        folder.rmdir()


def export(context, player, plan, path, target):
    """Writes the frames that `player` shows as one file of that format. Raises FileError."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    as_vertices = target.content(plan.faces).as_vertices
    try:
        with _shown_alone(context, player, plan, as_vertices):
            target.write(temporary, plan.first, plan.last)
        if not temporary.is_file():
            raise pointmorph.FileError(
                str(path),
                "a file that can be written",
                "none",
                "Choose another folder.",
            )
        with _let_go(path):
            pointmorph.storage.files.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        raise pointmorph.FileError(
            str(path), "a file that can be written", str(error).strip(), "Choose another folder."
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _let_go(path):
    """While a file is replaced, no object of this Blender reads it: Windows replaces no open file.
    They read the new one afterward."""
    readers = [
        (cache, cache.filepath)
        for cache in bpy.data.cache_files
        if Path(bpy.path.abspath(cache.filepath, library=cache.library)) == path
    ]
    for cache, _ in readers:
        cache.filepath = ""
    bpy.context.view_layer.update()
    try:
        yield
    finally:
        for cache, was in readers:
            cache.filepath = was


@contextlib.contextmanager
def _shown_alone(context, player, plan, as_vertices):
    """What exporters look at: the player as the only selected object, and the plan's frames."""
    scene = context.scene
    was = scene.frame_start, scene.frame_end, scene.frame_current
    selected = [o for o in context.view_layer.objects if o.select_get()]
    shown = frames_display.frames_as_vertices(player) if as_vertices else player
    if shown is not player:
        creation.link(context, shown)
    try:
        for other in selected:
            other.select_set(False)
        shown.select_set(True)
        scene.frame_start, scene.frame_end = plan.first, plan.last
        yield
    finally:
        scene.frame_start, scene.frame_end = was[:2]
        scene.frame_set(was[2])
        shown.select_set(False)
        if shown is not player:
            bpy.data.batch_remove([shown, shown.data])
        for other in selected:
            other.select_set(True)
