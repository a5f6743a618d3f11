"""Takes the manual's pictures from the real window: python3 build_addon.py pictures

Not among the tests: it writes into docs/manual/images.
"""

import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from steps import MORPH, RUNNING, VIEWPORT, finished

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "manual" / "images"
WIDTH = 720
DEMO = "Hound to Giraffe"


@pytest.fixture(scope="session")
def size():
    """Room for Blender's whole window, as users have it."""
    return 1280, 1000


@pytest.fixture
def demo(window):
    """The two animals of the menu, from the front left, with room between them."""
    window.run(
        """
from mathutils import Euler, Vector
area.spaces[0].overlay.show_floor = True
area.spaces[0].overlay.show_axis_x = area.spaces[0].overlay.show_axis_y = True
area.spaces[0].shading.type = "SOLID"
area.spaces[0].shading.color_type = "VERTEX"
bpy.context.scene.pointmorph.show_as = "MESH"
with in_viewport():
    bpy.ops.pointmorph.add_demo()
    bpy.data.objects["Hound"].location.x = -2.2
    bpy.data.objects["Giraffe"].location.x = 2.2
    view = area.spaces[0].region_3d
    view.view_perspective = "ORTHO"
    view.view_rotation = Euler((1.35, 0, -0.6)).to_quaternion()
    for obj in bpy.data.objects: obj.select_set(True)
    bpy.ops.view3d.view_selected()
    # The sidebar covers a third of the viewport.
    view.view_distance *= 1.15
    view.view_location += view.view_rotation @ Vector((1.2, 0, 0))
scenes.select(bpy.data.objects["Hound"])
"""
    )
    window.open_tab()
    return window


def take(window, name, part="all"):
    """A picture of the viewport and the sidebar, or of the sidebar alone."""
    path = window.screenshot(name)
    left, top, right, bottom = window.sidebar()
    with Image.open(path) as picture:
        edge = {"all": 60, "sidebar": left}[part]
        cut = picture.convert("RGB").crop((edge, top, right + 22, min(bottom, top + 800)))
        if cut.width > WIDTH:
            cut = cut.resize((WIDTH, round(cut.height * WIDTH / cut.width)), Image.LANCZOS)
        IMAGES.mkdir(exist_ok=True)
        cut.save(IMAGES / f"{name}.png", optimize=True)


def morph(window):
    window.press_button(MORPH)
    window.wait(finished(f"bpy.data.objects.get({DEMO!r})"))
    window.run("bpy.ops.pointmorph.show_shapes()")  # halfway, the result is between them


def set_value(window, value):
    keys = f"bpy.data.objects[{DEMO!r}].data.shape_keys"
    window.run(f"{keys}.key_blocks['Morph'].value = {value}")


def wait_for_blue(window):
    """Until the result is there in the color of little distortion: at first, Blender compiles
    shaders."""
    for _ in range(60):
        with Image.open(window.screenshot("distortion")) as picture:
            colors = np.asarray(picture.convert("RGB"), int)[:, :700]
        if (colors[..., 2] > 60 + colors[..., 0]).sum() > 3000:
            return
        time.sleep(1)
    raise AssertionError("the points are still not there")


def test_marked(demo):
    take(demo, "marked")


def test_clicking(demo):
    demo.run(
        """
for obj in (bpy.data.objects["Hound"], bpy.data.objects["Giraffe"]):
    for name in ("pm.nose", "pm.ear.L", "pm.ear.R"):
        if (obj.name, name) != ("Hound", "pm.nose"):
            obj.vertex_groups.remove(obj.vertex_groups[name])
"""
    )
    demo.press_button("click_features")
    demo.settle()
    take(demo, "clicking")
    demo.press("Escape", over=VIEWPORT)


def test_result(demo):
    morph(demo)
    set_value(demo, 0.5)
    take(demo, "result")
    demo.open_panel("POINTMORPH_PT_quality")
    demo.press_button("show_distortion")
    wait_for_blue(demo)
    take(demo, "distortion")
    demo.close_panel("POINTMORPH_PT_quality")


def test_cut(demo):
    demo.open_panel("POINTMORPH_PT_cut")
    demo.press_button("propose_loop")
    demo.wait(f"not ({RUNNING}) and len(bpy.context.scene.pointmorph.loop) > 2")
    take(demo, "cut")
    demo.close_panel("POINTMORPH_PT_cut")


def test_error(demo):
    demo.run(
        """
giraffe = bpy.data.objects["Giraffe"]
giraffe.vertex_groups.remove(giraffe.vertex_groups["pm.tail"])
"""
    )
    demo.press_button(MORPH)
    demo.wait("session().problem is not None")
    demo.press("Left", over=(300, 980))  # Blender's own message goes when the mouse does
    demo.settle()
    take(demo, "error", "sidebar")


def test_frames(demo):
    morph(demo)
    demo.run("bpy.context.scene.pointmorph.bake_as = 'FRAMES'")
    demo.find("bake_frames")
    take(demo, "frames", "sidebar")


def test_mesh(window):
    """The default cube, which gets more vertices, on its way to a sphere between the two."""
    window.run(
        """
from mathutils import Euler, Vector
area.spaces[0].overlay.show_floor = True
area.spaces[0].overlay.show_axis_x = area.spaces[0].overlay.show_axis_y = True
area.spaces[0].overlay.show_wireframes = True
area.spaces[0].overlay.wireframe_threshold = 1.0
area.spaces[0].shading.type = "SOLID"
bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4, location=(3.2, 0, 0))
bpy.ops.mesh.primitive_cube_add(location=(-3.2, 0, 0))
scenes.pick(bpy.context.object, bpy.data.objects["Icosphere"])
with in_viewport():
    view = area.spaces[0].region_3d
    view.view_perspective = "ORTHO"
    view.view_rotation = Euler((1.1, 0, -0.3)).to_quaternion()
    for obj in bpy.data.objects: obj.select_set(True)
    bpy.ops.view3d.view_selected()
    view.view_distance *= 1.1
    view.view_location += view.view_rotation @ Vector((1.6, 0, 0))
scenes.select(bpy.data.objects["Cube"])
"""
    )
    window.open_tab()
    window.run("bpy.context.scene.pointmorph.show_as = 'MESH'")
    window.press_button(MORPH)
    window.wait(finished("bpy.data.objects.get('Cube to Icosphere')"))
    window.press_button("subdivide_source")
    window.wait(f"not ({RUNNING}) and bpy.context.object.pointmorph.state == 'CURRENT'")
    window.run(
        """
bpy.ops.pointmorph.show_shapes()
mesh = bpy.data.objects["Cube to Icosphere"]
mesh.location.x = -3.2 * 1.2  # and 0.6 of the way to the sphere: in the middle
mesh.data.shape_keys.key_blocks["Morph"].value = 0.6
"""
    )
    window.settle()
    take(window, "mesh")


SHAPES = {
    "Cube to Icosphere": "primitive('cube'), primitive('ico_sphere', subdivisions=4)",
    "Cylinder to Sphere": "primitive('cylinder'), primitive('uv_sphere')",
    "Cone to Suzanne": "primitive('cone'), primitive('monkey')",
    "Fox to Hare": "creature('Fox', .9, .6, .3, .06, 500), creature('Hare', 1.2, .8, .5, .02)",
}


def test_shapes(changed_window):
    """Blender's own shapes and two animals of 500 and some 50,000 faces, by two clicks: *Morph*
    and, as the panel says, *Subdivide Source*. Left the source as it was, right the target,
    between them the source's mesh at 1."""
    window = changed_window
    pictures = []
    for name, make in SHAPES.items():
        source, target = name.split(" to ")
        window.run(
            f"""
for obj in list(bpy.data.objects): bpy.data.objects.remove(obj)
from mathutils import Euler, Vector
from modeling import creature, primitive
source, target = {make}
area.spaces[0].overlay.show_wireframes = False  # those of the hare would hide it
area.spaces[0].overlay.wireframe_threshold = 1.0
area.spaces[0].shading.type = "SOLID"
source.show_wire = True
target.show_wire = len(target.data.polygons) < 9999
apart = 1.25 * max(target.dimensions)
source.location.x = -apart
target.location.x = apart
bpy.context.view_layer.update()
with in_viewport():
    view = area.spaces[0].region_3d
    view.view_perspective = "ORTHO"
    view.view_rotation = Euler((1.25, 0, 0.3)).to_quaternion()
    for obj in bpy.data.objects: obj.select_set(True)
    bpy.ops.view3d.view_selected()
    view.view_location += view.view_rotation @ Vector((0.55 * apart, 0, 0))
plain = source.copy()
plain.data = plain.data.copy()
scenes.pick(source, target)
bpy.context.scene.pointmorph.show_as = "MESH"
"""
        )
        window.open_tab()
        window.press_button(MORPH)
        window.wait(finished(f"bpy.data.objects.get('{name}')"))
        window.press_button("subdivide_source")
        window.wait(f"not ({RUNNING}) and bpy.context.object.pointmorph.state == 'CURRENT'")
        window.run(
            f"""
bpy.ops.pointmorph.show_shapes()
bpy.data.objects["{source}"].hide_set(True)
bpy.context.collection.objects.link(plain)
for obj in bpy.data.objects: obj.select_set(False)
mesh = bpy.data.objects["{name}"]
mesh.show_wire = True
mesh.location.x = -2 * (bpy.data.objects["{target}"].location.x)
mesh.data.shape_keys.key_blocks["Morph"].value = 1
"""
        )
        window.settle()
        with Image.open(window.screenshot(name.split()[0].lower())) as picture:
            _, top, right, bottom = window.sidebar()
            cut = picture.convert("RGB").crop((60, top, right + 22, min(bottom, top + 560)))
            pictures.append(
                cut.resize((WIDTH, round(cut.height * WIDTH / cut.width)), Image.LANCZOS)
            )
    height = pictures[0].height
    sheet = Image.new("RGB", (2 * WIDTH, 2 * height))
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % 2 * WIDTH, k // 2 * height))
    sheet.quantize(96, dither=Image.Dither.NONE).save(IMAGES / "shapes.png", optimize=True)
