"""Pictures of the stages on the unit sphere."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.figure import Figure

from stage_pictures.drawing import FRONT, along, figure, fit, page_of, picture, share_of, surface
from stage_pictures.shapes import STANDING, Animals


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
