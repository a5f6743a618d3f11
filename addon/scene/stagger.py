"""How a morph is staggered: chosen on the mesh that shows it, and followed by its points."""

from dataclasses import dataclass, replace

import bpy
import numpy as np
import pointmorph

from ..data import arrays, attribute_names, nodes, versions
from . import morph_object, path_display, stagger_nodes

# Drivers can have no objects and no words.
_DRIVEN = (
    path_display.CURVE,
    stagger_nodes.STAGGER,
    *stagger_nodes.COMMON,
    "Size",
    "Seed",
)
_COPIED = ("Object", stagger_nodes.GROUP_NAME, "Direction")


@dataclass(frozen=True)
class Timing:
    """When each point goes: see `core.path_stages.local_times`."""

    delays: np.ndarray
    overlap: float
    falloff: float

    def by_row(self, rows):
        """Of the points whose pairs these are."""
        return replace(self, delays=arrays.by_row(rows, self.delays))


def timing_of(context, points):
    """The timing of the pairs of a morph object in the present frame; None where all go together.

    The delays are what the nodes make of them, on a copy that is there for a moment.

    Raises
    ------
    CloudError
        When the points don't go as the mesh does that shows them.
    """
    share(points)
    leading = modifier_of(morph_object.shown_of(points))
    if leading is None or kind_of(leading) == stagger_nodes.OFF:
        return None
    own = modifier_of(points)
    if own is None:
        raise _not_staggered(points)
    overlap, falloff = (versions.input_value(leading, name) for name in ("Overlap", "Falloff"))
    copy = points.copy()
    try:
        context.scene.collection.objects.link(copy)
        for modifier in [m for m in copy.modifiers if m.name != own.name]:
            copy.modifiers.remove(modifier)
        copy.hide_viewport = False
        depsgraph = context.evaluated_depsgraph_get()
        depsgraph.update()
        mesh = copy.evaluated_get(depsgraph).data
        known = mesh.attributes.get(attribute_names.DELAY)
        if known is None:
            raise _not_staggered(points)
        delays = arrays.read_attribute(known)
    finally:
        bpy.data.objects.remove(copy)
    return Timing(np.clip(delays, 0.0, 1.0), overlap, falloff)


def _not_staggered(points):
    return pointmorph.CloudError(
        points.name,
        "points that are staggered like the mesh that shows them",
        "points from an earlier version, or with a changed Path modifier",
        "Recompute the morph, or turn Stagger off.",
    )


def modifier_of(obj):
    """The modifier that staggers a morph object; None where an earlier version made it."""
    return path_display.modifier_of(obj)


def kind_of(modifier):
    """What staggers: one of `stagger_nodes.KINDS`."""
    return versions.choice_of(modifier, stagger_nodes.STAGGER, stagger_nodes.KINDS)


def choose(obj, kind, **values):
    """Staggers a morph object in a way of `stagger_nodes.KINDS`; `values` are inputs of it."""
    modifier = modifier_of(obj)
    versions.set_choice(modifier, stagger_nodes.STAGGER, stagger_nodes.KINDS, kind)
    for name, value in values.items():
        versions.set_input(modifier, name, value)
    obj.update_tag()


def follow(points, mesh):
    """Makes the points of a morph do what the mesh does that shows it."""
    own, leading = modifier_of(points), modifier_of(mesh)
    if own is None or leading is None:
        return
    for name in _DRIVEN:
        nodes.follow_input(points, own, name, mesh, leading)
    share(points)


def share(points):
    """Gives the points of a morph what drivers can't, where it has changed."""
    mesh = morph_object.shown_of(points)
    own, leading = modifier_of(points), modifier_of(mesh)
    if mesh == points or own is None or leading is None or not points.is_editable:
        return
    by_group = kind_of(leading) == stagger_nodes.GROUP
    wanted = {name: versions.input_value(leading, name) for name in _COPIED}
    wanted[stagger_nodes.WEIGHTS_FROM] = mesh if by_group else None
    changed = {k: v for k, v in wanted.items() if _differs(versions.input_value(own, k), v)}
    for name, value in changed.items():
        versions.set_input(own, name, value)
    if changed:
        points.update_tag()


def share_changes(scene, depsgraph):
    """Does so for all morphs whose mesh has changed just now."""
    for update in depsgraph.updates:
        obj = update.id.original
        points = getattr(obj, "pointmorph", None) and getattr(obj.pointmorph, "made_from", None)
        if points is not None and points.pointmorph.mesh == obj:
            share(points)


def _differs(one, other):
    if isinstance(one, str | None) or isinstance(other, str | None) or hasattr(one, "name"):
        return one != other
    return tuple(one) != tuple(other)
