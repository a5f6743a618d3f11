"""Everything that the add-on says, it says in German too."""

import ast
import string
from pathlib import Path

import bpy
import pointmorph
import pytest

KINDS = (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup)
# Properties that nothing draws.
HIDDEN = {"PointmorphObject"}
# With two words for a part that isn't a name, put together in the code.
COMPOSED = [
    f'The {side} "{{name}}" is no longer in the scene: pick another'
    for side in ("source", "target")
] + [f"Pick a {side} first" for side in ("source", "target")]


@pytest.fixture(scope="module")
def german(addon):
    return addon("translations").words()["de_DE"]


def own_classes(module):
    return [
        (base, cls)
        for base in KINDS
        for cls in base.__subclasses__()
        if cls.__module__.startswith(f"{module}.")
    ]


def texts_of(base, cls):
    """What Blender shows of a class: names, tooltips, and those of its properties."""
    known = cls.bl_rna
    if base is not bpy.types.PropertyGroup:
        yield cls.bl_label
    if base is bpy.types.Operator:
        known = getattr(bpy.ops.pointmorph, cls.bl_idname.split(".")[1]).get_rna_type()
        yield known.description
    inherited = {"rna_type", *base.bl_rna.properties.keys()} - {"name"}
    if base is bpy.types.PropertyGroup:
        inherited.add("name")
    for item in known.properties:
        if item.identifier in inherited or cls.__name__ in HIDDEN:
            continue
        yield item.name
        yield item.description
        if item.type == "ENUM":
            for choice in item.enum_items:
                yield choice.name
                yield choice.description


def test_names_and_tooltips(module, german):
    classes = own_classes(module)
    assert len(classes) > 40
    texts = {text for base, cls in classes for text in texts_of(base, cls)}
    assert len(texts) > 200
    assert sorted(text for text in texts if text and text not in german) == []


def test_tooltips_are_in_one_line(module):
    for base, cls in own_classes(module):
        if base is bpy.types.Operator:
            said = list(texts_of(base, cls))[1]
            assert said, cls.__name__
            assert "\n" not in said, cls.__name__
            assert "  " not in said, cls.__name__


# --- What stands in the code ----------------------------------------------------------------------


def sources(addon):
    folder = Path(addon("panels").__file__).parent
    for path in folder.glob("*.py"):
        if path.stem != "german":
            yield path.stem, ast.parse(path.read_text())


def name_of(call):
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def values_of(node, within):
    """The strings that an expression can be: itself, both of a choice, what a name was given."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.IfExp):
        return values_of(node.body, within) + values_of(node.orelse, within)
    if isinstance(node, ast.Name):
        return [
            value
            for given in ast.walk(within)
            if isinstance(given, ast.Assign)
            and any(isinstance(t, ast.Name) and t.id == node.id for t in given.targets)
            for value in values_of(given.value, within)
        ]
    return []


SAYING = {"tell": 0, "poll_message_set": 0, "possible": 1, "report": 1}
"""What says something: the place of that among its arguments."""


def said(addon):
    """(where, text) of every message, and of every label that a panel writes itself."""
    for where, tree in sources(addon):
        for within in ast.walk(tree):
            if isinstance(within, ast.Assign) and getattr(within.targets[0], "id", "") == "stopped":
                yield where, within.value.value
            if not isinstance(within, ast.FunctionDef):
                continue
            if within.name.endswith(("reason", "unmarkable")):
                for node in ast.walk(within):
                    if isinstance(node, ast.Return) and node.value is not None:
                        yield from ((where, text) for text in values_of(node.value, within))
            for node in ast.walk(within):
                if not isinstance(node, ast.Call):
                    continue
                place = SAYING.get(name_of(node))
                if place is not None and len(node.args) > place:
                    yield from ((where, text) for text in values_of(node.args[place], within))
                for word in node.keywords:
                    if word.arg == "text" and name_of(node) in {"label", "prop", "operator"}:
                        yield from ((where, text) for text in values_of(word.value, within))


def test_messages(addon, german):
    found = {(where, text) for where, text in said(addon) if text}
    assert len(found) > 60
    assert sorted(item for item in found if item[1] not in german) == []


def test_messages_with_something_put_in_are_translated_first(addon):
    """What is put together already can't be looked up any more."""
    for where, tree in sources(addon):
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and name_of(node) in {*SAYING} - {"tell"}:
                composed = [a for a in node.args if isinstance(a, (ast.JoinedStr, ast.BinOp))]
                assert not composed, (where, node.lineno)


def test_anything_can_be_put_in(addon):
    told = addon("translations").tell("{text}     Ctrl Z: take back     Esc: done", text="{a}")
    assert told.startswith("{a}")


def test_what_is_put_in_is_the_same_in_both_languages(german):
    for english, other in german.items():
        names = [
            {name for _, name, _, _ in string.Formatter().parse(text) if name}
            for text in (english, other)
        ]
        assert names[0] == names[1], english
        assert other.strip()


def test_every_word_that_is_translated_is_used(addon, german):
    used = set(COMPOSED)
    for _, tree in sources(addon):
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                used |= {node.value, " ".join(node.value.split())}
    properties = addon("properties")
    for option in pointmorph.options():
        used |= {properties.setting_label(option), properties.setting_tip(option)}
        used |= {properties.switch_label(option), properties.switch_tip(option)}
        used |= {properties.choice_label(choice) for choice in option.choices}
    assert sorted(set(german) - used) == []


def test_every_setting_is_known(addon):
    german = addon("german")
    options = pointmorph.options()
    assert set(german.SETTINGS) == {option.name for option in options}
    assert set(german.UNITS) == {option.unit for option in options} - {""}
    assert set(german.CHOICES) == {choice for option in options for choice in option.choices}


def test_the_panel_speaks_german(addon):
    view = bpy.context.preferences.view
    if "de_DE" not in bpy.app.translations.locales:
        pytest.skip("this Blender is built without languages")
    before = view.language
    try:
        view.language = "de_DE"
        view.use_translate_interface = view.use_translate_tooltips = True
        translated = bpy.app.translations.pgettext_iface
        assert translated("Take Selected", "Operator") == "Auswahl nehmen"
        assert translated("Cut and Domain") == "Schnitt und Grundfläche"
        assert "Quelle" in bpy.app.translations.pgettext_tip(
            "Make the target the source and the source the target"
        )
        assert addon("checks").shapes_reason(bpy.context) == "Pick a source first"
        told = addon("translations").tell("{count} frames written to {place}", count=3, place="x")
        assert told == "3 Bilder nach x geschrieben"
    finally:
        view.language = before
