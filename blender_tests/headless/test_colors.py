"""What is shown has its colours, in Cycles and in Workbench, whatever stands for the points."""

import math

import bpy
import numpy as np
import pytest
from pointmorph.sequences import surfaces
from scenes import add_attribute, add_object, coordinates, morph, pair

pytestmark = pytest.mark.interface

SIDE = 64
CLEAR = 0.3  # alpha, on the right


@pytest.fixture
def painted(settings):
    """A morph object whose points are red on the left and green on the right, half seen through
    there; and a camera above it."""
    for obj in pair(40, 38):
        left = coordinates(obj.data.vertices)[:, :1] < 0
        colors = np.where(left, [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, CLEAR])
        add_attribute(obj.data, "Paint", "FLOAT_COLOR", colors)
        obj.data.color_attributes.active_color = obj.data.color_attributes["Paint"]
        obj.hide_render = True
    bpy.ops.pointmorph.morph()
    scene = bpy.context.scene
    camera = add_object("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2.2
    camera.location.z = 5
    scene.camera = camera
    add_object("Sun", bpy.data.lights.new("Sun", "SUN")).data.energy = 3.0
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    return bpy.context.view_layer.objects.active


def show_as(versions, obj, kind):
    for name in ("Discs", "Spheres"):
        versions.set_input(obj.modifiers["Points"], name, name == kind)
    obj.update_tag()


def sides(kind, output, name):
    """Red, green, blue and alpha of the pixels on the left and of those on the right."""
    scene = bpy.context.scene
    if kind == "CYCLES":
        scene.render.engine = "CYCLES"
        scene.cycles.samples, scene.cycles.use_denoising = 16, False
    else:
        scene.render.engine = "BLENDER_WORKBENCH"
        scene.display.shading.color_type = "VERTEX"
    path = output / f"colors_{name}_{kind.lower()}.png"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    values = np.array(image.pixels[:]).reshape(SIDE, SIDE, 4)[SIDE // 4 : -SIDE // 4]
    bpy.data.images.remove(image)
    both = values[:, 8 : SIDE // 2 - 8], values[:, SIDE // 2 + 8 : -8]
    return [side.reshape(-1, 4) for side in both]


def render(kind, output, name):
    """Mean red, green, blue and alpha on the left and on the right."""
    return [side.mean(axis=0) for side in sides(kind, output, name)]


def assert_red_and_green(left, right):
    assert left[0] > 2.5 * left[1:3].max(), left
    assert right[1] > 2.5 * max(right[0], right[2]), right
    assert left[3] > 0.98


@pytest.mark.renders
@pytest.mark.parametrize("kind", ["Points", "Spheres", "Discs"])
@pytest.mark.parametrize("what", ["morph", "frames"])
def test_colours_show(addon, painted, output, kind, what):
    obj = painted
    if what == "frames":
        bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3, resample=False)
        obj = bpy.context.view_layer.objects.active
    show_as(addon("data.versions"), obj, kind)
    for t, frame in ((0.0, 1), (0.5, 2)):
        painted.data.shape_keys.key_blocks["Morph"].value = t
        bpy.context.scene.frame_set(frame)
        left, right = render("CYCLES", output, f"{what}_{kind}_{frame}")
        assert_red_and_green(left, right)
        assert CLEAR < right[3] < 0.93  # where splats lie on one another, less shines through
        if kind != "Points":  # Workbench knows no colours of points
            assert_red_and_green(*render("WORKBENCH", output, f"{what}_{kind}_{frame}"))


@pytest.mark.renders
@pytest.mark.parametrize("kind", ["Spheres", "Discs"])
def test_pairs_of_one_point_are_as_bright_as_others(addon, painted, output, kind):
    """Splats that lie in the same place keep no light from each other."""
    show_as(addon("data.versions"), painted, kind)
    end = painted.data.shape_keys.key_blocks["Morph"]
    places = coordinates(end.data)
    assert len(np.unique(places, axis=0)) < 0.9 * len(places)
    end.value = 1.0
    left, _ = sides("CYCLES", output, f"one_point_{kind}")
    red = left[:, 0]
    assert red.min() > 0.8 * red.mean()


@pytest.mark.renders
def test_backs_of_discs_have_colour_and_alpha(addon, painted, output):
    show_as(addon("data.versions"), painted, "Discs")
    camera = bpy.context.scene.camera
    camera.location.z, camera.rotation_euler.y = -5, math.pi
    right, left = render("CYCLES", output, "backs")
    assert_red_and_green(left, right)
    assert CLEAR < right[3] < 0.93


@pytest.mark.renders
def test_colours_of_faces_show(painted, output):
    if not surfaces.is_available():
        pytest.skip("this Python has no pymeshlab and scipy that fit its numpy")
    bpy.ops.pointmorph.bake_frames(frame_start=1, frame_end=3, step=2, faces=True)
    for kind in ("CYCLES", "WORKBENCH"):
        assert_red_and_green(*render(kind, output, "faces"))


@pytest.mark.parametrize("kind", ["Spheres", "Discs"])
def test_nothing_but_the_splats_is_left(addon, painted, kind):
    """The mesh that says which colours are active isn't shown itself."""
    show_as(addon("data.versions"), painted, kind)
    evaluated = painted.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    corners = 12 if kind == "Spheres" else 6
    assert len(evaluated.vertices) == corners * len(painted.data.vertices)
    assert evaluated.color_attributes.active_color.name == "Color"


def test_a_morph_object_as_a_shape_keeps_its_colours(painted, addon):
    colors = addon("data.arrays").mesh_colors(painted.data)
    assert colors is not None
    assert set(np.unique(colors[:, 2])) == {0.0}


@pytest.mark.makes_nodes
def test_a_material_of_an_earlier_version_is_mended(settings):
    """An Attribute node that feeds an alpha makes Blender 5.2.3 end when it exports USD."""
    material = bpy.data.materials.new("Pointmorph Points")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    color = tree.nodes.new("ShaderNodeAttribute")
    color.attribute_name = "Color"
    tree.links.new(color.outputs["Alpha"], surface.inputs["Alpha"])
    pair()
    obj = morph()
    group = obj.modifiers["Points"].node_group
    shown = next(node for node in group.nodes if node.bl_idname == "GeometryNodeSetMaterial")
    assert shown.inputs["Material"].default_value == material
    (link,) = surface.inputs["Alpha"].links
    assert link.from_node.bl_idname == "ShaderNodeVertexColor"
    assert link.from_node.layer_name == "Color"
