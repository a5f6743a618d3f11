"""Keeps the list of features in step with the objects, and forgets what undo or a file overtook."""

import bpy

from ..core import background_job, done_steps
from ..data.feature_list import sync_features
from ..data.registration import Registration, on_other_states
from ..operators import polls
from ..scene import cached_frames, preview_object, stagger
from ..view import cut_curves


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
        *on_other_states(_sync),
        *on_other_states(_start_anew),
        *on_other_states(polls.forget_results),
    ),
)
