"""Pictures of the stages that measure a morph."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.figure import Figure

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    INK,
    ORANGE,
    PALE,
    RED,
    YELLOW,
    dots,
    figure,
    fit,
    page_of,
    picture,
    rgb,
    surface,
)
from stage_pictures.shapes import STANDING, WALKING, Animals, Array, unit


def reddened(distortion: Array) -> Array:
    bad = np.clip(np.floor(5 * distortion.reshape(-1, 1)) / 10, 0, 1)
    return (1 - bad) * rgb("#e3e7eb") + bad * rgb(RED)


@picture
def quality() -> Figure:
    animals = Animals()
    wrong = animals.ends("head", "left fore", "right fore", "left hind", "right hind")
    wrong["left fore"], wrong["right fore"] = (
        (wrong["left fore"][0], wrong["right fore"][1]),
        (wrong["right fore"][0], wrong["left fore"][1]),
    )
    right = animals.ends(*STANDING)
    panels = figure(2, 340, ("all marks right", "left and right exchanged at the fore feet"))
    for axes, features in zip(panels, (right, wrong), strict=True):
        found = pointmorph.morph(*animals.clouds(), features).quality
        seen = animals.source @ FRONT
        surface(axes, seen, animals.source_triangles, found.source.distortion, reddened)
        dots(axes, seen[[place.source for place in found.worst]], YELLOW, 8, edgecolors=INK)
        fit(axes, seen, 0.08)
    return page_of(panels)


# Of points whose right place is known, stated doubt and the share that is wrong; see the page.
STATED = (0.014, 0.034, 0.071, 0.140, 0.264, 0.419, 0.592, 0.828)


WRONG = (0.015, 0.026, 0.060, 0.134, 0.321, 0.495, 0.615, 0.719)


SHARE = (0.164, 0.309, 0.239, 0.143, 0.072, 0.030, 0.023, 0.020)


@picture
def local_confidence() -> Figure:
    animals = Animals()
    whole = animals.target_directions @ unit(np.array(WALKING["left fore"][0])) < 0.93
    renumbered = np.cumsum(whole) - 1
    kept = animals.target_triangles[whole[animals.target_triangles].all(axis=1)]
    target = animals.target[whole]
    morph = pointmorph.morph(pointmorph.Cloud(animals.source), pointmorph.Cloud(target))
    found = morph.measure_confidence()
    panels = figure(3, 290, ("sure (white) and in doubt (red)", "a leg is missing", ""))
    seen = animals.source @ FRONT
    surface(panels[0], seen, animals.source_triangles, found.source, doubtful)
    dots(panels[0], seen[[place.source for place in found.doubtful]], YELLOW, 8, edgecolors=INK)
    fit(panels[0], seen, 0.08)
    surface(panels[1], target @ FRONT, renumbered[kept], rgb(ORANGE) * 0.8 + 0.2)
    fit(panels[1], target @ FRONT, 0.08)
    chart = panels[2]
    chart.set_axis_on()
    chart.set_position((0.74, 0.2, 0.24, 0.72))
    chart.plot((0, 1), (0, 1), color=PALE, lw=1.2)
    chart.plot(STATED, WRONG, color=BLUE, lw=1.2)
    chart.scatter(STATED, WRONG, s=[600 * share for share in SHARE], color=BLUE, zorder=3)
    chart.set(xlim=(0, 1), ylim=(0, 1), xticks=(0, 0.5, 1), yticks=(0, 0.5, 1), aspect="equal")
    for side in ("top", "right"):
        chart.spines[side].set_visible(False)
    chart.set_xlabel("stated doubt", color=INK)
    chart.set_ylabel("share that is wrong", color=INK)
    return page_of(panels)


def doubtful(confidence: Array) -> Array:
    """White where it is sure, red where it isn't."""
    return reddened(2.0 * (1.0 - np.asarray(confidence, float)))
