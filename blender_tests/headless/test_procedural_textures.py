"""Base colors that only nodes know, such as those of procedural textures."""

import subprocess
import sys
import time

import bpy
import numpy as np
import pytest
from painted_scenes import flat_uvs, image_of, linear, material, new_image, sheets
from scenes import add_mesh, coordinates, data_blocks, morph, patch

pytestmark = pytest.mark.interface


def read_shape(addon, obj, as_shown=False, bakes=("color", "alpha")):
    """What a morph takes from an object."""
    bpy.context.view_layer.update()
    steps = addon("scene.shape_reader").read_own_steps(bpy.context, obj, as_shown, False, bakes)
    return addon("core.stepping").finish(steps)


def with_nodes(made, kind, output, coordinates, inputs=None):
    """Puts a texture into a material's base color, at a kind of coordinates; returns its node."""
    tree = made.node_tree
    node, places = tree.nodes.new(kind), tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(places.outputs[coordinates], node.inputs["Vector"])
    for name, value in (inputs or {}).items():
        node.inputs[name].default_value = value
    tree.links.new(node.outputs[output], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return node


def showing(made, coordinates):
    """Makes coordinates a material's base color."""
    tree = made.node_tree
    places = tree.nodes.new("ShaderNodeTexCoord")
    scale = tree.nodes.new("ShaderNodeVectorMath")  # a node that isn't read one by one
    scale.operation = "MULTIPLY_ADD"
    scale.inputs[1].default_value, scale.inputs[2].default_value = (0.25,) * 3, (0.5,) * 3
    tree.links.new(places.outputs[coordinates], scale.inputs[0])
    tree.links.new(scale.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made


def show_mix(tree, share, first, second):
    """Has a material show two shaders, the second with this share."""
    mix = tree.nodes.new("ShaderNodeMixShader")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    for number, socket in enumerate((share, first.outputs[0], second.outputs[0])):
        tree.links.new(socket, mix.inputs[number])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


RED, BLUE = (0.7, 0.1, 0.05, 1.0), (0.02, 0.2, 0.9, 1.0)


def checked(name, fields=4.0):
    made = material(name)
    colors = {"Color1": RED, "Color2": BLUE, "Scale": fields}
    with_nodes(made, "ShaderNodeTexChecker", "Color", "UV", colors)
    return made


def field_colors(uvs, fields=4):
    """What a checker shows at UVs, and where they lie well inside a field."""
    inside = (np.abs(uvs * fields % 1 - 0.5) < 0.4).all(axis=1)
    is_red = np.floor(uvs * fields).astype(int).sum(axis=1) % 2 == 1
    return np.where(is_red[:, None], RED, BLUE), inside


def test_points_have_the_colors_of_a_checker(addon, settings):
    obj = add_mesh("Sheet", *patch(26))
    flat_uvs(obj)
    obj.data.materials.append(checked("Checks"))
    shape = read_shape(addon, obj)
    uvs = (coordinates(obj.data.vertices)[:, :2] + 1) / 2
    wanted, inside = field_colors(uvs)
    assert inside.mean() > 0.3
    np.testing.assert_allclose(shape.colors[inside], wanted[inside], atol=6e-3)
    assert shape.skin.look.sources == ['the nodes of the material "Checks"']
    assert shape.skin.look.remarks == ()


def test_the_target_of_a_mesh_shows_a_checker(settings):
    """Drawn on an image in the source's UV layout, by a morph that nobody had to prepare."""
    source, target = sheets(settings)
    source.data.materials.append(material("Plain", (0.1, 0.1, 0.1, 1)))
    target.data.materials.append(checked("Checks", 2.0))
    settings.texture_size = "256"
    before = data_blocks()
    image = image_of(morph())
    assert not any("Bake" in name or "Checks." in name for name in data_blocks() - before)
    colors = linear(image[..., :3]).reshape(-1, 3)
    near = [np.abs(colors - color[:3]).max(axis=1) < 0.02 for color in (RED, BLUE)]
    assert min(part.mean() for part in near) > 0.4
    assert sum(part.mean() for part in near) > 0.93


@pytest.mark.parametrize("kind", ["Generated", "Object"])
def test_coordinates_are_those_of_the_object_that_is_morphed(addon, settings, kind):
    """Not of the copy that is baked, also where modifiers move and make vertices."""
    obj = add_object("Box", *box_with_polygons())
    obj.location, obj.scale = (3, -2, 1), (0.5, 2.0, 1.0)
    obj.data.materials.append(showing(material("Where"), kind))
    places = coordinates(obj.data.vertices)
    moved = obj.modifiers.new("Move", "DISPLACE")
    moved.direction, moved.strength = "X", 0.3
    shape = read_shape(addon, obj, as_shown=True)
    assert np.abs(shape.positions - places).max() > 0.1
    wanted = shape.positions
    if kind == "Generated":
        wanted = (places - places.min(axis=0)) / np.ptp(places, axis=0)
    np.testing.assert_allclose((shape.colors[:, :3] - 0.5) / 0.25, wanted, atol=0.03)


def add_object(name, vertices, faces):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def box_with_polygons():
    """Triangles, squares and a polygon of many corners: a box with a roof."""
    rim = [(np.cos(a), np.sin(a), 0.4) for a in np.linspace(0, 2 * np.pi, 7)[:-1]]
    low = [(x, y, -0.5) for x, y, _ in rim]
    vertices = [*rim, *low, (0, 0, 0.9)]
    faces = [tuple(range(11, 5, -1))]
    faces += [(k, 6 + k, 6 + (k + 1) % 6, (k + 1) % 6) for k in range(6)]
    faces += [(k, (k + 1) % 6, 12) for k in range(6)]
    return np.array(vertices), faces


def test_faces_that_modifiers_make_are_baked_as_well(addon, settings):
    obj = add_mesh("Half", *patch(9))
    obj.data.materials.append(showing(material("Where"), "Object"))
    mirror = obj.modifiers.new("Mirror", "MIRROR")
    mirror.use_axis = (False, False, True)
    obj.location.z = 1.0
    subdivision = obj.modifiers.new("More", "SUBSURF")
    subdivision.levels, subdivision.render_levels = 1, 3  # baked as in the viewport
    shape = read_shape(addon, obj, as_shown=True)
    assert len(shape.positions) > 400
    found = (shape.colors[:, :3] - 0.5) / 0.25
    np.testing.assert_allclose(found, shape.positions, atol=0.03)


def test_shaders_in_groups_and_beside_transparent_ones(addon, settings):
    obj = add_mesh("Sheet", *patch(26))
    flat_uvs(obj)
    made = checked("Checks")
    tree = made.node_tree
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    inner.interface.new_socket("Color", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    diffuse = inner.nodes.new("ShaderNodeBsdfDiffuse")
    inner.links.new(inner.nodes.new("NodeGroupInput").outputs[0], diffuse.inputs["Color"])
    inner.links.new(diffuse.outputs[0], inner.nodes.new("NodeGroupOutput").inputs[0])
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = inner
    checks = next(node for node in tree.nodes if node.type == "TEX_CHECKER")
    tree.links.new(checks.outputs["Color"], group.inputs[0])
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    show_mix(tree, checks.outputs[1], clear, group)
    obj.data.materials.append(made)
    before, words = data_blocks(), [len(tree.nodes), len(tree.links), len(inner.nodes)]
    shape = read_shape(addon, obj)
    assert data_blocks() == before
    assert [len(tree.nodes), len(tree.links), len(inner.nodes)] == words
    wanted, inside = field_colors((coordinates(obj.data.vertices)[:, :2] + 1) / 2)
    np.testing.assert_allclose(shape.colors[inside, :3], wanted[inside, :3], atol=6e-3)
    assert shape.skin.look.remarks == ()
    is_solid = wanted[inside, 0] == RED[0]  # where the checker's factor is 1
    np.testing.assert_allclose(shape.colors[inside, 3], is_solid, atol=6e-3)


def numbers_of_checker(made, fields=2.0):
    """Feeds roughness, metalness and alpha of a material from a checker of 0.25 and 0.75."""
    tree = made.node_tree
    node, places = tree.nodes.new("ShaderNodeTexChecker"), tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(places.outputs["UV"], node.inputs["Vector"])
    node.inputs["Scale"].default_value = fields
    for name, value in (("Color1", 0.75), ("Color2", 0.25)):
        node.inputs[name].default_value = (value, value, value, 1)
    for name in ("Roughness", "Metallic", "Alpha"):
        tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs[name])
    return made


def shares_of(values, *wanted):
    return [float((np.abs(values - value) < 0.02).mean()) for value in wanted]


@pytest.mark.parametrize("roughness", [True, False])
def test_roughness_metalness_and_alpha_of_nodes(settings, roughness, capfd):
    """What the base color is doesn't matter, and roughness is baked only on request."""
    source, target = sheets(settings)
    source.data.materials.append(material("Plain", (0.1, 0.1, 0.1, 1)))
    target.data.materials.append(numbers_of_checker(checked("Checks", 2.0)))
    settings.texture_size, settings.texture_roughness = "256", roughness
    obj = morph()
    color = image_of(obj)
    assert min(shares_of(color[..., 3], 0.25, 0.75)) > 0.4
    assert min(shares_of(linear(color[..., 0]), RED[0], BLUE[0])) > 0.4
    said = capfd.readouterr().out
    if not roughness:
        assert 'Nodes of the material "Checks" can\'t be read (Checker Texture)' in said
        return
    assert "can't be read" not in said
    surface = image_of(obj, "Surface")
    for channel in (1, 2):
        assert min(shares_of(surface[..., channel], 0.25, 0.75)) > 0.4
    np.testing.assert_allclose(surface[..., 1], surface[..., 2], atol=0.01)
    rough = surface[..., 1] > 0.5
    assert (rough == (color[..., 3] > 0.5)).mean() > 0.95


def test_a_share_of_two_shaders_that_nodes_compute(addon, settings):
    """Their colors are mixed as it says, and their roughness and alpha as well."""
    obj = add_mesh("Sheet", *patch(26))
    flat_uvs(obj)
    made = checked("Checks")
    tree = made.node_tree
    checks = next(node for node in tree.nodes if node.type == "TEX_CHECKER")
    first, second = tree.nodes["Principled BSDF"], tree.nodes.new("ShaderNodeBsdfGlossy")
    for link in list(first.inputs["Base Color"].links):
        tree.links.remove(link)
    first.inputs["Base Color"].default_value, first.inputs["Roughness"].default_value = BLUE, 0.9
    second.inputs["Color"].default_value, second.inputs["Roughness"].default_value = RED, 0.3
    show_mix(tree, checks.outputs[1], first, second)
    obj.data.materials.append(made)
    baked = addon("scene.baked_colors")
    bpy.context.view_layer.update()
    steps = addon("scene.shape_reader").read_own_steps(
        bpy.context, obj, False, False, baked.COLORS + baked.SURFACE
    )
    look = addon("core.stepping").finish(steps).skin.look
    assert look.remarks == ()
    corners = np.arange(len(look.of_corners))[:, None]
    shares = np.ones((len(corners), 1), np.float32)
    uvs = (coordinates(obj.data.vertices)[:, :2] + 1) / 2
    colors, inside = field_colors(uvs)
    rows = np.array([loop.vertex_index for loop in obj.data.loops])
    known = inside[rows]
    is_second = (colors[:, 0] == RED[0])[rows][known]
    for part, values in {"roughness": (0.9, 0.3), "metallic": (0.0, 1.0), "alpha": (1, 1)}.items():
        found = look.values(lambda surface, part=part: getattr(surface, part), corners, shares)
        wanted = np.where(is_second, values[1], values[0])
        np.testing.assert_allclose(found[known, 0], wanted, atol=6e-3)
    found = look.color_values(corners, shares)[known]
    np.testing.assert_allclose(found[:, :3], colors[rows][known][:, :3], atol=6e-3)


SLOPE = 0.4


def slope_of_nodes(made):
    """A height that rises along X by SLOPE: an output, and its tree."""
    tree = made.node_tree
    places = tree.nodes.new("ShaderNodeTexCoord")
    height = tree.nodes.new("ShaderNodeVectorMath")
    height.operation = "DOT_PRODUCT"
    height.inputs[1].default_value = (SLOPE, 0.0, 0.0)
    tree.links.new(places.outputs["Object"], height.inputs[0])
    return height.outputs["Value"], tree


def bend(made):
    """By a Bump node."""
    height, tree = slope_of_nodes(made)
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 1.0, 1.0
    tree.links.new(height, bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])


def displace(made):
    """At the output, and not as a bump: what is drawn on has the same form all the same."""
    height, tree = slope_of_nodes(made)
    displacement = tree.nodes.new("ShaderNodeDisplacement")
    displacement.inputs["Scale"].default_value = 1.0
    tree.links.new(height, displacement.inputs["Height"])
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(displacement.outputs[0], output.inputs["Displacement"])
    made.displacement_method = "DISPLACEMENT"


def point_elsewhere(made):
    """By a normal map in the object's own space."""
    tree = made.node_tree
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.space = "OBJECT"
    color = 0.5 + 0.5 * np.array([-SLOPE, 0.0, 1.0]) / np.hypot(SLOPE, 1.0)
    node.inputs["Color"].default_value = (*color, 1.0)
    tree.links.new(node.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])


def mix_bent(made):
    """One of two shaders that show the same half of the other."""
    bend(made)
    tree = made.node_tree
    other = tree.nodes.new("ShaderNodeBsdfDiffuse")
    other.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1.0)
    share = tree.nodes.new("ShaderNodeValue")
    share.outputs[0].default_value = 0.0
    show_mix(tree, share.outputs[0], tree.nodes["Principled BSDF"], other)


@pytest.mark.parametrize("bent", [bend, displace, point_elsewhere, mix_bent])
def test_normals_that_nodes_compute(settings, bent, capfd):
    source, target = sheets(settings)
    for obj in (source, target):  # flat, so that the normals are those of the nodes
        obj.data.vertices.foreach_set("co", (coordinates(obj.data.vertices) * (1, 1, 0)).ravel())
    source.data.materials.append(material("Plain", (0.1, 0.1, 0.1, 1)))
    made = material("Bent")
    bent(made)
    target.data.materials.append(made)
    obj = morph()
    words = [len(made.node_tree.nodes), len(made.node_tree.links), made.displacement_method]
    before = data_blocks()
    assert bpy.ops.pointmorph.blend_textures(size="256", normal=True) == {"FINISHED"}
    assert "can't be read" not in capfd.readouterr().out
    assert not any("Bake" in name or "Bent." in name for name in data_blocks() - before)
    assert words == [len(made.node_tree.nodes), len(made.node_tree.links), made.displacement_method]
    normals = 2.0 * image_of(obj, "Normal")[..., :3].reshape(-1, 3) - 1.0
    wanted = np.array([-SLOPE, 0.0, 1.0]) / np.hypot(SLOPE, 1.0)
    # The map of a flat square onto another turns a little here and there, and tilts nothing.
    assert (np.abs(normals[:, 2] - wanted[2]) < 0.01).mean() > 0.98
    np.testing.assert_allclose(np.median(normals, axis=0), wanted, atol=0.04)


def test_slots_that_can_be_read_are_read(addon, settings):
    obj = add_mesh("Sheet", *patch(26))
    flat_uvs(obj)
    obj.data.materials.append(checked("Checks"))
    obj.data.materials.append(None)
    obj.data.materials.append(material("Image", image=new_image("red", [[(1, 0, 0, 1)] * 2] * 2)))
    x = np.array([face.center.x for face in obj.data.polygons])
    obj.data.polygons.foreach_set("material_index", np.where(x > 0, 2, 0).astype(np.int32))
    shape = read_shape(addon, obj)
    places = coordinates(obj.data.vertices)
    wanted, inside = field_colors((places[:, :2] + 1) / 2)
    left, right = inside & (places[:, 0] < -0.1), places[:, 0] > 0.1
    np.testing.assert_allclose(shape.colors[left], wanted[left], atol=6e-3)
    np.testing.assert_allclose(shape.colors[right], [[1, 0, 0, 1]] * right.sum(), atol=1e-6)


def test_a_change_of_the_nodes_is_seen(settings):
    source, target = sheets(settings)
    source.data.materials.append(material("Plain"))
    made = checked("Checks", 2.0)
    target.data.materials.append(made)
    settings.show_as = "POINTS"
    obj = morph()
    assert obj.pointmorph.state == "CURRENT"
    node = next(node for node in made.node_tree.nodes if node.type == "TEX_CHECKER")
    node.location = (50, 50)
    assert obj.pointmorph.state == "CURRENT"
    node.inputs["Scale"].default_value = 3.0
    assert obj.pointmorph.state == "STALE"
    assert 'the look of "Dune" has changed' in obj.pointmorph.stale


def test_the_same_is_baked_once(addon, settings, monkeypatch):
    baked_colors = addon("scene.baked_colors")
    runs = []
    bake = baked_colors._bake
    monkeypatch.setattr(baked_colors, "_bake", lambda *args: runs.append(1) or bake(*args))
    monkeypatch.setattr(baked_colors, "_known", {})
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj)
    obj.data.materials.append(checked("Checks"))
    first = read_shape(addon, obj).colors
    np.testing.assert_array_equal(read_shape(addon, obj).colors, first)
    assert len(runs) == 1
    read_shape(addon, obj, bakes=())
    assert len(runs) == 1
    node = next(n for n in obj.data.materials[0].node_tree.nodes if n.type == "TEX_CHECKER")
    node.inputs["Color1"].default_value = (0, 0, 0, 1)
    assert not np.array_equal(read_shape(addon, obj).colors, first)
    assert len(runs) == 2


@pytest.fixture
def elsewhere(addon, monkeypatch):
    """Has another Blender bake, as in a window; returns what is started there."""
    other, started = addon("data.other_blender"), []
    words = [sys.executable]
    if bpy.app.binary_path:
        monkeypatch.setattr(bpy.app, "background", False, raising=False)
        words = other.command()
    monkeypatch.setattr(other, "command", lambda: words)
    monkeypatch.setattr(addon("scene.baked_colors"), "_known", {})
    start = subprocess.Popen
    monkeypatch.setattr(
        other.subprocess,
        "Popen",
        lambda *args, **keys: started.append(start(*args, **keys)) or started[-1],
    )
    return started


def checked_sheet():
    obj = add_mesh("Sheet", *patch(9))
    flat_uvs(obj)
    obj.data.materials.append(checked("Checks"))
    return obj


def test_another_blender_bakes_the_same(addon, settings, elsewhere, request):
    """Also in coordinates of another object, which the file must have, too."""
    obj = checked_sheet()
    nodes = obj.data.materials[0].node_tree.nodes
    places = next(node for node in nodes if node.type == "TEX_COORD")
    places.object = add_mesh("Projector", *patch(3))
    places.object.location, places.object.scale = (0.3, 0.1, 0.05), (0.7, 0.5, 1.0)
    checks = next(node for node in nodes if node.type == "TEX_CHECKER")
    places.id_data.links.new(places.outputs["Object"], checks.inputs["Vector"])
    bpy.context.view_layer.update()
    before = data_blocks()
    steps = addon("scene.shape_reader").read_own_steps(bpy.context, obj, False, False, ("color",))
    waited = 0
    while True:
        try:
            if next(steps) is not None:
                waited += 1
                assert data_blocks() == before  # nothing of it is to be seen meanwhile
                time.sleep(0.05)  # else this one takes the processor from the other
        except StopIteration as end:
            colors = end.value.colors
            break
    assert waited
    assert [process.returncode for process in elsewhere] == [0]
    request.getfixturevalue("monkeypatch").undo()
    addon("scene.baked_colors")._known.clear()
    assert np.array_equal(read_shape(addon, obj).colors, colors)


def test_another_blender_is_stopped_when_nobody_waits_for_it(addon, settings, elsewhere):
    obj = checked_sheet()
    steps = addon("scene.shape_reader").read_own_steps(bpy.context, obj, False, False, ("color",))
    while next(steps) is None:
        pass
    [process] = elsewhere
    assert process.poll() is None
    steps.close()
    assert process.poll() not in (None, 0)


def test_what_another_blender_said_is_told(addon, settings, elsewhere, monkeypatch):
    script = "import sys; print('no room left'); sys.exit(3)"
    monkeypatch.setattr(
        addon("data.other_blender"), "command", lambda: [sys.executable, "-c", script]
    )
    [remark] = read_shape(addon, checked_sheet()).skin.look.remarks
    assert "no room left" in remark


def painted_pixels(image):
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


PAINTED = ("saved", "packed", "generated", "float", "data", "transparent")


def paint(kind, number, folder):
    """An image that was scaled and painted since it was made, or last saved."""
    pixels = np.random.default_rng(number).uniform(0.1, 0.9, (8, 16, 4)).astype(np.float32)
    if kind != "transparent":
        pixels[..., 3] = 1.0
    image = new_image("Paint", np.zeros((4, 4, 4), np.float32), packed=kind == "packed")
    if kind == "float":
        bpy.data.images.remove(image)
        image = bpy.data.images.new("Paint", 4, 4, float_buffer=True, alpha=True)
    if kind == "data":
        image.colorspace_settings.name = "Non-Color"
    if kind == "saved":
        image.filepath_raw, image.file_format = str(folder / "paint.png"), "PNG"
        image.save()
    image.scale(16, 8)
    image.pixels.foreach_set(pixels.reshape(-1))
    image.update()
    assert image.is_dirty
    return image


def projected(images):
    """A sheet with two rows of faces for each image, which is projected from all sides, as no
    reader reads."""
    rows = 2 * len(images)
    obj = add_mesh("Sheet", *patch(rows + 1))
    flat_uvs(obj)
    for image in images:
        made = material("Painted")
        node = with_nodes(made, "ShaderNodeTexImage", "Color", "UV")
        node.projection, node.image = "BOX", image
        obj.data.materials.append(made)
    slots = np.arange(rows * rows, dtype=np.int32) // (2 * rows)
    obj.data.polygons.foreach_set("material_index", slots)
    return obj


def test_another_blender_bakes_what_was_painted_and_is_in_no_file(
    addon, settings, elsewhere, tmp_path, request
):
    """Images of every kind at once, because each other Blender takes long to start."""
    images = [paint(kind, number, tmp_path) for number, kind in enumerate(PAINTED)]
    obj, before = projected(images), [painted_pixels(image) for image in images]
    before_blocks = data_blocks()
    colors = read_shape(addon, obj).colors
    assert [process.returncode for process in elsewhere] == [0]
    for image, pixels in zip(images, before, strict=True):
        assert image.is_dirty  # and still the user's to save
        assert tuple(image.size) == (16, 8)
        np.testing.assert_array_equal(painted_pixels(image), pixels)
    assert data_blocks() == before_blocks
    request.getfixturevalue("monkeypatch").undo()
    addon("scene.baked_colors")._known.clear()
    expected = read_shape(addon, obj).colors
    # By column of the sheet's vertices: every second one shows a single image.
    columns = len(PAINTED) * 2 + 1
    found, expected = (values.reshape(columns, columns, 4) for values in (colors, expected))
    for number, kind in enumerate(PAINTED):
        assert np.ptp(found[2 * number + 1, :, :3]) > 0.1, kind
        np.testing.assert_array_equal(found[2 * number + 1], expected[2 * number + 1], kind)
    np.testing.assert_array_equal(found, expected)


def test_without_cycles_it_is_said_what_to_do(addon, settings, capfd, monkeypatch):
    monkeypatch.setattr(addon("scene.color_bake"), "RENDERER", "NO_CYCLES")
    source, target = sheets(settings)
    source.data.materials.append(material("Plain"))
    target.data.materials.append(checked("Checks"))
    target.data.materials[0].diffuse_color = (0.5, 0.25, 0.1, 1)
    before = data_blocks()
    settings.show_as = "POINTS"
    obj = morph()
    said = capfd.readouterr().out
    assert 'Nodes of the material "Checks" can\'t be read (Checker Texture)' in said
    assert "its viewport color is used instead" in said
    assert "Enable it (Edit > Preferences > Add-ons" in said
    assert not any("Bake" in name or "Checks." in name for name in data_blocks() - before)
    assert obj.pointmorph.state == "CURRENT"
