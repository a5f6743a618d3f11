"""What the panel knows about the state of a morph object without looking it up at every redraw.

To compare large shapes takes a second, so it waits until nothing has changed for a moment, and is
done once, in many short steps between which Blender goes on.
"""

import time

import bpy

from ..core.stepping import go_on
from ..data import areas
from ..data.registration import Registration, on_other_states, stop_timer
from ..scene import morph_object, recipes, staleness

_PAUSE = 0.6  # seconds
_STEP = 0.02  # seconds of work at a time
_prints = {}  # by name of an object; of those that a panel has shown
_wanted = set()
_begun = None  # the name that is being looked at, and the steps that are left
_changed_at = 0.0


def known_state(obj):
    """What `states.state` says, as far as known; the rest is looked up soon. None for not yet."""
    if obj.name not in _prints:
        _want(obj.name)
        return None
    prints = _prints[obj.name]
    shapes = recipes.shapes_of(obj)
    if None not in shapes and [shape.name for shape in shapes] != [p["name"] for p in prints or ()]:
        _want(obj.name)
        return None
    return staleness.state(obj, prints)


def _want(name):
    _wanted.add(name)
    if not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=0.05)


def _look():
    """Called by a timer; returns after how long to be called again."""
    global _begun
    left = _changed_at + _PAUSE - time.monotonic()
    if left > 0:
        return left
    if _begun is None and _wanted:
        name = _wanted.pop()
        obj = bpy.data.objects.get(name)
        if obj is not None and morph_object.is_made(obj):
            _begun = name, staleness.fingerprints_steps(obj)
    if _begun is not None:
        name, steps = _begun
        try:
            go_on(steps, _STEP)
        except StopIteration as done:
            _prints[name] = done.value
            _begun = None
        except ReferenceError:  # removed meanwhile; who shows it asks again
            _begun = None
    if _begun is not None or _wanted:
        return 0.0
    areas.redraw_viewports()
    return None


def _note_changes(scene, depsgraph):
    global _begun, _changed_at
    if not _prints and _begun is None:
        return
    changed = {
        item.id.original
        for item in depsgraph.updates
        if item.is_updated_geometry
        or item.is_updated_transform
        or isinstance(item.id, bpy.types.Material)  # also for its nodes and images
    }
    if _begun is not None and changed:
        _wanted.add(_begun[0])
        _begun = None
        _changed_at = time.monotonic()
    for name in list(_prints):
        obj = bpy.data.objects.get(name)
        if obj is None or not changed.isdisjoint(_seen_on(obj)):
            del _prints[name]
            _changed_at = time.monotonic()


def _seen_on(obj):
    """What a morph object was made from: objects, their data and materials."""
    shapes = [shape for shape in recipes.pointers_of(obj) if shape is not None]
    materials = (slot.material for shape in shapes for slot in shape.material_slots)
    return [*shapes, *(shape.data for shape in shapes), *materials]


def _forget(*_):
    global _begun
    _prints.clear()
    _wanted.clear()
    _begun = None


def _stop():
    stop_timer(_look)
    _forget()


registration = Registration(
    stop=_stop,
    handlers=(
        ("depsgraph_update_post", _note_changes),
        *on_other_states(_forget),
    ),
)
