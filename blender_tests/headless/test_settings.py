"""The settings are the library's."""

from dataclasses import replace

import bpy
import pointmorph
import pytest
from scenes import pair

# What staggers is chosen on the result, and in Blender z is up.
OPTIONS = {
    o.name: o for o in pointmorph.options() if o.name != "up" and not o.name.startswith("stagger")
}
AUTOMATIC = [name for name, option in OPTIONS.items() if option.default is None]


@pytest.fixture(autouse=True)
def untouched(settings):
    settings.property_unset("path")


@pytest.mark.parametrize("name", OPTIONS)
def test_names_defaults_and_ranges(settings, name):
    option = OPTIONS[name]
    prop = settings.bl_rna.properties[name]
    assert option.help.rstrip(".") in prop.description
    if option.kind == "choice":
        assert tuple(item.identifier for item in prop.enum_items) == option.choices
        assert getattr(settings, name) == option.default
        return
    assert prop.hard_min == pytest.approx(option.minimum, rel=1e-6)
    assert prop.hard_max == pytest.approx(min(option.maximum, 2**31 - 1), rel=1e-6)
    if option.default is not None:
        assert getattr(settings, name) == pytest.approx(option.default, rel=1e-6)


# What files hold of a setting: a number that must mean the same in every version.
NUMBERS = {
    "method": ["auto", "paper"],
    "domain": ["auto", "disk", "cut", "sphere", "network"],
    "boundary_spacing": ["uniform", "chord"],
    "solve": ["full", "lod"],
    "missing_parts": ["leave", "stretch"],
    "path": ["linear", "similarity", "rigid", "auto"],
    "show_as": ["MESH", "POINTS", "DISCS"],
    "texture_size": ["256", "512", "1024", "2048", "4096"],
    "bake_as": ["KEYS", "FRAMES"],
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_choice_means_in_old_files_what_it_did(settings, name):
    items = settings.bl_rna.properties[name].enum_items
    assert [i.identifier for i in sorted(items, key=lambda i: i.value)] == NUMBERS[name]
    assert sorted(i.value for i in items) == list(range(len(items)))


def test_every_choice_of_the_library_is_among_them():
    assert {name for name, o in OPTIONS.items() if o.kind == "choice"} <= set(NUMBERS)


@pytest.mark.parametrize("name", [name for name, o in OPTIONS.items() if o.kind == "choice"])
def test_a_new_word_of_a_choice_comes_last_in_files(addon, name):
    option = OPTIONS[name]
    newer = replace(option, choices=("nearest", *option.choices[::-1], "farthest"))
    items = addon("data.properties")._property(newer).keywords["items"]
    assert [item[0] for item in items] == list(newer.choices)
    numbers = {item[0]: item[3] for item in items}
    words = [*NUMBERS[name], "nearest", "farthest"]
    assert numbers == {word: number for number, word in enumerate(words)}


def test_what_staggers_is_no_setting_of_a_scene(settings):
    assert not any(hasattr(settings, o.name) for o in pointmorph.options() if o.name not in OPTIONS)


def test_untouched_settings_are_exactly_the_defaults(addon, settings):
    """Not their float32 neighbours: the command line gets the same result then."""
    values = addon("core.settings").settings_values(settings)
    defaults = {name: o.default for name, o in OPTIONS.items() if o.default is not None}
    assert values == {**defaults, "up": "z"}


@pytest.mark.parametrize("name", [name for name, o in OPTIONS.items() if o.kind == "float"])
def test_decimals_arrive_as_typed(addon, settings, name):
    option = OPTIONS[name]
    value = float(f"{option.minimum + 0.317 * (option.maximum - option.minimum):.3g}")
    setattr(settings, name, value)
    assert addon("core.settings").settings_values(settings)[name] == value


@pytest.mark.parametrize("name", AUTOMATIC)
def test_a_value_given_is_used_and_can_be_made_automatic_again(addon, settings, name):
    values = addon("core.settings").settings_values
    assert name not in values(settings)
    setattr(settings, name, OPTIONS[name].maximum)
    assert values(settings)[name] == pytest.approx(OPTIONS[name].maximum)
    setattr(settings, f"use_{name}", False)
    assert name not in values(settings)


def test_values_are_kept_within_the_range(settings):
    option = next(o for o in OPTIONS.values() if o.kind == "int" and o.default is not None)
    setattr(settings, option.name, int(option.maximum) + 1)
    assert getattr(settings, option.name) == option.maximum


@pytest.mark.computes
def test_the_library_gets_them(settings, addon, monkeypatch):
    pair()
    option = next(o for o in OPTIONS.values() if o.kind == "int" and o.default is not None)
    setattr(settings, option.name, int(option.minimum) + 1)
    seen = {}

    def morph(*arguments, **keywords):
        seen.update(keywords)
        raise pointmorph.OptionError("that", "this", "those", "Stop here.")

    monkeypatch.setattr(pointmorph, "morph", morph)
    with pytest.raises(RuntimeError, match="Stop here"):
        bpy.ops.pointmorph.morph()
    assert seen[option.name] == option.minimum + 1
