"""Morphs one sampled shape into another, in Blender. The work is done by the library `pointmorph`,
which the extension brings as a wheel.
"""

from .core import library

library.check()  # before what imports it, so that a user is told what is wrong

from .data import properties, registration
from .operators import (
    bakes,
    chains,
    clicks,
    collections,
    commands,
    demo_scene,
    features,
    keying,
    loop,
    made_objects,
    manual,
    mirroring,
    modal_operator,
    morph,
    objects,
    quality,
    recompute,
    textures,
)
from .scene import cache_files, left_copies, marked_points, object_properties
from .ui import handlers, panels, quality_panel, result_panel, stagger_panel
from .view import cut_curves, markers, staleness_watch

# In this order: the others use the properties, and a running job is stopped first.
_registrations = [
    module.registration
    for module in (
        modal_operator,
        properties,
        object_properties,
        marked_points,
        cache_files,
        left_copies,
        markers,
        cut_curves,
        staleness_watch,
        objects,
        features,
        mirroring,
        clicks,
        loop,
        morph,
        quality,
        bakes,
        collections,
        commands,
        made_objects,
        recompute,
        textures,
        keying,
        chains,
        demo_scene,
        manual,
        panels,
        result_panel,
        quality_panel,
        stagger_panel,
        handlers,
    )
]


def register():
    registration.register(_registrations)


def unregister():
    registration.unregister(_registrations)
