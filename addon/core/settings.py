"""The library's settings as the panel shows them: labels, tooltips, and values back."""

import numpy as np
import pointmorph

_ACRONYMS = {"lod": "LOD", "mls": "MLS"}
_BLENDERS = {"up": "z"}  # options of the library that Blender decides


def by_hand(option):
    """Name of the switch of a setting that is automatic by default."""
    return f"use_{option.name}"


def name_label(name):
    """How the panel calls a setting or a choice."""
    words = (_ACRONYMS.get(word, word.capitalize()) for word in name.split("_"))
    return " ".join(words)


def setting_label(option):
    return name_label(option.name)


def switch_label(option):
    """Of a setting that is automatic by default."""
    return f"Set {setting_label(option)}"


def switch_tip(option):
    return f"Set this by hand instead of automatically: {option.help}"


def setting_tip(option):
    parts = [option.help.rstrip(".")]
    if option.kind != "choice":
        unit = f" {option.unit}" if option.unit else ""
        parts.append(f"From {option.minimum:g} to {option.maximum:g}{unit}")
    default = "automatic" if option.default is None else f"{option.default}"
    parts.append(f"Default: {default}")
    return ". ".join(parts)


def scene_options():
    """The library's options that a scene has. What staggers is chosen on the result."""
    return [
        option
        for option in pointmorph.options()
        if option.name not in _BLENDERS and not option.name.startswith("stagger")
    ]


def shown_options(settings, *affects):
    """The library's options that the panel shows: those that affect one of `affects` and that a
    morph with the panel's method and domain uses."""
    return [
        option
        for option in scene_options()
        if option.affects in affects and option.is_used(settings.method, settings.domain)
    ]


def changed_settings(before, now):
    """Names of the settings that differ, as far as they change which points belong together.

    Parameters
    ----------
    before, now : dict
        See `settings_values`. `before` may have names that an earlier version used.
    """
    options = {option.name: option for option in pointmorph.options()}
    names = sorted(
        name
        for name in {*before, *now}
        if name not in _BLENDERS and before.get(name) != now.get(name)
    )
    return [
        name
        for name in names
        if name not in options
        or (options[name].affects == "map" and options[name].is_used(now["method"], now["domain"]))
    ]


def settings_values(settings):
    """The settings as `pointmorph.morph` takes them, and what Blender decides; without those that
    are automatic."""
    values = dict(_BLENDERS)
    for option in scene_options():
        if option.default is None and not getattr(settings, by_hand(option)):
            continue
        value = getattr(settings, option.name)
        # Blender keeps float32: back to the decimals that the user typed, so that a setting means
        # the same here as on the command line.
        values[option.name] = float(str(np.float32(value))) if option.kind == "float" else value
    return values
