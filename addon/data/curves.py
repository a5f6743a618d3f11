"""Animation curves."""

from . import versions

_OF_POINT = (
    "interpolation",
    "easing",
    "amplitude",
    "period",
    "back",
    "handle_left_type",
    "handle_right_type",
    "handle_left",
    "handle_right",
)


def copy_curve(curve, owner, name):
    """Animates a property of `owner` as a curve does."""
    owner.keyframe_insert(name, frame=curve.keyframe_points[0].co[0])
    copy = versions.curve_of(owner.id_data, owner.path_from_id(name))
    points = copy.keyframe_points
    points.add(len(curve.keyframe_points) - len(points))
    for point, known in zip(points, curve.keyframe_points, strict=True):
        point.co = known.co
        for key in _OF_POINT:
            setattr(point, key, getattr(known, key))
    copy.extrapolation = curve.extrapolation
    for modifier in curve.modifiers:
        _copy_values(modifier, copy.modifiers.new(modifier.type))
    copy.update()


def _copy_values(modifier, copy):
    for known in modifier.bl_rna.properties:
        if not known.is_readonly and known.identifier not in ("name", "active"):
            setattr(copy, known.identifier, getattr(modifier, known.identifier))
