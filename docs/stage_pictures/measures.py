"""Pictures of the stages that measure a morph."""

from __future__ import annotations

import textwrap

import numpy as np
import numpy.typing as npt
import pointmorph
import pointmorph.meshes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from pointmorph import _pointmorph
from scipy.spatial import cKDTree

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
from stage_pictures.shapes import STANDING, WALKING, Animals, Array, Rows, bowls, rotation, unit


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


def open_edges(rest: Array, places: Array) -> tuple[Rows, npt.NDArray[np.bool_]]:
    """Edges to the six nearest, and which are open in a frame; see the page."""
    near = _pointmorph.nearest_neighbors(rest, 6)
    edges = np.stack([np.repeat(np.arange(len(rest)), 6), near.ravel()], axis=1)
    lengths = np.linalg.norm(rest[near[:, 5]] - rest, axis=1) * np.sqrt(np.pi / 6)
    middles = places[edges].mean(axis=1)
    return edges, cKDTree(places).query(middles)[0] > 2 * lengths[edges].mean(axis=1)


@picture
def cracks() -> Figure:
    """A bowl that breaks in two."""
    source, target, normals = bowls()
    radii = np.full(len(source), 0.04)
    clouds = [pointmorph.Cloud(p, normals, radii=radii) for p in (source, target)]
    pairs = np.repeat(np.arange(len(source))[:, None], 2, axis=1)
    morph = pointmorph.restore(*clouds, pairs, (target, source))
    times = (0.25, 0.5, 0.75)
    shares = list(morph.cracks(times).values())
    titles = [f"t = {t:g}: {100 * s:.1f} % open" for t, s in zip(times, shares, strict=True)]
    panels = figure(3, 240, titles)
    look = rotation(0, -0.7)
    for axes, t, share in zip(panels, times, shares, strict=True):
        places = np.asarray(morph.frame(t).positions, float)
        edges, is_open = open_edges(source, places)
        assert abs(is_open.mean() - share) < 0.002
        seen = places @ look
        for some, color, width in ((~is_open, BLUE, 0.5), (is_open, RED, 1.0)):
            lines = seen[edges[some]][:, :, :2]
            axes.add_collection(LineCollection(lines, colors=color, linewidths=width))
        dots(axes, seen, INK, 1.6, linewidths=0)
        fit(axes, target @ look, 0.02)
    return page_of(panels)


@picture
def mesh_quality() -> Figure:
    animals = Animals(4)
    right = animals.ends(*STANDING)
    swapped = {**right, "left fore": (right["left fore"][0], right["right fore"][1])}
    swapped["right fore"] = (right["right fore"][0], right["left fore"][1])
    clouds = (
        pointmorph.Cloud(animals.source, faces=animals.source_triangles, name="the source"),
        pointmorph.Cloud(animals.target, faces=animals.target_triangles, name="the target"),
    )
    found = [pointmorph.morph(*clouds, features) for features in (right, swapped)]
    words = [textwrap.fill(morph.mesh_quality.verdict, 60) for morph in found]
    panels = figure(2, 400, words)
    blue = rgb(BLUE) * 0.6 + 0.4
    for axes, morph in zip(panels, found, strict=True):
        wrapped = np.asarray(morph.wrapped(1.0)) @ FRONT
        surface(axes, wrapped, animals.source_triangles, blue, edges=0.3)
        for place in morph.mesh_quality.worst:
            at = np.array([place.position]) @ FRONT
            dots(axes, at, YELLOW, 9, edgecolors=INK)
            axes.annotate(
                place.flaw, at[0, :2], (-9, 0), textcoords="offset points", color=INK, fontsize=10,
                ha="right", va="center", bbox={"fc": "white", "ec": INK, "pad": 2}, zorder=6,
            )  # fmt: skip
        fit(axes, animals.target @ FRONT, 0.14)
    return page_of(panels)
