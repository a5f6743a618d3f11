"""Keeps the list of features in step with what is marked on the objects."""

import bpy
from bpy.app.handlers import persistent

from .properties import sync_features


@persistent
def _sync(*_):
    for scene in bpy.data.scenes:
        if scene.library is None:
            sync_features(scene)


_events = ("depsgraph_update_post", "load_post", "undo_post", "redo_post")


def register():
    for event in _events:
        getattr(bpy.app.handlers, event).append(_sync)


def unregister():
    for event in _events:
        getattr(bpy.app.handlers, event).remove(_sync)
