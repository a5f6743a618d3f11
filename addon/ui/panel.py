"""What all panels share."""

import textwrap

from ..core import background_job
from ..operators import modal_operator, polls


class Panel:
    """Where all panels are. `bl_order` is that of the work."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Pointmorph"


def fields(layout):
    """A column of names and values, as Blender's own panels have them."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    column = layout.column()
    column.enabled = background_job.current is None
    return column


def say(layout, context, text, icon, beside=0):
    """Words on several lines; Blender doesn't wrap labels. `beside` is what stands beside."""
    scale = context.preferences.system.ui_scale
    width = context.region.width / scale - 65 - beside
    lines = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, max(18, int(width / 6.7)))):
        lines.label(text=line, icon="BLANK1" if number and icon != "NONE" else icon)


def explained(layout, text, meaning, icon="NONE"):
    """A label with a tooltip."""
    row = layout.row()
    row.alignment = "LEFT"
    row.operator("pointmorph.explain", text=text, icon=icon, emboss=False).meaning = meaning


def has_points(context):
    """Whether there is a morph object of pairs, which alone has quality and can be baked."""
    return polls.active_result(context) is not None


def draw_problem(layout, context, place):
    """What went wrong last, next to the thing that it is about."""
    if background_job.problem is None or background_job.problem[0] != place:
        return
    box = layout.box()
    box.alert = True
    say(box, context, background_job.problem[1], "ERROR")


def draw_progress(layout, place=None):
    """How far the job is that runs, in place of the button that started it; whether one runs.

    A button that is grayed meanwhile can stay so after an error until the mouse has left it.
    `place` is that of the job: see `Computing`. None is for any.
    """
    job = background_job.current
    if job is None or place not in (None, job.place):
        return False
    column = layout.column(align=True)
    row = column.row()
    row.scale_y = 1.8 if place is None else 1.0
    row.progress(text=modal_operator.progress_text(), factor=job.fraction)
    column.label(text="Press Esc to cancel")
    return True


def draw_subdivide(layout):
    """The button, but while the morph is recomputed: see `draw_progress`."""
    job = background_job.current
    if job is None or job.place != "RESULT":
        layout.operator("pointmorph.subdivide_source", icon="MOD_SUBSURF")
