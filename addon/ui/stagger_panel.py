"""The sidebar's part about which parts of a morph go first, and how they travel."""

import bpy

from ..data import versions
from ..data.registration import Registration
from ..operators import polls
from ..scene import morph_object, path_display, stagger, stagger_nodes
from .panel import Panel, fields


def draw_stagger(layout, obj):
    """What the modifier of a morph object takes: its path, and what staggers it. Each can be keyed
    and driven, as it is the modifier's own."""
    modifier = stagger.modifier_of(obj)
    column = fields(layout)
    _draw(column, modifier, path_display.CURVE)
    _draw(column, modifier, stagger_nodes.STAGGER)
    kind = stagger.kind_of(modifier)
    if kind == stagger_nodes.OFF:
        return
    for name in stagger_nodes.INPUTS[kind]:
        owner, prop = versions.input_property(modifier, name)
        if name == stagger_nodes.GROUP_NAME:
            column.prop_search(owner, prop, obj, "vertex_groups", text="Group")
        elif name == "Object" and owner == modifier:
            column.prop_search(owner, prop, bpy.data, "objects", text="Object")
        else:
            column.prop(owner, prop, text=name)
    for name in stagger_nodes.COMMON:
        _draw(column, modifier, name)


def _draw(column, modifier, name):
    owner, prop = versions.input_property(modifier, name)
    column.prop(owner, prop, text=name)


def leader(context):
    """The object whose modifier says how the active morph goes; None where there is none."""
    obj = polls.active_result(context)
    if obj is None or obj.pointmorph.is_preview:
        return None
    shown = morph_object.shown_of(obj)
    return None if stagger.modifier_of(shown) is None else shown


class POINTMORPH_PT_stagger(Panel, bpy.types.Panel):
    bl_label = "Path and Stagger"
    bl_parent_id = "POINTMORPH_PT_result"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return leader(context) is not None

    def draw(self, context):
        draw_stagger(self.layout, leader(context))


registration = Registration(classes=(POINTMORPH_PT_stagger,))
