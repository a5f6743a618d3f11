"""Keeps the list of features in step with the objects, and forgets what undo or a file overtook."""

import bpy

from ..core import background_job, done_steps
from ..data.feature_list import sync_features
from ..data.registration import Registration
from ..operators import polls
from ..scene import cached_frames, preview_object, stagger
from ..view import cut_curves

_OTHER_STATES = ("load_post", "undo_post", "redo_post")


def _sync(*_):
    for scene in bpy.data.scenes:
        if scene.library is None:
            sync_features(scene)


def _start_anew(*_):
    """What is remembered about the file that was open before doesn't hold for another state."""
    background_job.problem = None
    background_job.overtake()
    cut_curves.shown.clear()
    preview_object.remove_left_over()


def _forget_steps(*_):
    done_steps.forget()


registration = Registration(
    handlers=(
        ("load_post", _forget_steps),
        ("depsgraph_update_post", _sync),
        ("depsgraph_update_post", stagger.share_changes),
        ("depsgraph_update_post", cached_frames.separate_copies),
        *((event, _sync) for event in _OTHER_STATES),
        *((event, _start_anew) for event in _OTHER_STATES),
        *((event, polls.forget_results) for event in _OTHER_STATES),
    ),
)
