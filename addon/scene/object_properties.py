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
    too_fine: bpy.props.StringProperty(
        name="Too Fine",
        description="Name of a shape that the source has too few vertices to show",
    )
    baked: bpy.props.StringProperty(
        name="Baked", description="t and path of the shape keys baked here, as JSON"
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
    shading_before: bpy.props.StringProperty(
        name="Shading Before",
        description="Viewport shading before distortion was shown. Empty if it didn't change",
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
