"""Runs in a background Blender: installs the add-on and keeps it enabled for the next start."""

import bpy
import installing

installing.install()
preferences = bpy.context.preferences
preferences.view.show_splash = False
preferences.view.ui_scale = 1.0
# Without a graphics card every picture counts.
preferences.view.smooth_view = 0
preferences.view.show_tooltips = False
preferences.system.viewport_aa = "OFF"
preferences.system.use_overlay_smooth_wire = False
preferences.use_preferences_save = False  # at the end, by itself
bpy.ops.wm.save_userpref()
