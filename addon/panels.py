"""The sidebar of the 3D viewport."""

import textwrap

import bpy
import pointmorph

from . import display, operators, result, session
from .properties import by_hand


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Pointmorph"


class POINTMORPH_UL_features(bpy.types.UIList):
    """A feature a row: its name, what it is, and whether it's marked on source and target."""

    ICONS = {"point": "DOT", "curve": "CURVE_DATA", "region": "GROUP_VERTEX"}

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        layout.prop(item, "name", text="", emboss=False)
        row = layout.row(align=True)
        row.alignment = "RIGHT"
        if item.on_source and item.on_target:
            kind = item.found.split(",")[0].split(" ")[-1]
            if item.confidence >= 0:
                text, other = f"proposed, {100 * item.confidence:.0f} %", "QUESTION"
            else:
                text, other = kind or "both", "CHECKMARK"
            row.label(text=text, icon=self.ICONS.get(kind, other))
        else:
            row.label(text="only source" if item.on_source else "only target", icon="ERROR")


class POINTMORPH_PT_objects(_Panel, bpy.types.Panel):
    bl_label = "Objects"

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.enabled = session.current is None
        column.prop(settings, "source")
        column.prop(settings, "target")


class POINTMORPH_PT_features(_Panel, bpy.types.Panel):
    bl_label = "Features"

    def draw(self, context):
        settings = context.scene.pointmorph
        row = self.layout.row()
        row.template_list(
            "POINTMORPH_UL_features", "", settings, "features", settings, "active_feature", rows=3
        )
        buttons = row.column(align=True)
        buttons.operator("pointmorph.add_feature", text="", icon="ADD")
        buttons.operator("pointmorph.remove_feature", text="", icon="REMOVE")
        buttons.popover("POINTMORPH_PT_feature", text="", icon="DOWNARROW_HLT")
        self.layout.operator("pointmorph.propose_features", icon="VIEWZOOM")


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
        layout.operator("pointmorph.check_features", icon="VIEWZOOM")


class POINTMORPH_PT_settings(_Panel, bpy.types.Panel):
    bl_label = "Settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.enabled = session.current is None
        for option in pointmorph.options():
            if option.default is not None:
                column.prop(settings, option.name)
            else:
                row = column.row(heading=settings.bl_rna.properties[option.name].name)
                row.prop(settings, by_hand(option), text="")
                value = row.row()
                value.active = getattr(settings, by_hand(option))
                value.prop(settings, option.name, text="")


class POINTMORPH_PT_morph(_Panel, bpy.types.Panel):
    bl_label = "Morph"

    def draw(self, context):
        layout = self.layout
        if session.current is None:
            row = layout.row()
            row.scale_y = 1.5
            row.operator("pointmorph.morph")
        else:
            _draw_progress(layout)
        obj = operators.active_result(context)
        if obj is None:
            return
        column = layout.column()
        column.label(text=obj.name, icon="OBJECT_DATA")
        keys = obj.data.shape_keys
        if keys is not None and result.KEY in keys.key_blocks:
            column.prop(keys.key_blocks[result.KEY], "value", text="Morph", slider=True)


def _draw_progress(layout):
    text = operators.progress_text()
    if hasattr(layout, "progress"):
        layout.progress(text=text, factor=session.current.fraction)
    else:
        layout.label(text=text, icon="SORTTIME")
    layout.label(text="Press Esc over the viewport to stop")


class POINTMORPH_PT_bake(_Panel, bpy.types.Panel):
    bl_label = "Bake Shape Keys"

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "steps")
        for kind, text in (("SOURCE", "On the Source Mesh"), ("PAIRS", "On the Morph Object")):
            button = layout.operator("pointmorph.bake_shape_keys", text=text)
            button.kind = kind
            button.steps = settings.steps


class POINTMORPH_PT_frames(_Panel, bpy.types.Panel):
    bl_label = "Bake Frames"

    def draw(self, context):
        scene = context.scene
        layout = self.layout.column(align=True)
        for kind, text in (
            ("SCENE", "In the Scene"),
            ("PLY", "PLY Files"),
            ("USD", "USD"),
            ("ALEMBIC", "Alembic"),
        ):
            button = layout.operator("pointmorph.bake_frames", text=text)
            button.format = kind
            button.frame_start = scene.frame_start
            button.frame_end = scene.frame_end


class POINTMORPH_PT_quality(_Panel, bpy.types.Panel):
    bl_label = "Quality"

    @classmethod
    def poll(cls, context):
        return operators.active_result(context) is not None

    def draw(self, context):
        layout = self.layout
        obj = operators.active_result(context)
        layout.operator(
            "pointmorph.show_distortion",
            icon="COLOR",
            depress=display.shows_distortion(obj),
        )
        report = operators.report_of(obj)
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
        if not report["worst"]:
            layout.label(text="No place stands out", icon="CHECKMARK")
        for index, place in enumerate(report["worst"]):
            row = layout.box().row()
            lines = row.column(align=True)
            for line in textwrap.wrap(place["advice"], _characters(context)):
                lines.label(text=line)
            row.operator("pointmorph.go_to_place", text="", icon="PIVOT_CURSOR").index = index


def _characters(context):
    """How many characters fit beside a button; Blender doesn't wrap labels."""
    width = context.region.width / context.preferences.system.ui_scale
    return max(20, int((width - 90) / 6))


# In the order of the work.
_classes = (
    POINTMORPH_UL_features,
    POINTMORPH_PT_objects,
    POINTMORPH_PT_features,
    POINTMORPH_PT_feature,
    POINTMORPH_PT_settings,
    POINTMORPH_PT_morph,
    POINTMORPH_PT_bake,
    POINTMORPH_PT_quality,
    POINTMORPH_PT_frames,
)


def register():
    for cls in _classes:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(_classes):
        bpy.utils.unregister_class(cls)
