"""What the user does: morph, look at the quality."""

import bpy
import numpy as np
import pointmorph

from ..core import transforms
from ..data import attribute_names
from ..data.registration import Registration
from ..scene import (
    morph_object,
    own_points,
    placement,
    points_display,
    presentation,
    recipes,
)
from .polls import NO_RESULT, Explained, active_result, fail


class _Shows(Explained):
    """Colors the points by an attribute; pressed again, shows what was shown before."""

    attribute = ""

    @classmethod
    def reason(cls, context):
        obj = active_result(context)
        if obj is None:
            return NO_RESULT
        if not points_display.can_show(obj, cls.attribute):
            return f"This morph has no {cls.attribute} values: morph again"
        return None

    def execute(self, context):
        try:
            obj = own_points.of_active(context, active_result(context))
        except pointmorph.PointmorphError as error:
            return fail(self, error)
        on = not points_display.shows(obj, self.attribute)
        if not any(points_display.shows(obj, attribute) for attribute in points_display.SHOW):
            obj.pointmorph.shading_before = ""
            obj.pointmorph.shown_before = presentation.kind_of(obj)
        points_display.show(obj, self.attribute if on else None)
        if on:  # colors the points
            presentation.show_points(context, obj)
        self._shade(context, obj.pointmorph, on)
        was_mesh = obj.pointmorph.shown_before == presentation.MESH
        if not on and was_mesh and morph_object.shown_of(obj) != obj:
            try:
                presentation.show_as(context, obj, presentation.MESH)
            except pointmorph.PointmorphError as error:
                return fail(self, error)
        return {"FINISHED"}

    @staticmethod
    def _shade(context, remembered, show):
        """Solid shading knows one color for all points: material preview meanwhile."""
        space = context.space_data
        if space is None or space.type != "VIEW_3D":
            return
        if show:
            if space.shading.type in {"WIREFRAME", "SOLID"}:
                remembered.shading_before = space.shading.type
                space.shading.type = "MATERIAL"
        elif remembered.shading_before and space.shading.type == "MATERIAL":
            space.shading.type = remembered.shading_before


class POINTMORPH_OT_show_distortion(_Shows, bpy.types.Operator):
    """Color the points by distortion: blue is good, yellow is bad, red is folded. Press again to
    show what was shown before"""

    bl_idname = "pointmorph.show_distortion"
    bl_label = "Show Distortion"
    bl_options = {"REGISTER", "UNDO"}

    attribute = attribute_names.DISTORTION


class POINTMORPH_OT_show_confidence(_Shows, bpy.types.Operator):
    """Color the points by how likely the map is right: blue is sure, yellow is a toss-up, red is
    most likely wrong. Press again to show what was shown before"""

    bl_idname = "pointmorph.show_confidence"
    bl_label = "Show Confidence"
    bl_options = {"REGISTER", "UNDO"}

    attribute = attribute_names.CONFIDENCE


def _places(report, kind):
    """The bad places of the map, or of the source's faces at the end, or those in doubt."""
    if report is None:
        return []
    if kind == "DOUBT":
        return report.get("doubtful", [])
    return report["worst"] if kind == "MAP" else report.get("mesh", {}).get("worst", [])


class POINTMORPH_OT_go_to_place(Explained, bpy.types.Operator):
    """Move the 3D cursor to a place where the morph is bad"""

    bl_idname = "pointmorph.go_to_place"
    bl_label = "Show Place"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(
        name="Place", description="Which place to show. 0 is the worst", default=0, min=0, max=4
    )
    kind: bpy.props.EnumProperty(
        name="Kind",
        description="What is wrong there",
        items=[
            ("MAP", "Map", "Where the points of the morph are badly matched"),
            ("MESH", "Mesh", "Where the source's own faces look bad at the end"),
            ("DOUBT", "Doubt", "Where the map is more likely wrong than right"),
        ],
        default="MAP",
    )

    @staticmethod
    def reason(context):
        obj = active_result(context)
        if obj is None:
            return NO_RESULT
        report = recipes.report_of(obj)
        if any(_places(report, kind) for kind in ("MAP", "MESH", "DOUBT")):
            return None
        return "This morph has no bad places"

    def execute(self, context):
        obj = active_result(context)
        places = _places(recipes.report_of(obj), self.kind)
        if not places:
            self.report({"INFO"}, "There are no bad places of this kind")
            return {"CANCELLED"}
        placement.give_back(*morph_object.made_with(obj))
        place = places[min(self.index, len(places) - 1)]
        active = context.view_layer.objects.active
        is_beside = morph_object.is_beside(active, obj)
        shown = active if is_beside else morph_object.shown_of(obj)
        if self.kind == "MESH":
            position = np.array(place["position"])
        else:
            position = morph_object.position_of(obj, place["source"], shown)
        frame = placement.frame_of(active) if is_beside else placement.frame_seen(obj)
        location = transforms.apply(frame, position[None])[0]
        context.scene.cursor.location = location
        self.report({"INFO"}, recipes.present_words(obj, place["advice"]))
        return {"FINISHED"}


class POINTMORPH_OT_explain(bpy.types.Operator):
    """Explain what a figure means"""

    bl_idname = "pointmorph.explain"
    bl_label = "Explain"
    bl_options = {"INTERNAL"}

    meaning: bpy.props.StringProperty(name="Meaning", description="Text to show")

    @classmethod
    def description(cls, context, properties):
        return properties.meaning.rstrip(". ")

    def execute(self, context):
        self.report({"INFO"}, self.meaning)
        return {"FINISHED"}


registration = Registration(
    classes=(
        POINTMORPH_OT_show_distortion,
        POINTMORPH_OT_show_confidence,
        POINTMORPH_OT_go_to_place,
        POINTMORPH_OT_explain,
    ),
)
