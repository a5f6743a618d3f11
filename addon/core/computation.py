"""What the library is asked for, from plain arrays to plain arrays; no Blender in between."""

from dataclasses import dataclass, replace

import numpy as np
import pointmorph
import pointmorph.formats

from . import transforms
from .features import Marks


@dataclass(frozen=True)
class Shape:
    """An object's points: in its own space, or in the morph's (world axes, the source's origin).

    Attributes
    ----------
    name : str
        The object's.
    positions, normals : (N, 3) arrays of float32
    colors : (N, 4) array of float32
        Linear.
    radii : (N,) array of float32
    triangles : (F, 3) array of int32
        None, like the other attributes, where the object has none.
    marks : Marks
    """

    name: str
    positions: np.ndarray
    normals: np.ndarray | None
    colors: np.ndarray | None
    radii: np.ndarray | None
    triangles: np.ndarray | None
    marks: Marks

    def moved(self, matrix):
        """Taken through a (4, 4) matrix."""
        return replace(
            self,
            positions=transforms.move_positions(matrix, self.positions),
            normals=None if self.normals is None else transforms.move_normals(matrix, self.normals),
            radii=None if self.radii is None else transforms.move_radii(matrix, self.radii),
        )

    def cloud(self):
        """As the library takes it: the vertices are the samples. The boundary is the longest that
        the faces leave open, and they say what hangs together."""
        return pointmorph.formats.Shape(
            self.name, self.positions, self.normals, self.colors, self.radii, self.triangles
        ).cloud(as_surface=False)


@dataclass(frozen=True)
class Request:
    """All that a morph needs."""

    source: Shape
    target: Shape
    features: dict
    loop: list
    settings: dict


@dataclass(frozen=True)
class End:
    """One end of all pairs, a row a pair; float32."""

    rows: np.ndarray
    positions: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    radii: np.ndarray


@dataclass(frozen=True)
class Outcome:
    """All that the scene gets from a morph.

    `landing` is (N, 3): where every source vertex ends on the target, in the morph's frame.
    `distortion` is (M,), a value a pair: the worse of both its ends, see `pointmorph.PointQuality`.
    `maps` is the landing of all points of the source and of all of the target, for `Earlier`.
    `boundaries` are the rows of the boundary that each shape's faces leave open, or None.

    Of a chain, `between` are the shapes on the way, `stops` where every source vertex is on each of
    them, and `via_maps` where their own points land on the next shape and on the one before.
    """

    source: End
    target: End
    landing: np.ndarray
    distortion: np.ndarray
    report: dict
    maps: tuple
    boundaries: tuple
    between: tuple = ()
    stops: tuple = ()
    via_maps: tuple = ()

    @property
    def ends(self):
        """Every shape's `End`, in order."""
        return (self.source, *self.between, self.target)


@dataclass(frozen=True)
class Earlier:
    """What was asked for and found before, to start from after a mark was added or moved.

    `maps` are (N, 3) and (M, 3): where the points of both shapes ended.
    """

    request: Request
    maps: tuple

    def start_for(self, request):
        """The maps, if `request` differs in its features alone, else None."""
        same = (
            request.settings == self.request.settings
            and request.settings.get("method", "auto") == "auto"
            and request.features != self.request.features
            and np.array_equal(request.source.positions, self.request.source.positions)
            and np.array_equal(request.target.positions, self.request.target.positions)
        )
        return self.maps if same else None


def compute(request, progress, earlier=None):
    """Runs the library. `progress` is called as that of `pointmorph.morph`."""
    clouds = request.source.cloud(), request.target.cloud()
    morph = pointmorph.morph(
        *clouds,
        request.features,
        loop=request.loop,
        start=earlier.start_for(request) if earlier else None,
        progress=progress,
        **request.settings,
    )
    ends = []
    for t in (0, 1):
        frame = morph.frame(t)
        rows = morph.pairs[:, t].astype(np.int32)
        ends.append(End(rows, frame.positions, frame.normals, frame.colors, frame.radii))
    quality = morph.measure_quality(progress)
    distortion = np.maximum(
        *(
            side.distortion[end.rows]
            for side, end in zip((quality.source, quality.target), ends, strict=True)
        )
    )
    maps = morph.source_to_target, morph.target_to_source
    return Outcome(
        *ends,
        maps[0],
        distortion.astype(np.float32),
        morph.report,
        maps,
        tuple(cloud.boundary for cloud in clouds),
    )
