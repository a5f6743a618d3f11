"""The look of a mesh that goes over into its target's."""

import bmesh
import bpy
import numpy as np
import pytest
from painted_scenes import (
    bilinear,
    corners_of,
    image_of,
    linear,
    material,
    new_image,
    ramp,
    sheets,
)
from scenes import add_attribute, coordinates, error_of, key, morph, read

pytestmark = pytest.mark.interface


def send(obj, places):
    """Makes a morphing mesh end at places in its own space."""
    last = obj.data.shape_keys.key_blocks["Morph"]
    last.data.foreach_set("co", np.asarray(places, np.float32).reshape(-1))


def test_the_target_is_drawn_along_the_map(textured):
    """A map that is known: a quarter turn of the sheet."""
    source, target = textured
    obj = morph()
    assert obj.material_slots[0].material.name == "Blue to Dune"
    assert source.material_slots[0].material.name == "Blue"
    x, y, _ = key(obj, "Basis").T
    flat = np.stack([-y, x], axis=1) * 0.9
    form = coordinates(target.data.vertices)
    of_points = obj.pointmorph.made_from.data.shape_keys.key_blocks["Morph"].data
    for vertex in (*target.data.vertices, *of_points):  # which know how it was morphed
        vertex.co.z = 0.0
    assert len(form) == 100
    send(obj, np.column_stack([flat, np.zeros(len(flat))]))
    assert bpy.ops.pointmorph.blend_textures(size="256") == {"FINISHED"}
    found = image_of(obj)
    assert found.shape == (256, 256, 4)
    u, v = np.meshgrid((np.arange(256) + 0.5) / 256, (np.arange(256) + 0.5) / 256)
    x, y = 2 * u - 1, 2 * v - 1
    wanted = np.stack([(-0.9 * y + 1) / 2, (0.9 * x + 1) / 2], axis=-1)
    np.testing.assert_allclose(found[..., :2], wanted, atol=0.02)
    np.testing.assert_allclose(found[..., 2], 0.2, atol=0.01)


def test_morph_blends_by_itself_if_both_look_like_something(settings, textured):
    source, target = textured
    settings.blend_textures = False
    obj = morph()
    assert [m.name for m in obj.data.materials] == ["Blue"]
    settings.blend_textures = True
    made = target.data.materials[0]
    target.data.materials.clear()
    obj = morph()
    assert [m.name for m in obj.data.materials] == ["Blue"]
    assert "expected a material, an image" in error_of(bpy.ops.pointmorph.blend_textures)
    target.data.materials.append(made)
    assert morph() == obj
    assert [m.name for m in obj.data.materials] == ["Blue to Dune"]
    # Who has said no isn't asked again.
    assert bpy.ops.pointmorph.keep_textures() == {"FINISHED"}
    morph()
    nodes = obj.data.materials[0].node_tree.nodes
    assert "Pointmorph Target" not in nodes
    assert bpy.ops.pointmorph.show_as(kind="POINTS") == {"FINISHED"}
    bpy.data.objects.remove(obj)
    assert "Show the morph as a mesh first" in error_of(bpy.ops.pointmorph.blend_textures)
    assert [m.name for m in source.data.materials] == ["Blue"]


def test_every_material_of_the_source_goes_over(settings, textured):
    """Slots of the mesh and of the object, one twice, one empty."""
    source, _ = textured
    blue = source.data.materials[0]
    for made in (material("Red", (1, 0, 0, 1)), None, blue, None):
        source.data.materials.append(made)
    source.material_slots[4].link = "OBJECT"
    source.material_slots[4].material = own = material("Own", (0, 1, 0, 1))
    count = len(source.data.polygons)
    source.data.polygons.foreach_set("material_index", np.arange(count) % 5)
    obj = morph()
    names = [slot.material.name for slot in obj.material_slots]
    assert names[0] == names[3] == "Blue to Dune"
    assert names[1:3] == ["Red to Dune", "Hill to Dune Look"]
    assert names[4] == "Own to Dune"
    assert [slot.link for slot in obj.material_slots] == ["DATA"] * 4 + ["OBJECT"]
    assert source.material_slots[4].material == own
    assert [m and m.name for m in source.data.materials][:4] == ["Blue", "Red", None, "Blue"]
    images = {
        slot.material.node_tree.nodes["Pointmorph Color"].image for slot in obj.material_slots
    }
    assert len(images) == 1
    # Once more: nothing new.
    before = len(bpy.data.materials), len(bpy.data.images)
    assert bpy.ops.pointmorph.blend_textures(size="512") == {"FINISHED"}
    assert (len(bpy.data.materials), len(bpy.data.images)) == before
    assert images.pop().size[:] == (512, 512)


def test_the_slider_drives_it_also_without_the_add_on(addon, textured, tmp_path):
    obj = morph()
    name = obj.name
    t = obj.data.shape_keys.key_blocks["Morph"]
    for frame, value in ((1, 0.0), (11, 1.0)):
        t.value = value
        t.keyframe_insert("value", frame=frame)
    path = str(tmp_path / "blend.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.data.objects[name]
    drivers = obj.material_slots[0].material.node_tree.animation_data.drivers
    assert sorted(curve.driver.type for curve in drivers) == ["AVERAGE", "SCRIPTED"]
    assert all(curve.driver.is_valid for curve in drivers)
    assert all(c.driver.is_simple_expression for c in drivers if c.driver.type == "SCRIPTED")
    assert image_of(obj).std() > 0.1  # it was packed
    for frame, value in ((1, 0.0), (6, 0.5), (11, 1.0)):
        bpy.context.scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        shown = obj.material_slots[0].material.evaluated_get(depsgraph)
        found = shown.node_tree.nodes["Pointmorph t"].outputs[0].default_value
        assert found == pytest.approx(value, abs=1e-6)
        mean = image_of(obj)[..., 1]
        assert (shown.diffuse_color[1] < 0.8) == (value > 0)
        assert 0.0 < mean.mean() < 1.0


@pytest.mark.parametrize("uvs", ["none", "folded", "tiled"])
def test_a_source_without_a_layout_gets_one(settings, textured, uvs, capfd):
    source, _ = textured
    layer = source.data.uv_layers[0]
    if uvs == "none":
        source.data.uv_layers.remove(layer)
    else:
        places = read(layer.data, "uv", 2)
        places = np.abs(places - (0.5, 0.0)) if uvs == "folded" else 3 * places
        layer.data.foreach_set("uv", places.astype(np.float32).reshape(-1))
    obj = morph()
    assert "Pointmorph" in obj.data.uv_layers
    assert "Pointmorph" not in source.data.uv_layers
    assert "The images have a UV map of their own, because" in capfd.readouterr().out
    nodes = obj.material_slots[0].material.node_tree.nodes
    assert nodes["Pointmorph UV"].uv_map == "Pointmorph"
    if uvs != "none":
        render = next(layer for layer in obj.data.uv_layers if layer.active_render)
        assert render.name == "UVMap"
    # At every corner of a face there is the color of its place on the target.
    drawn = linear(image_of(obj)[..., :3])
    found = bilinear(drawn, read(obj.data.uv_layers["Pointmorph"].data, "uv", 2))
    places = ((key(obj, "Morph")[corners_of(obj.data)][:, :2] + 1) / 2).clip(0, 1)
    inside = (np.abs(places - 0.5) < 0.45).all(axis=1)
    wanted = linear(places)
    np.testing.assert_allclose(found[inside, :2], wanted[inside], atol=0.03)


def test_a_morph_without_room_for_a_layout_is_still_shown(settings, capfd):
    source, target = sheets(settings, low=0.0, high=3.0)  # tiled: nothing can be drawn on that
    for number in range(7):
        source.data.uv_layers.new(name=f"More {number}")
    source.data.materials.append(material("Blue", (0, 0, 1, 1)))
    target.data.materials.append(material("Ramp", image=new_image("ramp", ramp())))
    obj = morph()
    assert obj.name == "Hill to Dune"
    assert obj.pointmorph.keeps_faces
    assert not obj.hide_get()
    assert [m.name for m in obj.data.materials] == ["Blue"]
    assert '"Hill to Dune" keeps the look of its source' in capfd.readouterr().out


def test_a_mesh_without_faces_cannot_be_drawn_on(settings, textured):
    source, _ = textured
    edited = bmesh.new()
    edited.from_mesh(source.data)
    bmesh.ops.delete(edited, geom=edited.faces[:], context="FACES_ONLY")
    edited.to_mesh(source.data)
    edited.free()
    morph()
    assert bpy.ops.pointmorph.make_mesh() == {"FINISHED"}
    assert "expected faces to draw on" in error_of(bpy.ops.pointmorph.blend_textures)


def test_attributes_and_points_are_blended_as_well(settings):
    source, target = sheets(settings)
    for obj, color in ((source, (1, 0, 0, 1)), (target, (0, 1, 0, 1))):
        count = len(obj.data.vertices)
        add_attribute(obj.data, "Paint", "FLOAT_COLOR", np.tile(color, (count, 1)))
    obj = morph()
    made = obj.material_slots[0].material
    own = next(n for n in made.node_tree.nodes if n.type == "VERTEX_COLOR")
    assert own.layer_name == "Paint"
    np.testing.assert_allclose(
        image_of(obj)[..., :3], np.tile((0, 1, 0), (1024, 1024, 1)), atol=0.01
    )


def test_roughness_and_normals_on_request(textured):
    _, target = textured
    target.data.materials[0].node_tree.nodes["Principled BSDF"].inputs[
        "Metallic"
    ].default_value = 0.7
    target.data.materials.append(material("Smooth"))
    smooth = target.data.materials[1].node_tree.nodes["Principled BSDF"]
    smooth.inputs["Roughness"].default_value = 0.1
    centers = np.array([face.center[:] for face in target.data.polygons])
    target.data.polygons.foreach_set("material_index", (centers[:, 0] > 0).astype(np.int32))
    for face in target.data.polygons:
        face.use_smooth = True
    obj = morph()
    assert bpy.ops.pointmorph.blend_textures(size="256", roughness=True, normal=True) == {
        "FINISHED"
    }
    surface = image_of(obj, "Surface")
    assert sorted(np.unique(surface[..., 1].round(2)))[0] == pytest.approx(0.1, abs=0.01)
    assert surface[..., 1].max() == pytest.approx(0.5, abs=0.01)
    assert surface[..., 2].max() == pytest.approx(0.7, abs=0.01)
    normal = 2 * image_of(obj, "Normal")[..., :3] - 1
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0, atol=0.03)
    assert normal[..., 2].mean() > 0.95
    nodes = obj.material_slots[0].material.node_tree.nodes
    assert nodes["Pointmorph Bent"].uv_map == "UVMap"
    assert nodes["Pointmorph Normal"].image.colorspace_settings.is_data
    # Without them again.
    assert bpy.ops.pointmorph.blend_textures(size="256") == {"FINISHED"}
    nodes = obj.material_slots[0].material.node_tree.nodes
    assert "Pointmorph Normal" not in nodes
    assert nodes["Pointmorph Target"].inputs["Metallic"].default_value == pytest.approx(0.7)
