"""What a morph object remembers, as `object.pointmorph`."""

import threading

import bpy

from ..data.properties import PointmorphChoice, PointmorphShape
from ..data.registration import Registration
from .slider_keys import EASINGS
from .staleness import state

_SECONDS = 2  # from key to key, until somebody says otherwise


def _is_asked():
    """Whether it isn't Blender that compares library overrides, on other threads, where looking at
    the scene ends it."""
    return threading.current_thread() is threading.main_thread()


def _state(self):
    return state(self.id_data)[0] if _is_asked() else ""


def _stale(self):
    return "; ".join(state(self.id_data)[1]) if _is_asked() else ""


def _key_start(self):
    return self.key_frames[0] if self.has_key_frames else bpy.context.scene.frame_current


def _key_end(self):
    if self.has_key_frames:
        return self.key_frames[1]
    render = bpy.context.scene.render
    return _key_start(self) + round(_SECONDS * render.fps / render.fps_base)


def _set_key_start(self, value):
    length = _key_end(self) - _key_start(self)
    self.key_frames = value, value + length
    self.has_key_frames = True


def _set_key_end(self, value):
    self.key_frames = min(_key_start(self), value - 1), value
    self.has_key_frames = True


def _tag(self, context):
    self.id_data.update_tag(refresh={"DATA"})  # what was made from it may be out of date


class PointmorphObject(bpy.types.PropertyGroup):
    """What a morph object was made from."""

    source: bpy.props.PointerProperty(
        name="Source", description="Object shown at 0", type=bpy.types.Object
    )
    target: bpy.props.PointerProperty(
        name="Target", description="Object shown at 1", type=bpy.types.Object
    )
    source_matrix: bpy.props.FloatVectorProperty(
        name="Source Matrix",
        description="Rotation and scale of the source when the morph was made, row by row",
        size=9,
    )
    choices: bpy.props.CollectionProperty(
        name="Choices",
        description="What was chosen for the features that are marked on this object",
        type=PointmorphChoice,
    )
    rigid_group: bpy.props.StringProperty(
        name="Rigid",
        description="Vertex group of the source whose parts keep their shape when the mesh morphs, "
        "such as eyes, teeth or armor. They move, turn and grow as a whole. Weights below 1 let "
        "them bend",
        update=_tag,
    )
    fixed_group: bpy.props.StringProperty(
        name="Fixed",
        description="Vertex group of the source whose vertices stay where they are when the mesh "
        "morphs. Weights below 1 let them go part of the way",
        update=_tag,
    )
    keep_modifiers: bpy.props.BoolProperty(
        name="Keep Modifiers",
        description="Morph the mesh itself, and put its modifiers and shape keys on the result. "
        "There they change the target as well: at 1 it looks different. Off: where they would, "
        "a copy of the source is morphed that has them applied",
    )
    shown_from: bpy.props.PointerProperty(
        name="Shown From",
        description="Object of which this is a copy with modifiers, pose and shape keys applied",
        type=bpy.types.Object,
    )
    shown_form: bpy.props.StringProperty(
        name="Shown Form",
        description="Digests of such a copy as it was made",
    )
    is_preview: bpy.props.BoolProperty(
        name="Preview",
        description="A coarse morph, shown until the full one is ready",
    )
    via: bpy.props.CollectionProperty(
        name="Via", description="Shapes of a chain between source and target", type=PointmorphShape
    )
    made_from: bpy.props.PointerProperty(
        name="Made From",
        description="Morph object that this mesh was made from",
        type=bpy.types.Object,
    )
    mesh: bpy.props.PointerProperty(
        name="Mesh",
        description="The source's faces, which show this morph in place of its points",
        type=bpy.types.Object,
    )
    keeps_faces: bpy.props.BoolProperty(
        name="Keeps Faces", description="This is a copy of the source mesh that morphs"
    )
    follows: bpy.props.BoolProperty(
        name="Follows",
        description="Points follow the movement and deformation of the original objects",
    )
    recipe: bpy.props.StringProperty(
        name="Recipe",
        description="Everything needed to compute the morph again and to tell whether it is out of "
        "date, as JSON",
    )
    faces: bpy.props.StringProperty(
        name="Faces",
        description="Triangles of the shapes, packed, to compute the morph again when an object is "
        "gone",
    )
    noted: bpy.props.StringProperty(
        name="Noted",
        description="Where a few points are at the first and the last shape, as JSON, to know what "
        "was applied to this object",
    )
    applied: bpy.props.FloatVectorProperty(
        name="Applied",
        description="Matrix of the transforms that were applied to this mesh and that its points "
        "keep, row by row. Zeros for none",
        size=16,
    )
    too_fine: bpy.props.StringProperty(
        name="Too Fine",
        description="Name of a shape that the source has too few vertices to show",
    )
    baked: bpy.props.StringProperty(
        name="Baked",
        description="t, path and whether it is staggered, of the shape keys baked here, as JSON",
    )
    state: bpy.props.StringProperty(
        name="State",
        description="CURRENT; STALE: something has changed since the morph was made; ORPHAN: an "
        "object it was made from no longer exists; UNKNOWN: made by an earlier version. "
        "Empty for other objects. Computed when read",
        get=_state,
    )
    stale: bpy.props.StringProperty(
        name="Stale", description="Why the state isn't CURRENT, in words", get=_stale
    )
    key_start: bpy.props.IntProperty(
        name="Start",
        description="Frame in which Key Morph shows the first shape. Until you set it, the current "
        "frame; the end frame moves with it",
        get=_key_start,
        set=_set_key_start,
    )
    key_end: bpy.props.IntProperty(
        name="End",
        description="Frame in which Key Morph shows the last shape",
        get=_key_end,
        set=_set_key_end,
    )
    key_easing: bpy.props.EnumProperty(
        name="Easing",
        description="How Key Morph goes from the first shape to the last",
        items=EASINGS,
        default="SINE",
    )
    key_frames: bpy.props.IntVectorProperty(
        name="Key Frames", description="Start and end as they were set", size=2, options={"HIDDEN"}
    )
    has_key_frames: bpy.props.BoolProperty(
        name="Has Key Frames",
        description="Start and end were set, so that they no longer follow the current frame",
        options={"HIDDEN"},
    )
    shading_before: bpy.props.StringProperty(
        name="Shading Before",
        description="Viewport shading before distortion was shown. Empty if it didn't change",
    )
    shown_before: bpy.props.StringProperty(
        name="Shown Before",
        description="What showed the morph before its points were colored by an attribute",
        options={"HIDDEN"},
    )
    colors_by_attribute: bpy.props.BoolProperty(
        name="Colors by Attribute",
        description="A viewport was switched to the color type Attribute, which discs need",
        options={"HIDDEN"},
    )
    report: bpy.props.StringProperty(
        name="Report",
        description="What was done, how long it took and how good the result is, as JSON",
    )


registration = Registration(
    classes=(PointmorphObject,),
    properties=(
        (bpy.types.Object, "pointmorph", bpy.props.PointerProperty(type=PointmorphObject)),
    ),
)
