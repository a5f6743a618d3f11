"""Pictures of the stages on faces."""

from __future__ import annotations

import numpy as np
import pointmorph
import pointmorph.meshes
from matplotlib.figure import Figure

from stage_pictures.drawing import BLUE, FRONT, ORANGE, figure, fit, page_of, picture, rgb, surface
from stage_pictures.shapes import STANDING, WALKING, animal, end_of, icosphere


@picture
def wrapping() -> Figure:
    source_directions, source_triangles = icosphere(3)
    target_directions, target_triangles = icosphere(5)
    source = animal(source_directions, STANDING, (1.0, 0.5, 0.5))
    target = animal(target_directions, WALKING, (1.1, 0.6, 0.55))
    features = {
        limb: (end_of(limb, source_directions), end_of(limb, target_directions))
        for limb in ("head", "tail", "left fore", "right fore")
    }
    morph = pointmorph.morph(
        pointmorph.Cloud(source, faces=source_triangles),
        pointmorph.Cloud(target, faces=target_triangles),
        features,
    )
    titles = ("a mesh", "the surface to wrap it onto", "wrapped")
    panels = figure(3, 290, titles)
    blue = rgb(BLUE) * 0.6 + 0.4
    surface(panels[0], source @ FRONT, source_triangles, blue, edges=0.4)
    surface(panels[1], target @ FRONT, target_triangles, rgb(ORANGE) * 0.8 + 0.2)
    wrapped = np.asarray(morph.wrapped(1.0))
    surface(panels[2], wrapped @ FRONT, source_triangles, blue, edges=0.4)
    for axes, points in zip(panels, (source, target, target), strict=True):
        fit(axes, points @ FRONT, 0.08)
    return page_of(panels)
