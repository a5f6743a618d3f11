"""Pictures of pairs in what ``pointmorph batch`` writes."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pointmorph
from pointmorph.batch import thumbnails
from shapes import ball


def unpacked(png: bytes) -> np.ndarray:
    """The pixels of a PNG file of the kind that is written here."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    parts, at = {}, 8
    while at < len(png):
        size = int.from_bytes(png[at : at + 4], "big")
        body = png[at + 4 : at + 8 + size]
        assert zlib.crc32(body) == int.from_bytes(png[at + 8 + size : at + 12 + size], "big")
        parts[body[:4]] = body[4:]
        at += 12 + size
    width, height = (int.from_bytes(parts[b"IHDR"][k : k + 4], "big") for k in (0, 4))
    rows = np.frombuffer(zlib.decompress(parts[b"IDAT"]), np.uint8).reshape(height, -1)
    assert (rows[:, 0] == 0).all()
    return rows[:, 1:].reshape(height, width, 3)


def test_a_ball_looks_like_a_disc_lit_from_above(tmp_path: Path) -> None:
    points = ball(20_000)
    radii = np.full(len(points), (4 * np.pi / len(points)) ** 0.5)
    picture = thumbnails.draw(points, points, radii, size=100)
    assert (unpacked(thumbnails.png(picture)) == picture).all()
    y, x = np.mgrid[:100, :100]
    away = np.hypot(x - 49.5, y - 49.5)
    drawn = (picture != picture[0, 0]).any(axis=2)
    assert drawn[away < 43].all()
    assert not drawn[away > 48].any()
    assert picture[15, 50].sum() > 1.3 * picture[85, 50].sum()


def test_what_is_in_front_hides_what_is_behind() -> None:
    # Of two plates, the one that is nearer to the viewer, at -y, is darker.
    side = np.linspace(-1, 1, 60)
    x, z = (a.ravel() for a in np.meshgrid(side, side))
    plates = [np.stack([x, np.full_like(x, y), z], axis=1) for y in (-0.01, 0.01)]
    normals = [np.tile(n, (len(x), 1)) for n in ((0.0, 0.0, -0.2), (0.3, -0.9, 0.4))]
    radii = np.full(2 * len(x), 0.05)
    colors = set()
    for order in (1, -1):
        picture = thumbnails.draw(
            np.concatenate(plates[::order]), np.concatenate(normals[::order]), radii, size=64
        )
        colors.add(picture[32, 32].tobytes())
    alone = thumbnails.draw(plates[0], normals[0], radii[: len(x)], size=64)
    assert colors == {alone[32, 32].tobytes()}


def test_a_film_goes_from_the_source_to_the_target() -> None:
    source, target = ball(900), ball(1100) * (1.0, 1.0, 0.4)
    morph = pointmorph.morph(pointmorph.Cloud(source), pointmorph.Cloud(target))
    film = thumbnails.film(morph, size=60)
    assert film.shape == (60, 240, 3)
    drawn = (film != film[0, 0]).any(axis=2)
    areas = [int(drawn[:, k * 60 : k * 60 + 60].sum()) for k in range(4)]
    assert areas[0] > areas[1] > areas[2]
    assert abs(areas[2] - areas[3]) < 0.1 * areas[3]
