"""Colors from materials, images and attributes."""

import bpy
import numpy as np
import pytest
from painted_scenes import (
    bilinear,
    corners_of,
    flat_uvs,
    linear,
    material,
    new_image,
    ramp,
    sheets,
)
from scenes import add_attribute, add_mesh, coordinates, morph, patch

pytestmark = pytest.mark.interface


def source_colors(addon, obj):
    """(N, 4): what the morph takes from an object."""
    reader = addon("scene.shape_reader")
    bpy.context.view_layer.update()
    steps = addon("core.stepping").finish(reader.read_own_steps(bpy.context, obj, False))
    return steps.colors, steps


@pytest.mark.parametrize("kind", ["packed", "unsaved", "file", "float", "data"])
def test_points_have_the_colors_of_an_image(addon, settings, tmp_path, kind):
    rng = np.random.default_rng(3)
    values = np.ones((16, 8, 4))
    values[..., :3] = rng.integers(0, 256, (16, 8, 3)) / 255.0
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj, low=-0.4, high=1.7)
    options = {"float_buffer": kind == "float", "is_data": kind == "data"}
    image = new_image("noise", values, kind == "packed", **options)
    if kind == "file":
        image.filepath_raw, image.file_format = str(tmp_path / "noise.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)
        image = bpy.data.images.load(str(tmp_path / "noise.png"))
    obj.data.materials.append(material("Noise", image=image))
    colors, shape = source_colors(addon, obj)
    values[..., :3] = values[..., :3] if kind in ("float", "data") else linear(values[..., :3])
    places = coordinates(obj.data.vertices)[:, :2]
    wanted = bilinear(values, -0.4 + 2.1 * (places + 1) / 2)
    np.testing.assert_allclose(colors, wanted, atol=2e-5)
    assert shape.skin.look.sources == [f'the image "{image.name}"']


def test_a_generated_grid_is_an_image(addon, settings):
    obj = add_mesh("Sheet", *patch(30))
    flat_uvs(obj)
    image = bpy.data.images.new("grid", 64, 64)
    image.generated_type = "COLOR_GRID"
    obj.data.materials.append(material("Grid", image=image))
    colors, _ = source_colors(addon, obj)
    assert len(np.unique(colors.round(2), axis=0)) > 50


def test_how_a_texture_goes_on_and_where_it_lies(addon, settings):
    """Clipped, mirrored, moved by a Mapping node, by another UV map."""
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj, "First")
    flat_uvs(obj, "Second", 0.0, 0.5)
    made = material("Ramp", image=new_image("ramp", ramp()), extension="CLIP")
    obj.data.materials.append(made)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    mapping, uv = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeUVMap")
    uv.uv_map = "Second"
    mapping.inputs["Scale"].default_value = (2, 4, 1)
    mapping.inputs["Location"].default_value = (0.0, -0.5, 0.0)
    links.new(uv.outputs[0], mapping.inputs["Vector"])
    node = next(n for n in nodes if n.type == "TEX_IMAGE")
    links.new(mapping.outputs[0], node.inputs["Vector"])
    colors, _ = source_colors(addon, obj)
    u, v = ((coordinates(obj.data.vertices)[:, :2] + 1) / 4 * (2, 4) - (0, 0.5)).T
    inside = (v > 0.05) & (v < 0.95) & (u > 0.05) & (u < 0.95)
    np.testing.assert_allclose(colors[inside, 0], linear(u[inside]), atol=4e-3)
    np.testing.assert_allclose(colors[inside, 1], linear(v[inside]), atol=4e-3)
    assert (colors[(v < -0.01) | (v > 1.01)][:, :3] == 0).all()


def test_nodes_between_the_image_and_the_shader(addon, settings):
    """A reroute, a group, a product, and channels for what isn't color."""
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj)
    made = material("Ramp", image=new_image("ramp", ramp()))
    obj.data.materials.append(made)
    tree = made.node_tree
    image = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    shader = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
    inner = bpy.data.node_groups.new("Tint", "ShaderNodeTree")
    inner.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    mix = inner.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    factor, first, second = (s for s in mix.inputs if s.enabled)
    factor.default_value, second.default_value = 1.0, (0.5, 0.25, 1.0, 1.0)
    inner.links.new(inner.nodes.new("NodeGroupInput").outputs[0], first)
    result = next(s for s in mix.outputs if s.enabled)
    inner.links.new(result, inner.nodes.new("NodeGroupOutput").inputs[0])
    group, reroute = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("NodeReroute")
    group.node_tree = inner
    split = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(image.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], group.inputs[0])
    tree.links.new(group.outputs[0], shader.inputs["Base Color"])
    tree.links.new(image.outputs[0], split.inputs[0])
    tree.links.new(split.outputs["Green"], shader.inputs["Roughness"])
    colors, shape = source_colors(addon, obj)
    look = shape.skin.look
    assert look.remarks == ()
    places = ((coordinates(obj.data.vertices)[:, :2] + 1) / 2).clip(0.01, 0.99)
    inside = (np.abs(places - 0.5) < 0.4).all(axis=1)
    np.testing.assert_allclose(colors[inside, 0], 0.5 * linear(places[inside, 0]), atol=4e-3)
    np.testing.assert_allclose(colors[inside, 1], 0.25 * linear(places[inside, 1]), atol=4e-3)
    corners = np.arange(len(obj.data.loops))[:, None]
    rough = look.values(lambda s: s.roughness, corners, np.ones((len(corners), 1)))[:, 0]
    places = places[corners_of(obj.data)]
    inside = (np.abs(places - 0.5) < 0.4).all(axis=1)
    np.testing.assert_allclose(rough[inside], linear(places[inside, 1]), atol=4e-3)


def test_every_face_has_the_plain_color_of_its_material(addon, settings):
    obj = add_mesh("Sheet", *patch(9))
    for name, color in (("Red", (1, 0, 0, 1)), ("Green", (0, 1, 0, 1))):
        obj.data.materials.append(material(name, color))
    centers = np.array([face.center[:] for face in obj.data.polygons])
    right = centers[:, 0] > 0
    obj.data.polygons.foreach_set("material_index", right.astype(np.int32))
    colors, shape = source_colors(addon, obj)
    x = coordinates(obj.data.vertices)[:, 0]
    np.testing.assert_allclose(colors[x < -0.01], np.tile([1, 0, 0, 1], ((x < -0.01).sum(), 1)))
    np.testing.assert_allclose(colors[x > 0.01], np.tile([0, 1, 0, 1], ((x > 0.01).sum(), 1)))
    np.testing.assert_allclose(colors[np.abs(x) < 0.01][:, :2], 0.5)
    assert shape.skin.look.sources == ['the material "Red"', 'the material "Green"']


def test_what_comes_first(addon, settings):
    """What a material's nodes show, then the active color attribute, then a plain color."""
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj)
    assert source_colors(addon, obj)[0] is None
    obj.data.materials.append(material("Plain", (0.2, 0.3, 0.4, 1)))
    np.testing.assert_allclose(source_colors(addon, obj)[0][:, :3], [[0.2, 0.3, 0.4]] * 81)
    paint = np.random.default_rng(0).uniform(0, 1, (81, 4))
    add_attribute(obj.data, "Paint", "FLOAT_COLOR", paint)
    obj.data.color_attributes.active_color = obj.data.color_attributes["Paint"]
    colors, shape = source_colors(addon, obj)
    np.testing.assert_allclose(colors, paint, atol=1e-6)
    assert shape.skin.look.sources == ['the color attribute "Paint"']
    image = new_image("red", [[(1, 0, 0, 1)] * 2] * 2)
    obj.data.materials[0] = material("Image", image=image)
    np.testing.assert_allclose(source_colors(addon, obj)[0][:, :3], [[1, 0, 0]] * 81, atol=1e-6)
    bpy.context.view_layer.update()
    obj.data.materials[0].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (
        1, 1, 1, 1,
    )  # fmt: skip


def test_what_cannot_be_read_is_said(settings, capfd):
    source, target = sheets(settings)
    made = material("Wood")
    noise = made.node_tree.nodes.new("ShaderNodeTexNoise")
    shader = made.node_tree.nodes["Principled BSDF"]
    made.node_tree.links.new(noise.outputs[0], shader.inputs["Roughness"])
    source.data.materials.append(made)
    gone = bpy.data.images.new("lost", 2, 2)
    gone.source, gone.filepath = "FILE", "//nowhere.png"
    target.data.materials.append(material("Lost", image=gone))
    morph()
    said = capfd.readouterr().out
    assert 'Nodes of the material "Wood" can\'t be read (Noise Texture)' in said
    assert 'The image "lost" is missing' in said


def test_where_colors_come_from_is_said(textured, capfd):
    morph()
    said = capfd.readouterr().out
    assert 'Colors: "Hill" from the image "blue"; "Dune" from the image "ramp"' in said


@pytest.mark.parametrize("packed", [False, True])
def test_tiles_of_a_udim_image(addon, settings, tmp_path, packed):
    for number, value in ((1001, (1, 0, 0, 1)), (1002, (0, 1, 0, 1))):
        image = new_image(f"t{number}", [[value] * 2] * 2, packed=False)
        image.filepath_raw, image.file_format = str(tmp_path / f"t.{number}.png"), "PNG"
        image.save()
    image = bpy.data.images.load(str(tmp_path / "t.1001.png"))
    image.source = "TILED"
    image.filepath = str(tmp_path / "t.<UDIM>.png")
    if not any(tile.number == 1002 for tile in image.tiles):
        image.tiles.new(1002)
    if packed:
        image.pack()
        for number in (1001, 1002):
            (tmp_path / f"t.{number}.png").unlink()
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj, low=0.01, high=1.99)
    uvs = obj.data.uv_layers[0].data
    for item in uvs:
        item.uv.y = 0.5
    obj.data.materials.append(material("Tiles", image=image))
    colors, shape = source_colors(addon, obj)
    x = coordinates(obj.data.vertices)[:, 0]
    np.testing.assert_allclose(colors[x < -0.1][:, :2], [[1, 0]] * (x < -0.1).sum(), atol=1e-6)
    np.testing.assert_allclose(colors[x > 0.1][:, :2], [[0, 1]] * (x > 0.1).sum(), atol=1e-6)
    assert shape.skin.look.remarks == ()


def into_color(made, kind, **settings):
    """Puts a node between a material's image and its shader; returns it."""
    tree = made.node_tree
    node = tree.nodes.new(kind)
    for setting, value in settings.items():
        setattr(node, setting, value)
    image = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    shader = tree.nodes["Principled BSDF"]
    first = next(s for s in node.inputs if s.enabled and s.type in ("RGBA", "VALUE"))
    if kind == "ShaderNodeMix":
        factor, first, second = (s for s in node.inputs if s.enabled)
        factor.default_value, second.default_value = 0.5, (0.2, 0.7, 0.4, 1.0)
    output = next(s for s in node.outputs if s.enabled)
    tree.links.new(image.outputs["Color"], first)
    tree.links.new(output, shader.inputs["Base Color"])
    return node


NODES = {
    "math": ("ShaderNodeMath", lambda node: setattr(node, "operation", "MULTIPLY")),
    "mix": ("ShaderNodeMix", lambda node: setattr(node, "blend_type", "MULTIPLY")),
    "ramp": (
        "ShaderNodeValToRGB",
        lambda node: setattr(node.color_ramp.elements[1], "color", (1, 0, 0, 1)),
    ),
}


@pytest.mark.parametrize("kind", NODES)
def test_nodes_of_all_kinds_are_morphed_and_watched(textured, kind):
    _, target = textured
    name, change = NODES[kind]
    settings = {"data_type": "RGBA"} if kind == "mix" else {}
    node = into_color(target.data.materials[0], name, **settings)
    obj = morph()
    assert obj.pointmorph.state == "CURRENT"
    change(node)
    assert obj.pointmorph.state == "STALE"
    assert 'the look of "Dune" has changed' in obj.pointmorph.stale


def test_which_channel_a_color_comes_from_is_watched(textured):
    _, target = textured
    tree = target.data.materials[0].node_tree
    node = into_color(target.data.materials[0], "ShaderNodeSeparateColor")
    obj = morph()
    assert obj.pointmorph.state == "CURRENT"
    tree.links.new(node.outputs[1], tree.nodes["Principled BSDF"].inputs["Base Color"])
    assert obj.pointmorph.state == "STALE"


def test_a_mix_with_a_transparent_shader_is_morphed(textured):
    _, target = textured
    tree = target.data.materials[0].node_tree
    image = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    mix, clear = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "BsdfTransparent"))
    tree.links.new(image.outputs["Color"], mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes["Principled BSDF"].outputs[0], mix.inputs[2])
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    assert morph().pointmorph.state == "CURRENT"
