"""Marks that are dragged, and the morph that follows. Look at the pictures, too."""

import time

import pytest
from steps import MORPH, RUNNING, SIDE, VIEWPORT
from test_window import add_bare_pair, click_vertex, rows_of

FOLLOWER = "addon('core.live_follower').current"
SHOWN = "bpy.data.objects['Hill to Dune']"
PLACES = f"[round(v, 5) for p in {SHOWN}.data.shape_keys.key_blocks['Morph'].points for v in p.co]"
DRAGGED = "addon('view.markers').dragged"
UPDATE = "addon('operators.clicks')._waiting._update"


@pytest.fixture(name="side")
def make_side():
    """Few vertices suffice where nothing is measured."""
    return min(SIDE, 60) if SIDE == 90 else SIDE


def morph_with_marks(window, side):
    """A morph with a mark in each quarter, and the tool that marks by clicking; returns the row of
    the first mark on the target."""
    add_bare_pair(window, side)
    rows = {
        name: [
            int((0.3 + 0.4 * u) * count) * count + int((0.3 + 0.4 * v) * count)
            for u in (0, 1)
            for v in (0, 1)
        ]
        for name, count in (("Hill", side), ("Dune", side - 3))
    }
    window.run(
        f"""
for name, rows in {rows!r}.items():
    for number, row in enumerate(rows):
        scenes.add_group(bpy.data.objects[name], f"pm.mark {{number}}", {{row: 1.0}})
bpy.context.scene.pointmorph.domain = "auto"
bpy.context.scene.pointmorph.show_as = "MESH"
addon("data.feature_list").sync_features(bpy.context.scene)
bpy.ops.ed.undo_push(message="Marks")
"""
    )
    window.press_button(MORPH)
    window.wait(f"{SHOWN.replace('[', '.get(').replace(']', ')')} is not None and not ({RUNNING})")
    window.run(f"{SHOWN}.data.shape_keys.key_blocks['Morph'].value = 0.5")
    window.press_button("click_features")
    return rows["Dune"][0]


def hold(window, row):
    window._xdotool("mousemove", *window.ask(f"pixel('Dune', {row})"))
    window._xdotool("mousedown", 1)


def go(window, row, wanted, steps=8):
    """Moves what is held from a vertex of the target to another."""
    start, end = (window.ask(f"pixel('Dune', {r})") for r in (row, wanted))
    for step in range(1, steps + 1):
        at = (a + (b - a) * step // steps for a, b in zip(start, end, strict=True))
        window._xdotool("mousemove", *at)


def glide(window, row, wanted, steps):
    """The same in one go, as fast as a hand does it."""
    start, end = (window.ask(f"pixel('Dune', {r})") for r in (row, wanted))
    words = []
    for step in range(1, steps + 1):
        at = (a + (b - a) * step // steps for a, b in zip(start, end, strict=True))
        words += ["mousemove", *at, "sleep", 0.04]
    window._xdotool(*words)


def test_the_morph_follows_a_mark(window, side):
    row = morph_with_marks(window, side)
    assert window.ask(f"{FOLLOWER} is None")  # until a mark is taken hold of
    before, marked = window.ask(PLACES), rows_of(window)
    wanted = row + 6 * max(1, side // 60) * (side - 3 + 1)
    window.screenshot("drag_before")

    # Esc takes it all back.
    hold(window, row)
    go(window, row, wanted)
    window.wait(f"{FOLLOWER} is not None and {FOLLOWER}.updates and not {FOLLOWER}.waits")
    window.wait(f"{PLACES} != {before!r}")
    assert window.ask(DRAGGED)[:2] == ["Dune", "mark 0"]
    window.screenshot("drag_follows")
    window.press("Escape", over=window.ask(f"pixel('Dune', {wanted})"))
    window._xdotool("mouseup", 1)
    assert window.ask(PLACES) == before
    assert rows_of(window) == marked
    assert window.ask(f"{DRAGGED} is None and {FOLLOWER} is not None")

    # Let go, it is marked and computed.
    window.run(f"{FOLLOWER}.updates.clear()")
    hold(window, row)
    begun = time.monotonic()
    glide(window, row, wanted, steps=60)
    seconds = time.monotonic() - begun
    window.wait(f"{FOLLOWER}.updates and not {FOLLOWER}.waits")
    count = window.ask(f"len({FOLLOWER}.updates)")
    taken = sorted(window.ask(f"[u[1] for u in {FOLLOWER}.updates]"))
    print(
        f"{side**2} vertices: {count} updates in {seconds:.1f} s; median {taken[count // 2]:.3f} s"
    )
    window._xdotool("mouseup", 1)
    released = time.monotonic()
    moved = rows_of(window)
    at = moved["Dune", "pm.mark 0"]
    assert at != marked["Dune", "pm.mark 0"]
    assert {key: rows for key, rows in moved.items() if rows != marked[key]} == {
        ("Dune", "pm.mark 0"): at
    }
    window.wait(f"not ({RUNNING})")
    print(f"computed {time.monotonic() - released:.1f} s after it was let go")
    window.run("import json")
    points = "[o for o in bpy.data.objects if o.pointmorph.mesh is not None][0]"
    assert window.ask(f"json.loads({points}.pointmorph.report)['update']") == "updated"
    assert window.ask(PLACES) != before
    window.screenshot("drag_computed")

    # Each is an undo step of its own: the morph, and the mark.
    window.press("ctrl+z", over=VIEWPORT)
    assert rows_of(window)["Dune", "pm.mark 0"] == at
    window.press("ctrl+z", over=VIEWPORT)
    assert rows_of(window) == marked
    assert window.ask(PLACES) == before
    window.press("Escape", over=VIEWPORT)
    assert window.ask(f"{FOLLOWER} is None")


def test_a_mark_without_a_morph_is_dragged_too(window):
    add_bare_pair(window, 20)
    window.press_button("click_features")
    click_vertex(window, "Hill", 105)
    click_vertex(window, "Dune", 88)
    hold(window, 88)
    go(window, 88, 139)
    window._xdotool("mouseup", 1)
    assert rows_of(window) == {
        ("Hill", "pm.feature 1"): [105],
        ("Dune", "pm.feature 1"): [139],
    }
    window.press("ctrl+z", over=VIEWPORT)
    assert rows_of(window)["Dune", "pm.feature 1"] == [88]

    # A click on a mark leaves it where it is.
    click_vertex(window, "Dune", 88)
    assert rows_of(window)["Dune", "pm.feature 1"] == [88]
    window.press("Escape", over=VIEWPORT)


def test_a_drag_while_the_last_is_computed(window, side):
    row = morph_with_marks(window, side)
    step = max(1, side // 60) * (side - 3 + 1)
    hold(window, row)
    go(window, row, row + 6 * step)
    window.wait(f"{FOLLOWER} is not None and {FOLLOWER}.updates and not {FOLLOWER}.waits")
    window._xdotool("mouseup", 1)
    (at,) = rows_of(window)["Dune", "pm.mark 0"]
    assert at != row

    # Taken back, the one before is computed after all.
    hold(window, at)
    go(window, at, row + 3 * step)
    window.press("Escape", over=window.ask(f"pixel('Dune', {row + 3 * step})"))
    window._xdotool("mouseup", 1)
    asked = "addon('core.background_job').earlier.request.features['mark 0'][1]"
    window.wait(f"not ({RUNNING}) and not {UPDATE}.is_open and {asked} == {at}")
    assert rows_of(window)["Dune", "pm.mark 0"] == [at]
    computed = window.ask(PLACES)

    # On the vertex where it was, nothing happens.
    hold(window, at)
    go(window, at, row + 3 * step)
    go(window, row + 3 * step, at)
    window.wait(f"not {FOLLOWER}.waits")
    window._xdotool("mouseup", 1)
    window.wait(f"{DRAGGED} is None")
    assert not window.ask(f"{UPDATE}.is_open")
    assert window.ask(PLACES) == computed

    # Without the add-on's operator, nothing is left of it.
    hold(window, at)
    go(window, at, row + 3 * step)
    window.wait(f"{PLACES} != {computed!r}")
    window.run("addon('operators.clicks').registration.stop()")
    window._xdotool("mouseup", 1)
    assert window.ask(PLACES) == computed
    assert window.ask(f"{FOLLOWER} is None and {DRAGGED} is None")
    assert window.ask("addon('core.background_job').earlier.live is None")


def test_a_click_beside_a_mark_completes_a_feature(window):
    add_bare_pair(window, 90)
    window.press_button("click_features")
    click_vertex(window, "Hill", 4040)
    click_vertex(window, "Dune", 3800)
    click_vertex(window, "Hill", 2020)
    there, beside = (window.ask(f"pixel('Dune', {row})") for row in (3800, 3801))
    assert 0 < max(abs(a - b) for a, b in zip(there, beside, strict=True)) < 8
    click_vertex(window, "Dune", 3801)
    assert rows_of(window)["Dune", "pm.feature 2"] == [3801]
    assert rows_of(window)["Dune", "pm.feature 1"] == [3800]
    # With all marked on both, a click there takes hold of the mark, and leaves it.
    click_vertex(window, "Dune", 3801)
    assert len(rows_of(window)) == 4
    window.press("Escape", over=VIEWPORT)
