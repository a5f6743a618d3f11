"""Features of one side, marked on the other side as well."""

import bpy
import numpy as np
import pointmorph
import pointmorph.meshes

from ..data import arrays
from ..data.feature_list import CHOSEN, feature_names, sync_features
from ..data.registration import Registration
from ..scene import feature_marks
from .polls import Explained, fail, shapes_reason

_MIDDLE = 0.01  # of the diagonal: what lies nearer to the middle has no other side
_OFF = 0.05  # of the diagonal: farther from the mirrored place there is no vertex for it


class POINTMORPH_OT_mirror_features(Explained, bpy.types.Operator):
    """Mark the same place on the other side of both objects, across their own X axis: ear.L is
    mirrored to ear.R. A feature without a side in its name gets one"""

    bl_idname = "pointmorph.mirror_features"
    bl_label = "Mirror Features"
    bl_options = {"REGISTER", "UNDO"}

    all_features: bpy.props.BoolProperty(
        name="All",
        description="Mirror all features whose other side isn't marked yet, not only the "
        "selected one",
        default=False,
    )

    @staticmethod
    def reason(context):
        reason = shapes_reason(context) or feature_marks.unmarkable(context)
        if reason is None and not len(context.scene.pointmorph.features):
            reason = "There are no features yet"
        return reason

    def execute(self, context):
        settings = context.scene.pointmorph
        sync_features(context.scene)
        objects = (settings.source, settings.target)
        names = [feature.marked_name for feature in settings.features]
        if not self.all_features:
            names = names[min(max(settings.active_feature, 0), len(names) - 1) :][:1]
        else:
            names = [name for name in names if bpy.utils.flip_name(name) not in names]
        if not names:
            return self._stay("every feature with a side in its name already has a counterpart")
        found = [Mirrored(obj, [n for n in names if n in feature_names(obj)]) for obj in objects]
        count, refused = 0, False
        for name in names:
            sides = [side for side in found if name in side.rows]
            try:
                if not _is_to_be_mirrored(name, sides):
                    continue
                self._mirror(settings, name, sides)
            except pointmorph.PointmorphError as error:
                if not self.all_features:
                    return fail(self, error)
                self.report({"WARNING"}, str(error))
                refused = True
                continue
            count += 1
        sync_features(context.scene)
        if count == 0 and not refused:
            which = "the features lie" if len(names) > 1 else f'"{names[0]}" lies'
            return self._stay(f"{which} in the middle")
        self.report({"INFO"}, f"Features mirrored: {count}")
        return {"FINISHED"}

    def _stay(self, why):
        self.report({"INFO"}, f"Nothing to mirror: {why}")
        return {"CANCELLED"}

    def _mirror(self, settings, name, sides):
        mirrored = [(side.obj, *side.mirrored(name)) for side in sides]
        this, other = name, bpy.utils.flip_name(name)
        if other == name:
            this, other = (f"{name}.{side}" for side in ("LR" if sides[0].is_left(name) else "RL"))
            taken = {feature.marked_name for feature in settings.features}
            if this in taken:
                raise pointmorph.FeatureError(
                    f'feature "{name}"', f'no "{this}" yet', "one", "Rename one of them."
                )
            settings.features[name].name = this
        replaced = [obj.name for obj, *_ in mirrored if other in feature_names(obj)]
        for obj, rows, weights in mirrored:
            feature_marks.mark(obj, other, rows, weights)
        sync_features(settings.id_data)
        chosen = settings.features[this]
        for what in CHOSEN:
            setattr(settings.features[other], what, getattr(chosen, what))
        settings.features[other].confidence = -1.0
        if replaced:
            on = " and ".join(f'"{name}"' for name in replaced)
            self.report({"INFO"}, f'"{other}" was marked on {on} before: its mark was replaced')


def _is_to_be_mirrored(name, sides):
    """Whether a feature has another side than its own.

    Raises
    ------
    FeatureError
        Where it marks no point on an object, or lies in the middle of one object only.
    """
    for side in sides:
        if not len(side.rows[name]):
            raise pointmorph.FeatureError(
                f'feature "{name}"',
                f'marked points on "{side.obj.name}"',
                "none",
                "Mark it there, or remove it.",
            )
    in_the_middle = [side.is_in_the_middle(name) for side in sides]
    if any(in_the_middle) and not all(in_the_middle):
        one = sides[in_the_middle.index(True)].obj.name
        raise pointmorph.FeatureError(
            f'feature "{name}"',
            "a mark in the middle of both objects, or of neither",
            f'one in the middle of "{one}" only',
            "Move the mark on one of them.",
        )
    return not all(in_the_middle)


class Mirrored:
    """Features of an object and the vertices on its other side."""

    def __init__(self, obj, names):
        self.obj = obj
        self._positions = arrays.positions_of(obj.data)
        self._members = feature_marks.members(obj, names)
        self.rows = {name: rows for name, (rows, _) in self._members.items()}
        self._unit = float(np.linalg.norm(np.ptp(self._positions, axis=0)))

    def is_left(self, name):
        """Whether a feature lies where X is positive, as .L does in Blender."""
        return float(self._positions[self.rows[name], 0].mean()) > 0.0

    def is_in_the_middle(self, name):
        return bool((np.abs(self._positions[self.rows[name], 0]) < _MIDDLE * self._unit).all())

    def mirrored(self, name):
        """Rows on the other side, each once, in the same order, and their weights."""
        rows, weights = self._members[name]
        wanted = self._positions[rows] * np.array([-1.0, 1.0, 1.0], np.float32)
        there = pointmorph.meshes.nearest_rows(self._positions, wanted, 1)[:, 0]
        apart = np.linalg.norm(self._positions[there] - wanted, axis=1)
        if apart.max() > _OFF * self._unit:
            raise pointmorph.FeatureError(
                f'feature "{name}"',
                f'a vertex of "{self.obj.name}" at the mirrored place',
                "none near it",
                "Mark the other side by hand: the object isn't symmetric across its X axis there.",
            )
        _, first = np.unique(there, return_index=True)
        first.sort()
        return [int(row) for row in there[first]], [float(w) for w in weights[first]]


registration = Registration(
    classes=(POINTMORPH_OT_mirror_features,),
)
