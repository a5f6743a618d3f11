"""What shows a morph follows a mark, before the morph is computed."""

import threading
import time
from dataclasses import replace

import bpy
import numpy as np
import pytest
from scenes import attribute, coordinates, mark, morph, pair, row_at


@pytest.fixture
def live(addon, settings, remembering):
    """A morph, and what follows it; as after a click on Morph in a window."""
    settings.show_as = "MESH"
    pair(24, 22, domain="auto")
    for obj in (settings.source, settings.target):
        mark(obj, "corner", -0.6, -0.6)
        mark(obj, "side", -0.6, 0.5)
    addon("data.feature_list").sync_features(bpy.context.scene)
    background_job, recipes = addon("core.background_job"), addon("operators.polls")
    shown = morph()
    result = recipes.picked_result(bpy.context)
    request = request_of(addon)
    outcome = remembering(request, lambda stage, fraction: True)
    background_job.earlier = None
    background_job.remember(request, outcome)
    yield shown, result
    addon("core.live_follower").stop()
    background_job.earlier = None


def request_of(addon):
    """As *Morph* reads it: in the morph's frame."""
    recomputation, stepping = addon("scene.recomputation"), addon("core.stepping")
    settings = bpy.context.scene.pointmorph
    shapes, chosen = [settings.source, settings.target], recomputation.chosen_in(settings)
    plan = stepping.finish(recomputation.plan_of_steps(bpy.context, shapes, chosen))
    return plan.requests[0]


def ends(shown):
    return coordinates(shown.data.shape_keys.key_blocks["Morph"].points)


def wait_for(preview):
    """Until an answer is shown."""
    end = time.monotonic() + 60.0
    while not preview.show(bpy.data.objects):
        assert time.monotonic() < end
        time.sleep(0.01)


def wait_until(known):
    end = time.monotonic() + 60.0
    while not known():
        assert time.monotonic() < end
        time.sleep(0.01)


def begin(addon, result, name="corner", pending=None):
    scene = bpy.context.scene
    return addon("scene.live_preview").begin(bpy.data.objects, scene, result, name, pending)


def target_row(settings, x, y):
    return row_at(coordinates(settings.target.data.vertices), x, y)


def moved_features(addon, settings):
    request = addon("core.background_job").earlier.request
    row = target_row(settings, -0.4, -0.5)
    return {**request.features, "corner": (request.features["corner"][0], row)}


def test_the_mesh_follows_and_goes_back(addon, settings, live):
    shown, result = live
    live_follower = addon("core.live_follower")
    assert begin(addon, result, "nobody") is None
    assert live_follower.current is None  # nothing is prepared before there is something to follow
    before = ends(shown)
    preview = begin(addon, result)
    follower = live_follower.current
    target = coordinates(settings.target.data.vertices)
    source = row_at(coordinates(settings.source.data.vertices), -0.6, -0.6)
    wanted = row_at(target, -0.4, -0.5)
    preview.ask("corner", 1, wanted)
    wait_for(preview)
    assert follower.problem is None
    # Both objects lie where the other does: frames are the same but for the place.
    apart = settings.target.matrix_world.translation - settings.source.matrix_world.translation
    assert np.allclose(ends(shown)[source] - np.array(apart), target[wanted], atol=1e-4)
    assert np.abs(ends(shown) - before).max() < 1.0
    preview.ask("corner", 1, row_at(target, -0.6, -0.6))
    wait_for(preview)
    assert np.allclose(ends(shown), before, atol=1e-5)
    preview.put_back(bpy.data.objects)
    assert np.array_equal(ends(shown), before)


@pytest.mark.parametrize("kind", ["POINTS", "DISCS"])
def test_points_and_discs_follow_and_go_back(addon, settings, live, kind):
    shown, result = live
    bpy.ops.pointmorph.show_as(kind=kind)
    mesh, before = ends(shown), ends(result)
    preview = begin(addon, result)
    target = coordinates(settings.target.data.vertices)
    source = row_at(coordinates(settings.source.data.vertices), -0.6, -0.6)
    row = row_at(target, -0.4, -0.5)
    preview.ask("corner", 1, row)
    wait_for(preview)
    rows = attribute(result.data, "source_row")
    move = target[row] - target[target_row(settings, -0.6, -0.6)]
    np.testing.assert_allclose(
        (ends(result) - before)[rows == source],
        np.tile(move, ((rows == source).sum(), 1)),
        atol=1e-4,
    )
    moved = np.linalg.norm(ends(result) - before, axis=1)
    far = np.linalg.norm(before[:, :2] - before[rows == source][0, :2], axis=1) > 1.2
    assert moved[far].max() < 0.2 * np.linalg.norm(move)
    assert np.array_equal(ends(shown), mesh)  # it isn't seen
    preview.put_back(bpy.data.objects)
    assert np.array_equal(ends(result), before)
    bpy.ops.pointmorph.show_as(kind="MESH")
    assert begin(addon, result).name == shown.name


def test_the_next_morph_uses_what_was_made_to_follow(addon, settings, live):
    _, result = live
    live_follower, background_job = addon("core.live_follower"), addon("core.background_job")
    computation = addon("core.computation")
    preview = begin(addon, result)
    follower = live_follower.current
    wait_until(lambda: follower.live is not None)
    live_follower.lend()
    assert background_job.earlier.live is None  # nothing followed it yet
    preview.ask("corner", 1, target_row(settings, -0.5, -0.5))
    wait_for(preview)
    live_follower.lend()
    row = target_row(settings, -0.5, -0.5)
    addon("scene.feature_marks").mark(settings.target, "corner", [row])
    request = request_of(addon)
    assert background_job.earlier.live_for(request) is follower.live
    outcome = computation.compute(request, lambda stage, fraction: True, background_job.earlier)
    assert outcome.report["update"] == "updated"
    background_job.remember(request, outcome)
    assert background_job.earlier.live is follower.live
    live_follower.stop()
    assert live_follower.current is None

    # A map from scratch is another one, which it knows nothing of.
    scratch = replace(
        outcome, report={**outcome.report, "update": "Computed from scratch: it moved too far"}
    )
    background_job.remember(replace(request, features={}), scratch)
    assert background_job.earlier.live is None


def test_a_map_isnt_bent_for_what_else_has_changed(addon, settings, live):
    earlier = addon("core.background_job").earlier
    earlier.live = object()
    request = replace(earlier.request, features=moved_features(addon, settings))
    assert earlier.live_for(request) is earlier.live
    count = len(request.source.positions)
    for what, value in (
        ("normals", np.ones((count, 3), np.float32)),
        ("colors", np.ones((count, 4), np.float32)),
        ("radii", np.ones(count, np.float32)),
        ("boundary", [0, 1, 2]),
        ("name", "Another"),
    ):
        for side in ("source", "target"):
            other = replace(getattr(request, side), **{what: value})
            assert earlier.live_for(replace(request, **{side: other})) is None, (what, side)
    earlier.live = None


def test_other_objects_are_not_followed(addon, settings, live):
    shown, result = live
    earlier = addon("core.background_job").earlier
    assert begin(addon, None) is None
    earlier.request.settings["method"] = "paper"
    assert begin(addon, result) is None
    earlier.request.settings["method"] = "auto"
    settings.source.name = "Another"
    assert begin(addon, result) is None
    settings.source.name = earlier.request.source.name
    assert begin(addon, result) is not None

    # Nor is a mesh that shows something else, or for which other marks count now.
    points = shown.data.shape_keys.key_blocks["Morph"].points
    kept = points[3].co.copy()
    points[3].co.x += 0.1
    assert begin(addon, result) is None
    points[3].co = kept
    row = target_row(settings, -0.6, 0.5)
    addon("scene.feature_marks").mark(settings.target, "side", [row + 2])
    assert begin(addon, result) is None
    addon("scene.feature_marks").mark(settings.target, "side", [row])
    assert begin(addon, result) is not None
    settings.features["side"].use = False
    assert begin(addon, result) is None


def test_an_answer_is_for_the_drag_that_asked(addon, settings, live):
    shown, result = live
    live_follower = addon("core.live_follower")
    before = ends(shown)
    first = begin(addon, result)
    follower = live_follower.current
    first.ask("corner", 1, target_row(settings, -0.4, -0.5))
    wait_until(lambda: follower.updates and follower.waits)  # it lies there, and nobody took it
    second = begin(addon, result)
    assert live_follower.current is follower
    assert not second.show(bpy.data.objects)
    assert follower.answer() is None
    # Nor is one that was on its way.
    second.ask("corner", 1, target_row(settings, -0.4, -0.5))
    third = begin(addon, result)
    time.sleep(0.3)
    assert not third.show(bpy.data.objects)
    assert follower.answer() is None
    assert np.array_equal(ends(shown), before)


def test_what_was_computed_meanwhile_stays(addon, settings, live):
    shown, result = live
    preview = begin(addon, result)
    preview.ask("corner", 1, target_row(settings, -0.4, -0.5))
    wait_for(preview)
    points = shown.data.shape_keys.key_blocks["Morph"].points
    points[0].co.z += 0.5
    computed = ends(shown)
    preview.ask("corner", 1, target_row(settings, -0.5, -0.5))
    time.sleep(0.3)
    assert not preview.show(bpy.data.objects)
    preview.put_back(bpy.data.objects)
    assert np.array_equal(ends(shown), computed)


def test_a_drag_hides_the_source_and_goes_back(addon, settings, live):
    shown, _ = live
    dragging, markers = addon("operators.dragging"), addon("view.markers")
    target, source = settings.target, settings.source
    source.hide_set(False)
    target.hide_set(False)
    before = ends(shown)
    drag = dragging.Drag(bpy.context, target, "corner", (100, 100))
    assert drag.follows
    assert not drag.begins_at(bpy.context, 102, 101)
    assert not source.hide_get()
    assert drag.begins_at(bpy.context, 110, 101)
    assert source.hide_get()
    assert not drag.goes_elsewhere
    drag.move(target_row(settings, -0.6, -0.6))
    assert not drag.goes_elsewhere  # it is where it was
    row = target_row(settings, -0.4, -0.5)
    drag.move(row)
    assert drag.goes_elsewhere
    assert markers.dragged == ("Dune", "corner", row)
    wait_until(drag.show)
    wait_until(lambda: drag.show() or not addon("core.live_follower").current.waits)
    assert not np.array_equal(ends(shown), before)
    drag.end(keeps=False)
    assert np.array_equal(ends(shown), before)
    assert not source.hide_get()
    assert markers.dragged is None

    # A feature that the map doesn't know is dragged without it.
    mark(target, "new", 0.2, 0.2)
    drag = dragging.Drag(bpy.context, target, "new", (100, 100))
    assert not drag.follows
    drag.begins_at(bpy.context, 200, 100)
    drag.move(row)
    assert not drag.show()
    drag.end(keeps=True)
    assert markers.dragged is None


@pytest.mark.parametrize("gone", ["deleted", "without keys", "source unlinked"])
def test_a_drag_ends_whatever_has_gone(addon, settings, live, gone):
    shown, _ = live
    drag = addon("operators.dragging").Drag(bpy.context, settings.target, "corner", (100, 100))
    settings.source.hide_set(False)
    drag.begins_at(bpy.context, 200, 100)
    drag.move(target_row(settings, -0.4, -0.5))
    wait_until(drag.show)
    if gone == "deleted":
        bpy.data.objects.remove(shown)
    elif gone == "without keys":
        shown.shape_key_clear()
    else:
        for collection in list(settings.source.users_collection):
            collection.objects.unlink(settings.source)
    assert not drag.show()
    drag.end(keeps=False)
    assert addon("view.markers").dragged is None


def test_a_drag_is_overtaken_by_what_is_computed(addon, settings, live):
    dragging, background_job = addon("operators.dragging"), addon("core.background_job")

    def held():
        return dragging.Drag(bpy.context, settings.target, "corner", (100, 100))

    drag = held()
    assert not drag.is_overtaken
    job = background_job.start()
    try:
        assert drag.is_overtaken
        later = held()
        assert not later.is_overtaken
    finally:
        background_job.finish()
    assert not drag.is_overtaken
    assert job.cancelled
    assert not later.is_overtaken  # it was canceled and has changed nothing


@pytest.fixture
def dragged(addon, settings, live):
    """A mark that was let go elsewhere, and what is shown of it; what was before."""
    shown, result = live
    before = ends(shown)
    preview = begin(addon, result)
    row = target_row(settings, -0.4, -0.5)
    preview.ask("corner", 1, row)
    wait_for(preview)
    addon("scene.feature_marks").mark(settings.target, "corner", [row])
    return preview, before


def test_the_whole_morph_is_computed_once_it_can_be(addon, settings, live, dragged):
    shown, result = live
    preview, before = dragged
    background_job = addon("core.background_job")
    bpy.context.view_layer.objects.active = settings.source  # not what was previewed
    update = addon("operators.dragging").WholeUpdate()
    roughly = ends(shown)
    update.want(result.session_uid, preview)
    background_job.start()
    try:
        assert update.go_on() is None
        assert update.is_open
        assert np.array_equal(ends(shown), roughly)
    finally:
        background_job.finish()
    assert update.go_on() is None  # without a window, it is there at once
    assert not update.is_open
    assert not np.array_equal(ends(shown), roughly)
    assert not np.array_equal(ends(shown), before)


def test_what_is_shown_goes_back_where_nothing_comes_of_it(addon, settings, live, dragged):
    shown, result = live
    preview, before = dragged
    background_job = addon("core.background_job")
    update = addon("operators.dragging").WholeUpdate()
    update.want(result.session_uid, preview)
    update._is_due = False  # as if it ran
    update._job, update._earlier = background_job.start(), background_job.earlier
    update.interrupt()
    assert update._job.cancelled
    assert update.is_open
    background_job.finish()
    update.settle()
    assert update.is_open  # canceled for a drag: it is due again
    assert not np.array_equal(ends(shown), before)

    update._is_due = False
    update._job = background_job.start()
    background_job.finish()
    assert update.go_on() is None
    assert not update.is_open
    assert np.array_equal(ends(shown), before)


def test_where_it_cannot_be_computed_it_says_so(addon, settings, live, dragged):
    shown, _ = live
    preview, before = dragged
    update = addon("operators.dragging").WholeUpdate()
    update.want(-1, preview)  # it was deleted
    assert "wasn't updated" in update.go_on()
    assert np.array_equal(ends(shown), before)


def test_a_second_drag_goes_on_from_what_is_shown(addon, settings, live, dragged):
    shown, result = live
    first, before = dragged
    assert begin(addon, result, "side") is None
    second = begin(addon, result, "side", first)
    roughly = ends(shown)
    second.ask("side", 1, target_row(settings, -0.4, 0.5))
    wait_for(second)
    # Both marks are where they were put.
    target = coordinates(settings.target.data.vertices)
    apart = settings.target.matrix_world.translation - settings.source.matrix_world.translation
    own = coordinates(settings.source.data.vertices)
    for start, end in (((-0.6, -0.6), (-0.4, -0.5)), ((-0.6, 0.5), (-0.4, 0.5))):
        place = ends(shown)[row_at(own, *start)] - np.array(apart)
        assert np.allclose(place, target[row_at(target, *end)], atol=1e-4)
    kept = second.after(first)
    assert kept is second
    kept.lift(bpy.data.objects)
    assert np.array_equal(ends(shown), before)
    kept.lower(bpy.data.objects)
    assert not np.array_equal(ends(shown), roughly)
    kept.put_back(bpy.data.objects)
    assert np.array_equal(ends(shown), before)


def test_the_follower_ends_without_being_waited_for(addon, settings, live):
    _, result = live
    live_follower, background_job = addon("core.live_follower"), addon("core.background_job")
    preview = begin(addon, result)
    follower = live_follower.current
    preview.ask("corner", 1, target_row(settings, -0.4, -0.5))
    wait_for(preview)
    holds = threading.Event()
    follower.live = type("Slow", (), {"source_to_target": lambda *_: holds.wait(30.0)})()
    preview.ask("corner", 1, target_row(settings, -0.5, -0.5))
    live_follower.stop()
    assert live_follower.current is None
    assert background_job.earlier.live is follower.live
    holds.set()
    live_follower.end()
    assert not follower.runs
    assert background_job.earlier.live is None

    # Nothing of one file is followed in the next.
    preview.put_back(bpy.data.objects)
    begin(addon, result)
    assert live_follower.current is not None
    bpy.ops.wm.read_homefile(use_empty=True)
    assert live_follower.current is None
    assert background_job.earlier is None
