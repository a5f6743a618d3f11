"""What is said of models in several pieces, or with handles, is what their faces say."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pointmorph

Floats = npt.NDArray[np.float64]
Mesh = tuple[Floats, list[list[int]]]


def grid_of(around: int, along: int, at: Any, closed: bool) -> Mesh:
    """Squares over two angles, the second one closed or from 0 to 1."""
    u = np.linspace(0, 2 * np.pi, around, endpoint=False)
    v = np.linspace(0, 2 * np.pi if closed else 1, along, endpoint=not closed)
    places = np.array([at(a, b) for a in u for b in v])
    faces = []
    for i in range(around):
        for j in range(along if closed else along - 1):
            k, m = (i + 1) % around, (j + 1) % along
            faces.append([i * along + j, k * along + j, k * along + m, i * along + m])
    return places, faces


def torus(thick: float) -> Mesh:
    def at(a: float, b: float) -> list[float]:
        r = 1 + thick * np.cos(b)
        return [r * np.cos(a), r * np.sin(a), thick * np.sin(b)]

    return grid_of(40, 16, at, closed=True)


def bottle(radius: float, height: float) -> Mesh:
    """A can with both ends closed by a polygon, of thin walls next to each other."""
    places, faces = grid_of(
        24, 4, lambda a, b: [radius * np.cos(a), radius * np.sin(a), height * b], closed=False
    )
    ends = [list(range(0, len(places), 4))[::-1], list(range(3, len(places), 4))]
    return places, faces + ends


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> Mesh:
    unit = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return unit * size + at, faces


def together(*meshes: Mesh) -> Mesh:
    places, faces, first = [], [], 0
    for own, polygons in meshes:
        places.append(own)
        faces += [[first + corner for corner in polygon] for polygon in polygons]
        first += len(own)
    return np.concatenate(places), faces


def split(mesh: Mesh) -> Mesh:
    """Every face with vertices of its own."""
    places, faces = mesh
    rows = [corner for polygon in faces for corner in polygon]
    ends = np.cumsum([0, *map(len, faces)])
    return places[rows], [list(range(a, b)) for a, b in pairwise(ends)]


def report_of(source: Mesh, target: Mesh) -> dict[str, Any]:
    clouds = [
        pointmorph.Cloud(places, faces=faces, name=name)
        for (places, faces), name in ((source, "One"), (target, "Other"))
    ]
    return dict(pointmorph.morph(*clouds).report)


def pieces(report: dict[str, Any], side: str) -> list[tuple[int | None, int]]:
    return sorted((one["genus"], one["borders"]) for one in report["topology"][side]["pieces"])


def test_thin_boxes_have_no_handles_and_a_ring_has_one() -> None:
    book = together(
        box((2, 3, 0.02), (0, 0, 0)),
        box((2, 3, 0.02), (0, 0, 0.3)),
        box((1.9, 2.9, 0.2), (0, 0, 0.05)),
    )
    ring = together(torus(0.04), bottle(0.4, 1.5))
    report = report_of(book, ring)
    assert pieces(report, "source") == [(0, 0)] * 3
    assert pieces(report, "target") == [(0, 0), (1, 0)]
    report = report_of(split(ring), ring)
    assert pieces(report, "source") == [(0, 0), (1, 0)]
    assert not [text for text in report["warnings"] if "tears" in text]


def test_parts_that_touch_stay_apart() -> None:
    """As the eyes of a head, which have one vertex with it in common."""
    head, eye = bottle(1, 2), bottle(0.3, 0.4)
    eye[0][:] += head[0][0] - eye[0][0]
    whole = together(head, eye)
    assert (whole[0] == head[0][0]).all(axis=1).sum() == 2
    apart = together(head, (eye[0] + [0.5, 0, 0], eye[1]))
    report = report_of(whole, apart)
    assert pieces(report, "source") == pieces(report, "target") == [(0, 0), (0, 0)]
    assert not [text for text in report["warnings"] if "counterpart" in text]


def test_seams_that_differ_by_rounding_are_closed() -> None:
    """As exporters leave them that apply transforms to split vertices in single precision."""
    rng = np.random.default_rng(5)
    places, faces = split(bottle(1, 2))
    rounded = places + rng.uniform(-1e-6, 1e-6, places.shape)
    source = pointmorph.Cloud(rounded, faces=faces, name="One")
    target = pointmorph.Cloud(*bottle(0.5, 2)[:1], faces=bottle(0.5, 2)[1], name="Other")
    morph = pointmorph.morph(source, target)
    assert pieces(dict(morph.report), "source") == [(0, 0)]
    np.testing.assert_allclose(morph.wrapped(1e-9), rounded, atol=1e-7)
    _, place = np.unique(places.round(9), axis=0, return_inverse=True)
    for t in (0.25, 0.5, 0.75, 1.0):
        on_the_way = np.asarray(morph.wrapped(t))
        for one in range(place.max() + 1):
            assert np.ptp(on_the_way[place.reshape(-1) == one], axis=0).max() < 1e-5


def side_view(outline: list[tuple[float, float]], width: float) -> Mesh:
    """The same outline on both sides, and what is between them."""
    count = len(outline)
    places = np.array([[side * width / 2, y, z] for side in (-1, 1) for y, z in outline])
    around = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    return places, [list(range(count))[::-1], list(range(count, 2 * count)), *around]


def test_a_van_is_divided_among_the_cab_and_the_bed_of_a_pickup() -> None:
    """Also where the map began with one of them tilted, as if the cab were most of the van."""
    wheels = [box((0.3, 0.6, 0.6), (x, y, 0)) for x in (-0.7, 0.4) for y in (-1.16, 0.36)]
    front = [(-0.4, 1.6), (-0.7, 0.9), (-1.3, 0.9)]
    van = together(side_view([(-1.3, 0.4), (1.3, 0.4), (1.3, 1.6), *front], 1.2), *wheels)
    cab = side_view([(-1.3, 0.4), (0.2, 0.4), (0.2, 1.6), *front], 1.2)
    pickup = together(cab, box((1.2, 1.1, 0.4), (-0.6, 0.2, 0.4)), *wheels)
    for source, target in ((van, pickup), (pickup, van)):
        warnings = report_of(source, target)["warnings"]
        assert [text for text in warnings if "divided among 2 of" in text]


def test_a_way_through_is_told_of_its_piece() -> None:
    small = (bottle(0.3, 0.6)[0] + [3, 0, 0], bottle(0.3, 0.6)[1])
    report = report_of(together(torus(0.3), small), together(bottle(1.2, 0.6), small))
    (text,) = [text for text in report["warnings"] if "tears" in text]
    assert text.startswith("A piece isn't like its counterpart (")
    assert "in One a closed surface with 1 hole through it, in Other" in text


def test_meshes_are_told_what_faces_cannot_do() -> None:
    report = report_of(torus(0.3), bottle(1, 1.5))
    assert [text for text in report["warnings"] if "tears" in text]
    assert [text for text in report["warnings"] if text.startswith("The hole through One")]
    clouds = [pointmorph.Cloud(one[0], faces=one[1]) for one in (torus(0.3), bottle(1, 1.5))]
    bare = [pointmorph.Cloud(sampled.positions) for sampled in clouds]
    warnings = pointmorph.morph(*bare).report["warnings"]
    assert not [text for text in warnings if text.startswith("The hole through")]
