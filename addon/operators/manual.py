"""The way to the manual."""

from pathlib import Path

import bpy

from ..data.registration import Registration

MANUAL = Path(__file__).parents[1] / "docs" / "manual" / "index.html"
_SOURCES = Path(__file__).parents[2] / "docs" / "manual" / "index.md"  # of a checkout


class POINTMORPH_OT_manual(bpy.types.Operator):
    """Open the manual that comes with the add-on"""

    bl_idname = "pointmorph.manual"
    bl_label = "Manual"
    bl_options = {"REGISTER"}

    def execute(self, context):
        found = MANUAL if MANUAL.is_file() else _SOURCES
        if not found.is_file():
            self.report({"ERROR"}, f"The manual wasn't found at {MANUAL}: reinstall the add-on")
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=found.as_uri())
        return {"FINISHED"}


registration = Registration(
    classes=(POINTMORPH_OT_manual,),
)
