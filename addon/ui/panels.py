"""The sidebar of the 3D viewport, in the order of the work."""

import bpy
import pointmorph

from ..core import background_job
from ..core.settings import by_hand, setting_label, shown_options
from ..data import frame_formats
from ..data.frame_settings import copy_frame_settings
from ..data.registration import Registration
from ..operators import clicks, modal_operator, polls
from ..scene import marked_points, morph_object, points_display, presentation, recipes
from ..view import cut_curves
from .panel import Panel, draw_problem, fields, say

# --- Objects --------------------------------------------------------------------------------------


class POINTMORPH_PT_objects(Panel, bpy.types.Panel):
    bl_label = "Objects"
    bl_order = 0

    def draw_header_preset(self, context):
        self.layout.emboss = "NONE"
        self.layout.operator("pointmorph.manual", text="", icon="HELP")

    def draw(self, context):
        settings = context.scene.pointmorph
        column = fields(self.layout)
        column.prop(settings, "source")
        column.prop(settings, "target")
        row = column.row(align=True)
        row.operator("pointmorph.pick_selected")
        row.operator("pointmorph.swap_objects", text="", icon="ARROW_LEFTRIGHT")
        reason = polls.shapes_reason(context)
        if reason is not None:
            say(self.layout, context, reason, "INFO")
        draw_problem(self.layout, context, "OBJECTS")


# --- Features -------------------------------------------------------------------------------------


class POINTMORPH_UL_features(bpy.types.UIList):
    """A feature a row: its name, what it is, and whether it's marked on source and target."""

    ICONS = {"point": "DOT", "curve": "CURVE_DATA", "region": "GROUP_VERTEX"}

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        row = layout.row(align=True)
        row.prop(item, "use", text="")
        swatch = row.row(align=True)
        swatch.ui_units_x = 0.4
        swatch.prop(item, "color", text="")
        number = row.row(align=True)
        number.ui_units_x = 0.9
        number.label(text=f"{index + 1}")
        name = row.row(align=True)
        name.active = item.use
        name.prop(item, "name", text="", emboss=False)
        text, icon = self.state(context, item)
        state = row.row(align=True)
        state.active = item.use
        state.alignment = "RIGHT"
        state.label(text=text, icon=icon)

    def state(self, context, item):
        """What is to be said about a feature, and an icon for it."""
        if not item.use:
            return "", "BLANK1"
        if not (item.on_source and item.on_target):
            return "", "ERROR"
        if item.confidence >= 0:
            return f"{100 * item.confidence:.0f}%", "QUESTION"
        kind = item.found.split(",")[0].split(" ")[-1]
        if kind:
            return "", self.ICONS.get(kind, "CHECKMARK")
        counts = self._counts(context, item.marked_name)
        if 0 in counts:
            return "", "ERROR"
        if max(counts, default=1) > 1:
            return "", "GROUP_VERTEX"
        return "", "CHECKMARK"

    @staticmethod
    def _counts(context, name):
        """How many points are marked on source and target, where that is known."""
        settings = context.scene.pointmorph
        known = [marked_points.count_of(obj, name) for obj in (settings.source, settings.target)]
        return [count for count in known if count is not None]


class POINTMORPH_PT_features(Panel, bpy.types.Panel):
    bl_label = "Features"
    bl_order = 1

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        row = layout.row(align=True)
        row.scale_y = 1.3
        row.operator(
            "pointmorph.click_features", icon="RESTRICT_SELECT_OFF", depress=clicks.running
        )
        shown = "HIDE_OFF" if settings.show_markers else "HIDE_ON"
        row.prop(settings, "show_markers", text="", icon=shown)
        row = layout.row()
        row.template_list(
            "POINTMORPH_UL_features", "", settings, "features", settings, "active_feature", rows=5
        )
        buttons = row.column(align=True)
        buttons.operator("pointmorph.add_feature", text="", icon="ADD")
        buttons.operator("pointmorph.remove_feature", text="", icon="REMOVE")
        buttons.separator()
        buttons.operator(
            "pointmorph.jump_to_feature", text="", icon="TRIA_LEFT_BAR"
        ).side = "SOURCE"
        buttons.operator(
            "pointmorph.jump_to_feature", text="", icon="TRIA_RIGHT_BAR"
        ).side = "TARGET"
        buttons.separator()
        buttons.popover("POINTMORPH_PT_feature", text="", icon="DOWNARROW_HLT")
        missing = self.missing(settings)
        if missing is not None:
            say(layout, context, missing, "ERROR")
        row = layout.row(align=True)
        row.operator("pointmorph.pair_features")
        suggest = row.operator("pointmorph.propose_features")
        suggest.confidence = settings.suggest_confidence
        suggest.places = settings.suggest_places
        draw_problem(layout, context, "FEATURES")

    @staticmethod
    def missing(settings):
        """In words, the first feature that isn't marked on both objects; None where all are."""
        for obj, side in ((settings.source, "on_source"), (settings.target, "on_target")):
            for item in settings.features if obj is not None else ():
                if item.use and not getattr(item, side):
                    return f'"{item.name}" isn\'t marked on {obj.name}'
                if item.use and marked_points.count_of(obj, item.marked_name) == 0:
                    return f'"{item.name}" has no vertices on {obj.name}'
        return None


class POINTMORPH_PT_feature(bpy.types.Panel):
    """What the feature chosen in the list is, and how it is held"""

    bl_space_type = "VIEW_3D"
    bl_region_type = "HEADER"  # shown by its button alone
    bl_label = "Feature"
    bl_ui_units_x = 12

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        if 0 <= settings.active_feature < len(settings.features):
            item = settings.features[settings.active_feature]
            layout.label(text=f"{item.name}: {item.found}" if item.found else item.name)
            layout.prop(item, "kind")
            layout.prop(item, "hold")
            weight = layout.row()
            weight.active = item.hold != "EXACT"
            weight.prop(item, "weight")
            layout.operator(
                "pointmorph.click_features", text="Move by Clicking", icon="RESTRICT_SELECT_OFF"
            ).name = item.name
        layout.operator("pointmorph.check_features", icon="VIEWZOOM")
        layout.separator()
        layout.prop(settings, "suggest_confidence")
        layout.prop(settings, "suggest_places")


# --- Cut and domain -------------------------------------------------------------------------------


class POINTMORPH_UL_loop(bpy.types.UIList):
    """The features of the loop, in the order in which the cut passes them."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        known = data.features.get(item.name)
        good = known is not None and known.on_source and known.on_target and known.use
        layout.label(text=item.name, icon="DOT" if good else "ERROR")


class POINTMORPH_PT_cut(Panel, bpy.types.Panel):
    bl_label = "Cut and Domain"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        fields(layout).prop(settings, "domain")
        layout.label(text="Cut closed models along:")
        row = layout.row()
        row.template_list(
            "POINTMORPH_UL_loop", "", settings, "loop", settings, "active_loop", rows=4
        )
        buttons = row.column(align=True)
        buttons.operator("pointmorph.add_loop_feature", text="", icon="ADD")
        buttons.operator("pointmorph.remove_loop_feature", text="", icon="REMOVE")
        buttons.separator()
        for direction in ("UP", "DOWN"):
            button = buttons.operator(
                "pointmorph.move_loop_feature", text="", icon=f"TRIA_{direction}"
            )
            button.direction = direction
        row = layout.row(align=True)
        row.operator("pointmorph.propose_loop", text="Suggest")
        row.operator("pointmorph.show_cut", icon="HIDE_OFF", depress=bool(cut_curves.shown))
        row.operator("pointmorph.clear_loop", text="", icon="X")
        draw_problem(layout, context, "CUT")


# --- Morph ----------------------------------------------------------------------------------------


class POINTMORPH_PT_morph(Panel, bpy.types.Panel):
    bl_label = "Morph"
    bl_order = 3

    def draw(self, context):
        layout = self.layout
        if background_job.current is None:
            row = layout.row()
            row.scale_y = 1.8
            row.operator("pointmorph.morph", icon="MOD_SIMPLEDEFORM")
        else:
            _draw_progress(layout)
        settings = context.scene.pointmorph
        column = fields(layout)
        for option in shown_options(settings, "path"):
            column.prop(settings, option.name)
        draw_problem(layout, context, "MORPH")


def _draw_progress(layout):
    text = modal_operator.progress_text()
    row = layout.row()
    row.scale_y = 1.8
    row.progress(text=text, factor=background_job.current.fraction)
    layout.label(text="Press Esc to cancel", icon="EVENT_ESC")


# --- Result ---------------------------------------------------------------------------------------


class POINTMORPH_PT_result(Panel, bpy.types.Panel):
    bl_label = "Result"
    bl_order = 5

    @classmethod
    def poll(cls, context):
        return polls.active_result(context) is not None

    def draw(self, context):
        layout = self.layout
        obj = polls.active_result(context)
        shown = morph_object.shown_of(obj)
        layout.label(text=shown.name, icon="OBJECT_DATA")
        if obj.pointmorph.is_preview:
            layout.label(text="Preview: computing the full morph", icon="INFO")
        keys, name = shown.data.shape_keys, morph_object.morph_keys(shown)[0]
        if keys is not None and name in keys.key_blocks:
            row = layout.row()
            row.scale_y = 1.3
            row.prop(keys.key_blocks[name], "value", text="Morph", slider=True)
        self._draw_shown_as(layout, obj)
        layout.operator(
            "pointmorph.show_distortion",
            icon="COLOR",
            depress=points_display.shows_distortion(obj),
        )
        if obj.pointmorph.too_fine:
            say(layout, context, f'Too few vertices to show "{obj.pointmorph.too_fine}"', "INFO")
            layout.operator("pointmorph.subdivide_source", icon="MOD_SUBSURF")

    @staticmethod
    def _draw_shown_as(layout, obj):
        row = layout.row(align=True)
        now = presentation.kind_of(obj)
        if now == presentation.MESH or presentation.has_faces(obj):
            for kind, text in ((presentation.MESH, "Mesh"), (presentation.POINTS, "Points")):
                button = row.operator("pointmorph.show_as", text=text, depress=kind == now)
                button.kind = kind
        visible = presentation.shows_shapes(obj)
        row.operator(
            "pointmorph.show_shapes", icon="HIDE_OFF" if visible else "HIDE_ON", depress=visible
        )


class POINTMORPH_PT_quality(Panel, bpy.types.Panel):
    bl_label = "Quality"
    bl_parent_id = "POINTMORPH_PT_result"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        report = recipes.report_of(polls.active_result(context))
        if report is None:
            return
        box = layout.box().column(align=True)
        for name, value in (
            *pointmorph.quality_summary(report),
            *pointmorph.feature_summary(report),
        ):
            row = box.split(factor=0.35)
            row.label(text=name)
            row.label(text=value)
        mesh = report.get("mesh")
        if not report["worst"] and not (mesh and mesh["worst"]):
            layout.label(text="No bad places", icon="CHECKMARK")
        _draw_places(layout, context, "MAP", report["worst"])
        if mesh is not None:
            icon = {"good": "CHECKMARK", "fair": "INFO"}.get(mesh["grade"], "ERROR")
            say(layout, context, mesh["verdict"], icon)
            _draw_places(layout, context, "MESH", mesh["worst"])
            if any(place["flaw"] == "uncovered" for place in mesh["worst"]):
                layout.operator("pointmorph.subdivide_source", icon="MOD_SUBSURF")


def _draw_places(layout, context, kind, places):
    """What is wrong at bad places, and buttons to go there; see the operator."""
    for index, place in enumerate(places):
        row = layout.box().row()
        say(row, context, place["advice"], "BLANK1", beside=30)
        button = row.operator("pointmorph.go_to_place", text="", icon="PIVOT_CURSOR")
        button.kind, button.index = kind, index


# --- Bake -----------------------------------------------------------------------------------------


class POINTMORPH_PT_bake(Panel, bpy.types.Panel):
    bl_label = "Bake"
    bl_order = 6

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        layout.row().prop(settings, "bake_as", expand=True)
        if settings.bake_as == "KEYS":
            self.draw_keys(layout, settings)
        else:
            self.draw_frames(layout, settings, context.scene)

    def draw_keys(self, layout, settings):
        fields(layout).prop(settings, "steps")
        for kind, text in (("SOURCE", "On the Source Mesh"), ("PAIRS", "On the Morph Object")):
            button = layout.operator("pointmorph.bake_shape_keys", text=text)
            button.kind = kind
            button.steps = settings.steps

    def draw_frames(self, layout, settings, scene):
        column = fields(layout)
        column.prop(settings, "frames_format")
        if frame_formats.FORMATS[settings.frames_format].in_files:
            column.prop(settings, "frames_directory")
        column.prop(scene, "frame_start", text="First")
        column.prop(scene, "frame_end", text="Last")
        column.prop(settings, "frames_easing", text="Easing")
        column.prop(settings, "frames_resample")
        column.prop(settings, "frames_faces")
        button = layout.operator("pointmorph.bake_frames")
        copy_frame_settings(settings, button)
        button.frame_start = scene.frame_start
        button.frame_end = scene.frame_end


# --- Advanced -------------------------------------------------------------------------------------


class POINTMORPH_PT_settings(Panel, bpy.types.Panel):
    bl_label = "Advanced"
    bl_order = 8
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        settings = context.scene.pointmorph
        column = fields(self.layout)
        column.use_property_split = False
        for option in shown_options(settings, "map", "frames", "nothing"):
            if option.name == "domain":  # in the panel Cut and Domain
                continue
            # Above its value, because names are longer than half the sidebar.
            column.label(text=setting_label(option))
            row = column.row(align=True)
            if option.default is None:
                row.prop(settings, by_hand(option), text="")
                row = row.row(align=True)
                row.active = getattr(settings, by_hand(option))
            row.prop(settings, option.name, text="")
        draw_problem(self.layout, context, "ADVANCED")


registration = Registration(
    classes=(
        POINTMORPH_UL_features,
        POINTMORPH_UL_loop,
        POINTMORPH_PT_objects,
        POINTMORPH_PT_features,
        POINTMORPH_PT_feature,
        POINTMORPH_PT_cut,
        POINTMORPH_PT_morph,
        POINTMORPH_PT_result,
        POINTMORPH_PT_quality,
        POINTMORPH_PT_bake,
        POINTMORPH_PT_settings,
    ),
)
