"""The files that hold frames for the Mesh Cache modifier, and how long each stays.

A file is never written again: every bake has one of its own, so that undo, a file that is closed
without saving, and other versions of it show what they did. What nothing shows any longer goes when
the .blend file is saved.
"""

import contextlib
import os
import re
import shutil
from pathlib import Path

import bpy
import pointmorph
import pointmorph.storage.files

from ..core import background_job
from ..data import areas
from ..data.registration import Registration
from . import frame_files, frame_players

NAME = "Frames"
MODIFIER = "Mesh Cache"
OF = "pointmorph_frames_of"
"""On an object that shows frames: the morph object that they are of."""
_OWN_NAME = re.compile(rf"_{NAME}(_\d+)?\.pc2$")

_changed = []  # while a file is being saved: (an object, its file before, as it had it in words)
_moved = {}  # in this session: where the files of frames went that were temporary


def new_path(name):
    """A file that there isn't yet, for frames of the object `name`. Raises FileError."""
    return _free(frame_files.cache_path(f"{name} {NAME}"))


def path_of(obj):
    """The file that an object shows, or None."""
    cache = obj.modifiers.get(MODIFIER)
    if cache is None or cache.type != "MESH_CACHE" or not cache.filepath:
        return None
    return _absolute(cache, obj)


def _absolute(cache, obj):
    path = bpy.path.abspath(cache.filepath, library=obj.library)
    return Path(os.path.normpath(path))  # as it is compared with others


def relative(path):
    """As Blender keeps it: it moves along with the .blend file."""
    if not bpy.data.filepath or _is_in_temporary(path):
        return str(path)
    with contextlib.suppress(ValueError):  # another drive
        return bpy.path.relpath(str(path))
    return str(path)


def is_temporary(player):
    """Whether frames are gone when Blender ends, unless the file is saved."""
    path = path_of(player)
    return path is not None and _is_in_temporary(path)


def _is_in_temporary(path):
    return path.is_relative_to(bpy.app.tempdir)


def _free(path, besides=()):
    """That path, or one with a number, where there is no file yet."""
    tried, number = path, 0
    while tried in besides or os.path.lexists(tried):
        number += 1
        tried = path.with_name(f"{path.stem}_{number}{path.suffix}")
    return tried


# --- When a file is saved -------------------------------------------------------------------------


def _before_saving(path, *_):
    """Frames go beside the .blend file that shows them: those that were baked in a file that had
    never been saved, and those of the file that this one is another version of."""
    _changed.clear()
    if not path:
        return
    frame_players.forget_deleted(OF)
    folder = frame_files.cache_folder(path)
    for old, players in _by_file().items():
        if not _belongs_elsewhere(old, folder):
            continue
        try:
            new = _copied(old, folder)
        except (OSError, pointmorph.PointmorphError) as error:
            said = (
                f"Frames stay in {old}, because {folder} can't store them: {error}. Free some space"
            )
            background_job.problem = ("MORPH", f"{said} and save again")
            areas.redraw_sidebars()
            continue
        for player in players:
            cache = player.modifiers[MODIFIER]
            _changed.append((player, old, cache.filepath))
            if bpy.data.filepath:
                cache.filepath = relative(new)  # Blender makes it relative to the new folder
            else:
                cache.filepath = f"//{folder.name}/{new.name}"


def _by_file():
    """By file, the objects of this .blend file that show frames from there."""
    found = {}
    for obj in bpy.data.objects:
        # What it points at may have been deleted.
        if obj.library is None and OF in obj and (path := path_of(obj)) is not None:
            found.setdefault(path, []).append(obj)
    return found


def _belongs_elsewhere(path, folder):
    """Whether a file is to have a copy in `folder`, where the frames of a .blend file are."""
    if path.parent == folder or not path.is_file():
        return False
    of_other = frame_files.is_cache_folder(path.parent) and _OWN_NAME.search(path.name)
    return _is_in_temporary(path) or bool(of_other)


def _copied(old, folder):
    """The same frames in a folder: by another name of the file where the disk has such, since
    nothing ever writes to it."""
    pointmorph.storage.files.make_folder(folder)
    new = _free(folder / re.sub(r"(_\d+)?\.pc2$", ".pc2", old.name))
    part = new.with_name(f".{new.name}.part")
    part.unlink(missing_ok=True)
    try:
        try:
            os.link(old, part)
        except OSError:
            shutil.copyfile(old, part)
        pointmorph.storage.files.replace(part, new)
    finally:
        part.unlink(missing_ok=True)
    return new


def _after_saving(path, *_):
    """What is open stays as it is if a copy was saved; what nothing shows any longer goes."""
    if not path:
        return
    if not bpy.data.filepath or Path(bpy.data.filepath) != Path(path):
        _take_back()
        return
    for player, old, _ in _changed:
        if _is_in_temporary(old):
            _moved[old] = path_of(player)
            with contextlib.suppress(OSError):
                old.unlink(missing_ok=True)
    _changed.clear()
    _remove_unused(frame_files.cache_folder(path))


def _take_back(*_):
    """Objects show the files that they did before saving."""
    for player, _, before in _changed:
        player.modifiers[MODIFIER].filepath = before
    _changed.clear()


def _remove_unused(folder):
    """Removes files of frames that nothing in the .blend file shows, from its own folder."""
    shown = set()
    for obj in bpy.data.objects:
        for modifier in obj.modifiers if obj.users else ():
            if modifier.type == "MESH_CACHE":
                shown.add(_absolute(modifier, obj).name)
    with contextlib.suppress(OSError):
        for path in list(folder.iterdir()):
            if _OWN_NAME.search(path.name) and path.name not in shown:
                with contextlib.suppress(OSError):  # somebody reads it
                    path.unlink()
        frame_files.remove_empty(folder)


def _after_undo(*_):
    """What was temporary before the file was saved is beside it now."""
    for path, players in _by_file().items() if _moved else ():
        new = _moved.get(path)
        if new is not None and not path.exists():
            for player in players:
                player.modifiers[MODIFIER].filepath = relative(new)


registration = Registration(
    handlers=(
        ("save_pre", _before_saving),
        ("save_post", _after_saving),
        ("save_post_fail", _take_back),
        ("undo_post", _after_undo),
        ("redo_post", _after_undo),
    ),
)
