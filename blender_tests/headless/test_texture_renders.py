"""Renders of meshes whose looks are blended."""

import bpy
import numpy as np
import pytest
from painted_scenes import checker, flat_uvs, material, new_image, ramp
from scenes import add_mesh, add_object, mark, morph, patch, pick

pytestmark = pytest.mark.interface


SIDE = 96  # of a render


def rendered(output, name, *shown):
    scene = bpy.context.scene
    for obj in bpy.data.objects:
        if obj.type == "MESH":
            obj.hide_render = obj not in shown
    scene.render.filepath = str(output / f"textures_{name}.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    values = np.array(image.pixels[:]).reshape(SIDE, SIDE, 4)
    bpy.data.images.remove(image)
    return values[..., :3]


def stage():
    scene = bpy.context.scene
    camera = add_object("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location.z = "ORTHO", 1.8, 5
    scene.camera = camera
    add_object("Sun", bpy.data.lights.new("Sun", "SUN")).data.energy = 3.0
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 16, False
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"


@pytest.mark.renders
def test_looks_go_part_by_part_where_the_morph_does(addon, textured, output):
    obj = morph()
    stage()
    for face in obj.data.polygons:
        face.use_smooth = True
    stagger = addon("scene.stagger")
    t = obj.data.shape_keys.key_blocks["Morph"]
    t.value = 0.5
    together = rendered(output, "together", obj)
    stagger.choose(obj, "Height", Direction=(1.0, 0.0, 0.0), Overlap=0.2)
    bpy.context.view_layer.update()
    apart = rendered(output, "staggered", obj)
    half = SIDE // 2
    for row in (slice(half - 8, half + 8),):
        left, right = apart[row, 4:20].mean(axis=(0, 1)), apart[row, -20:-4].mean(axis=(0, 1))
        assert left[1] > left[2]  # the target's ramp
        assert right[2] > 2 * right[1]  # the source's blue
    assert together[half, 8, 2] > apart[half, 8, 2] + 0.1


@pytest.mark.renders
def test_both_ends_look_like_the_models(settings, output):
    source = add_mesh("Hill", *patch(40, bump=0.2))
    target = add_mesh("Dune", *patch(34, bump=0.3, turn=1.0))
    for obj in (source, target):
        for number, (x, y) in enumerate([(0, 0), (-1, -1), (1, -1), (1, 1), (-1, 1)]):
            mark(obj, str(number), x, y)
        flat_uvs(obj, low=0.02, high=0.98)
        for face in obj.data.polygons:
            face.use_smooth = True
    pick(source, target)
    settings.domain, settings.show_as = "disk", "MESH"
    source.data.materials.append(material("Checker", image=new_image("checker", checker())))
    source.data.materials.append(material("Red", (0.7, 0.02, 0.02, 1)))
    centers = np.array([face.center[:] for face in source.data.polygons])
    source.data.polygons.foreach_set("material_index", (centers[:, 1] > 0.5).astype(np.int32))
    target.data.materials.append(material("Ramp", image=new_image("ramp", ramp())))
    stage()
    obj = morph()
    t = obj.data.shape_keys.key_blocks["Morph"]
    wanted = rendered(output, "source", source), rendered(output, "target", target)
    for value, picture in zip((0.0, 1.0), wanted, strict=True):
        t.value = value
        found = rendered(output, f"mesh_{value:.0f}", obj)
        apart = np.abs(found - picture)
        assert apart.mean() < (0.003 if value == 0 else 0.02), value
        assert np.percentile(apart, 95) < (0.02 if value == 0 else 0.06), value
    t.value = 0.5
    middle = rendered(output, "mesh_half", obj)
    for picture in wanted:
        assert np.abs(middle - picture).mean() > 0.03
