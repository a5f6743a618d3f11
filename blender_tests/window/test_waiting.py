"""What a person sees while a morph is computed; figures of the wait, in the output folder."""

import json

import pytest
from steps import DONE, MORPH, SIDE, add_pair

# Times what the add-on does between redraws, and the gaps between turns of Blender's main loop.
STOPWATCH = """
import sys, time
ours, gaps = {}, []

def timed(owner, name, what):
    before = getattr(owner, name)
    def call(*arguments, **keywords):
        start = time.perf_counter()
        try:
            return before(*arguments, **keywords)
        finally:
            ours.setdefault(what, []).append(time.perf_counter() - start)
    setattr(owner, name, call)
    undo.append(lambda: setattr(owner, name, before))

undo, last = [], []
morph = addon("operators.morph").POINTMORPH_OT_morph
timed(addon("operators.modal_operator").Computing, "_read_on", "reading the scene, a turn")
timed(morph, "_meanwhile", "showing the coarse morph")
timed(morph, "_leave", "taking the coarse morph away")
timed(morph, "_finish", "making the result")
timed(addon("scene.marked_points"), "marks_of", "looking up marks")

def beat():
    now = time.perf_counter()
    gaps.extend(now - before for before in last)
    last[:] = [now]
    return 0.005 if undo else None

bpy.app.timers.register(beat)
"""


@pytest.mark.computes
def test_a_coarse_morph_shows_first_and_leaves_nothing(window, output):
    """Drawing many points without a graphics card takes seconds, so they are hidden."""
    window.run("area.spaces[0].show_object_viewport_mesh = False")
    window.run("area.spaces[0].show_object_viewport_pointcloud = False")
    add_pair(window, SIDE)
    window.run("preview = addon('core.preview'); large, preview.LARGE = preview.LARGE, 1000")
    place = window.find(MORPH)
    window.run(STOPWATCH)
    window.run("started = time.perf_counter(); first = None")
    window.run(
        """
def look():
    global first
    if any(obj.pointmorph.is_preview for obj in bpy.data.objects):
        first = time.perf_counter() - started
        return None
    return 0.01 if undo else None
bpy.app.timers.register(look)
"""
    )
    window.click(place)
    window.run("clicked = time.perf_counter() - started")
    window.wait(DONE)
    window.redraw()
    figures = window.run(
        """
while undo: undo.pop()()
answer = {
    "seconds": time.perf_counter() - started,
    "coarse morph after seconds": first,
    "longest gap between turns, ms": 1000 * max(gaps),
    "gaps over 100 ms": [round(1000 * g) for g in gaps if g > 0.1],
    "longest of the add-on's own, ms": {k: round(1000 * max(v), 1) for k, v in ours.items()},
}
"""
    )
    window.run("preview.LARGE = large")
    (output / "waiting.json").write_text(json.dumps(figures, indent=2))
    print(json.dumps(figures, indent=2))
    assert 0 < figures["coarse morph after seconds"] < figures["seconds"]
    assert not window.ask("[o.name for o in bpy.data.objects if o.pointmorph.is_preview]")
