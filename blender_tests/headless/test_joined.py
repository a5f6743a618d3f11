"""Models of several objects: a mesh is made of them, and morphs as a whole."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from modeling import add_armature, show_by_nodes
from painted_scenes import material
from panel_drawing import Layout, drawing_context
from scenes import add_mesh, coordinates, data_blocks, error_of, morph, patch


def add_part(name, parent, matrix=None, skin=None, uv_map=None):
    """A smooth sheet, parented to something, with a material and a UV map that tells its parts."""
    part = add_mesh(name, *patch(5))
    part.data.shade_smooth()
    part.parent = parent
    part.matrix_world = matrix or Matrix()
    if skin is not None:
        part.data.materials.append(bpy.data.materials.new(skin))
    if uv_map is not None:
        layer = part.data.uv_layers.new(name=uv_map)
        for corner, uv in enumerate(layer.uv):
            uv.vector = (corner / 100, len(bpy.data.meshes) / 100)
    return part


def add_empty(name="Model", place=(1, 2, 3)):
    empty = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(empty)
    empty.location = place
    bpy.context.view_layer.update()
    return empty


def select(*objects):
    bpy.context.view_layer.update()
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.objects.active = objects[-1] if objects else None


def join(*objects):
    select(*objects)
    assert bpy.ops.pointmorph.join_copies() == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def shown_vertices(obj):
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    matrix = np.array(obj.matrix_world)
    return coordinates(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]


def shown_normals(obj):
    """At the corners of faces, in the world, from the faces with the least rows of vertices."""
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    into = np.linalg.inv(np.array(obj.matrix_world)[:3, :3])
    found = {}
    for loop, normal in zip(mesh.loops, mesh.corner_normals, strict=True):
        found.setdefault(loop.vertex_index, []).append(np.array(normal.vector) @ into)
    means = np.array([np.mean(found[row], axis=0) for row in range(len(mesh.vertices))])
    return means / np.linalg.norm(means, axis=1, keepdims=True)


PLACES = {
    "turned": Matrix.Translation((4, 0, 0)) @ Matrix.Rotation(0.7, 4, "X"),
    "mirrored": Matrix.Translation((0, 5, 0)) @ Matrix.Diagonal((-1, 1, 1, 1)),
    "stretched": Matrix.Translation((0, 0, 6)) @ Matrix.Diagonal((1, 3, 0.4, 1)),
}


def test_a_mesh_shows_what_the_parts_of_a_model_show(capfd):
    root = add_empty()
    parts = [add_part(name, root, matrix, name, name) for name, matrix in PLACES.items()]
    for part in parts:
        normals = np.array([(0.3, 0.4, 0.866)] * len(part.data.loops))
        part.data.normals_split_custom_set(normals.tolist())
    plain = add_part("plain", root)
    hidden = add_part("hidden", root)
    hidden.hide_set(True)
    bpy.context.view_layer.update()
    before = {one.name: [*map(tuple, one.matrix_world)] for one in [*parts, plain]}
    counts = data_blocks()
    joined = join(root)

    assert joined.name == joined.data.name == "Model Joined"
    assert tuple(joined.location) == (1, 2, 3)
    assert joined.select_get()
    assert {one.partition(": ")[2] for one in data_blocks() - counts} == {"Model Joined"}
    for one in (*parts, plain):
        assert one.hide_get()
        assert one.hide_render
        assert [*map(tuple, one.matrix_world)] == before[one.name]
    assert not root.hide_get()
    assert hidden.hide_render  # else it would be rendered beside the mesh
    said = '"hidden", which was hidden, isn\'t in the mesh, and is now hidden in renders, too'
    assert said in capfd.readouterr().out
    assert len(joined.data.vertices) == 4 * 25

    # Parts come in any order: a place tells which is which.
    places, normals = shown_vertices(joined), shown_normals(joined)
    for part in (*parts, plain):
        own = shown_vertices(part)
        rows = [int(np.argmin(np.linalg.norm(places - place, axis=1))) for place in own]
        np.testing.assert_allclose(places[rows], own, atol=1e-5)
        np.testing.assert_allclose(normals[rows], shown_normals(part), atol=2e-3)
        faces = [p for p in joined.data.polygons if set(p.vertices) <= set(rows)]
        assert len(faces) == 16
        materials = {joined.material_slots[face.material_index].material for face in faces}
        assert materials == {next(iter(part.data.materials), None)}
        if part != plain:
            # What is rendered is one map for all; a material that names its own finds that.
            shown = next(m for m in joined.data.uv_layers if m.active_render)
            for layer in (shown, joined.data.uv_layers[part.name]):
                v = {round(layer.uv[i].vector.y, 5) for f in faces for i in f.loop_indices}
                assert v == {round(part.data.uv_layers[0].uv[0].vector.y, 5)}
    outward = [
        np.dot(p.normal, joined.data.corner_normals[p.loop_start].vector)
        for p in joined.data.polygons
    ]
    assert min(outward) > 0


@pytest.mark.parametrize("how", ["object", "monitor", "eye", "collection's monitor"])
def test_what_is_hidden_in_any_way_is_not_rendered_beside_the_mesh(capfd, how):
    """Spare weapons in a collection whose eye was off floated beside the character."""
    root = add_empty()
    add_part("Body", root)
    spare = add_part("Spare", root)
    home = bpy.data.collections.new("Spares")
    bpy.context.scene.collection.children.link(home)
    bpy.context.scene.collection.objects.unlink(spare)
    home.objects.link(spare)
    layer = bpy.context.view_layer.layer_collection.children["Spares"]
    spare.hide_set(how == "object")
    spare.hide_viewport = how == "monitor"
    layer.hide_viewport = how == "eye"
    home.hide_viewport = how == "collection's monitor"
    joined = join(root)
    assert len(joined.data.vertices) == 25
    assert spare.hide_render
    assert spare.hide_get() == (how == "object")  # shown again with its collection
    assert '"Spare", which was hidden, isn\'t in the mesh' in capfd.readouterr().out


def test_a_rig_stands_for_what_it_bends(settings):
    bent, loose = add_part("Bent", None), add_part("Loose", None)
    add_armature(bent, (0, 0, 0.5))
    rig = bpy.data.objects["Rig"]
    add_part("Held", rig, Matrix.Translation((3, 0, 0)))
    bpy.context.view_layer.update()
    places = shown_vertices(bent)
    joined = join(rig)
    assert len(joined.data.vertices) == 50
    assert not loose.hide_get()
    assert not joined.modifiers
    assert [group.name for group in joined.vertex_groups] == ["Bone"]
    found = shown_vertices(joined)
    near = [np.linalg.norm(found - place, axis=1).min() for place in places]
    assert max(near) < 1e-5


def add_character(pose):
    """A rig with a part that it bends, one that a bone holds, and one on that; their places."""
    bent = add_part("Bent", None)
    add_armature(bent, (0, 0, 0))
    rig = bpy.data.objects["Rig"]
    rig.matrix_world = Matrix.Translation((1, 2, 0)) @ Matrix.Diagonal((2, 2, 2, 1))
    rig.data.pose_position = pose
    rig.pose.bones["Bone"].rotation_mode = "XYZ"
    rig.pose.bones["Bone"].rotation_euler = (0.3, 0.5, 0.7)
    held = add_part("Held", rig, Matrix.Translation((3, 0, 0)))
    held.parent_type, held.parent_bone = "BONE", "Bone"
    add_part("On held", held, Matrix.Rotation(0.4, 4, "X"))
    bpy.context.view_layer.update()
    return rig, [bpy.data.objects[name] for name in ("Bent", "Held", "On held")]


def test_a_rig_at_rest_goes_on_moving_what_it_moved(capfd):
    """So a whole character morphs while it runs."""
    rig, parts = add_character("REST")
    joined = join(rig)
    assert '"Rig" moves it' in capfd.readouterr().out
    assert joined.parent == rig
    for position in ("REST", "POSE"):
        rig.data.pose_position = position
        for part in parts:
            part.hide_set(False)
        bpy.context.view_layer.update()
        found = shown_vertices(joined)
        places = np.concatenate([shown_vertices(part) for part in parts])
        assert len(found) == len(places)
        apart = np.linalg.norm(found[:, None] - places, axis=2)
        assert apart.min(axis=0).max() < 1e-5
        assert apart.min(axis=1).max() < 1e-5


WHY_NOT = {
    "pose": "undo, set that to Rest Position and join again",
    "bone": 'undo, turn on Deform for its bone "Bone"',
    "two rigs": '"Rig" and "Rig.001" move them, and only one can move a mesh',
}


@pytest.mark.parametrize("why", WHY_NOT)
def test_a_rig_that_cannot_move_a_mesh_leaves_it_and_that_is_said(capfd, why):
    """Two rigs at rest left it in silence."""
    rig, _ = add_character("POSE" if why == "pose" else "REST")
    rig.data.bones["Bone"].use_deform = why != "bone"
    chosen = [rig]
    if why == "two rigs":
        other = add_part("Other", None, Matrix.Translation((9, 0, 0)))
        add_armature(other, (0, 0, 0))
        chosen = [rig, other.modifiers[0].object]
    joined = join(*chosen)
    assert joined.parent is None
    assert not joined.modifiers
    assert WHY_NOT[why] in capfd.readouterr().out


def test_a_collection_that_is_shown_is_joined():
    shown = bpy.data.collections.new("Set")
    for x in (0, 3):
        part = add_part(f"Part {x}", None, Matrix.Translation((x, 0, 0)))
        bpy.context.scene.collection.objects.unlink(part)
        shown.objects.link(part)
    empty = add_empty("Shows", (0, 7, 0))
    empty.instance_type, empty.instance_collection = "COLLECTION", shown
    bpy.context.view_layer.update()
    joined = join(empty)
    assert empty.hide_get()
    low, high = shown_vertices(joined).min(axis=0), shown_vertices(joined).max(axis=0)
    np.testing.assert_allclose((low[:2], high[:2]), ((-1, 6), (4, 8)), atol=1e-5)


def test_curves_and_texts_are_joined():
    bpy.ops.object.text_add()
    text = bpy.context.object
    add_part("Sheet", text, Matrix.Translation((0, 0, 4)))
    bpy.context.view_layer.update()
    joined = join(text)
    assert joined.name == "Text Joined"
    assert len(joined.data.vertices) > 25
    assert np.ptp(shown_vertices(joined)[:, 2]) > 3


def test_two_models_morph_as_wholes(settings):
    settings.show_as = "MESH"
    settings.domain = "auto"
    models = []
    for name in ("One", "Other"):
        root = add_empty(name, (0, 0, 0))
        for x in (0, 4):
            add_part(f"{name} {x}", root, Matrix.Translation((x, 0, 0)))
        bpy.context.view_layer.update()
        models.append(join(root))
    places = shown_vertices(models[0])
    select(*models)
    shown = morph()
    assert shown.name == "One Joined to Other Joined"
    np.testing.assert_array_equal(shown_vertices(shown), places)


def test_what_cannot_be_joined_is_said():
    empty = add_empty()
    select(empty)
    assert "expected several objects with faces, found none" in error_of(
        bpy.ops.pointmorph.join_copies
    )
    part = add_part("Part", None)
    select(part)
    said = error_of(bpy.ops.pointmorph.join_copies)
    assert "found one. Select the others as well, or the object that they are parented to" in said
    other = add_part("Other", part)
    other.data.clear_geometry()
    assert "found one" in error_of(bpy.ops.pointmorph.join_copies)
    show_by_nodes(part, "GeometryNodeInstanceOnPoints")
    bpy.context.view_layer.update()
    assert not part.hide_get()
    select()
    assert "Select the objects of a model first" in error_of(bpy.ops.pointmorph.join_copies)


def test_instances_of_faces_that_nodes_make_are_not_left_out_in_silence():
    part, other = add_part("Part", None), add_part("Other", None)
    show_by_nodes(part, "GeometryNodeInstanceOnPoints")
    group = part.modifiers[0].node_group
    instances = next(n for n in group.nodes if n.bl_idname == "GeometryNodeInstanceOnPoints")
    cone = group.nodes.new("GeometryNodeMeshCone")
    group.links.new(cone.outputs[0], instances.inputs["Instance"])
    bpy.context.view_layer.update()
    select(part, other)
    said = error_of(bpy.ops.pointmorph.join_copies)
    assert 'Add the node "Realize Instances"' in said


def test_those_who_select_a_whole_model_are_told(addon, settings, capfd):
    polls = addon("operators.polls")
    root = add_empty()
    parts = [add_part(f"Part {number}", root) for number in range(12)]
    other = add_part("Other", None)
    parented = " makes a mesh of what is parented to it"
    select(root)
    assert f". Join Copies{parented}" in polls.morph_reason(bpy.context)
    select(root, other)
    assert f"with it alone selected,{parented}" in polls.morph_reason(bpy.context)
    select(*parts)
    assert "make one mesh of them (Join Copies)" in polls.morph_reason(bpy.context)
    parts[1].parent = parts[0]
    bpy.context.view_layer.update()
    settings.domain = "disk"
    select(parts[0], other)
    morph()
    said = capfd.readouterr().out
    assert '"Part 1" parented to "Part 0" didn\'t morph with it' in said
    select(parts[0], parts[1])


@pytest.mark.parametrize(
    ("selected", "offered"),
    [
        ("root", True),
        ("parent", True),
        ("both", True),
        ("three", True),
        ("two", False),
        ("parent and another", False),
    ],
)
def test_the_panel_offers_to_join_what_may_be_parts(addon, selected, offered):
    root = add_empty()
    lid = add_part("Lid", add_part("Chest", root))
    loose = [add_part(name, None) for name in "ABC"]
    objects = {
        "root": [root],
        "parent": [lid.parent],
        "both": [lid.parent, lid],
        "three": loose,
        "two": loose[:2],
        "parent and another": [lid.parent, loose[0]],
    }
    select(*objects[selected])
    remark = addon("operators.polls").morph_remark(bpy.context)
    said = remark is not None and 'select "Chest" alone and press Join Copies' in remark
    assert said == (selected == "parent and another")
    layout = Layout()
    panel = addon("ui.panels").POINTMORPH_PT_morph
    panel._draw_shapes(SimpleNamespace(_draw_between=None), layout, drawing_context())
    assert ("join_copies" in layout.drawn) == offered


def test_what_is_rendered_is_no_other_map_of_the_same_name():
    """A part had the image that its light map is for."""
    first, second = add_part("A", None, uv_map="UVMap"), add_part("B", None, uv_map="UVMap")
    layer = second.data.uv_layers.new(name="Second")
    for uv in layer.uv:
        uv.vector = (0.75, 0.5)
    layer.active_render = True
    joined = join(first, second)
    shown = next(layer for layer in joined.data.uv_layers if layer.active_render)
    assert sum(tuple(uv.vector) == (0.75, 0.5) for uv in shown.uv) == len(shown.uv) // 2
    for name in ("UVMap", "Second"):
        assert name in joined.data.uv_layers
    light = [uv.vector.x for uv in joined.data.uv_layers["UVMap"].uv]
    assert 0.75 not in light or light.count(0.75) < len(light) // 2


def test_parts_keep_their_marks_and_stay_where_no_bone_moves_them():
    rig, (bent, held, _) = add_character("REST")
    held.vertex_groups.new(name="pm.tip").add([3], 1.0, "REPLACE")
    still = add_part("Still", rig, Matrix.Translation((9, 0, 0)))
    still.vertex_groups.new(name="Bone").add(range(25), 1.0, "REPLACE")
    bent.modifiers[0].use_deform_preserve_volume = True
    joined = join(rig)
    assert "pm.tip" in joined.vertex_groups
    assert joined.modifiers[0].use_deform_preserve_volume
    rig.data.pose_position = "POSE"
    still.hide_set(False)
    bpy.context.view_layer.update()
    apart = np.linalg.norm(shown_vertices(joined)[:, None] - shown_vertices(still), axis=2)
    assert apart.min(axis=0).max() < 1e-5


def test_a_morph_that_the_rig_moves_is_no_part(settings):
    """Whoever joined the parts again after edits got the morph in the mesh, and hidden."""
    settings.show_as = "MESH"
    rig, parts = add_character("REST")
    first = join(rig)
    other = add_part("Other", None, Matrix.Translation((0, 0, 9)))
    select(first, other)
    shown = morph()
    assert shown.parent == rig
    bpy.data.objects.remove(first)
    for part in parts:
        part.hide_set(False)
    assert len(join(rig).data.vertices) == 75
    assert not shown.hide_get()


def test_what_a_scale_of_zero_flattens_is_joined():
    first, flat = add_part("A", None), add_part("B", None, Matrix.Diagonal((1, 1, 0, 1)))
    flat.data.normals_split_custom_set([(0.3, 0.4, 0.866)] * len(flat.data.loops))
    joined = join(first, flat)
    assert len(joined.data.vertices) == 50
    assert np.isfinite(coordinates(joined.data.vertices)).all()


def show_in_collection(*parts):
    """An empty that shows a collection with these parts, which aren't seen otherwise."""
    shown = bpy.data.collections.new("Set")
    for part in parts:
        bpy.context.scene.collection.objects.unlink(part)
        shown.objects.link(part)
    empty = add_empty("Shows", (0, 7, 0))
    empty.instance_type, empty.instance_collection = "COLLECTION", shown
    bpy.context.view_layer.update()
    return empty


def test_instances_in_a_collection_that_is_shown_are_not_left_out_in_silence():
    part, others = add_part("Part", None), [add_part(name, None) for name in "AB"]
    show_by_nodes(part, "GeometryNodeInstanceOnPoints")
    group = part.modifiers[0].node_group
    instances = next(n for n in group.nodes if n.bl_idname == "GeometryNodeInstanceOnPoints")
    cone = group.nodes.new("GeometryNodeMeshCone")
    group.links.new(cone.outputs[0], instances.inputs["Instance"])
    select(show_in_collection(part, *others))
    said = error_of(bpy.ops.pointmorph.join_copies)
    assert 'Part: expected a mesh in the viewport, found instances. Add the node "Realize' in said


def test_texts_in_a_collection_that_is_shown_are_joined():
    bpy.ops.object.text_add()
    joined = join(show_in_collection(bpy.context.object, add_part("Part", None)))
    assert len(joined.data.vertices) > 25


def paint(part, name, color, kind="FLOAT_COLOR", domain="POINT"):
    colors = part.data.color_attributes.new(name, kind, domain)
    for one in colors.data:
        one.color = color
    part.data.color_attributes.active_color = colors


RED, GREEN, BLUE = (1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1)


@pytest.mark.parametrize(
    "others",
    [
        {"name": "Paint"},
        {"name": "Col", "kind": "BYTE_COLOR", "domain": "CORNER"},
        {"name": "Col", "domain": "CORNER"},
    ],
)
@pytest.mark.parametrize("first", [0, 1])
def test_colors_of_parts_are_shown_whatever_their_names_and_kinds(others, first):
    """All parts but those with the first one's name were white, or black in Blender 5."""
    parts = [
        add_part(name, None, Matrix.Translation((4 * x, 0, 0))) for x, name in enumerate("ABC")
    ]
    paint(parts[first], "Col", RED)
    paint(parts[1 - first], color=GREEN, **others)
    parts[2].data.materials.append(material("Blue", BLUE))
    joined = join(*parts).data
    names = [colors.name for colors in joined.color_attributes]
    assert len(names) == len(set(names))
    shown = joined.color_attributes.active_color
    assert joined.attributes.default_color_name == shown.name
    wanted = [RED, GREEN, BLUE] if first == 0 else [GREEN, RED, BLUE]
    for face in joined.polygons:
        for corner in face.loop_indices:
            row = joined.loops[corner].vertex_index
            color = shown.data[corner if shown.domain == "CORNER" else row].color
            place = joined.vertices[row].co.x + bpy.data.objects["C"].location.x
            assert tuple(color) == pytest.approx(wanted[round(place / 4)], abs=1e-3)


def in_viewport():
    """Where a viewport is, and its region."""
    window = bpy.context.window_manager.windows[0]
    area = next(one for one in window.screen.areas if one.type == "VIEW_3D")
    region = next(one for one in area.regions if one.type == "WINDOW")
    return bpy.context.temp_override(window=window, area=area, region=region)


def test_what_a_local_view_leaves_out_is_not_joined():
    root = add_empty()
    parts = [add_part(name, root) for name in "ABC"]
    select(root, *parts[:2])
    with in_viewport():
        assert bpy.ops.view3d.localview() == {"FINISHED"}
        joined = join(root)
        assert len(joined.data.vertices) == 2 * 25
        assert joined.visible_get()
        assert not parts[2].hide_render
        bpy.ops.view3d.localview()


def test_an_error_midway_leaves_nothing_behind(addon, monkeypatch):
    """What was joined stayed, and parts were hidden."""
    rig, parts = add_character("REST")
    select(rig)
    before = data_blocks()

    def fail(*_):
        raise RuntimeError("of Blender's")

    as_shown = addon("scene.as_shown")
    for name in ("hide", "link_beside"):
        with monkeypatch.context() as patched:
            patched.setattr(as_shown, name, fail)
            assert "of Blender's" in error_of(bpy.ops.pointmorph.join_copies)
        assert data_blocks() == before
        assert not any(part.hide_get() or part.hide_render for part in parts)


def test_long_names():
    """The map that is rendered got a name that Blender cut, and wasn't found."""
    name = "ä" * 31
    parts = [add_part(f"{x}", None, uv_map=name) for x in "AB"]
    layer = parts[1].data.uv_layers.new(name="L" * 63)
    layer.active_render = True
    for uv in layer.uv:
        uv.vector = (0.75, 0.5)
    parts[1].name = "n" * 63
    parts[0].data.uv_layers.new(name="L" * 63)
    joined = join(*parts)
    assert joined.name.endswith(" Joined")
    shown = next(layer for layer in joined.data.uv_layers if layer.active_render)
    assert sum(tuple(uv.vector) == (0.75, 0.5) for uv in shown.uv) == len(shown.uv) // 2


@pytest.mark.parametrize("hides_one", [False, True])
def test_parts_that_are_linked_are_said_to_be_rendered(tmp_path, capfd, hides_one):
    """They can't be hidden there. Of one that was hidden, it was said that it is now."""
    path = str(tmp_path / "parts.blend")
    chest = add_part("Chest", None)
    bpy.data.libraries.write(path, {chest, add_part("Lid", chest)})
    for name in ("Lid", "Chest"):
        bpy.data.objects.remove(bpy.data.objects[name])
    with bpy.data.libraries.load(path, link=True) as (there, linked):
        linked.objects = there.objects
    for part in linked.objects:
        bpy.context.scene.collection.objects.link(part)
    own = add_part("Own", None)
    bpy.data.objects["Lid"].hide_set(hides_one)
    join(*linked.objects, own)
    assert all(part.hide_get() for part in linked.objects)
    said = capfd.readouterr().out
    assert "2 objects are linked from another file and can't be hidden" in said
    assert "now hidden in renders" not in said


def test_linked_targets_are_said_to_be_rendered(settings, tmp_path, capfd):
    path = str(tmp_path / "part.blend")
    bpy.data.libraries.write(path, {add_part("Lid", None)})
    bpy.data.objects.remove(bpy.data.objects["Lid"])
    with bpy.data.libraries.load(path, link=True) as (there, linked):
        linked.objects = there.objects
    bpy.context.scene.collection.objects.link(linked.objects[0])
    settings.domain = "disk"
    select(add_part("Other", None), linked.objects[0])
    capfd.readouterr()
    morph()
    assert '"Lid" is linked from another file and can\'t be hidden' in capfd.readouterr().out


def test_the_panel_does_not_offer_to_join_an_empty_alone(addon):
    select(add_empty())
    assert not addon("operators.polls").are_parts(bpy.context)
