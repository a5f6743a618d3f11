"""The features that are marked on the picked objects, and the panel's list of them."""

import colorsys
from dataclasses import fields

import numpy as np

from ..core import background_job
from ..core.features import PREFIX, Choice
from .arrays import SHAPE_TYPES


def feature_names(obj):
    """Names, without the prefix, of the features that are marked on an object or None."""
    if obj is None or obj.type not in SHAPE_TYPES:
        return []
    return [item.name[len(PREFIX) :] for item in named(obj) if item.name.startswith(PREFIX)]


def named(obj):
    """What marks features by its name: vertex groups, or the attributes of a point cloud."""
    return obj.vertex_groups if obj.type == "MESH" else obj.data.attributes


def feature_groups(obj):
    """By index, the vertex groups of a mesh that mark features: names without the prefix."""
    return {
        group.index: group.name[len(PREFIX) :]
        for group in obj.vertex_groups
        if group.name.startswith(PREFIX)
    }


def sync_features(scene):
    """Makes the list of features say what is marked on source and target; order is kept.

    What went wrong before something was marked or unmarked is forgotten.
    """
    settings = scene.pointmorph
    before = _standing(settings.features)
    on_source = feature_names(settings.source)
    on_target = feature_names(settings.target)
    names = list(dict.fromkeys(on_source + on_target))
    features = settings.features
    for index in reversed(range(len(features))):
        if features[index].marked_name not in names:
            _set_aside(settings, features[index])
            features.remove(index)
    listed = {feature.marked_name for feature in features}
    for name in names:
        if name not in listed:
            added = features.add()
            added.marked_name = added.name = name  # by which what is chosen is stored
            _take_back(settings, added, name)
    for feature in features:  # only now: one that is added may move the others in memory
        name = feature.marked_name
        _set(feature, "name", name)
        _set(feature, "on_source", name in on_source)
        _set(feature, "on_target", name in on_target)
    if _standing(features) != before:
        background_job.problem = None


CHOSEN = [field.name for field in fields(Choice)]
"""What a user chooses for a feature."""


def keep_choice(feature):
    """Stores with the objects that have a feature what was chosen for it: it goes along when they
    are appended, or picked in another scene."""
    settings = feature.id_data.pointmorph
    name = feature.marked_name
    for obj in (settings.source, settings.target):
        if not _can_keep(obj) or name not in feature_names(obj):
            continue
        choices = obj.pointmorph.choices
        kept = choices.get(name)
        if kept is None:
            kept = choices.add()
            kept.name = name
        for chosen in CHOSEN:
            _set(kept, chosen, getattr(feature, chosen))


def _can_keep(obj):
    """Whether something can be stored with an object; library overrides have no lists of their
    own."""
    return obj is not None and obj.is_editable and obj.override_library is None


def rename_choice(obj, old, new):
    """Has what is stored for a feature follow its name."""
    if not _can_keep(obj):
        return
    drop_choice(obj, new)
    kept = obj.pointmorph.choices.get(old)
    if kept is not None:
        kept.name = new


def drop_choice(obj, name):
    """Forgets what is stored for a feature."""
    if _can_keep(obj):
        index = obj.pointmorph.choices.find(name)
        if index >= 0:
            obj.pointmorph.choices.remove(index)


def _set_aside(settings, feature):
    """Keeps what was chosen for a feature until an object that has it is picked again."""
    forget_choice(settings, feature.marked_name)
    if any(feature.is_property_set(name) for name in CHOSEN):
        kept = settings.set_aside.add()
        kept.name = feature.marked_name
        for name in CHOSEN:
            _set(kept, name, getattr(feature, name))


def _take_back(settings, feature, name):
    kept = settings.set_aside.get(name)
    for obj in (settings.source, settings.target):
        if kept is None and obj is not None and name in feature_names(obj):
            kept = obj.pointmorph.choices.get(name)
    if kept is not None:
        # All at once: what is set is stored with the objects, in what is read here.
        for chosen, value in [(chosen, getattr(kept, chosen)) for chosen in CHOSEN]:
            _set(feature, chosen, value)
        forget_choice(settings, name)


def forget_choice(settings, name):
    """Forgets what was chosen for a feature that is listed no longer."""
    index = settings.set_aside.find(name)
    if index >= 0:
        settings.set_aside.remove(index)


def _standing(features):
    return [(feature.marked_name, feature.on_source, feature.on_target) for feature in features]


def _set(item, key, value):
    # A write, even of the same value, makes Blender evaluate the scene again.
    if getattr(item, key) != value:
        setattr(item, key, value)


def color_of(number):
    """(3,) sRGB of the feature that stands at this place of the list; neighbors differ."""
    return colorsys.hsv_to_rgb((0.02 + number * 0.381966) % 1.0, 0.75, 1.0)


def feature_choices(settings):
    """By name, what the user wants features to be."""
    return {
        item.marked_name: Choice(
            item.kind, item.hold, float(str(np.float32(item.weight))), item.use
        )
        for item in settings.features
    }


def set_loop(settings, names):
    """Makes the loop pass these features, in order."""
    settings.loop.clear()
    for name in names:
        settings.loop.add().name = name
    settings.active_loop = 0
