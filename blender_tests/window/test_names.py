"""Names in the sidebar."""

import subprocess

import numpy as np
from steps import DONE, MORPH, add_pair

LETTERS = 14


def test_names_are_shown_in_full_at_the_sidebars_own_width(window):
    """Whichever letter of them becomes another of the same width, it is seen in the same rows."""
    add_pair(window, 14)
    window.press_button(MORPH)
    window.wait(DONE)
    window.run("result = bpy.context.object")
    window.leave_sidebar()
    plain = sidebar(window, -1)
    rows = changed(plain, sidebar(window, 0))
    assert len(rows) >= 4  # of source, target, result and feature, and of what has changed
    for letter in (3, 6, 7, 10, LETTERS - 1):
        seen = changed(plain, sidebar(window, letter))
        assert len(seen) == len(rows), letter
        assert np.abs(np.subtract(seen, rows)).max() < 6, letter


def sidebar(window, letter):
    """The sidebar's gray values where one letter of all names is another than the rest."""
    name = "".join("u" if k == letter else "n" for k in range(LETTERS))
    window.run(
        f"""
settings = bpy.context.scene.pointmorph
for obj, first in ((settings.source, "S"), (settings.target, "T"), (result, "R")):
    obj.name = first + {name!r}
settings.features[0].name = {name!r}
"""
    )
    window.redraw()
    window.wait(
        "addon('view.staleness_watch').known_state(result) is not None"
    )  # and not "Checking"
    left, top, right, bottom = window.sidebar()
    size = f"{right - left}x{bottom - top}+{left}+{top}"
    path = window.screenshot(f"names_{letter}")
    program = ("convert", str(path), "-crop", size, "-depth", "8", "gray:-")
    pixels = subprocess.run(program, capture_output=True, check=True).stdout
    return np.frombuffer(pixels, np.uint8).reshape(bottom - top, -1).astype(int)


def changed(before, after):
    """The rows of text that differ, by the middle of each."""
    lines = np.flatnonzero((np.abs(after - before) > 30).any(axis=1))
    rows = np.split(lines, np.flatnonzero(np.diff(lines) > 6) + 1)
    return [row.mean() for row in rows if row.size]
