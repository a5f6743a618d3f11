"""What a morph object remembers, as `object.pointmorph`."""

import bpy

from ..data.properties import PointmorphShape
from ..data.registration import Registration
from .staleness import state


def _state(self):
    return state(self.id_data)[0]


def _stale(self):
    return "; ".join(state(self.id_data)[1])


class PointmorphObject(bpy.types.PropertyGroup):
    """What a morph object was made from."""

    source: bpy.props.PointerProperty(
        name="Source", description="The object at 0", type=bpy.types.Object
    )
    target: bpy.props.PointerProperty(
        name="Target", description="The object at 1", type=bpy.types.Object
    )
    source_matrix: bpy.props.FloatVectorProperty(
        name="Source Matrix",
        description="Rotation and scale of the source when the morph was made, row by row",
        size=9,
    )
    is_preview: bpy.props.BoolProperty(
        name="Preview",
        description="A coarse morph that is shown until the whole one is there",
    )
    via: bpy.props.CollectionProperty(
        name="Via", description="The shapes between, of a chain", type=PointmorphShape
    )
    made_from: bpy.props.PointerProperty(
        name="Made From",
        description="The morph object of a mesh with the source's faces",
        type=bpy.types.Object,
    )
    keeps_faces: bpy.props.BoolProperty(
        name="Keeps Faces", description="It is a copy of the source's mesh that morphs"
    )
    follows: bpy.props.BoolProperty(
        name="Follows",
        description="Its points follow how the objects it was made from move and deform",
    )
    recipe: bpy.props.StringProperty(
        name="Recipe",
        description="All that it takes to compute the morph again, and to see whether that would "
        "change anything, as JSON",
    )
    baked: bpy.props.StringProperty(
        name="Baked", description="t and path of the shape keys that were baked here, as JSON"
    )
    state: bpy.props.StringProperty(
        name="State",
        description="CURRENT; STALE: something has changed since it was made; ORPHAN: something it "
        "was made from is gone; UNKNOWN: made by an earlier version; empty for other objects. "
        "Looked up when asked for",
        get=_state,
    )
    stale: bpy.props.StringProperty(
        name="Stale", description="In words, why the state isn't CURRENT", get=_stale
    )
    shading_before: bpy.props.StringProperty(
        name="Shading Before",
        description="The viewport's shading before distortion was shown; empty where it stayed",
    )
    report: bpy.props.StringProperty(
        name="Report", description="What was done, how long it took and how good it is, as JSON"
    )


registration = Registration(
    classes=(PointmorphObject,),
    properties=(
        (bpy.types.Object, "pointmorph", bpy.props.PointerProperty(type=PointmorphObject)),
    ),
)
