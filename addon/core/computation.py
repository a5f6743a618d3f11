"""What the library is asked for, from plain arrays to plain arrays; no Blender in between."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pointmorph
import pointmorph.base.option_table
import pointmorph.formats

from . import packing, path_stages, transforms
from .features import Marks
from .look_transfer import Canvas, Drawn, Model, Skin, draw, is_worth_it


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
    boundary : sequence of int
        Rows of the boundary where it's known without faces; None where they say it, or nothing.
    skin : look_transfer.Skin
        None for a shape without faces.
    rigid, fixed : (N,) arrays of float32
        How much a vertex keeps its shape or its place when the faces are wrapped, 0 to 1.
    """

    name: str
    positions: np.ndarray
    normals: np.ndarray | None
    colors: np.ndarray | None
    radii: np.ndarray | None
    triangles: np.ndarray | None
    marks: Marks
    boundary: Sequence | None = None
    skin: Skin | None = None
    rigid: np.ndarray | None = None
    fixed: np.ndarray | None = None

    def moved(self, matrix):
        """Taken through a (4, 4) matrix."""
        return replace(
            self,
            positions=transforms.move_positions(matrix, self.positions),
            normals=None if self.normals is None else transforms.move_normals(matrix, self.normals),
            radii=None if self.radii is None else transforms.move_radii(matrix, self.radii),
            triangles=None
            if self.triangles is None
            else transforms.move_faces(matrix, self.triangles),
            skin=None if self.skin is None else self.skin.moved(matrix),
        )

    def model(self):
        """As something to be drawn."""
        colors = None if self.skin is not None else self.colors
        return Model(self.positions, self.triangles, self.skin, colors)

    def cloud(self):
        """As the library takes it: the surface of the faces, or else the points."""
        arrays = self.positions, self.normals, self.colors, self.radii
        if self.triangles is None:
            return pointmorph.Cloud(*arrays, name=self.name, boundary=self.boundary)
        masks = {"rigid": self.rigid, "fixed": self.fixed}
        return pointmorph.formats.Shape(self.name, *arrays, self.triangles, **masks).cloud()


@dataclass(frozen=True)
class Request:
    """All that a morph needs."""

    source: Shape
    target: Shape
    features: dict
    loop: list
    settings: dict

    def without_looks(self):
        """The same without images and what else takes much room."""
        ends = [replace(shape, skin=None) for shape in (self.source, self.target)]
        return Request(*ends, self.features, self.loop, self.settings)


@dataclass(frozen=True)
class End:
    """One end of all pairs, a row a pair; float32."""

    rows: np.ndarray
    positions: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    radii: np.ndarray


@dataclass(frozen=True)
class Way:
    """How far the way from a shape to the next lies off the straight one; see `path_stages`.

    Attributes
    ----------
    pairs : (K, M, 3) array
        At `path_stages.TIMES`.
    normals : (L, M, 3) array
        Of the pairs, at `path_stages.NORMAL_TIMES`.
    vertices : (K, N, 3) array
        Of the source's own vertices on their way to `Outcome.landing`.
    """

    pairs: np.ndarray
    normals: np.ndarray
    vertices: np.ndarray


@dataclass(frozen=True)
class Outcome:
    """All that the scene gets from a morph.

    `landing` is (N, 3): where every source vertex ends on the target, in the morph's frame; where
    the source has faces, as they are when they are wrapped onto it.
    `distortion` is (M,), a value a pair: the worse of both its ends, see `pointmorph.PointQuality`.
    `maps` are where the map takes all points of the source and all of the target, for `Earlier`.
    `faces` are each shape's triangles as `packing` has them, or None.
    `ways` are a `Way` for each way from a shape to the next, or None where it is straight.

    Of a chain, `between` are the shapes on the way, `stops` where every source vertex is on each of
    them, and `via_maps` where their own points land on the next shape and on the one before.

    `confidence` is (M,): how likely each pair is right, 0 to 1; None where nobody knows.

    `drawn` is the target's look on the source's faces, where that was asked for.
    """

    source: End
    target: End
    landing: np.ndarray
    distortion: np.ndarray
    report: dict
    maps: tuple
    faces: tuple
    ways: tuple
    between: tuple = ()
    stops: tuple = ()
    via_maps: tuple = ()
    drawn: Drawn | None = None
    confidence: np.ndarray | None = None

    @property
    def ends(self):
        """Every shape's `End`, in order."""
        return (self.source, *self.between, self.target)


@dataclass(eq=False)
class Earlier:
    """What was asked for and found before, to start from after a mark was added or moved.

    `maps` are (N, 3) and (M, 3): where the points of both shapes ended. `landing` is (N, 3): where
    what is shown of the source ends. `live` is the LiveMorph of these shapes that there is, if any.
    `same_marks` is whether features that are the same may start from it, too: those of a way of a
    chain, in which others have changed.
    """

    request: Request
    maps: tuple
    landing: np.ndarray | None = None
    live: pointmorph.LiveMorph | None = None
    same_marks: bool = False

    @property
    def can_be_bent(self):
        """Whether a LiveMorph can be made of it."""
        settings = self.request.settings
        return (settings.get("method", "auto"), settings.get("domain", "auto")) == ("auto", "auto")

    def live_for(self, request):
        """The LiveMorph, if `request` differs in its features alone, else None. It gives back
        all else as it was made with: names, normals, colors and radii as well."""
        same = (
            self.live is not None
            and self.start_for(request)
            and request.loop == self.request.loop
            and _same_look(request.source, self.request.source)
            and _same_look(request.target, self.request.target)
        )
        return self.live if same else None

    def followed_by(self, request, outcome):
        """What is to be kept of the next outcome. It shares the LiveMorph with this one if that has
        made it; a map from scratch is another one, which it knows nothing of."""
        updated = outcome.report.get("update") == "updated"
        live = self.live_for(request) if updated else None
        return Earlier(request, outcome.maps, outcome.landing, live)

    def start_for(self, request):
        """The maps, if `request` differs in its features alone, or in nothing with `same_marks`,
        else None."""
        same = (
            request.settings == self.request.settings
            and request.settings.get("method", "auto") == "auto"
            and request.settings.get("domain", "auto") == "auto"  # others start in their domain
            and (self.same_marks or request.features != self.request.features)
            and np.array_equal(request.source.positions, self.request.source.positions)
            and np.array_equal(request.target.positions, self.request.target.positions)
            and _same_faces(request.source, self.request.source)
            and _same_faces(request.target, self.request.target)
        )
        return self.maps if same else None


def _same_faces(one, other):
    return _same(one.triangles, other.triangles)


def _same_look(one, other):
    """Whether shapes of the same positions and faces are the same in all that a morph returns."""
    return one.name == other.name and all(
        _same(getattr(one, what), getattr(other, what))
        for what in ("normals", "colors", "radii", "boundary", "rigid", "fixed")
    )


def _same(one, other):
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


def _packed(triangles):
    return None if triangles is None else packing.pack(triangles)


def compute(request, progress, earlier=None):
    """Runs the library. `progress` is called as that of `pointmorph.morph`."""
    live = earlier.live_for(request) if earlier else None
    if live is not None:
        morph = live.updated(request.features, progress)
    else:
        morph = pointmorph.morph(
            request.source.cloud(),
            request.target.cloud(),
            request.features,
            loop=request.loop,
            start=earlier.start_for(request) if earlier else None,
            frames=True,
            progress=progress,
            **request.settings,
        )
    ends = []
    for t in (0, 1):
        frame = morph.frame(t)
        rows = morph.pairs[:, t].astype(np.int32)
        ends.append(End(rows, frame.positions, frame.normals, frame.colors, frame.radii))
    quality = morph.measure_quality(progress)
    confidence = morph.measure_confidence(progress).of_pairs(morph.pairs)
    if morph.has_mesh:
        morph.measure_mesh_quality(progress)  # for the report, which asks nobody whether to go on
    distortion = np.maximum(
        *(
            side.distortion[end.rows]
            for side, end in zip((quality.source, quality.target), ends, strict=True)
        )
    )
    maps = morph.source_to_target, morph.target_to_source
    landing = morph.wrapped(1.0, progress) if morph.has_mesh else maps[0]
    return Outcome(
        *ends,
        landing,
        distortion.astype(np.float32),
        morph.report,
        maps,
        tuple(_packed(shape.triangles) for shape in (request.source, request.target)),
        (_way(morph, request, ends, landing, progress),),
        confidence=confidence,
    )


def with_look(requests, outcome, options, progress):
    """An outcome with the last target's look drawn on the first source's faces, if both look like
    something."""
    source, model = requests[0].source, requests[-1].target.model()
    if not is_worth_it(source.skin, model):
        return outcome
    canvas = Canvas(source.triangles, source.skin, outcome.landing.astype(np.float32))
    return replace(outcome, drawn=draw(canvas, model, options, progress))


def _way(morph, request, ends, landing, progress):
    if pointmorph.base.option_table.is_straight(**request.settings):
        return None
    at = morph.wrapped if morph.has_mesh else morph.source_at
    start, end = ends
    positions, normals, own = (
        np.empty((len(times), *like.shape), np.float32)
        for times, like in (
            (path_stages.TIMES, start.positions),
            (path_stages.NORMAL_TIMES, start.normals),
            (path_stages.TIMES, morph.source.positions),
        )
    )
    frame = morph.empty_frame()
    for number, t in enumerate(path_stages.TIMES):
        # What the frame has found, the vertices needn't find again.
        morph.frame(t, frame, progress)
        vertices = at(t, progress)
        path_stages.put_deviation(
            frame.positions, start.positions, end.positions, t, positions[number]
        )
        if t in path_stages.NORMAL_TIMES:
            its = normals[path_stages.NORMAL_TIMES.index(t)]
            path_stages.put_deviation(frame.normals, start.normals, end.normals, t, its)
        path_stages.put_deviation(vertices, morph.source.positions, landing, t, own[number])
    return Way(positions, normals, own)
