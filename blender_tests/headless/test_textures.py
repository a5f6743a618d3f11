"""Colors from materials, images and attributes; the look of a mesh that goes over into its
target's."""

import bmesh
import bpy
import numpy as np
import pytest
from scenes import (
    add_attribute,
    add_mesh,
    add_object,
    coordinates,
    error_of,
    key,
    mark,
    morph,
    pair,
    patch,
    pick,
    read,
    select,
)

pytestmark = pytest.mark.interface

SIDE = 96  # of a render


# --- Scenes ---------------------------------------------------------------------------------------


def corners_of(mesh):
    return read(mesh.loops, "vertex_index", 1, np.int32)


def flat_uvs(obj, name="UVMap", low=0.0, high=1.0):
    """A UV map seen from above: the sheet from -1 to 1 goes from `low` to `high`."""
    layer = obj.data.uv_layers.new(name=name)
    places = coordinates(obj.data.vertices)[corners_of(obj.data)][:, :2]
    uvs = low + (high - low) * (places + 1) / 2
    layer.data.foreach_set("uv", uvs.astype(np.float32).reshape(-1))
    return uvs


def new_image(name, values, packed=True, **options):
    values = np.asarray(values, np.float32)
    image = bpy.data.images.new(name, values.shape[1], values.shape[0], alpha=True, **options)
    image.pixels.foreach_set(values.reshape(-1))
    image.update()
    if packed:
        image.pack()
    return image


def ramp(size=64):
    """Bytes whose red goes with u and whose green with v, as encoded."""
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    return np.stack([u, v, np.full_like(u, 0.2), np.ones_like(u)], axis=-1)


def checker(size=64, fields=4):
    rows, columns = np.indices((size, size)) * fields // size
    values = np.ones((size, size, 4))
    values[..., :3] = np.where((rows + columns) % 2, 0.9, 0.1)[..., None]
    return values


def material(name, color=(0.8, 0.8, 0.8, 1), image=None, **settings):
    """A material with a plain color, or an image in its place."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    tree = made.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = color
    if image is not None:
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        for setting, value in settings.items():
            setattr(node, setting, value)
        tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    return made


def sheets(settings, side=12, **options):
    """Two sheets with UV maps, shown as a mesh when they morph."""
    source, target = pair(side, 10)
    for obj in (source, target):
        flat_uvs(obj, **options)
    settings.show_as = "MESH"
    return source, target


@pytest.fixture
def textured(settings):
    """Source and target: one blue, the other with a ramp."""
    source, target = sheets(settings)
    source.data.materials.append(
        material("Blue", image=new_image("blue", [[(0, 0, 1, 1)] * 2] * 2))
    )
    target.data.materials.append(material("Ramp", image=new_image("ramp", ramp())))
    settings.texture_size = "256"
    return source, target


def linear(values):
    values = np.asarray(values, float)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def source_colors(addon, obj):
    """(N, 4): what the morph takes from an object."""
    reader = addon("scene.shape_reader")
    bpy.context.view_layer.update()
    steps = addon("core.stepping").finish(reader.read_own_steps(bpy.context, obj, False))
    return steps.colors, steps


def bilinear(values, uvs):
    """By hand, with what is beyond an end taken from the other."""
    height, width = values.shape[:2]
    x, y = uvs[:, 0] * width - 0.5, uvs[:, 1] * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    result = 0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - (x - column)) * np.abs(1 - dy - (y - row))
            result += weight[:, None] * values[(row + dy) % height, (column + dx) % width]
    return result


# --- Where colors come from -----------------------------------------------------------------------


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
    made.diffuse_color = (0.5, 0.25, 0.1, 1)
    noise = made.node_tree.nodes.new("ShaderNodeTexNoise")
    shader = made.node_tree.nodes["Principled BSDF"]
    made.node_tree.links.new(noise.outputs[1], shader.inputs["Base Color"])
    source.data.materials.append(made)
    gone = bpy.data.images.new("lost", 2, 2)
    gone.source, gone.filepath = "FILE", "//nowhere.png"
    target.data.materials.append(material("Lost", image=gone))
    morph()
    said = capfd.readouterr().out
    assert 'Nodes of the material "Wood" can\'t be read (Noise Texture)' in said
    assert "its viewport color is used instead" in said
    assert 'The image "lost" is missing' in said


def test_where_colors_come_from_is_said(textured, capfd):
    morph()
    said = capfd.readouterr().out
    assert 'Colors: "Hill" from the image "blue"; "Dune" from the image "ramp"' in said


def test_tiles_of_a_udim_image(addon, settings, tmp_path):
    for number, value in ((1001, (1, 0, 0, 1)), (1002, (0, 1, 0, 1))):
        image = new_image(f"t{number}", [[value] * 2] * 2, packed=False)
        image.filepath_raw, image.file_format = str(tmp_path / f"t.{number}.png"), "PNG"
        image.save()
    image = bpy.data.images.load(str(tmp_path / "t.1001.png"))
    image.source = "TILED"
    image.filepath = str(tmp_path / "t.<UDIM>.png")
    if not any(tile.number == 1002 for tile in image.tiles):
        image.tiles.new(1002)
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


# --- The look of the mesh -------------------------------------------------------------------------


def image_of(obj, what="Color"):
    """(H, W, 4): an image of the second look, as encoded."""
    nodes = obj.material_slots[0].material.node_tree.nodes
    image = nodes[f"Pointmorph {what}"].image
    return np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)


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
    for vertex in target.data.vertices:
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


# --- Renders --------------------------------------------------------------------------------------


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
