"""The sidebar's part about the morph object that is there, and about chains."""

import bpy

from ..data.registration import Registration
from ..operators.made_objects import made_object
from ..scene import morph_object, staleness
from ..view import staleness_watch
from .panel import Panel, say


class POINTMORPH_UL_shapes(bpy.types.UIList):
    """The shapes between source and target, in order."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        layout.prop(item, "object", text="", icon="OBJECT_DATA")


class POINTMORPH_PT_chain(Panel, bpy.types.Panel):
    bl_label = "Chain"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        settings = context.scene.pointmorph
        layout = self.layout
        row = layout.row()
        row.template_list(
            "POINTMORPH_UL_shapes", "", settings, "via", settings, "active_via", rows=3
        )
        buttons = row.column(align=True)
        buttons.operator("pointmorph.add_to_chain", text="", icon="ADD")
        for change, icon in (("REMOVE", "REMOVE"), ("UP", "TRIA_UP"), ("DOWN", "TRIA_DOWN")):
            buttons.operator("pointmorph.change_chain", text="", icon=icon).change = change
        layout.operator("pointmorph.morph_chain")


class POINTMORPH_PT_morph_object(Panel, bpy.types.Panel):
    bl_label = "Morph Object"
    bl_order = 7

    @classmethod
    def poll(cls, context):
        return made_object(context) is not None

    def draw(self, context):
        obj = made_object(context)
        layout = self.layout
        layout.label(text=obj.name, icon="OBJECT_DATA")
        self._draw_state(context, obj)
        layout.operator("pointmorph.recompute", icon="FILE_REFRESH")
        layout.operator("pointmorph.edit_morph", icon="EYEDROPPER")
        if morph_object.is_result(obj):
            layout.operator(
                "pointmorph.follow", depress=obj.pointmorph.follows, icon="CON_FOLLOWTRACK"
            )
            layout.operator("pointmorph.make_mesh", icon="MESH_DATA")
        elif obj.pointmorph.made_from is None and obj.data.shape_keys is not None:
            key = obj.data.shape_keys.key_blocks.get(morph_object.morph_keys(obj)[0])
            if key is not None:
                layout.prop(key, "value", text="Morph", slider=True)
        settings = context.scene.pointmorph
        column = layout.column(align=True)
        button = column.operator("pointmorph.transfer_attributes", icon="MOD_DATA_TRANSFER")
        row = column.row(align=True)
        for what in ("colors", "weights", "uvs"):
            row.prop(settings, f"transfer_{what}", toggle=True)
            setattr(button, what, getattr(settings, f"transfer_{what}"))

        draw_textures(layout, context)

    def _draw_state(self, context, obj):
        known = staleness_watch.known_state(obj)
        if known is None:
            self.layout.label(text="Checking whether it is up to date", icon="TIME")
            return
        state, reasons = known
        if state == staleness.CURRENT:
            self.layout.label(text="Up to date", icon="CHECKMARK")
            return
        heads = {
            staleness.STALE: "Out of date",
            staleness.ORPHAN: "Objects missing",
            staleness.UNKNOWN: "May be out of date",
        }
        box = self.layout.box().column(align=True)
        box.label(text=heads[state], icon="ERROR")
        for reason in reasons:
            say(box, context, reason, "BLANK1")


def draw_textures(layout, context):
    """How the mesh's look goes over into the target's."""
    settings = context.scene.pointmorph
    column = layout.column(align=True)
    row = column.row(align=True)
    button = row.operator("pointmorph.blend_textures", icon="NODE_MATERIAL")
    row.operator("pointmorph.keep_textures", text="", icon="X")
    row = column.row(align=True)
    row.prop(settings, "texture_size", text="")
    for what in ("roughness", "normal"):
        row.prop(settings, f"texture_{what}", toggle=True)
        setattr(button, what, getattr(settings, f"texture_{what}"))
    button.size = settings.texture_size


registration = Registration(
    classes=(
        POINTMORPH_UL_shapes,
        POINTMORPH_PT_chain,
        POINTMORPH_PT_morph_object,
    ),
)
