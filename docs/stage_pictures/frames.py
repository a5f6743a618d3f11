"""Pictures of the stages of in-between clouds."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.figure import Figure

from stage_pictures.drawing import (
    BLUE,
    FRONT,
    INK,
    LIGHT,
    ORANGE,
    along,
    dots,
    figure,
    fit,
    page_of,
    picture,
    rgb,
    share_of,
    surface,
)
from stage_pictures.shapes import STANDING, Animals, Array, bar, bowls, rotation, unit


@picture
def path() -> Figure:
    animals = Animals()
    source, target = animals.clouds()
    morph = pointmorph.morph(source, target, animals.ends(*STANDING))
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 190, [f"t = {t:g}" for t in times])
    colors = along(share_of(animals.source[morph.pairs[:, 0], 0]))
    every = np.concatenate([morph.frame(t).positions @ FRONT for t in (0.0, 1.0)])
    for axes, t in zip(panels, times, strict=True):
        frame = morph.frame(t)
        seen, normals = frame.positions @ FRONT, frame.normals @ FRONT
        shown = np.flatnonzero(normals[:, 2] > 0)
        shown = shown[np.argsort(seen[shown, 2])]
        light = np.clip(0.5 + 0.5 * (normals[shown] @ unit(LIGHT)), 0.3, 1)[:, None]
        dots(axes, seen[shown], colors[shown] * light, 1.8, linewidths=0)
        fit(axes, every)
    return page_of(panels)


@picture
def motion() -> Figure:
    """A bar whose right half is turned up."""
    along_bar, around = np.meshgrid(np.linspace(-1, 1, 120), np.arange(24), indexing="ij")
    angle = 2 * np.pi * around / 24
    points = np.stack([along_bar, 0.13 * np.cos(angle), 0.13 * np.sin(angle)], axis=-1)
    normals = np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=-1).reshape(-1, 3)
    points = points.reshape(-1, 3)

    def bent(by: float, radius: float = 0.25) -> Array:
        x = np.clip(points[:, 0], 0, radius * by)
        a, rest = x / radius, points - np.column_stack([x, 0 * x, 0 * x])
        cos, sin = np.cos(a), np.sin(a)
        turned = np.column_stack(
            [cos * rest[:, 0] - sin * rest[:, 1], sin * rest[:, 0] + cos * rest[:, 1], rest[:, 2]]
        )
        return turned + np.column_stack([radius * sin, radius * (1 - cos), 0 * a])

    i, j = (g.ravel() for g in np.meshgrid(np.arange(119), np.arange(24), indexing="ij"))
    k = (j + 1) % 24
    triangles = np.concatenate(
        [
            np.stack([i * 24 + j, i * 24 + k, (i + 1) * 24 + k], axis=1),
            np.stack([i * 24 + j, (i + 1) * 24 + k, (i + 1) * 24 + j], axis=1),
        ]
    )
    image = bent(2.6)
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 250, [f"t = {t:g}" for t in times], rows=2)
    share = share_of(points[:, 0])
    every = np.concatenate([points, image, np.array([[1.0, 0.85, 0.0]])])
    for row, kind in enumerate(("linear", "rigid")):
        moves = pointmorph.Motion(points, normals, image, kind)
        for axes, t in zip(panels[5 * row :], times, strict=False):
            surface(axes, moves.at(t), triangles, share, along, back=True)
            fit(axes, every, 0.08)
        panels[5 * row].text(
            0.06, 0.95, kind, transform=panels[5 * row].transAxes, color=INK, fontsize=10, va="top"
        )
    return page_of(panels)


@picture
def resampling() -> Figure:
    """A bowl that breaks in two."""
    source, target, normals = bowls()
    pairs = np.repeat(np.arange(len(source))[:, None], 2, axis=1)
    radii = np.full(len(source), 0.04)
    clouds = [pointmorph.Cloud(p, normals, radii=radii) for p in (source, target)]
    morph = pointmorph.restore(*clouds, pairs, (target, source))
    plain, filled = morph.frame(0.5), morph.resampled_frame(0.5)
    panels = figure(2, 360, ("the frame at t = 0.5", "with the points that fill its crack"))
    look = rotation(0, -0.7)
    for axes, frame in zip(panels, (plain, filled), strict=True):
        base = np.full((len(frame.positions), 3), rgb(BLUE))
        base[len(plain.positions) :] = rgb(ORANGE)
        light = np.clip(0.45 + 0.6 * np.abs(frame.normals @ look @ unit(LIGHT)), 0.3, 1)[:, None]
        dots(axes, frame.positions @ look, np.clip(base * light, 0, 1), 5.0, linewidths=0)
        fit(axes, plain.positions @ look, 0.02)
    return page_of(panels)


@picture
def mesh_motion() -> Figure:
    """A bar that is twisted."""
    points, triangles = bar(61, 3, 1.0, 0.16)
    angle = 0.9 * np.pi * (points[:, 0] + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    y, z = points[:, 1], points[:, 2]
    twisted = np.column_stack([points[:, 0], cos * y - sin * z, sin * y + cos * z])
    normals = unit(points * (0, 1, 1))
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 220, [f"t = {t:g}" for t in times], rows=2)
    look = rotation(2, -0.3) @ rotation(0, -1.25)
    striped = rgb(BLUE) * np.where(np.arange(len(triangles)) // 12 % 2, 0.45, 0.9)[:, None]
    colors = striped + np.where(np.arange(len(triangles)) // 12 % 2, 0.55, 0.1)[:, None]
    for row, kind in enumerate(("linear", "rigid")):
        moves = pointmorph.Motion(points, normals, twisted, kind, faces=triangles)
        for axes, t in zip(panels[5 * row :], times, strict=False):
            surface(axes, moves.at(t) @ look, triangles, colors, edges=0.2, back=True)
            fit(axes, points @ look, 0.1)
        panels[5 * row].text(
            0.06, 0.97, kind, transform=panels[5 * row].transAxes, color=INK, fontsize=10, va="top"
        )
    return page_of(panels)


@picture
def stagger() -> Figure:
    animals = Animals()
    source, target = animals.clouds()
    times = (0.0, 0.25, 0.5, 0.75, 1.0)
    panels = figure(5, 360, [f"t = {t:g}" for t in times], rows=2)
    every = np.concatenate([animals.source, animals.target]) @ FRONT
    for row, (kind, order) in enumerate((("x", "reverse"), ("noise", "forward"))):
        morph = pointmorph.morph(
            source, target, animals.ends(*STANDING), stagger=kind, stagger_order=order,
            stagger_overlap=0.4,
        )  # fmt: skip
        for axes, t in zip(panels[5 * row :], times, strict=False):
            frame = morph.frame(t)
            share = morph.vertex_times(t)[morph.pairs[:, 0]][:, None]
            seen, normals = frame.positions @ FRONT, frame.normals @ FRONT
            shown = np.flatnonzero(normals[:, 2] > 0)
            shown = shown[np.argsort(seen[shown, 2])]
            light = np.clip(0.5 + 0.5 * (normals[shown] @ unit(LIGHT)), 0.3, 1)[:, None]
            colors = (1 - share) * rgb(BLUE) + share * rgb(ORANGE)
            dots(axes, seen[shown], colors[shown] * light, 1.8, linewidths=0)
            fit(axes, every)
        panels[5 * row].text(
            0.06, 1.0, kind, transform=panels[5 * row].transAxes, color=INK, fontsize=10, va="top"
        )
    return page_of(panels)
