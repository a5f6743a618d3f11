"""Objects and collections of other files, and operators that compute beside a window."""

import bpy
from scenes import add_mesh, mark, morph, pair, patch, pick


def link(path, collections=(), objects=()):
    """Links data-blocks of a file into the scene; returns them."""
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.collections, wanted.objects = list(collections), list(objects)
    for one in wanted.collections:
        bpy.context.scene.collection.children.link(one)
    for one in wanted.objects:
        bpy.context.scene.collection.objects.link(one)
    return [*wanted.collections, *wanted.objects]


def write_sheet(path, name, side, bump):
    """A file with one marked sheet."""
    obj = add_mesh(name, *patch(side, bump))
    mark(obj, "peak", 0, 0)
    mark(obj, "slope", 0.5, 0.3)
    bpy.data.libraries.write(str(path), {obj})
    bpy.data.objects.remove(obj)


def test_a_morph_beside_a_linked_collection_that_is_active(settings, tmp_path):
    collection = bpy.data.collections.new("Props")
    bpy.data.libraries.write(str(tmp_path / "props.blend"), {collection})
    bpy.data.collections.remove(collection)
    [linked] = link(tmp_path / "props.blend", collections=["Props"])
    layers = bpy.context.view_layer
    layers.active_layer_collection = layers.layer_collection.children[linked.name]
    pair()
    assert bpy.context.collection == linked
    obj = morph()
    assert list(obj.users_collection) == [bpy.context.scene.collection]


def test_two_objects_of_one_name_from_two_files(settings, tmp_path):
    for number, bump in enumerate((0.5, 0.8)):
        write_sheet(tmp_path / f"{number}.blend", "Sheet", 12 - 2 * number, bump)
    [source] = link(tmp_path / "0.blend", objects=["Sheet"])
    [target] = link(tmp_path / "1.blend", objects=["Sheet"])
    assert source.name == target.name
    for picked in ((source, target), (target, source)):
        pick(*picked)
        settings.domain = "disk"
        obj = morph()
        assert (obj.pointmorph.source, obj.pointmorph.target) == picked
        assert obj.pointmorph.state == "CURRENT"


def test_the_last_morph_of_two_objects_is_found_among_others(settings, addon):
    active_result = addon("operators.polls").active_result
    source, target = pair()
    assert active_result(bpy.context) is None
    first = morph()
    bpy.context.view_layer.objects.active = source
    assert active_result(bpy.context) == first
    settings.source, settings.target = target, source
    assert active_result(bpy.context) is None
    second = morph()
    bpy.context.view_layer.objects.active = None
    assert active_result(bpy.context) == second
    settings.source, settings.target = source, target
    assert active_result(bpy.context) == first
    first.name = "Renamed"
    assert active_result(bpy.context) == first
    third = morph(new_result=True)
    bpy.context.view_layer.objects.active = None
    assert active_result(bpy.context) == third
    bpy.data.objects.remove(third)
    assert active_result(bpy.context) == first


def test_no_option_in_the_redo_panel_computes_again(addon):
    """What is changed there runs an operator at once, in Blender's own thread."""
    computing = addon("operators.modal_operator").Computing
    found = [c for c in bpy.types.Operator.__subclasses__() if issubclass(c, computing)]
    assert len(found) >= 8
    assert not [c.bl_idname for c in found if "REGISTER" in c.bl_options]
