"""Pictures of the stages on the unit sphere."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.figure import Figure

from stage_pictures.drawing import (
    FRONT,
    PATCHES,
    RED,
    along,
    dots,
    figure,
    fit,
    page_of,
    picture,
    rgb,
    share_of,
    surface,
    visible,
)
from stage_pictures.shapes import STANDING, WALKING, Animals, Array, Pull, rotation, unit


@picture
def spherical_parameterization() -> Figure:
    animals = Animals()
    morph = pointmorph.morph(
        *animals.clouds(), animals.ends(*STANDING), method="paper", domain="sphere"
    )
    share = share_of(animals.source[:, 0])
    sphere = np.asarray(morph.source_domain)
    panels = figure(2, 360, ("a closed shape", "on the unit sphere"))
    turn = np.linalg.svd(sphere.T @ animals.source)
    to_shape = turn[0] @ turn[2]
    for axes, points in zip(panels, (animals.source, sphere @ to_shape), strict=True):
        surface(axes, points @ FRONT, animals.source_triangles, share, along)
        fit(axes, points @ FRONT)
    return page_of(panels)


def limb_of(directions: Array, pulls: dict[str, Pull]) -> Array:
    """The number of the limb that each point is on, 1 to 6, or 0."""
    pulled = [
        np.exp((directions @ unit(np.array(axis)) - 1) / width) for axis, _, width in pulls.values()
    ]
    return np.where(np.max(pulled, axis=0) > 0.3, 1 + np.argmax(pulled, axis=0), 0)


def limb_colors(share: Array) -> Array:
    """From shares of the limbs in each point to the color of the largest."""
    return LIMBS[np.argmax(share, axis=1)]


LIMBS = np.array([rgb("#e3e7eb"), *(rgb(color) * 0.75 + 0.25 for color in PATCHES[:6])])


@picture
def spherical_alignment() -> Figure:
    animals = Animals()
    marks = animals.ends("head", "left fore", "right hind")
    morph = pointmorph.morph(*animals.clouds(), marks, method="paper", domain="sphere")
    spheres = [np.asarray(rows) for rows in (morph.source_domain, morph.target_domain)]
    turn = np.linalg.svd(spheres[0].T @ animals.source)
    to_shape = turn[0] @ turn[2]
    if np.linalg.det(to_shape) < 0:
        to_shape = turn[0] @ np.diag([1, 1, -1]) @ turn[2]
    look = rotation(2, -0.95) @ rotation(0, -1.95)
    panels = figure(4, 260, ("source", "on the sphere", "target", "on the sphere, aligned"))
    sides = (
        (animals.source_directions, STANDING, animals.source, animals.source_triangles),
        (animals.target_directions, WALKING, animals.target, animals.target_triangles),
    )
    for side, (directions, pulls, points, triangles) in enumerate(sides):
        limbs = np.eye(7)[limb_of(directions, pulls)]
        rows = np.array([pair[side] for pair in marks.values()])
        for axes, places in zip(
            panels[2 * side :], (points, spheres[side] @ to_shape), strict=False
        ):
            seen = places @ look
            surface(axes, seen, triangles, limbs, limb_colors)
            shown = rows[visible(seen[rows], seen, triangles)]
            dots(axes, seen[shown], RED, 8)
            fit(axes, seen, 0.08)
    return page_of(panels)
