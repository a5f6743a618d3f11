"""From Blender as it was just installed to a baked morph: the zip, the demo, one button each."""

import os
from pathlib import Path

import pytest
from steps import BAKE_SOURCE, MORPH, RUNNING, VIEWPORT, finished

MODULE = "bl_ext.user_default.pointmorph"
RESULT = 'bpy.data.objects.get("Hound to Giraffe")'

# Edit > Preferences > Get Extensions, in the place of the viewport: a second window needs somebody
# who puts it where it can be seen.
PREFERENCES = """
window = bpy.context.window_manager.windows[0]
area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
bpy.context.preferences.active_section = "EXTENSIONS"
area.ui_type = "PREFERENCES"
"""

INSTALL_FROM_DISK = """
region = next(region for region in area.regions if region.type == "WINDOW")
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.extensions.package_install_files("INVOKE_DEFAULT")

def browser():
    spaces = [area.spaces[0] for area in window.screen.areas if area.type == "FILE_BROWSER"]
    return spaces[0] if spaces and spaces[0].params else None
"""


@pytest.mark.skipif("POINTMORPH_ZIP" not in os.environ, reason="about the packaged add-on")
def test_install_from_disk_demo_morph_bake(new_users_window):
    window, packed = new_users_window, Path(os.environ["POINTMORPH_ZIP"])
    window.press("Escape", over=VIEWPORT)  # the first start's questions
    window.run(PREFERENCES)
    window.picture("new_user_0_extensions")
    window.run(INSTALL_FROM_DISK)
    window.wait("browser() is not None")
    window.run(f"browser().params.directory = {os.fsencode(packed.parent)!r}")
    window.run(f"browser().params.filename = {packed.name!r}")
    window.picture("new_user_1_install_from_disk")
    window.press("Return", over=VIEWPORT)
    window.wait(f"{MODULE!r} in bpy.context.preferences.addons")
    window.picture("new_user_2_installed")

    window.run("area.ui_type = 'VIEW_3D'")
    window.start()
    window.run("with in_viewport(): bpy.ops.pointmorph.add_demo(); bpy.ops.view3d.view_all()")
    window.open_tab()
    window.screenshot("new_user_3_demo")
    window.press_button(MORPH)
    window.wait(finished(RESULT))
    window.screenshot("new_user_4_morph")
    window.press_button(BAKE_SOURCE)
    keys = "bpy.data.objects['Hound'].data.shape_keys"
    assert window.ask(f"[key.name for key in {keys}.key_blocks]") == ["Basis", "Giraffe"]
    window.screenshot("new_user_5_baked")
    assert not window.ask(RUNNING)
    assert "Error" not in window.log
    assert window.close() == 0
