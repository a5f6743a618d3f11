"""What the scene and the morph objects remember.

`scene.pointmorph` has the source, the target, the features, the loop, and the library's settings
under the library's own names. `object.pointmorph` says of a morph object what it was made from.
"""

import bpy

from ..core import background_job
from ..core.features import PREFIX
from ..core.settings import (
    by_hand,
    name_label,
    scene_options,
    setting_label,
    setting_tip,
    switch_label,
    switch_tip,
)
from . import feature_list
from .arrays import MORPHED_TYPES
from .frame_settings import frame_settings
from .registration import Registration
from .transfer_settings import transfer_settings

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
            feature_list.rename_choice(obj, old, new)


def _forget(feature, context):
    feature.found = ""
    feature_list.keep_choice(feature)


def _keep(feature, context):
    feature_list.keep_choice(feature)


def _color(feature):
    return feature_list.color_of(feature.id_data.pointmorph.features.find(feature.name))


class PointmorphFeature(bpy.types.PropertyGroup):
    """A place that source and target have in common."""

    name: bpy.props.StringProperty(
        name="Name",
        description="Name of the feature. The vertex groups of both objects have this name "
        "with the "
        'prefix "pm."',
        update=_rename,
    )
    marked_name: bpy.props.StringProperty(
        name="Marked Name",
        description="Name on the objects, without the prefix",
        options={"HIDDEN"},
    )
    on_source: bpy.props.BoolProperty(
        name="On Source", description="The source has a vertex group for this feature"
    )
    on_target: bpy.props.BoolProperty(
        name="On Target", description="The target has a vertex group for this feature"
    )
    use: bpy.props.BoolProperty(
        name="Use",
        description="Use this feature. When off, the morph ignores it, and its marks stay",
        default=True,
        update=_keep,
    )
    color: bpy.props.FloatVectorProperty(
        name="Color",
        description="Color of its marks in the viewport",
        subtype="COLOR_GAMMA",
        size=3,
        get=_color,
    )
    confidence: bpy.props.FloatProperty(
        name="Confidence",
        description="How likely a suggested pair is right. Negative for features marked by hand",
        default=-1.0,
    )

    kind: bpy.props.EnumProperty(
        name="Kind",
        description="How the marked vertices are interpreted",
        items=[
            (
                "AUTO",
                "Automatic",
                "One vertex is a point. Vertices that edges join into a path, open or "
                "closed, are a curve. Any others are a region",
            ),
            ("POINT", "Point", "Match one place to one place: the vertex with the highest weight"),
            (
                "CURVE",
                "Curve",
                "Match a path to a path, evenly along their lengths. Without edges, "
                "weights give the order, highest first",
            ),
            (
                "REGION",
                "Region",
                "Match the inside to the inside, whatever the number of vertices. "
                "Painted weights are matched to the same weights",
            ),
        ],
        default="AUTO",
        update=_forget,
    )
    hold: bpy.props.EnumProperty(
        name="Hold",
        description="Whether the feature must be met exactly or may give way",
        items=[
            (
                "AUTO",
                "Automatic",
                "Points are hard, or soft if the weight of the vertex is below 1. Curves "
                "and regions are soft",
            ),
            ("EXACT", "Hard", "Meet the feature exactly, whatever that does to its surroundings"),
            ("SOFT", "Soft", "Pull toward the feature, but give way to the shapes"),
        ],
        default="AUTO",
        update=_forget,
    )
    weight: bpy.props.FloatProperty(
        name="Weight",
        description="How strongly a soft feature pulls: 1 nearly meets it, 0.1 goes about halfway",
        default=1.0,
        min=0.001,
        max=1000.0,
        soft_max=10.0,
        precision=3,
        update=_forget,
    )
    found: bpy.props.StringProperty(
        name="Found",
        description="What the feature was when Check Features or Morph last read it",
    )


class PointmorphChoice(bpy.types.PropertyGroup):
    """What was chosen for a feature, stored with an object that has it."""

    kind: bpy.props.StringProperty(
        name="Kind", description="How the marked vertices are interpreted", default="AUTO"
    )
    hold: bpy.props.StringProperty(
        name="Hold", description="Whether the feature must be met exactly", default="AUTO"
    )
    weight: bpy.props.FloatProperty(
        name="Weight", description="How strongly a soft feature pulls", default=1.0
    )
    use: bpy.props.BoolProperty(name="Use", description="Whether the feature is used", default=True)


class PointmorphLoopFeature(bpy.types.PropertyGroup):
    """A feature on the curve along which a closed model is cut; its name is all there is."""


# Files hold the number of a choice, wherever the panel lists it. Words that aren't here come after
# those that are, in the library's order.
_NUMBERS = {
    "method": ("auto", "paper"),
    "domain": ("auto", "disk", "cut", "sphere", "network"),
    "boundary_spacing": ("uniform", "chord"),
    "solve": ("full", "lod"),
    "missing_parts": ("leave", "stretch"),
    "path": ("linear", "similarity", "rigid", "auto"),
}


def _numbers(option):
    """The number of each word of a choice."""
    known = _NUMBERS.get(option.name, ())
    words = [*known, *(word for word in option.choices if word not in known)]
    return {word: number for number, word in enumerate(words)}


def _property(option):
    shared = {"name": setting_label(option), "description": setting_tip(option)}
    if option.kind == "choice":
        numbers = _numbers(option)
        items = [(word, name_label(word), "", numbers[word]) for word in option.choices]
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
    for option in scene_options():
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
    return obj.type in MORPHED_TYPES


def _sync(self, context):
    background_job.problem = None  # it was about other shapes
    feature_list.sync_features(self.id_data)


TEXTURE_SIZES = [
    (str(size), str(size), f"{size} by {size} pixels") for size in (256, 512, 1024, 2048, 4096)
]


class PointmorphShape(bpy.types.PropertyGroup):
    """A shape on the way from source to target."""

    object: bpy.props.PointerProperty(
        name="Object",
        description="A mesh, a point cloud, text, a curve, a surface or metaballs",
        type=bpy.types.Object,
        poll=_is_shape,
    )


class PointmorphScene(bpy.types.PropertyGroup):
    """What is morphed in a scene, and how."""

    source: bpy.props.PointerProperty(
        name="Source",
        description="Object that the morph starts from: a mesh, a point cloud, text, a curve, a "
        "surface or metaballs. It is used as the viewport shows it, with modifiers and shape keys",
        type=bpy.types.Object,
        poll=_is_shape,
        update=_sync,
    )
    target: bpy.props.PointerProperty(
        name="Target",
        description="Object that the morph ends at: a mesh, a point cloud, text, a curve, a "
        "surface or metaballs. It is used as the viewport shows it, with modifiers and shape keys",
        type=bpy.types.Object,
        poll=_is_shape,
        update=_sync,
    )
    features: bpy.props.CollectionProperty(
        name="Features",
        description="Places that the source and target have in common",
        type=PointmorphFeature,
    )
    active_feature: bpy.props.IntProperty(
        name="Active Feature", description="The feature selected in the list"
    )
    set_aside: bpy.props.CollectionProperty(
        name="Set Aside",
        description="Features of objects chosen earlier, with their settings",
        type=PointmorphFeature,
        options={"HIDDEN"},
    )
    show_markers: bpy.props.BoolProperty(
        name="Markers",
        description="Show the marks of all features in the viewport, numbered as in the "
        "list. Marks "
        "on the far side are faint",
        default=True,
    )
    loop: bpy.props.CollectionProperty(
        name="Loop",
        description="Features, in order, that the cut through a closed model passes through",
        type=PointmorphLoopFeature,
    )
    active_loop: bpy.props.IntProperty(
        name="Active", description="The feature selected in the loop"
    )
    show_as: bpy.props.EnumProperty(
        name="Show As",
        description="What shows a new morph",
        items=[
            (
                "MESH",
                "Mesh",
                "The source's own faces, with its materials, UV maps and modifiers. A source "
                "without faces is shown as discs, or as points if there are many",
            ),
            ("POINTS", "Points", "The points of both shapes, in the colors of both"),
            ("DISCS", "Discs", "Discs in the surface at these points: solid in every shading"),
        ],
        default="MESH",
    )
    blend_textures: bpy.props.BoolProperty(
        name="Blend Textures",
        description="Blend the look of the source into that of the target when a new morph is "
        "shown as a mesh, if both have materials, images or color attributes",
        default=True,
    )
    texture_size: bpy.props.EnumProperty(
        name="Size",
        description="Pixels along each side of the images that show the target",
        items=TEXTURE_SIZES,
        default="1024",
    )
    texture_roughness: bpy.props.BoolProperty(
        name="Roughness",
        description="Also draw the target's roughness and metalness. Otherwise, the whole mesh "
        "uses the target's most common values",
        default=False,
    )
    texture_normal: bpy.props.BoolProperty(
        name="Normal",
        description="Also draw a normal map of the target's details. A new morph gets none",
        default=False,
    )
    suggest_confidence: bpy.props.FloatProperty(
        name="Confidence",
        description="Suggest only features that are at least this certain",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    suggest_places: bpy.props.BoolProperty(
        name="Places Between", description="Also suggest places between the tips", default=False
    )
    bake_as: bpy.props.EnumProperty(
        name="Bake As",
        description="What to bake the morph as",
        items=[
            ("KEYS", "Shape Keys", "Shape keys on the source mesh or on the morph object"),
            ("FRAMES", "Frames", "A point cloud for each frame, in the scene or in files"),
        ],
        default="KEYS",
    )
    via: bpy.props.CollectionProperty(
        name="Via",
        description="Shapes that a chain passes through between source and target, in order",
        type=PointmorphShape,
    )
    active_via: bpy.props.IntProperty(
        name="Active Shape", description="The shape selected in the list"
    )
    steps: bpy.props.IntProperty(
        name="Steps",
        description="Number of shape keys to bake, evenly spaced. The last one is the target",
        default=1,
        min=1,
        max=1000,
        soft_max=20,
    )


PointmorphScene.__annotations__.update(
    {f"frames_{name}": value for name, value in frame_settings().items()}
    | {f"transfer_{name}": value for name, value in transfer_settings().items()}
)
PointmorphScene.__annotations__.update(_settings(PointmorphScene.__annotations__))


registration = Registration(
    classes=(
        PointmorphChoice,
        PointmorphFeature,
        PointmorphLoopFeature,
        PointmorphShape,
        PointmorphScene,
    ),
    properties=((bpy.types.Scene, "pointmorph", bpy.props.PointerProperty(type=PointmorphScene)),),
)
