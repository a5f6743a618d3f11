"""The add-on comes and goes without a trace, and explains itself."""

import os
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

pytestmark = pytest.mark.interface

OPERATORS = (
    "add_feature",
    "add_to_chain",
    "change_chain",
    "edit_morph",
    "blend_textures",
    "explain",
    "follow",
    "join_copies",
    "keep_textures",
    "make_mesh",
    "morph_chain",
    "recompute",
    "transfer_attributes",
    "bake_collection",
    "bake_frames",
    "bake_shape_keys",
    "add_demo",
    "add_loop_feature",
    "check_features",
    "clear_loop",
    "click_features",
    "copy_command",
    "jump_to_feature",
    "key_morph",
    "manual",
    "morph",
    "move_loop_feature",
    "pair_features",
    "pick_selected",
    "mirror_features",
    "propose_features",
    "propose_loop",
    "remove_feature",
    "remove_loop_feature",
    "show_cut",
    "swap_objects",
    "show_as",
    "show_confidence",
    "show_distortion",
    "show_shapes",
    "go_to_place",
    "subdivide_source",
    "use_as_shown",
)
# Each click is undone by itself; the others change nothing in the file.
UNDO_STEPS_OF_THEIR_OWN = ("click_features", "copy_command", "explain", "manual", "show_cut")


def registered():
    """Whatever bears the add-on's name in Blender."""
    types = {name for name in dir(bpy.types) if "pointmorph" in name.lower()}
    operators = set(dir(bpy.ops.pointmorph))
    on_types = {
        cls.__name__ for cls in (bpy.types.Scene, bpy.types.Object) if hasattr(cls, "pointmorph")
    }
    handlers = {
        event
        for event in dir(bpy.app.handlers)
        if isinstance(getattr(bpy.app.handlers, event), list)
        for function in getattr(bpy.app.handlers, event)
        if "pointmorph" in getattr(function, "__module__", "")
    }
    return types, operators, on_types, handlers


def test_disabling_leaves_nothing_and_enabling_brings_everything_back(module):
    before = registered()
    types, operators, on_types, handlers = before
    assert operators == set(OPERATORS)
    assert on_types == {"Scene", "Object"}
    assert "depsgraph_update_post" in handlers
    assert "POINTMORPH_PT_morph" in types
    for _ in range(2):
        bpy.ops.preferences.addon_disable(module=module)
        assert registered() == (set(), set(), set(), set())
        bpy.ops.preferences.addon_enable(module=module)
        assert registered() == before


@pytest.mark.skipif("POINTMORPH_ZIP" not in os.environ, reason="about the packaged add-on")
def test_the_library_is_the_one_that_the_add_on_brings(module):
    import pointmorph

    assert pointmorph.__file__.startswith(os.environ["BLENDER_USER_RESOURCES"])


@pytest.mark.parametrize("name", OPERATORS)
def test_operators_explain_themselves_and_can_be_undone(name):
    steps = name in UNDO_STEPS_OF_THEIR_OWN
    assert ("UNDO" in getattr(bpy.types, f"POINTMORPH_OT_{name}").bl_options) != steps
    operator = getattr(bpy.ops.pointmorph, name).get_rna_type()
    assert operator.description
    for prop in operator.properties:
        if prop.identifier != "rna_type":
            assert prop.description, prop.identifier


@pytest.mark.parametrize("group", ["scene", "object", "feature"])
def test_properties_have_tooltips(settings, group):
    obj = bpy.data.objects.new("Empty", None)
    groups = {"scene": settings, "object": obj.pointmorph, "feature": settings.features.add()}
    for prop in groups[group].bl_rna.properties:
        if prop.identifier not in ("rna_type", "name"):
            assert prop.description, prop.identifier


def test_panels_sit_in_their_tab():
    panels = [name for name in dir(bpy.types) if name.startswith("POINTMORPH_PT_")]
    assert panels
    for name in panels:
        panel = getattr(bpy.types, name)
        if name == "POINTMORPH_PT_feature":  # opened by its button alone
            assert panel.bl_region_type != "UI"
            continue
        assert (panel.bl_space_type, panel.bl_region_type) == ("VIEW_3D", "UI")
        assert panel.bl_category == "Pointmorph"


def test_blender_ends_well_with_the_add_on(module, tmp_path):
    """Enabled, with a morph in the scene, a Blender that just ends does so without a crash."""
    if bpy.app.binary_path:
        pytest.skip("about Blender as a Python module")
    if bpy.app.version < (4, 5):
        pytest.skip("bpy 4.2 crashes at its end after any property with a callback was registered")
    scripts = str(Path(bpy.__file__).parents[2])
    paths = [str(Path(bpy.__file__).parents[5])]
    paths += [path for path in sys.path if path and not path.startswith(scripts)]
    code = f"""
import sys
sys.path[:] = {paths!r}
import bpy
bpy.ops.preferences.addon_enable(module={module!r})
sys.path.insert(0, {str(Path(__file__).parent)!r})
import scenes
bpy.ops.wm.read_homefile(use_empty=True)
scenes.pair(12, 10)
bpy.ops.pointmorph.morph()
print("morphed")
"""
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False
    )
    assert "morphed" in ended.stdout, ended.stderr
    assert ended.returncode == 0, ended.stderr
