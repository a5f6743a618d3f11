"""What the user does: morph, look at the quality."""

import bpy

from ..data.registration import Registration
from ..scene import morph_object, points_display, recipes
from .polls import NO_RESULT, Explained, active_result


class POINTMORPH_OT_show_distortion(Explained, bpy.types.Operator):
    """Color the points by distortion: blue is good, yellow is bad, red is folded. Press again to
    show their own colors"""

    bl_idname = "pointmorph.show_distortion"
    bl_label = "Show Distortion"
    bl_options = {"REGISTER", "UNDO"}

    @staticmethod
    def reason(context):
        obj = active_result(context)
        if obj is None:
            return NO_RESULT
        if not points_display.can_show_distortion(obj):
            return "This morph has no distortion values: morph again"
        return None

    def execute(self, context):
        obj = active_result(context)
        show = not points_display.shows_distortion(obj)
        points_display.show_distortion(obj, show)
        self._shade(context, obj.pointmorph, show)
        return {"FINISHED"}

    @staticmethod
    def _shade(context, remembered, show):
        """Solid shading knows one color for all points: material preview meanwhile."""
        space = context.space_data
        if space is None or space.type != "VIEW_3D":
            return
        if show:
            plain = space.shading.type in {"WIREFRAME", "SOLID"}
            remembered.shading_before = space.shading.type if plain else ""
            if plain:
                space.shading.type = "MATERIAL"
        elif remembered.shading_before and space.shading.type == "MATERIAL":
            space.shading.type = remembered.shading_before


class POINTMORPH_OT_go_to_place(Explained, bpy.types.Operator):
    """Move the 3D cursor to a place where the morph is bad"""

    bl_idname = "pointmorph.go_to_place"
    bl_label = "Show Place"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(
        name="Place", description="Which place to show. 0 is the worst", default=0, min=0, max=4
    )

    @staticmethod
    def reason(context):
        obj = active_result(context)
        if obj is None:
            return NO_RESULT
        report = recipes.report_of(obj)
        return None if report and report["worst"] else "This morph has no bad places"

    def execute(self, context):
        obj = active_result(context)
        places = recipes.report_of(obj)["worst"]
        place = places[min(self.index, len(places) - 1)]
        context.scene.cursor.location = morph_object.world_position(obj, place["source"])
        self.report({"INFO"}, place["advice"])
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_show_distortion,
        POINTMORPH_OT_go_to_place,
    ),
)
