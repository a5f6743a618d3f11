"""The sidebar of the 3D viewport, in the order of the work."""

import bpy

from ..core import background_job
from ..core.settings import by_hand, setting_label, shown_options
from ..data import frame_formats
from ..data.frame_settings import copy_frame_settings
from ..data.masks import KINDS
from ..data.registration import Registration
from ..operators import clicks, polls
from ..operators.made_objects import made_object
from ..scene import as_shown, marked_points, presentation
from ..view import cut_curves
from .panel import Panel, draw_problem, draw_progress, fields, has_points, say

# --- Objects and Morph ----------------------------------------------------------------------------


class POINTMORPH_UL_shapes(bpy.types.UIList):
    """The shapes between source and target, in order."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        layout.prop(item, "object", text="", icon="OBJECT_DATA")


class POINTMORPH_PT_morph(Panel, bpy.types.Panel):
    bl_label = "Morph"
    bl_order = 0

    def draw_header_preset(self, context):
        self.layout.emboss = "NONE"
        self.layout.operator("pointmorph.copy_command", text="", icon="CONSOLE")
        self.layout.operator("pointmorph.manual", text="", icon="HELP")

    def draw(self, context):
        layout = self.layout
        self._draw_shapes(layout, context)
        draw_problem(layout, context, "OBJECTS")
        if not draw_progress(layout):
            row = layout.row()
            row.scale_y = 1.8
            row.operator("pointmorph.morph", icon="MOD_SIMPLEDEFORM")
        draw_problem(layout, context, "MORPH")

    def _draw_shapes(self, layout, context):
        """One list: the source, the shapes in between, where there are any, and the target."""
        settings = context.scene.pointmorph
        column = layout.column()
        column.enabled = background_job.current is None
        _draw_side(column, settings, "source")
        _draw_left_out(column, context, settings.source)
        if len(settings.via):
            self._draw_between(column, settings)
        _draw_side(column, settings, "target")
        if as_shown.left_out(settings.target):
            _draw_beside_name(column).label(
                text=_with_vertices("As shown", context, settings.target)
            )
        row = column.row(align=True)
        row.operator("pointmorph.pick_selected")
        row.operator("pointmorph.swap_objects", text="", icon="ARROW_LEFTRIGHT")
        row.operator("pointmorph.add_to_chain", text="", icon="ADD")
        if polls.are_parts(context):
            column.operator("pointmorph.join_copies")
        if made_object(context) is None and presentation.hidden_shapes(context):
            column.operator("pointmorph.show_shapes", text="Show Originals", icon="HIDE_ON")
        reason = polls.morph_reason(context) or polls.morph_remark(context)
        if reason is not None:
            say(layout, context, reason, "INFO")

    @staticmethod
    def _draw_between(layout, settings):
        row = layout.row()
        row.template_list(
            "POINTMORPH_UL_shapes", "", settings, "via", settings, "active_via", rows=3
        )
        buttons = row.column(align=True)
        for change, icon in (("REMOVE", "REMOVE"), ("UP", "TRIA_UP"), ("DOWN", "TRIA_DOWN")):
            buttons.operator("pointmorph.change_chain", text="", icon=icon).change = change


def _draw_side(layout, settings, side):
    """A picker that leaves room for the object's name."""
    _draw_beside_name(layout, side.capitalize()).prop(settings, side, text="")


def _draw_beside_name(layout, name=""):
    row = layout.split(factor=0.22)
    row.label(text=name)
    return row


def _draw_left_out(layout, context, source):
    """What a morph makes of the source's modifiers and shape keys, and the choice."""
    names = as_shown.left_out(source)
    if not names:
        return
    column = _draw_beside_name(layout).column(align=True)
    if source.pointmorph.keep_modifiers:
        column.label(text=f"{', '.join(names)} also on the target", icon="INFO")
    elif as_shown.may_change(source):
        taken = as_shown.is_taken_as_shown(context.view_layer, source)
        if taken:
            column.label(text=_with_vertices("As shown", context, source))
        elif taken is False:  # else it isn't known yet
            column.label(text=f"Without modifiers: {len(source.data.vertices):,} vertices")
    column.prop(source.pointmorph, "keep_modifiers")


def _with_vertices(text, context, obj):
    count = as_shown.vertices_shown(context.view_layer, obj)
    return text if count is None else f"{text}: {count:,} vertices"


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
        number.ui_units_x = 0.6 if len(data.features) < 10 else 0.9
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
            return f"{100 * item.confidence:.0f}%", "NONE"  # an icon would take a name's room
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
    bl_order = 2

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
        if len(settings.features):
            self._draw_list(layout, settings)
        else:
            row.operator("pointmorph.add_feature", text="", icon="ADD")
        missing = self.missing(settings)
        if missing is not None:
            say(layout, context, missing, "ERROR")
        if draw_progress(layout, "FEATURES"):
            return
        row = layout.row(align=True)
        row.operator("pointmorph.pair_features")
        suggest = row.operator("pointmorph.propose_features")
        suggest.confidence = settings.suggest_confidence
        suggest.places = settings.suggest_places
        draw_problem(layout, context, "FEATURES")

    @staticmethod
    def _draw_list(layout, settings):
        row = layout.row()
        row.template_list(
            "POINTMORPH_UL_features", "", settings, "features", settings, "active_feature", rows=5
        )
        buttons = row.column(align=True)
        buttons.operator("pointmorph.add_feature", text="", icon="ADD")
        buttons.operator("pointmorph.remove_feature", text="", icon="REMOVE")
        buttons.operator("pointmorph.mirror_features", text="", icon="MOD_MIRROR")
        buttons.separator()
        buttons.operator(
            "pointmorph.jump_to_feature", text="", icon="TRIA_LEFT_BAR"
        ).side = "SOURCE"
        buttons.operator(
            "pointmorph.jump_to_feature", text="", icon="TRIA_RIGHT_BAR"
        ).side = "TARGET"
        buttons.separator()
        buttons.popover("POINTMORPH_PT_feature", text="", icon="DOWNARROW_HLT")

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
    """Kind, hold and weight of the feature selected in the list"""

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
    bl_order = 3
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
        if draw_progress(layout, "CUT"):
            return
        row = layout.row(align=True)
        row.operator("pointmorph.propose_loop", text="Suggest")
        row.operator("pointmorph.show_cut", icon="HIDE_OFF", depress=bool(cut_curves.shown))
        row.operator("pointmorph.clear_loop", text="", icon="X")
        draw_problem(layout, context, "CUT")


# --- Masks ----------------------------------------------------------------------------------------


class POINTMORPH_PT_masks(Panel, bpy.types.Panel):
    bl_label = "Masks"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        source = context.scene.pointmorph.source
        return source is not None and source.type == "MESH"

    def draw(self, context):
        source = context.scene.pointmorph.source
        self.layout.label(text=f"Vertex groups of {source.name}:")
        column = fields(self.layout)
        for kind in KINDS:
            column.prop_search(source.pointmorph, f"{kind}_group", source, "vertex_groups")


# --- Bake -----------------------------------------------------------------------------------------


class POINTMORPH_PT_bake(Panel, bpy.types.Panel):
    bl_label = "Bake"
    bl_order = 4

    @classmethod
    def poll(cls, context):
        return has_points(context)

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        layout.row().prop(settings, "bake_as", expand=True)
        column = fields(layout)
        for option in shown_options(settings, "path"):
            column.prop(settings, option.name)
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
        if draw_progress(layout, "BAKE"):
            return
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
        POINTMORPH_UL_shapes,
        POINTMORPH_PT_morph,
        POINTMORPH_PT_features,
        POINTMORPH_PT_feature,
        POINTMORPH_PT_cut,
        POINTMORPH_PT_masks,
        POINTMORPH_PT_bake,
        POINTMORPH_PT_settings,
    ),
)
