"""The mesh follows a mark, before the morph is computed."""

import time

import bpy
import numpy as np
import pytest
from scenes import coordinates, mark, morph, pair, row_at


@pytest.fixture
def live(addon, settings):
    """A morph, and what follows it; as after a click on Morph in a window."""
    settings.show_as = "MESH"
    pair(24, 22, domain="auto")
    for obj in (settings.source, settings.target):
        mark(obj, "corner", -0.6, -0.6)
        mark(obj, "side", -0.6, 0.5)
    addon("data.feature_list").sync_features(bpy.context.scene)
    background_job, computation = addon("core.background_job"), addon("core.computation")
    recipes = addon("operators.polls")
    shown = morph()
    result = recipes.picked_result(bpy.context)
    request = request_of(addon)
    outcome = computation.compute(request, lambda stage, fraction: True)
    background_job.earlier = None
    background_job.remember(request, outcome)
    yield shown, result
    addon("core.live_follower").stop()
    background_job.earlier = None


def request_of(addon):
    """As *Morph* reads it: in the morph's frame."""
    recomputation, stepping = addon("scene.recomputation"), addon("core.stepping")
    settings = bpy.context.scene.pointmorph
    plan = stepping.finish(
        recomputation.plan_of_steps(
            bpy.context,
            [settings.source, settings.target],
            addon("data.feature_list").feature_choices(settings),
            [],
            addon("core.settings").settings_values(settings),
        )
    )
    return plan.requests[0]


def ends(shown):
    return coordinates(shown.data.shape_keys.key_blocks["Morph"].points)


def wait_for(preview):
    """Until an answer is shown."""
    end = time.monotonic() + 60.0
    while not preview.show(bpy.data.objects):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_the_mesh_follows_and_goes_back(addon, settings, live):
    shown, result = live
    live_preview = addon("scene.live_preview")
    follower = live_preview.follower_of(bpy.context.scene, result)
    assert live_preview.can_follow(follower, "corner")
    assert not live_preview.can_follow(follower, "nobody")
    before = ends(shown)
    preview = live_preview.LivePreview(result, follower)
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


def test_the_next_morph_uses_what_was_made_to_follow(addon, settings, live):
    _, result = live
    live_follower, background_job = addon("core.live_follower"), addon("core.background_job")
    computation = addon("core.computation")
    follower = addon("scene.live_preview").follower_of(bpy.context.scene, result)
    follower.ask(follower.earlier.request.features)
    end = time.monotonic() + 60.0
    while follower.answer() is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    live_follower.lend()
    addon("scene.feature_marks").mark(
        settings.target,
        "corner",
        [row_at(coordinates(settings.target.data.vertices), -0.5, -0.5)],
    )
    request = request_of(addon)
    assert background_job.earlier.live_for(request) is follower.live
    outcome = computation.compute(request, lambda stage, fraction: True, background_job.earlier)
    assert outcome.report["update"] == "updated"
    background_job.remember(request, outcome)
    assert background_job.earlier.live is follower.live
    live_follower.stop()
    assert live_follower.current is None


def test_other_objects_are_not_followed(addon, settings, live):
    _, result = live
    follower_of = addon("scene.live_preview").follower_of
    assert follower_of(bpy.context.scene, None) is None
    addon("core.background_job").earlier.request.settings["method"] = "paper"
    assert follower_of(bpy.context.scene, result) is None
    addon("core.background_job").earlier.request.settings["method"] = "auto"
    settings.source.name = "Another"
    assert follower_of(bpy.context.scene, result) is None


def test_a_drag_hides_the_source_and_goes_back(addon, settings, live):
    shown, _ = live
    clicks, markers = addon("operators.clicks"), addon("view.markers")
    target, source = settings.target, settings.source
    source.hide_set(False)
    target.hide_set(False)
    before = ends(shown)
    drag = clicks._Drag(bpy.context, target, "corner", (100, 100))
    assert drag.follows
    assert not drag.begins_at(bpy.context, 102, 101)
    assert not source.hide_get()
    assert drag.begins_at(bpy.context, 110, 101)
    assert source.hide_get()
    row = row_at(coordinates(target.data.vertices), -0.4, -0.5)
    drag.move(row)
    assert markers.dragged == ("Dune", "corner", row)
    end = time.monotonic() + 60.0
    while not drag.show():
        assert time.monotonic() < end
        time.sleep(0.01)
    assert not np.array_equal(ends(shown), before)
    drag.end(keeps=False)
    assert np.array_equal(ends(shown), before)
    assert not source.hide_get()
    assert markers.dragged is None

    # A feature that the map doesn't know is dragged without it.
    mark(target, "new", 0.2, 0.2)
    drag = clicks._Drag(bpy.context, target, "new", (100, 100))
    assert not drag.follows
    drag.begins_at(bpy.context, 200, 100)
    drag.move(row)
    assert not drag.show()
    drag.end(keeps=True)
    assert markers.dragged is None
