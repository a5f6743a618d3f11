"""How a morph object says that it is out of date."""

import json

import bpy
import numpy as np
import pytest
from scenes import (
    add_attribute,
    add_mesh,
    assert_same,
    content,
    mark,
    morph,
    move_vertices,
    pair,
    patch,
    recompute,
    select,
)

# --- The state ------------------------------------------------------------------------------------


def test_a_new_morph_is_up_to_date(settings):
    pair()
    obj = morph()
    assert (obj.pointmorph.state, obj.pointmorph.stale) == ("CURRENT", "")
    assert settings.source.pointmorph.state == ""


def edit_source(source, target, settings):
    move_vertices(source, (0, 0, 0.1))


def edit_target(source, target, settings):
    move_vertices(target, (0, 0, 0.1))


def mark_both(source, target, settings):
    for obj in (source, target):
        mark(obj, "foot", -0.6, -0.6)


def weaken_a_feature(source, target, settings):
    group = target.vertex_groups["pm.peak"]
    for vertex in target.data.vertices:
        if any(element.group == group.index for element in vertex.groups):
            group.add([vertex.index], 0.5, "REPLACE")


def move_target(source, target, settings):
    target.location.x += 1


def turn_source(source, target, settings):
    source.rotation_euler.z += 1


def change_a_setting(source, target, settings):
    settings.transfer_neighbors = 20


def set_by_hand(source, target, settings):
    settings.domain = "auto"


def hold_softly(source, target, settings):
    settings.features["peak"].hold = "SOFT"


def add_a_modifier(source, target, settings):
    target.modifiers.new("Wave", "SIMPLE_DEFORM").angle = 1.0


def color_the_source(source, target, settings):
    values = np.tile((1, 0, 0, 1), (len(source.data.vertices), 1))
    item = add_attribute(source.data, "Col", "FLOAT_COLOR", values)
    source.data.color_attributes.active_color = item


@pytest.mark.parametrize(
    ("edit", "word"),
    [
        (edit_source, '"Hill" was edited'),
        (edit_target, '"Dune" was edited'),
        (mark_both, 'features on "Hill" have changed; features on "Dune" have changed'),
        (weaken_a_feature, 'features on "Dune" have changed'),
        (move_target, '"Dune" was moved, rotated or scaled'),
        (turn_source, '"Hill" was moved, rotated or scaled'),
        (change_a_setting, 'the setting "Transfer Neighbors" was changed'),
        (set_by_hand, 'the setting "Domain" was changed'),
        (hold_softly, 'the options of feature "peak" were changed'),
        (add_a_modifier, '"Dune" looks different'),
        (color_the_source, '"Hill" was edited'),
    ],
)
def test_what_is_stale_says_so_and_recompute_makes_what_a_new_morph_would(settings, edit, word):
    source, target = pair()
    obj = morph()
    edit(source, target, settings)
    bpy.context.view_layer.update()
    assert obj.pointmorph.state == "STALE"
    assert word in obj.pointmorph.stale
    recompute(obj)
    assert (obj.pointmorph.state, obj.pointmorph.stale) == ("CURRENT", "")
    again = content(obj)
    assert_same(content(morph(new_result=True)), again)


@pytest.mark.parametrize(
    "edit",
    [
        lambda source, target, settings: source.modifiers.new("Finer", "SUBSURF"),
        lambda source, target, settings: setattr(source, "name", "Mountain"),
        lambda source, target, settings: setattr(target.data, "name", "Sand"),
        lambda source, target, settings: setattr(settings, "threads", 1),
        lambda source, target, settings: setattr(settings, "path", "rigid"),
        lambda source, target, settings: source.vertex_groups.new(name="bone"),
        lambda source, target, settings: [
            setattr(obj.location, "x", obj.location.x + 3) for obj in (source, target)
        ],
    ],
    ids=["modifier", "name", "mesh's name", "threads", "path", "bone", "moved together"],
)
def test_what_changes_nothing_is_not_stale(settings, edit):
    source, target = pair()
    obj = morph()
    edit(source, target, settings)
    bpy.context.view_layer.update()
    assert (obj.pointmorph.state, obj.pointmorph.stale) == ("CURRENT", "")


def test_other_settings_in_the_panel_do_not_concern_a_morph_of_other_objects(settings):
    pair()
    obj = morph()
    settings.source = add_mesh("Other", *patch(8))
    settings.transfer_neighbors = 20
    assert obj.pointmorph.state == "CURRENT"
    recompute(obj)
    assert json.loads(obj.pointmorph.report)["options"]["transfer_neighbors"] == 12
    select(obj)
    bpy.ops.pointmorph.edit_morph()
    assert settings.source.name == "Hill"
    assert settings.transfer_neighbors == 12
    assert obj.pointmorph.state == "CURRENT"


def test_a_target_that_moves_by_itself_does_not_become_stale(settings):
    _, target = pair()
    target.shape_key_add(name="Basis")
    wave = target.shape_key_add(name="Wave")
    for point in wave.data:
        point.co.z += 0.3
    for frame, value in ((1, 0.0), (11, 1.0)):
        wave.value = value
        wave.keyframe_insert("value", frame=frame)
    bpy.context.scene.frame_set(1)
    obj = morph()
    for frame in (5, 11):
        bpy.context.scene.frame_set(frame)
        assert obj.pointmorph.state == "CURRENT"


@pytest.mark.parametrize("modifier", [False, True])
def test_a_source_that_goes_somewhere_makes_nothing_stale(settings, modifier):
    """The target was said to have moved."""
    settings.show_as = "MESH"
    source, _ = pair()
    if modifier:
        source.modifiers.new("Twice", "ARRAY")
    for frame, x in ((1, 0.0), (11, 5.0)):
        source.location.x = x
        source.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(1)
    obj = morph()
    for frame in (5, 11):
        bpy.context.scene.frame_set(frame)
        assert (obj.pointmorph.state, obj.pointmorph.stale) == ("CURRENT", "")


# --- What the panel knows -------------------------------------------------------------------------


def test_the_panel_looks_in_short_steps_and_again_after_a_change(addon, settings):
    """The timer is called by hand here: nothing runs it without a window."""
    source, _ = pair(80, 12)
    obj = morph()
    watching = addon("view.staleness_watch")
    watching._forget()
    assert watching.known_state(obj) is None
    calls = 0
    while watching.known_state(obj) is None:
        watching._look()
        calls += 1
        assert calls < 1000
    assert watching.known_state(obj) == ("CURRENT", [])
    settings.transfer_neighbors = 20
    assert watching.known_state(obj)[0] == "STALE"  # settings are cheap to compare
    settings.transfer_neighbors = 12
    move_vertices(source, (0, 0, 1))
    bpy.context.view_layer.update()
    assert watching.known_state(obj) is None
    assert watching._look() > 0  # it waits for the end of the changes
    watching._changed_at = 0.0
    while watching.known_state(obj) is None:
        watching._look()
    assert watching.known_state(obj) == ("STALE", ['"Hill" was edited'])
    source.name = "Mountain"
    assert watching.known_state(obj) is None
    while watching.known_state(obj) is None:
        watching._look()
    assert watching.known_state(obj) == ("STALE", ['"Mountain" was edited'])
    bpy.data.objects.remove(source)
    while watching.known_state(obj) is None:
        watching._look()
    assert watching.known_state(obj)[0] == "ORPHAN"
