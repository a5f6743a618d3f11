"""Blended looks once something changed: materials, meshes, the morph itself."""

import bpy
import numpy as np
import pytest
from modeling import add_armature
from painted_scenes import bilinear, corners_of, image_of, linear, material, new_image
from scenes import add_mesh, error_of, key, mark, morph, patch, read, select


def test_recompute_draws_anew(addon, textured):
    _, target = textured
    obj = morph()
    made, image = obj.material_slots[0].material, image_of(obj)
    assert obj.pointmorph.state == "CURRENT"
    node = next(n for n in target.data.materials[0].node_tree.nodes if n.type == "TEX_IMAGE")
    node.image = new_image("other", np.tile((0.5, 0.5, 0.5, 1.0), (4, 4, 1)))
    assert obj.pointmorph.state == "STALE"
    assert 'the look of "Dune" has changed' in obj.pointmorph.stale
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert obj.pointmorph.state == "CURRENT"
    assert obj.material_slots[0].material == made
    assert np.abs(image_of(obj) - image).max() > 0.2
    np.testing.assert_allclose(image_of(obj)[..., :3], 0.5, atol=0.01)
    assert addon("scene.recipes").recipe_of(obj)["textures"]["size"] == 256


@pytest.mark.parametrize("edited", ["source", "mesh"])
def test_recompute_draws_for_the_uvs_that_the_mesh_has(textured, edited):
    """Turned on the source, UVs are taken over; turned on the mesh alone, they stay."""
    source, _ = textured
    obj = morph()
    changed = source if edited == "source" else obj
    layer = changed.data.uv_layers[0]
    turned = 1.0 - read(layer.data, "uv", 2)
    layer.data.foreach_set("uv", turned.reshape(-1))
    changed.data.update()
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert obj.pointmorph.state == "CURRENT"
    uvs = read(obj.data.uv_layers["UVMap"].data, "uv", 2)
    np.testing.assert_array_equal(uvs, turned)
    found = bilinear(linear(image_of(obj)[..., :3]), uvs)
    places = ((key(obj, "Morph")[corners_of(obj.data)][:, :2] + 1) / 2).clip(0, 1)
    inside = (np.abs(places - 0.5) < 0.45).all(axis=1)
    np.testing.assert_allclose(found[inside, :2], linear(places[inside]), atol=0.03)


@pytest.mark.usefixtures("textured")
def test_normals_are_drawn_anew_in_the_background(addon, monkeypatch):
    """In the job, which can be canceled, and not when its result is put into the scene."""
    obj = morph()
    assert bpy.ops.pointmorph.blend_textures(size="256", normal=True) == {"FINISHED"}
    before = image_of(obj, "Normal")
    drawn_in, draw = [], addon("core.computation").draw

    def note(*args):
        drawn_in.append(args[2])
        return draw(*args)

    monkeypatch.setattr(addon("core.computation"), "draw", note)
    monkeypatch.setattr(addon("scene.blended_textures"), "read_steps", None)
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert [options.normal for options in drawn_in] == [True]
    np.testing.assert_allclose(image_of(obj, "Normal"), before, atol=0.02)


@pytest.mark.parametrize("normal", [False, True])
def test_a_target_that_has_another_pose_by_now_looks_as_it_did(textured, normal):
    """It was drawn where the target's faces were by now, which is anywhere."""
    _, target = textured
    target.data.shade_smooth()
    add_armature(target, (0, 0, 0))
    obj = morph()
    select(obj)
    assert bpy.ops.pointmorph.blend_textures(size="256", normal=normal) == {"FINISHED"}
    names = ("Color", "Normal") if normal else ("Color",)
    before = [image_of(obj, name) for name in names]
    bone = bpy.data.objects["Rig"].pose.bones["Bone"]
    bone.location, bone.rotation_quaternion = (0.7, 0.4, 0.3), (0.6, 0.5, 0.4, 0.5)
    bpy.context.view_layer.update()
    assert bpy.ops.pointmorph.blend_textures(size="256", normal=normal) == {"FINISHED"}
    for name, image in zip(names, before, strict=True):
        np.testing.assert_allclose(image_of(obj, name), image, atol=0.02)


def test_recompute_blends_where_nobody_decided(addon, settings, textured):
    settings.blend_textures = False
    obj = morph()
    settings.blend_textures = True
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert obj.material_slots[0].material.name == "Blue to Dune"
    assert addon("scene.recipes").recipe_of(obj)["textures"]["size"] == 256


def test_every_mesh_of_a_morph_is_drawn_as_it_was(textured):
    obj = morph()
    select(obj)
    bpy.ops.object.duplicate()
    twin = bpy.context.view_layer.objects.active
    assert bpy.ops.pointmorph.blend_textures(size="512", roughness=True) == {"FINISHED"}
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert image_of(obj).shape[0] == 256
    assert image_of(twin).shape[0] == 512


def in_a_group(made):
    """Puts a group between a material's image and shader; returns a node in it."""
    tree = made.node_tree
    inner = bpy.data.node_groups.new("Tint", "ShaderNodeTree")
    for name, kind in (("In", "INPUT"), ("Out", "OUTPUT")):
        inner.interface.new_socket(name, in_out=kind, socket_type="NodeSocketColor")
    start, gamma, end = (
        inner.nodes.new(kind) for kind in ("NodeGroupInput", "ShaderNodeGamma", "NodeGroupOutput")
    )
    inner.links.new(start.outputs[0], gamma.inputs[0])
    inner.links.new(gamma.outputs[0], end.inputs[0])
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = inner
    image = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    tree.links.new(image.outputs["Color"], group.inputs[0])
    tree.links.new(group.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return gamma


@pytest.mark.parametrize("what", ["shader", "group", "image"])
def test_the_panel_notices_that_a_material_changed(addon, textured, what):
    _, target = textured
    made = target.data.materials[0]
    gamma = in_a_group(made)
    obj = morph()
    watching = addon("view.staleness_watch")
    watching._forget()
    bpy.context.view_layer.update()

    def known():
        watching._changed_at = 0.0
        for _ in range(1000):
            state = watching.known_state(obj)
            if state is not None:
                return state[0]
            watching._look()
        raise AssertionError("nothing was found out")

    assert known() == "CURRENT"
    obj.data.shape_keys.key_blocks["Morph"].value = 0.5  # moves the mesh's own materials
    bpy.context.view_layer.update()
    assert watching.known_state(obj) is not None
    if what == "shader":
        made.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.9
    elif what == "group":
        gamma.inputs[1].default_value = 2.0
    else:
        next(n for n in made.node_tree.nodes if n.type == "TEX_IMAGE").image.filepath = "//o.png"
    bpy.context.view_layer.update()
    assert watching.known_state(obj) is None
    assert known() == "STALE"


@pytest.mark.parametrize("how", ["edited", "other"])
def test_recompute_takes_the_source_s_new_material(textured, how):
    source, _ = textured
    obj = morph()
    if how == "edited":
        shader = source.data.materials[0].node_tree.nodes["Principled BSDF"]
        shader.inputs["Roughness"].default_value = 0.25
    else:
        made = source.data.materials[0] = material("Red", (1, 0, 0, 1))
        made.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.25
    count = len(bpy.data.materials)
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    own = obj.material_slots[0].material
    assert own.name == ("Blue to Dune" if how == "edited" else "Red to Dune")
    nodes = own.node_tree.nodes
    assert nodes["Principled BSDF"].inputs["Roughness"].default_value == pytest.approx(0.25)
    assert "Pointmorph Mix 0" in nodes
    assert len(bpy.data.materials) == count


def test_recompute_keeps_a_material_that_was_edited_on_the_mesh(textured):
    source, _ = textured
    obj = morph()
    own = obj.material_slots[0].material
    own.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.75
    shader = source.data.materials[0].node_tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.25
    select(obj)
    assert bpy.ops.pointmorph.recompute() == {"FINISHED"}
    assert obj.material_slots[0].material == own
    nodes = own.node_tree.nodes
    assert nodes["Principled BSDF"].inputs["Roughness"].default_value == pytest.approx(0.75)


def test_the_source_s_own_look_comes_back(textured):
    source, _ = textured
    obj = morph()
    made = obj.material_slots[0].material
    color = list(source.data.materials[0].diffuse_color)
    obj.data.shape_keys.key_blocks["Morph"].value = 0.7
    bpy.context.view_layer.update()
    assert bpy.ops.pointmorph.keep_textures() == {"FINISHED"}
    assert obj.material_slots[0].material == made
    nodes = made.node_tree.nodes
    assert [n.name for n in nodes if n.name.startswith("Pointmorph")] == ["Pointmorph t"]
    assert not [image for image in bpy.data.images if image.name.startswith("Hill to")]
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    assert output.inputs["Surface"].links[0].from_node.type == "BSDF_PRINCIPLED"
    assert list(made.diffuse_color) == pytest.approx(color)
    assert not made.animation_data or not len(made.animation_data.drivers)
    assert "There are no blended textures" in error_of(bpy.ops.pointmorph.keep_textures)
    assert bpy.ops.pointmorph.blend_textures(size="256") == {"FINISHED"}
    assert obj.material_slots[0].material == made
    assert "Pointmorph Mix 0" in nodes


@pytest.mark.parametrize("kept", [None, "source", "material"])
def test_the_images_own_layout_goes_with_them(textured, kept):
    """Exporters would split all corners for it."""
    source, _ = textured
    source.data.uv_layers.remove(source.data.uv_layers[0])
    if kept == "source":
        source.data.uv_layers.new(name="Pointmorph")
    obj = morph()
    assert "Pointmorph" in obj.data.uv_layers
    if kept == "material":
        node = obj.material_slots[0].material.node_tree.nodes.new("ShaderNodeUVMap")
        node.uv_map = "Pointmorph"
    assert bpy.ops.pointmorph.keep_textures() == {"FINISHED"}
    assert ("Pointmorph" in obj.data.uv_layers) == (kept is not None)
    assert bpy.ops.pointmorph.blend_textures(size="256") == {"FINISHED"}
    assert "Pointmorph" in obj.data.uv_layers


def test_undo_takes_it_back(textured):
    bpy.ops.ed.undo_push(message="before")
    name = morph().name
    bpy.ops.ed.undo_push(message="morph")
    assert "Blue to Dune" in bpy.data.materials
    bpy.ops.ed.undo()
    assert "Blue to Dune" not in bpy.data.materials
    assert name not in bpy.data.objects
    bpy.ops.ed.redo()
    assert image_of(bpy.data.objects[name]).std() > 0.1


def test_a_copy_of_the_mesh_has_materials_of_its_own(textured):
    obj = morph()
    select(obj)
    bpy.ops.object.duplicate()
    twin = bpy.context.view_layer.objects.active
    assert twin.material_slots[0].material == obj.material_slots[0].material
    assert bpy.ops.pointmorph.blend_textures(size="256") == {"FINISHED"}
    made = twin.material_slots[0].material
    assert made != obj.material_slots[0].material
    drivers = made.node_tree.animation_data.drivers
    known = {v.targets[0].id for c in drivers for v in c.driver.variables}
    assert known == {twin.data.shape_keys, twin}
    nodes = [node.name for node in made.node_tree.nodes]
    assert nodes.count("Pointmorph t") == 1
    assert not [name for name in nodes if name.startswith("Pointmorph t.")]


@pytest.mark.usefixtures("textured")
def test_a_chain_ends_with_the_look_of_the_last(settings):
    middle = add_mesh("Ridge", *patch(11, bump=0.2))
    mark(middle, "peak", 0, 0)
    mark(middle, "slope", 0.5, 0.3)
    settings.via.add().object = middle
    assert bpy.ops.pointmorph.morph_chain() == {"FINISHED"}
    obj = bpy.context.view_layer.objects.active
    obj.data.shape_keys.key_blocks["Morph"].value = 1.0
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shown = obj.material_slots[0].material.evaluated_get(depsgraph)
    value = shown.node_tree.nodes["Pointmorph t"].outputs[0].default_value
    assert value == pytest.approx(0.5)


def test_drawing_that_is_canceled_changes_nothing(addon, textured):
    import pointmorph

    obj = morph()
    textures = addon("scene.blended_textures")
    options = textures.Options(64)
    draw = addon("core.stepping").finish(textures.read_steps(bpy.context, obj, options))
    with pytest.raises(pointmorph.Cancelled):
        draw(lambda stage, fraction: fraction < 0.05)
    assert image_of(obj).shape == (256, 256, 4)
