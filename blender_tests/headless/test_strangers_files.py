"""Morph objects of a .blend file that somebody has tampered with."""

import contextlib
import json

import bpy
import numpy as np
import pointmorph
import pytest
from scenes import morph, pair, select

pytestmark = pytest.mark.logic

DEEP = "[" * 10_000 + "]" * 10_000
TEXTS = ("", "{", "7", "null", "[]", "{}", '"text"', DEEP, '{"shapes": []}')
NAMES = ("recipe", "report", "faces", "baked", "noted")
REPLACEMENTS = (None, -1, 1e308, "text", [], {}, [[]], [None, None], {"a": {"b": []}}, True)


def tampered(value, rng):
    """The same JSON with one thing in it replaced by something else."""
    if isinstance(value, dict) and value and rng.random() < 0.8:
        key = sorted(value)[rng.integers(len(value))]
        return {**value, key: tampered(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.8:
        at = rng.integers(len(value))
        return [*value[:at], tampered(value[at], rng), *value[at + 1 :]]
    return REPLACEMENTS[rng.integers(len(REPLACEMENTS))]


def use(addon, obj):
    """All that reads what a morph object remembers, without an operator."""
    recipes, object_of = addon("scene.recipes"), addon("scene.morph_object")
    recipes.report_of(obj)
    recipes.present_words(obj, "some words")
    assert addon("scene.staleness").state(obj)[0] in ("CURRENT", "STALE", "UNKNOWN")
    addon("scene.placement").placed_by(obj)
    addon("scene.attribute_transfer").words_of(obj)
    addon("scene.blended_textures").options_of(obj)
    for read in (recipes.faces_of, object_of.stage_rows):
        with contextlib.suppress(pointmorph.CloudError):
            read(obj)


def test_what_a_file_remembers_is_read_with_care(settings, addon):
    pair()
    obj = morph()
    data = obj.pointmorph
    rng = np.random.default_rng(5)
    for name in NAMES:
        text = getattr(data, name)
        changed = [json.dumps(tampered(json.loads(text or "{}"), rng)) for _ in range(40)]
        for other in (*TEXTS, *changed):
            setattr(data, name, other)
            use(addon, obj)
        setattr(data, name, text)
    assert addon("scene.staleness").state(obj)[0] == "CURRENT"


OPERATORS = {
    "recompute": {},
    "bake_shape_keys": {"kind": "PAIRS", "steps": 1},
    "edit_morph": {},
    "key_morph": {},
    "go_to_place": {},
    "make_mesh": {},
    "transfer_attributes": {},
    "blend_textures": {},
}


@pytest.mark.parametrize("name", NAMES)
def test_operators_refuse_in_words_where_a_file_was_tampered_with(settings, name):
    pair()
    obj = morph()
    settings.source = None  # so that the object's own settings count
    rng = np.random.default_rng(7)
    text = getattr(obj.pointmorph, name)
    for other in (DEEP, json.dumps(tampered(json.loads(text or "{}"), rng))):
        for operator, options in OPERATORS.items():
            setattr(obj.pointmorph, name, other)
            select(obj)
            said = ""
            try:
                getattr(bpy.ops.pointmorph, operator)(**options)
            except RuntimeError as error:
                said = str(error)
            assert "Traceback" not in said
            assert obj.name in bpy.data.objects


def test_rows_that_there_are_not_are_refused(settings, addon):
    pair()
    obj = morph()
    rows = obj.data.attributes["source_row"].data
    rows[0].value = 2_000_000_000  # 24 GB if it were taken for true
    with pytest.raises(pointmorph.CloudError, match="rows of points"):
        addon("scene.morph_object").stage_rows(obj)
