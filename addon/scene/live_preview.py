"""What a mark that is dragged makes of the mesh that shows the morph, before it is computed."""

from dataclasses import replace

import numpy as np
import pointmorph

from ..core import background_job, live_follower, transforms
from ..data import arrays
from . import marked_points, morph_object


class LivePreview:
    """The mesh that shows a morph, so that it can follow a feature and be put back.

    Parameters
    ----------
    result : Object
        The morph object of pairs.
    follower : live_follower.LiveFollower
    """

    def __init__(self, result, follower):
        self._name = morph_object.shown_of(result).name
        self._back = np.linalg.inv(morph_object.source_matrix_of(result))
        self._follower = follower
        self._before = None

    def ask(self, name, side, row):
        """Has the morph follow a point feature to a row of the source (0) or the target (1)."""
        features = self._follower.earlier.request.features
        self._follower.ask({**features, name: _moved(features[name], side, row)})

    def show(self, objects):
        """Shows the newest answer; whether there was one."""
        answer = self._follower.answer()
        if answer is None:
            return False
        key = morph_object.last_key(objects[self._name])
        if self._before is None:
            self._before = arrays.key_positions(key)
        places = self._follower.earlier.landing + answer.shifts
        self._write(objects, transforms.move_positions(self._back, places))
        return True

    def put_back(self, objects):
        """Shows what was shown before."""
        if self._before is not None:
            self._write(objects, self._before)
            self._before = None

    def _write(self, objects, places):
        mesh = objects[self._name].data
        arrays.write_key(morph_object.last_key(objects[self._name]), places)
        mesh.update_tag()


def _moved(feature, side, row):
    if isinstance(feature, pointmorph.Feature):
        return replace(feature, **{("source", "target")[side]: row})
    return (row, feature[1]) if side == 0 else (feature[0], row)


def follower_of(scene, result):
    """The LiveFollower of what was computed last, if that is what the morph object shows with the
    source's faces; else None."""
    earlier = background_job.earlier
    if result is None or earlier is None or earlier.landing is None or not earlier.can_be_bent:
        return None
    settings, request = scene.pointmorph, earlier.request
    shown = morph_object.shown_of(result)
    fits = (
        shown != result
        and not result.pointmorph.via
        and shown.mode == "OBJECT"
        and len(shown.data.vertices) == len(earlier.landing)
        and all(
            shape.name == obj.name and len(shape.positions) == marked_points.size_of(obj)
            for shape, obj in (
                (request.source, settings.source),
                (request.target, settings.target),
            )
        )
    )
    return live_follower.follow(earlier) if fits else None


def can_follow(follower, name):
    """Whether a feature is a point of the map that is followed."""
    if follower is None or follower.problem is not None:
        return False
    feature = follower.earlier.request.features.get(name)
    kind = feature.kind if isinstance(feature, pointmorph.Feature) else "point"
    return feature is not None and kind == "point"
