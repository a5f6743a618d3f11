"""The sidebar's part about the morph object that is there: a box of rows, and what is folded below.

A row is a function of `ROWS`: it gets the layout, the context and the morph object, of pairs or
with the source's faces.
"""

import bpy

from ..data.registration import Registration
from ..operators.made_objects import made_object, shown_object
from ..scene import attribute_transfer, morph_object, presentation, recipes, staleness
from ..view import staleness_watch
from .panel import Panel, draw_progress, draw_subdivide, say
from .quality_panel import draw_verdict


def draw_name(layout, context, obj):
    row = layout.row()
    row.label(text=shown_object(context).name, icon="OBJECT_DATA")
    if obj.pointmorph.is_preview:
        layout.label(text="Preview: computing the full morph", icon="INFO")


def draw_slider(layout, context, obj):
    seen = shown_object(context)
    keys, name = seen.data.shape_keys, morph_object.morph_keys(seen)[0]
    if keys is not None and name in keys.key_blocks:
        row = layout.row()
        row.scale_y = 1.3
        row.prop(keys.key_blocks[name], "value", text="Morph", slider=True)


def draw_key_morph(layout, context, obj):
    settings = shown_object(context).pointmorph
    column = layout.column(align=True)
    row = column.row(align=True)
    row.prop(settings, "key_start")
    row.prop(settings, "key_end")
    row = column.row(align=True)
    row.prop(settings, "key_easing", text="")
    row.operator("pointmorph.key_morph", icon="KEY_HLT")


def _points_of(obj):
    """The morph object of pairs; None where it is gone."""
    points = obj if morph_object.is_result(obj) else obj.pointmorph.made_from
    return points if morph_object.is_result(points) else None


def draw_shown_as(layout, context, obj):
    points = _points_of(obj)
    row = layout.row(align=True)
    if points is not None:
        is_beside = morph_object.is_beside(obj, points)
        now = presentation.MESH if is_beside else presentation.kind_of(points)
        kinds = ["POINTS", "DISCS"]
        if now == presentation.MESH or presentation.has_faces(points):
            kinds.insert(0, "MESH")
        for kind in kinds:
            text = kind.capitalize()
            button = row.operator("pointmorph.show_as", text=text, depress=kind == now)
            button.kind = kind
        row.separator()
    visible = presentation.shows_shapes(obj)
    icon = "HIDE_OFF" if visible else "HIDE_ON"
    text = "Originals" if points is None else ""
    row.operator("pointmorph.show_shapes", text=text, icon=icon, depress=visible)


def draw_state(layout, context, obj):
    """Whether the morph is up to date, and the button that brings it there."""
    if draw_progress(layout, "RESULT"):
        return
    known = staleness_watch.known_state(obj)
    if known is None or known[0] == staleness.CURRENT:
        row = layout.row()
        if known is None:
            row.label(text="Checking", icon="TIME")
        else:
            row.label(text="Up to date", icon="CHECKMARK")
        row.operator("pointmorph.recompute", text="", icon="FILE_REFRESH")
        return
    state, reasons = known
    heads = {
        staleness.STALE: "Out of date",
        staleness.ORPHAN: "Objects missing",
        staleness.UNKNOWN: "May be out of date",
    }
    box = layout.box().column(align=True)
    box.label(text=heads[state], icon="ERROR")
    for reason in reasons:
        say(box, context, reason, "BLANK1")
    box.operator("pointmorph.recompute", icon="FILE_REFRESH")


def draw_too_fine(layout, context, obj):
    points = _points_of(obj)
    if points is not None and points.pointmorph.too_fine:
        name = recipes.present_words(points, points.pointmorph.too_fine)
        say(layout, context, f'Too few vertices to show "{name}"', "INFO")
        draw_subdivide(layout)


def draw_textures(layout, context):
    """How the mesh's look goes over into the target's."""
    if draw_progress(layout, "TEXTURES"):
        return
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


def _named(layout, name):
    """What stands beside a name; as wide as those of source and target."""
    row = layout.split(factor=0.22)
    row.label(text=name)
    return row.row(align=True)


def draw_transfer(layout, context, obj):
    """What the target has, for the mesh or the source, and what was done at last."""
    settings = context.scene.pointmorph
    column = layout.column(align=True)
    button = column.operator("pointmorph.transfer_attributes", icon="MOD_DATA_TRANSFER")
    for names in (("colors", "weights", "uvs"), ("keys", "hair")):
        row = column.row(align=True)
        for name in names:
            row.prop(settings, f"transfer_{name}", toggle=True)
            setattr(button, name, getattr(settings, f"transfer_{name}"))
    column.separator()
    _named(column, "Onto").prop(settings, "transfer_onto", expand=True)
    _named(column, "Prefix").prop(settings, "transfer_prefix", text="")
    column.prop(settings, "transfer_back")
    button.onto = settings.transfer_onto
    button.prefix = settings.transfer_prefix
    button.back = settings.transfer_back
    lines = attribute_transfer.words_of(obj)
    if lines:
        box = layout.box().column(align=True)
        for line in lines:
            say(box, context, line, "DOT")


ROWS = (
    draw_name,
    draw_slider,
    draw_key_morph,
    draw_shown_as,
    draw_state,
    draw_verdict,
    draw_too_fine,
)


class POINTMORPH_PT_result(Panel, bpy.types.Panel):
    bl_label = "Result"
    bl_order = 1

    @classmethod
    def poll(cls, context):
        return made_object(context) is not None

    def draw(self, context):
        obj = made_object(context)
        for draw_row in ROWS:
            draw_row(self.layout, context, obj)


class POINTMORPH_PT_more(Panel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "POINTMORPH_PT_result"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 9

    def draw(self, context):
        obj = made_object(context)
        layout = self.layout
        layout.operator("pointmorph.edit_morph", icon="EYEDROPPER")
        if morph_object.is_result(obj):
            layout.operator(
                "pointmorph.follow", depress=obj.pointmorph.follows, icon="CON_FOLLOWTRACK"
            )
            layout.operator("pointmorph.make_mesh", icon="MESH_DATA")
        if draw_progress(layout, "TRANSFER"):
            return
        draw_textures(layout, context)
        draw_transfer(layout, context, obj)


registration = Registration(
    classes=(
        POINTMORPH_PT_result,
        POINTMORPH_PT_more,
    ),
)
