"""What the scene and the morph objects remember.

`scene.pointmorph` has the source, the target, the features, the loop, and the library's settings
under the library's own names. `object.pointmorph` says of a morph object what it was made from.
"""

import bpy
import pointmorph

from ..core import background_job
from ..core.features import PREFIX
from ..core.settings import (
    by_hand,
    choice_label,
    setting_label,
    setting_tip,
    switch_label,
    switch_tip,
)
from . import feature_list
from .arrays import SHAPE_TYPES
from .frame_settings import frame_settings
from .registration import Registration

_LARGEST_INT = 2**31 - 1


def _rename(feature, context):
    """Passes a name that was typed in on to the objects."""
    old, new = feature.marked_name, feature.name
    if old in ("", new):
        return
    settings = feature.id_data.pointmorph
    taken = {item.marked_name for item in settings.features}
    if not new or new in taken:
        feature.name = old
        return
    feature.marked_name = new
    for obj in (settings.source, settings.target):
        if old in feature_list.feature_names(obj):
            feature_list.named(obj)[PREFIX + old].name = PREFIX + new


def _forget(feature, context):
    feature.found = ""


def _color(feature):
    return feature_list.color_of(feature.id_data.pointmorph.features.find(feature.name))


class PointmorphFeature(bpy.types.PropertyGroup):
    """A place that source and target have in common."""

    name: bpy.props.StringProperty(
        name="Name",
        description="The vertex groups of both objects have this name with the prefix “pm.”",
        update=_rename,
    )
    marked_name: bpy.props.StringProperty(
        name="Marked Name",
        description="The name on the objects, without the prefix",
        options={"HIDDEN"},
    )
    on_source: bpy.props.BoolProperty(
        name="On Source", description="The source has the vertex group of this feature"
    )
    on_target: bpy.props.BoolProperty(
        name="On Target", description="The target has the vertex group of this feature"
    )
    use: bpy.props.BoolProperty(
        name="Use",
        description="Off: the morph takes no notice of this feature, and its marks stay",
        default=True,
    )
    color: bpy.props.FloatVectorProperty(
        name="Color",
        description="The colour of its marks in the viewport",
        subtype="COLOR_GAMMA",
        size=3,
        get=_color,
    )
    confidence: bpy.props.FloatProperty(
        name="Confidence",
        description="How likely a proposed pair is right; below 0 for a mark of the user's own",
        default=-1.0,
    )

    kind: bpy.props.EnumProperty(
        name="Kind",
        description="What is marked",
        items=[
            (
                "AUTO",
                "Automatic",
                "One vertex is a point; several that edges join to a path, open or closed, are a "
                "curve; any other several are a region",
            ),
            ("POINT", "Point", "One place goes onto one place: the vertex of highest weight"),
            (
                "CURVE",
                "Curve",
                "A path goes onto a path by share of the length. Without edges the weights say the "
                "order, the heaviest first",
            ),
            (
                "REGION",
                "Region",
                "What is inside goes inside, however many vertices; painted weights go onto the "
                "same weights",
            ),
        ],
        default="AUTO",
        update=_forget,
    )
    hold: bpy.props.EnumProperty(
        name="Hold",
        description="Whether the feature must be met, or may give way",
        items=[
            (
                "AUTO",
                "Automatic",
                "Points exactly, but softly where the weight of the vertex is below 1; curves and "
                "regions softly",
            ),
            ("EXACT", "Exactly", "The feature is met, whatever that does to its surroundings"),
            ("SOFT", "Softly", "The feature pulls, and may give way to the shapes"),
        ],
        default="AUTO",
        update=_forget,
    )
    weight: bpy.props.FloatProperty(
        name="Weight",
        description="How strongly the feature pulls where it is held softly: 1 mostly has its way, "
        "0.1 goes about half",
        default=1.0,
        min=0.001,
        max=1000.0,
        soft_max=10.0,
        precision=3,
        update=_forget,
    )
    found: bpy.props.StringProperty(
        name="Found",
        description="What the feature was when it was last looked at: by Check or Morph",
    )


class PointmorphLoopFeature(bpy.types.PropertyGroup):
    """A feature on the curve along which a closed model is cut; its name is all there is."""


def _property(option):
    shared = {"name": setting_label(option), "description": setting_tip(option)}
    if option.kind == "choice":
        items = [(choice, choice_label(choice), "") for choice in option.choices]
        return bpy.props.EnumProperty(items=items, default=option.default, **shared)
    if option.default is None:
        # Who sets a value wants it used.
        shared["update"] = lambda self, context: setattr(self, by_hand(option), True)
    default = option.minimum if option.default is None else option.default
    if option.kind == "int":
        return bpy.props.IntProperty(
            default=int(default),
            min=int(option.minimum),
            max=int(min(option.maximum, _LARGEST_INT)),
            **shared,
        )
    if option.kind == "float":
        return bpy.props.FloatProperty(
            default=default, min=option.minimum, max=option.maximum, precision=4, **shared
        )
    raise TypeError(f"{option.name} is of a kind that the add-on doesn't know: {option.kind}")


def _settings(taken):
    """Blender's properties for the library's settings, by name."""
    properties = {}
    for option in pointmorph.options():
        if option.name in taken:
            raise ValueError(f"the library's setting {option.name} has a name that the add-on uses")
        properties[option.name] = _property(option)
        if option.default is None:
            properties[by_hand(option)] = bpy.props.BoolProperty(
                name=switch_label(option), description=switch_tip(option)
            )
    return properties


# --- The scene and the morph objects --------------------------------------------------------------


def _is_shape(self, obj):
    return obj.type in SHAPE_TYPES


def _sync(self, context):
    background_job.problem = None  # it was about other shapes
    feature_list.sync_features(self.id_data)


class PointmorphShape(bpy.types.PropertyGroup):
    """A shape on the way from source to target."""

    object: bpy.props.PointerProperty(
        name="Object", description="A mesh or a point cloud", type=bpy.types.Object, poll=_is_shape
    )


class PointmorphScene(bpy.types.PropertyGroup):
    """What is morphed in a scene, and how."""

    source: bpy.props.PointerProperty(
        name="Source",
        description="What the morph starts from: a mesh or a point cloud. Of a mesh, the vertices "
        "without modifiers are taken, because shape keys are put on these",
        type=bpy.types.Object,
        poll=_is_shape,
        update=_sync,
    )
    target: bpy.props.PointerProperty(
        name="Target",
        description="What the morph ends at: a mesh or a point cloud, taken as the viewport shows "
        "it, with modifiers and shape keys",
        type=bpy.types.Object,
        poll=_is_shape,
        update=_sync,
    )
    features: bpy.props.CollectionProperty(
        name="Features",
        description="Places that source and target have in common",
        type=PointmorphFeature,
    )
    active_feature: bpy.props.IntProperty(
        name="Active Feature", description="The feature that is chosen in the list"
    )
    show_markers: bpy.props.BoolProperty(
        name="Markers",
        description="Show the marks of all features in the viewport, numbered as in the list; pale "
        "on the far side",
        default=True,
    )
    loop: bpy.props.CollectionProperty(
        name="Loop",
        description="Features, in order, through which a closed model is cut",
        type=PointmorphLoopFeature,
    )
    active_loop: bpy.props.IntProperty(
        name="Active", description="The feature of the loop that is chosen in its list"
    )
    bake_as: bpy.props.EnumProperty(
        name="Bake As",
        description="What the morph becomes",
        items=[
            ("KEYS", "Shape Keys", "Keys on the source mesh, or on the morph object"),
            ("FRAMES", "Frames", "A cloud for each frame, in the scene or as files"),
        ],
        default="KEYS",
    )
    via: bpy.props.CollectionProperty(
        name="Via",
        description="Shapes that a chain goes through between source and target, in order",
        type=PointmorphShape,
    )
    active_via: bpy.props.IntProperty(
        name="Active Shape", description="The shape between that is chosen in the list"
    )
    steps: bpy.props.IntProperty(
        name="Steps",
        description="Shape keys to bake, equally far from one another; the last one is the target",
        default=1,
        min=1,
        max=1000,
        soft_max=20,
    )


PointmorphScene.__annotations__.update(
    {f"frames_{name}": value for name, value in frame_settings().items()}
)
PointmorphScene.__annotations__.update(_settings(PointmorphScene.__annotations__))


registration = Registration(
    classes=(
        PointmorphFeature,
        PointmorphLoopFeature,
        PointmorphShape,
        PointmorphScene,
    ),
    properties=((bpy.types.Scene, "pointmorph", bpy.props.PointerProperty(type=PointmorphScene)),),
)
