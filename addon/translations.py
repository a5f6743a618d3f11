"""The panel's words in other languages, and messages that have something put in."""

import inspect

import bpy
import pointmorph

from . import german
from .properties import CONTEXT, choice_label, setting_label, setting_tip, switch_label, switch_tip


def tell(text, **values):
    """A message in the user's language, with values put where their names stand in braces. Blender
    itself translates what is the same every time."""
    return bpy.app.translations.pgettext_tip(text).format(**values)


def put_tooltips(classes):
    """Gives operators tooltips without the line breaks of their docstrings."""
    for cls in classes:
        if issubclass(cls, bpy.types.Operator) and "bl_description" not in vars(cls):
            cls.bl_description = tooltip(cls)


def tooltip(cls):
    """What an operator says about itself, in one line."""
    return " ".join((inspect.getdoc(cls) or "").split())


def words():
    """All words that are translated, by language."""
    known = {**german.LABELS, **german.TIPS, **german.MESSAGES}
    for option in pointmorph.options():
        if option.name not in german.SETTINGS:  # of another version of the library
            continue
        label, tip = german.SETTINGS[option.name]
        known[setting_label(option)] = label
        known[setting_tip(option)] = _german_tip(option, tip)
        if option.default is None:
            known[switch_label(option)] = f"{label} setzen"
            known[switch_tip(option)] = f"Von Hand statt automatisch: {tip}"
        known.update((choice_label(choice), _german_choice(choice)) for choice in option.choices)
    return {"de_DE": known}


def _german_choice(choice):
    return german.CHOICES.get(choice, choice)


def _german_tip(option, tip):
    """As `properties.setting_tip` does in English."""
    parts = [tip]
    if option.kind != "choice":
        unit = f" {german.UNITS.get(option.unit, option.unit)}" if option.unit else ""
        parts.append(f"Von {option.minimum:g} bis {option.maximum:g}{unit}")
    default = "automatisch" if option.default is None else option.default
    parts.append(f"Standard: {_german_choice(default)}")
    return ". ".join(parts)


def _dictionary():
    """As Blender wants it: labels and tooltips have no context, names of operators have one, and so
    has what Blender itself would translate otherwise."""
    contexts = ("*", "Operator", CONTEXT)
    return {
        language: {(context, word): text for word, text in known.items() for context in contexts}
        for language, known in words().items()
    }


def register():
    bpy.app.translations.register(__name__, _dictionary())


def unregister():
    bpy.app.translations.unregister(__name__)
