"""Keeps the list of features in step with the objects, and forgets what undo or a file overtook."""

import bpy
from bpy.app.handlers import persistent

from . import cuts, previewing, session
from .properties import sync_features


@persistent
def _sync(*_):
    for scene in bpy.data.scenes:
        if scene.library is None:
            sync_features(scene)


@persistent
def _start_anew(*_):
    """What is remembered about the file that was open before doesn't hold for another state."""
    session.problem = None
    session.overtake()
    cuts.shown.clear()
    previewing.remove_left_over()


_events = ("depsgraph_update_post", "load_post", "undo_post", "redo_post")


_other_states = ("load_post", "undo_post", "redo_post")


def register():
    for event in _events:
        getattr(bpy.app.handlers, event).append(_sync)
    for event in _other_states:
        getattr(bpy.app.handlers, event).append(_start_anew)


def unregister():
    for event in _other_states:
        getattr(bpy.app.handlers, event).remove(_start_anew)
    for event in _events:
        getattr(bpy.app.handlers, event).remove(_sync)
