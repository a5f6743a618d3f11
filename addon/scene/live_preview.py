"""What a mark that is dragged makes of what shows the morph, before it is computed: of the mesh, or
of the points, also as discs."""

from dataclasses import dataclass, replace

import numpy as np
import pointmorph

from ..core import background_job, live_follower, transforms
from ..core.computation import Shape
from ..core.features import Marks, match
from ..data import arrays
from ..data.feature_list import feature_choices, feature_names
from . import feature_marks, marked_points, morph_object, presentation

_SAME = 1e-5  # of the extent: what float32 and a way through matrices leave of a place


@dataclass(frozen=True)
class _Ends:
    """Where the vertices that are seen end by the map, in the morph's frame: `places`. Each is that
    of a point of the source, which `rows` names; None for one after the other. `back` is a matrix
    from that frame to the object's own."""

    places: np.ndarray
    rows: np.ndarray | None
    back: np.ndarray

    def shifted(self, shifts):
        """Where they are, in the object's own space, once source points end so far from there."""
        places = self.places + (shifts if self.rows is None else shifts[self.rows])
        return transforms.move_positions(self.back, places)


def _ends_of(result, shown, earlier):
    """The _Ends of what shows a morph object; None where the map isn't its own."""
    source, target = earlier.request.source, earlier.request.target
    if shown != result:
        back = np.linalg.inv(morph_object.source_matrix_of(shown))
        fits = len(shown.data.vertices) == len(earlier.landing)
        return _Ends(earlier.landing, None, back) if fits else None
    try:
        rows, ends = morph_object.stage_rows(result)
    except pointmorph.CloudError:  # somebody took a key or an attribute away
        return None
    sizes = (len(source.positions), len(target.positions))
    if not len(rows) or (rows.max() + 1, ends.max() + 1) != sizes:
        return None
    return _Ends(target.positions[ends], rows, np.eye(4))


class LivePreview:
    """What shows a morph, so that it can follow a feature and be put back. Only what it has written
    itself is ever put back: a morph that was computed meanwhile stays.

    Parameters
    ----------
    name : str
        Of the object that is seen.
    ends : _Ends
        Of its vertices.
    follower : live_follower.LiveFollower
    features : dict
        Those that are marked now.
    """

    def __init__(self, name, ends, follower, features):
        self.name = name
        self._ends = ends
        self._follower = follower
        self._features = features
        self._before = self._written = None
        self._asked = False
        follower.forget()  # what others have asked for

    def ask(self, name, side, row):
        """Has the morph follow a point feature to a row of the source (0) or the target (1)."""
        self._asked = True
        self._follower.ask({**self._features, name: _moved(self._features[name], side, row)})

    def show(self, objects):
        """Shows the newest answer; whether there was one."""
        answer = self._follower.answer() if self._asked else None
        if answer is None:
            return False
        present = _places(objects, self.name)
        if present is None or len(present) != len(self._ends.places):
            return False
        if self._before is None:
            self._before = present
        elif not np.array_equal(present, self._written):
            return False
        self._written = self._ends.shifted(answer.shifts).astype(np.float32)
        self._write(objects, self._written)
        return True

    def is_shown(self, objects):
        """Whether what is seen is as this has made it."""
        if self._before is None:
            return False
        present = _places(objects, self.name)
        return present is not None and np.array_equal(present, self._written)

    def put_back(self, objects):
        """Shows what was shown before."""
        self.lift(objects)
        self._before = None

    def lift(self, objects):
        """Shows what was shown before, until `lower`."""
        if self.is_shown(objects):
            self._write(objects, self._before)

    def lower(self, objects):
        """Shows the answer again."""
        present = None if self._before is None else _places(objects, self.name)
        if present is not None and np.array_equal(present, self._before):
            self._write(objects, self._written)

    def after(self, other):
        """What is to be kept of this one, where `other` (or None) was shown when it began: it goes
        back to what was there before both."""
        if other is None or other.name != self.name or other._before is None:
            return self
        if self._before is None:
            return other
        self._before = other._before
        return self

    def _write(self, objects, places):
        arrays.write_key(_key(objects, self.name), places)
        objects[self.name].data.update_tag()


def _key(objects, name):
    """The shape key that is shown at the end; None where somebody took it, or the object, away."""
    obj = objects.get(name)
    if obj is None or obj.type != "MESH" or obj.data.shape_keys is None:
        return None
    try:
        return morph_object.last_key(obj)
    except (pointmorph.CloudError, KeyError):
        return None


def _places(objects, name):
    key = _key(objects, name)
    return None if key is None else arrays.key_positions(key).astype(np.float32)


def _moved(feature, side, row):
    if isinstance(feature, pointmorph.Feature):
        return replace(feature, **{("source", "target")[side]: row})
    return (row, feature[1]) if side == 0 else (feature[0], row)


def present_features(settings):
    """What is marked on source and target now, as a morph would be asked for it; None where it
    couldn't be."""
    shapes = []
    for obj in (settings.source, settings.target):
        names = [name for name in feature_names(obj) if name]
        is_mesh = obj.type == "MESH"
        shapes.append(
            Shape(
                name=obj.name,
                positions=arrays.positions_of(obj.data),
                normals=None,
                colors=None,
                radii=None,
                triangles=None,
                marks=Marks(
                    "vertex group" if is_mesh else "point attribute",
                    feature_marks.members(obj, names),
                    *([arrays.mesh_edges(obj.data)] if is_mesh else []),
                ),
            )
        )
    try:
        return match(*shapes, feature_choices(settings))
    except pointmorph.FeatureError:
        return None


def begin(objects, scene, result, name, pending=None):
    """A LivePreview of what a point feature makes of the morph that was computed last; None where
    that isn't what the morph object shows, or other marks belong to it.

    `pending` is a LivePreview that is shown, or None: the morph of its marks is yet to be computed.
    """
    earlier, settings = background_job.earlier, scene.pointmorph
    if result is None or earlier is None or not _is_of(earlier, settings, result):
        return None
    shown = presentation.seen_of(result)
    ends = _ends_of(result, shown, earlier)
    places = _places(objects, shown.name)
    if ends is None or places is None:
        return None
    awaited = pending is not None and pending.name == shown.name and pending.is_shown(objects)
    if not (awaited or _are_same(places, transforms.apply(ends.back, ends.places))):
        return None
    features = present_features(settings)
    if features is None or not (awaited or features == earlier.request.features):
        return None
    feature = features.get(name)
    kind = feature.kind if isinstance(feature, pointmorph.Feature) else "point"
    if feature is None or kind != "point":
        return None
    follower = live_follower.follow(earlier)
    if follower is None or follower.problem is not None:
        return None
    return LivePreview(shown.name, ends, follower, features)


def _is_of(earlier, settings, result):
    """Whether a morph object shows a map of the picked objects that can be bent."""
    return (
        earlier.landing is not None
        and earlier.can_be_bent
        and not result.pointmorph.via
        and presentation.seen_of(result).mode == "OBJECT"
        and all(
            shape.name == obj.name and len(shape.positions) == marked_points.size_of(obj)
            for shape, obj in (
                (earlier.request.source, settings.source),
                (earlier.request.target, settings.target),
            )
        )
    )


def _are_same(places, others):
    if len(places) != len(others):
        return False
    extent = float(np.ptp(others, axis=0).max()) if len(others) else 0.0
    largest = float(np.abs(others).max()) if len(others) else 0.0
    return bool(np.abs(places - others).max() <= _SAME * max(extent, largest))
