"""The sidebar's part about how good a morph is: a line in the box of the result, and what is
behind it."""

import bpy
import pointmorph

from ..core import quality_words
from ..data import attribute_names
from ..data.registration import Registration
from ..operators import polls
from ..scene import morph_object, points_display, recipes
from .panel import Panel, draw_subdivide, explained, has_points, say

_ICONS = ("COLORSET_04_VEC", "COLORSET_09_VEC", "COLORSET_01_VEC")  # blue, yellow, red
_LEGENDS = {
    attribute_names.DISTORTION: ("Good", "Bad", "Folded"),
    attribute_names.CONFIDENCE: ("Sure", "Unsure", "Doubtful"),
}
_GRADE_ICONS = {"good": "CHECKMARK", "fair": "INFO", "poor": "ERROR"}


def draw_verdict(layout, context, obj):
    """How good the morph is, in a line."""
    report = recipes.report_of(obj)
    if report is None:
        return
    verdict = quality_words.verdict(report)
    reasons = "".join(f"\n{reason}" for reason in verdict.reasons)
    meaning = recipes.present_words(obj, f'"Quality" has the places and all figures.{reasons}')
    row = layout.split(factor=0.86)
    explained(row, verdict.line, meaning, _GRADE_ICONS[verdict.grade])
    for kind, places in _places(report):
        if places:
            edge = row.row()
            edge.alignment = "RIGHT"
            button = edge.operator("pointmorph.go_to_place", text="", icon="PIVOT_CURSOR")
            button.kind, button.index = kind, 0
            return


def _places(report):
    return (
        ("MAP", report["worst"]),
        ("MESH", report.get("mesh", {}).get("worst", [])),
        ("DOUBT", report.get("doubtful", [])),
    )


class POINTMORPH_PT_quality(Panel, bpy.types.Panel):
    bl_label = "Quality"
    bl_parent_id = "POINTMORPH_PT_result"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 8

    @classmethod
    def poll(cls, context):
        return has_points(context)

    def draw(self, context):
        layout = self.layout
        obj = polls.active_result(context)
        _draw_colors(layout, context, obj)
        report = recipes.report_of(obj)
        if report is None:
            return
        verdict = quality_words.verdict(report)
        _draw_reasons(layout, context, obj, verdict)
        if verdict.grade != "good":
            _draw_missing_marks(layout, context)
        for kind, places in _places(report):
            _draw_places(layout, context, obj, kind, places)
        if any(place.get("flaw") == "uncovered" for place in _places(report)[1][1]):
            draw_subdivide(layout)
        box = layout.box().column(align=True)
        for name, value in pointmorph.quality_summary(report):
            _draw_figure(box, name, value, quality_words.meaning(name, report))
        for name, value in pointmorph.feature_summary(report):
            _draw_figure(box, name, value, quality_words.OF_FEATURES)


def _draw_colors(layout, context, obj):
    """The buttons that color the points, and what the colors mean."""
    buttons = layout.column(align=True)
    for attribute, words in _LEGENDS.items():
        is_beside = morph_object.is_beside(context.view_layer.objects.active, obj)
        shown = not is_beside and points_display.shows(obj, attribute)
        buttons.operator(f"pointmorph.show_{attribute}", icon="COLOR", depress=shown)
        if shown:
            row = layout.row()
            for text, icon in zip(words, _ICONS, strict=True):
                row.label(text=text, icon=icon)


def _draw_reasons(layout, context, obj, verdict):
    """The verdict, and why."""
    column = layout.column(align=True)
    column.label(text=verdict.line, icon=_GRADE_ICONS[verdict.grade])
    for reason in verdict.reasons:
        say(column, context, recipes.present_words(obj, reason), "DOT")


def _draw_missing_marks(layout, context):
    names = [item.name for item in context.scene.pointmorph.features if item.use]
    for there, missing in quality_words.missing_marks(names):
        say(layout, context, f'Mark "{missing}": only "{there}" is marked', "INFO")


def _draw_figure(layout, name, value, meaning):
    row = layout.split(factor=0.5)
    explained(row, name, meaning)
    explained(row, value, meaning)


def _draw_places(layout, context, obj, kind, places):
    """Buttons to go to bad places, by name, and what is wrong there; see the operator."""
    for index, place in enumerate(places):
        advice = recipes.present_words(obj, place["advice"])
        box = layout.box().column(align=True)
        name = quality_words.place_name(advice)
        button = box.operator("pointmorph.go_to_place", text=name, icon="PIVOT_CURSOR")
        button.kind, button.index = kind, index
        say(box, context, advice, "NONE")


registration = Registration(
    classes=(POINTMORPH_PT_quality,),
)
