"""The add-on's textures without Blender: images sampled, faces drawn, looks taken along a map."""

from __future__ import annotations

import importlib
import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import pointmorph
import pytest
from pointmorph.base.errors import CloudError
from pointmorph.meshes import ClosestPlaces, nearest_rows

CORE = Path(__file__).resolve().parents[3] / "addon" / "core"
Array = npt.NDArray[Any]


def load(name: str) -> ModuleType:
    """A module of the add-on's core, which needs no Blender."""
    if "textures_core" not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            "textures_core", CORE / "__init__.py", submodule_search_locations=[str(CORE)]
        )
        assert spec is not None
        assert spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        sys.modules["textures_core"] = package
        spec.loader.exec_module(package)
    return importlib.import_module(f"textures_core.{name}")


textures, looks, texels = load("textures"), load("looks"), load("texels")
look_transfer, tangents = load("look_transfer"), load("tangents")


def go_on(stage: str, fraction: float) -> bool:
    return True


def grid(side: int, turn: float = 0.0) -> tuple[Array, Array, Array]:
    """A sheet on the unit square: positions, triangles, UVs of the vertices."""
    u, v = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side), indexing="ij")
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)
    z = turn * np.sin(3 * u) * np.cos(2 * v)
    rows = np.arange(side * side).reshape(side, side)
    a, b, c, d = rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]
    triangles = np.concatenate(
        [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    )
    return np.column_stack([uvs, z.reshape(-1)]), triangles, uvs


# --- Images ---------------------------------------------------------------------------------------


def by_hand(values: Array, u: float, v: float, extension: str) -> Array:
    """Bilinear interpolation, one pixel after the other."""
    height, width = values.shape[:2]

    def wrapped(number: int, count: int) -> int:
        if extension == "REPEAT":
            return number % count
        if extension == "MIRROR":
            number %= 2 * count
            return min(number, 2 * count - 1 - number)
        return min(max(number, 0), count - 1)

    if extension == "CLIP" and not (0 <= u <= 1 and 0 <= v <= 1):
        return np.zeros(4)
    x, y = u * width - 0.5, v * height - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    result = np.zeros(4)
    for dx in (0, 1):
        for dy in (0, 1):
            weight = abs(1 - dx - (x - column)) * abs(1 - dy - (y - row))
            pixel = values[wrapped(row + dy, height), wrapped(column + dx, width)].astype(float)
            pixel[:3] *= pixel[3]
            result += weight * pixel
    return result


@pytest.mark.parametrize("extension", ["REPEAT", "EXTEND", "CLIP", "MIRROR"])
@pytest.mark.parametrize("samples", [20, 400])
def test_images_are_sampled_between_pixels(extension: str, samples: int) -> None:
    rng = np.random.default_rng(1)
    values = rng.uniform(0, 1, (5, 9, 4)).astype(np.float32)
    uvs = rng.uniform(-2.5, 3.5, (samples, 2))
    found = textures.sample(textures.Texture("", values), uvs, extension)
    wanted = [by_hand(values, u, v, extension) for u, v in uvs.tolist()]
    np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_the_closest_pixel_is_taken_as_it_is() -> None:
    values = np.arange(4 * 4 * 4, dtype=np.float32).reshape(4, 4, 4)
    texture = textures.Texture("", values, is_solid=True)
    found = textures.sample(texture, np.array([[0.1, 0.1], [0.99, 0.3], [1.3, 0.99]]), closest=True)
    assert np.array_equal(found, values[[0, 1, 3], [0, 3, 1]])


def test_bytes_are_decoded_before_they_are_mixed() -> None:
    values = np.array([[[0, 0, 0, 255], [255, 188, 128, 255]]], np.uint8)
    found = textures.sample(textures.Texture("", values, is_srgb=True), np.array([[0.5, 0.5]]))
    wanted = 0.5 * textures.to_linear(values[0, 1] / 255.0)
    np.testing.assert_allclose(found[0, :3], wanted[:3], atol=1e-6)
    plain = textures.sample(textures.Texture("", values), np.array([[0.5, 0.5]]))
    np.testing.assert_allclose(plain[0, :3], values[0, 1, :3] / 510.0, atol=1e-6)


def test_encoding_is_the_inverse_of_decoding() -> None:
    values = np.linspace(0, 1, 256)
    np.testing.assert_allclose(textures.to_srgb(textures.to_linear(values)), values, atol=1e-6)


def test_what_is_transparent_has_no_color_to_give() -> None:
    values = np.array([[[255, 0, 0, 255], [0, 255, 0, 0]]], np.uint8)
    found = textures.sample(textures.Texture("", values), np.array([[0.5, 0.5]]))
    np.testing.assert_allclose(textures.unassociated(found), [[1, 0, 0, 0.5]], atol=1e-6)


def test_tiles_lie_side_by_side() -> None:
    tiles = {
        number: textures.Texture("", np.full((2, 2, 4), value, np.float32), is_solid=True)
        for number, value in ((1001, 0.1), (1002, 0.2), (1011, 0.3))
    }
    udim = textures.Texture("", None, tiles=tiles)
    uvs = np.array([[0.5, 0.5], [1.99, 0.5], [0.5, 1.01], [1.5, 1.5], [-0.5, 0.5]])
    assert textures.sample(udim, uvs)[:, 0] == pytest.approx([0.1, 0.2, 0.3, 0.0, 0.0])


def test_an_image_at_half_the_size_has_the_mean_of_four() -> None:
    rng = np.random.default_rng(2)
    texture = textures.Texture("", rng.integers(0, 256, (8, 4, 4), dtype=np.uint8), is_srgb=True)
    whole, half = texture.linear(), texture.reduced(1)
    assert half.values.shape == (4, 2, 4)
    np.testing.assert_allclose(
        half.linear(), whole.reshape(4, 2, 2, 2, 4).mean(axis=(1, 3)), atol=1e-6
    )
    assert texture.reduced(9).values.shape == (2, 1, 4)


# --- Faces on an image ----------------------------------------------------------------------------


def test_each_pixel_of_a_surface_is_drawn_once() -> None:
    positions, triangles, uvs = grid(7)
    spread = 0.03 + 0.91 * uvs + 0.02 * np.sin(9 * uvs[:, ::-1])
    found, count = texels.cover(spread[triangles], 64)
    assert count == len(found.rows) == len(np.unique(found.rows))
    places = np.einsum("tk,tkc->tc", found.shares, spread[triangles][found.triangles]) * 64 - 0.5
    np.testing.assert_allclose(
        places, np.column_stack([found.rows % 64, found.rows // 64]), atol=1e-4
    )
    # As many as its area says.
    u, v = (spread[triangles][:, k] - spread[triangles][:, 0] for k in (1, 2))
    area = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() * 64**2
    assert len(found.rows) == pytest.approx(area, rel=0.02)
    assert positions.shape == (49, 3)


def test_overlaps_and_what_lies_outside_are_seen() -> None:
    _, triangles, uvs = grid(9)
    assert texels.are_usable(uvs[triangles], 64)[0] is None
    folded = np.column_stack([np.abs(uvs[:, 0] - 0.5), uvs[:, 1]])
    assert "overlap" in texels.are_usable(folded[triangles], 64)[0]
    assert "overlap" in texels.are_usable(2 * uvs[triangles], 64)[0]
    assert "larger than the image" in texels.are_usable(12 * uvs[triangles], 64)[0]
    # Beyond its ends the image repeats.
    shifted, count = texels.cover(uvs[triangles] + (3.25, -0.5), 64)
    assert count == len(shifted.rows) == 64 * 64
    assert "no area" in texels.are_usable(0 * uvs[triangles] + 0.3, 64)[0]
    assert "larger" in texels.are_usable(np.nan * uvs[triangles], 64)[0]


@pytest.mark.parametrize("count", [1, 700, 40_000])
def test_every_face_has_a_place_of_its_own(count: int) -> None:
    """Painted face by face, each shows its own color up to its corners, and nothing else."""
    rng = np.random.default_rng(count)
    counts = rng.choice([3, 3, 4, 4, 4, 5, 9], count)
    uvs, owners = texels.lay_out(counts, rng.pareto(2.0, count) + 0.01, 256)
    size = len(owners)
    starts = np.cumsum(counts) - counts
    triangles = np.concatenate(
        [
            np.array([[s, s + k, s + k + 1] for k in range(1, c - 1)])
            for s, c in zip(starts, counts, strict=True)
        ]
    )
    of_triangle = np.repeat(np.arange(count), counts - 2)
    found, drawn = texels.cover(uvs[triangles], size)
    assert drawn == len(found.rows)  # no pixel is in two faces
    values = np.zeros((size * size, 1), np.float32)
    known = np.zeros(size * size, bool)
    values[found.rows, 0], known[found.rows] = of_triangle[found.triangles], True
    assert (np.bincount(of_triangle[found.triangles], minlength=count) > 0).all()
    image = texels.filled(values.reshape(size, size, 1), known.reshape(size, size), owners)
    rgba = np.repeat(image, 4, axis=2)
    texture = textures.Texture("faces", rgba, is_solid=True)
    face = np.repeat(np.arange(count), counts)
    middles = (np.add.reduceat(uvs, starts) / counts[:, None])[face]
    for places in (uvs, 0.5 * (uvs + middles)):
        np.testing.assert_allclose(textures.sample(texture, places)[:, 0], face, atol=0.01)


def test_larger_faces_have_larger_places() -> None:
    uvs, owners = texels.lay_out(np.full(64, 4), np.repeat([1.0, 4.0], [32, 32]), 1024)
    sides = np.ptp(uvs.reshape(64, 4, 2), axis=1) * len(owners)
    assert (sides[32:] > 3.5 * sides[:32]).all()
    assert sides.min() > 20


@pytest.mark.parametrize("place", [1e30, np.inf, np.nan])
def test_faces_of_any_size_have_places(place: float) -> None:
    corners = np.zeros((12, 3), np.float32)
    corners[:, 0] = np.arange(12) % 4
    corners[5] = place
    counts = np.full(3, 4)
    with np.errstate(invalid="ignore"):
        lengths = texels.extents(corners, counts)
    uvs, owners = texels.lay_out(counts, lengths, 256)
    assert np.isfinite(uvs).all()
    assert {0, 1, 2} <= set(np.unique(owners).tolist())


def test_filling_goes_on_from_what_is_there() -> None:
    values = np.zeros((32, 32, 2), np.float32)
    known = np.zeros((32, 32), bool)
    known[8:16, 4:20] = True
    values[8:16, 4:20] = (0.25, 0.75)
    owners = np.zeros(known.shape, np.int32)
    filled = texels.filled(values, known, owners)
    np.testing.assert_allclose(filled, np.broadcast_to((0.25, 0.75), (32, 32, 2)), atol=1e-6)
    assert (texels.filled(values, np.zeros((32, 32), bool), owners) == 0).all()


def test_faces_of_any_shape_are_drawn_on_without_uvs() -> None:
    """Squares and triangles side by side: each place shows the color that the model has there."""
    positions, triangles, _ = grid(9)
    half = len(triangles) // 2  # the first triangle of every square; then the second ones
    corners = np.zeros_like(triangles)
    square, apart = np.arange(half) % 3 > 0, 0
    for row in range(half):
        corners[row] = apart + np.arange(3)
        corners[half + row] = apart + (np.array([0, 2, 3]) if square[row] else np.array([3, 4, 5]))
        apart += 4 if square[row] else 6
    skin = look_transfer.Skin(corners, None, None, "", np.zeros(len(triangles), bool))
    colors = np.column_stack([positions[:, :2], np.zeros(len(positions)), np.ones(len(positions))])
    model = look_transfer.Model(positions, None, None, colors.astype(np.float32))
    canvas = look_transfer.Canvas(triangles, skin, positions.astype(np.float32))
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(256), go_on)
    shares = np.random.default_rng(0).dirichlet((1, 1, 1), len(triangles))
    uvs = np.einsum("tk,tkc->tc", shares, drawn.uvs[corners])
    wanted = np.einsum("tk,tkc->tc", shares, positions[triangles])
    texture = textures.Texture("", np.asarray(drawn.color, np.float32), is_solid=True)
    found = textures.sample(texture, uvs)
    # The colors between the model's points are no finer than these lie apart.
    np.testing.assert_allclose(found[:, :2], wanted[:, :2], atol=0.04)


# --- The closest place ----------------------------------------------------------------------------


def nearest_of_all(positions: Array, triangles: Array, places: Array) -> Array:
    """The distance of each place from the nearest triangle, by many points of each."""
    u, v = (x.reshape(-1) for x in np.mgrid[:41, :41] / 40.0)
    inside = u + v <= 1.0
    shares = np.column_stack([1.0 - u - v, u, v])[inside]
    points = np.einsum("sk,tkc->tsc", shares, positions[triangles]).reshape(-1, 3)
    return np.min(
        [np.linalg.norm(places - points[part : part + 1], axis=1) for part in range(len(points))],
        axis=0,
    )


@pytest.mark.parametrize("side", [3, 8])
def test_closest_places_are_those_of_all_triangles(side: int) -> None:
    positions, triangles, _ = grid(side, 0.4)
    rng = np.random.default_rng(side)
    # Beside the surface, as the places of a wrapped mesh are, and far from it.
    rows, shares = rng.integers(0, len(triangles), 120), rng.dirichlet((1, 1, 1), 120)
    places = np.einsum("tk,tkc->tc", shares, positions[triangles[rows]])
    places += rng.normal(size=(120, 3)) * np.where(np.arange(120) < 100, 0.01, 1.0)[:, None]
    found, shares = ClosestPlaces(positions, triangles).of(places)
    assert (shares >= 0).all()
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    reached = np.einsum("tk,tkc->tc", shares, positions[triangles[found]])
    distance = np.linalg.norm(reached - places, axis=1)
    least = nearest_of_all(positions, triangles, places)
    step = np.linalg.norm(np.ptp(positions[triangles], axis=1), axis=1).max() / 40
    assert (distance <= least + 1e-9).all()
    assert (distance >= least - step).all()


def test_closest_places_are_the_same_for_any_number_of_threads() -> None:
    positions, triangles, _ = grid(12, 0.3)
    places = np.random.default_rng(0).normal(size=(5000, 3))
    script = (
        "import sys, numpy as np; from pointmorph.meshes import ClosestPlaces;"
        "p, t, q = (np.load(name) for name in sys.argv[1:]);"
        "f, s = ClosestPlaces(p, t).of(q); sys.stdout.buffer.write(f.tobytes() + s.tobytes())"
    )
    with tempfile.TemporaryDirectory() as folder:
        names = [f"{folder}/{number}.npy" for number in range(3)]
        for name, values in zip(names, (positions, triangles, places), strict=True):
            np.save(name, values)
        said = [
            subprocess.run(
                [sys.executable, "-c", script, *names],
                env={**os.environ, "OMP_NUM_THREADS": threads},
                capture_output=True,
                check=True,
            ).stdout
            for threads in ("1", "3")
        ]
    assert said[0] == said[1]
    assert len(said[0]) == 5000 * (8 + 24)


def test_closest_places_of_odd_surfaces() -> None:
    flat = np.zeros((3, 3))
    one = np.array([[0, 1, 2]])
    found, shares = ClosestPlaces(flat, one).of([[1.0, 2.0, 3.0]])
    assert found.tolist() == [0]
    assert shares.sum() == pytest.approx(1.0)
    with pytest.raises(CloudError, match="triangles: expected at least one"):
        ClosestPlaces(flat, np.empty((0, 3), np.int64))
    with pytest.raises(CloudError, match="rows 0 to 2, found 0 to 3"):
        ClosestPlaces(flat, np.array([[0, 1, 3]]))
    with pytest.raises(CloudError, match="triangles: expected whole numbers"):
        ClosestPlaces(flat, one + 0.5)
    with pytest.raises(CloudError, match="positions: expected finite numbers"):
        ClosestPlaces(flat + np.inf, one)
    with pytest.raises(CloudError, match="places: expected a table with 3 columns"):
        ClosestPlaces(flat, one).of([[0.0, 0], [0, 1]])
    with pytest.raises(CloudError, match="in row 1"):
        ClosestPlaces(flat, one).of([[0.0, 0, 0], [0, np.nan, 0]])
    assert ClosestPlaces(flat, one).of(np.empty((0, 3)))[0].size == 0


def test_the_search_for_closest_places_can_be_canceled() -> None:
    positions, triangles, _ = grid(12, 0.3)
    told: list[str] = []

    def cancel(stage: str, fraction: float) -> bool:
        told.append(stage)
        return False

    with pytest.raises(pointmorph.Cancelled):
        ClosestPlaces(positions, triangles).of(np.zeros((200_000, 3)), cancel)
    assert set(told) == {"closest places"}


def test_nearest_rows() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0]])
    assert nearest_rows(points, np.array([[0.9, 0, 0]]), 2).tolist() == [[1, 0]]


# --- A look along a map ---------------------------------------------------------------------------


def skin_of(triangles: Array, uvs: Array | None, look: Any) -> Any:
    """With a corner of its own for every triangle's corner."""
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    by_corner = None if uvs is None else uvs[triangles.reshape(-1)].astype(np.float32)
    name = "" if uvs is None else "UVMap"
    return look_transfer.Skin(corners, look, by_corner, name, np.ones(len(triangles), bool))


def textured(triangles: Array, uvs: Array, texture: Any) -> Any:
    surface = looks.Surface(looks.ImageColor(texture, "UVMap"), source="the image")
    by_corner = uvs[triangles.reshape(-1)].astype(np.float32)
    corners = np.zeros(3 * len(triangles), np.int64)
    return looks.Look((surface,), corners, {"UVMap": by_corner}, {})


def ramp(size: int) -> Any:
    """An image whose red is u and green is v."""
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    values = np.stack([u, v, np.full_like(u, 0.5), np.ones_like(u)], axis=-1)
    return textures.Texture("ramp", values.astype(np.float32))


def swirl(positions: Array) -> Array:
    """A map of the sheet onto itself."""
    x, y = positions[:, 0], positions[:, 1]
    bump = 0.15 * np.sin(np.pi * x) * np.sin(np.pi * y)
    return np.column_stack([x + bump, y - 0.8 * bump, np.zeros_like(x)]).astype(np.float32)


@pytest.mark.parametrize("with_uvs", [True, False])
def test_colors_go_along_the_map(with_uvs: bool) -> None:
    positions, triangles, uvs = grid(40)
    target, target_faces, target_uvs = grid(31)
    model = look_transfer.Model(
        target,
        target_faces,
        skin_of(target_faces, None, textured(target_faces, target_uvs, ramp(256))),
        None,
    )
    canvas = look_transfer.Canvas(
        triangles, skin_of(triangles, 0.1 + 0.8 * uvs if with_uvs else None, None), swirl(positions)
    )
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(512), go_on)
    assert (drawn.uvs is None) == with_uvs
    assert bool(drawn.remarks) != with_uvs
    # Wherever one looks on the source's surface, there is the target's color.
    rng = np.random.default_rng(3)
    rows = rng.integers(0, len(triangles), 2000)
    shares = rng.dirichlet((1, 1, 1), 2000)
    corners = canvas.skin.corners[rows]
    layout = canvas.skin.uvs if with_uvs else drawn.uvs
    seen = textures.sample(
        textures.Texture("", drawn.color), np.einsum("tk,tkc->tc", shares, layout[corners])
    )
    places = np.einsum("tk,tkc->tc", shares, canvas.places[triangles[rows]])
    inside = ((places[:, :2] > 0.01) & (places[:, :2] < 0.99)).all(axis=1)
    np.testing.assert_allclose(seen[inside, :2], places[inside, :2], atol=0.012)
    assert np.abs(seen[inside, :2] - places[inside, :2]).mean() < 2e-3
    np.testing.assert_allclose(seen[:, 2:], np.broadcast_to((0.5, 1.0), (2000, 2)), atol=1e-5)
    assert drawn.mean[2:] == pytest.approx((0.5, 1.0), abs=1e-5)


def test_two_materials_meet_where_they_do_on_the_target() -> None:
    positions, triangles, uvs = grid(30)
    target, faces, _ = grid(21)
    surfaces = tuple(
        looks.Surface(looks.Constant(color), roughness=looks.Constant((rough,) * 3 + (1.0,)))
        for color, rough in (((1, 0, 0, 1), 0.2), ((0, 0, 1, 1), 0.9))
    )
    right = target[faces].mean(axis=1)[:, 0] > 0.5
    look = looks.Look(surfaces, np.repeat(right.astype(int), 3), {}, {})
    model = look_transfer.Model(target, faces, skin_of(faces, None, look), None)
    canvas = look_transfer.Canvas(triangles, skin_of(triangles, uvs, None), swirl(positions))
    options = look_transfer.Options(256, roughness=True)
    drawn = look_transfer.draw(canvas, model, options, go_on)
    at = textures.sample(textures.Texture("", drawn.color), uvs.astype(np.float32), "EXTEND")
    places = canvas.places[:, 0]
    clear = np.abs(places - 0.5) > 0.04
    wanted = np.where(places[:, None] > 0.5, (0, 0, 1), (1, 0, 0))
    np.testing.assert_allclose(at[clear, :3], wanted[clear], atol=1e-5)
    assert set(np.round(np.unique(drawn.roughness[:, 10]), 3)) == {np.float32(0.2)}
    # Without an image of it, roughness is that of most faces.
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(64), go_on)
    assert drawn.roughness in (pytest.approx(0.2), pytest.approx(0.9))


def test_what_is_plain_needs_no_image() -> None:
    positions, triangles, uvs = grid(5)
    look = looks.Look(
        (looks.Surface(looks.Constant((0.1, 0.2, 0.3, 1)), looks.Constant((0.5,) * 4)),),
        np.zeros(3 * len(triangles), int),
        {},
        {},
    )
    model = look_transfer.Model(positions, triangles, skin_of(triangles, uvs, look), None)
    canvas = look_transfer.Canvas(triangles, skin_of(triangles, uvs, None), positions)
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(), go_on)
    assert not drawn.has_images
    assert drawn.color == (0.1, 0.2, 0.3, 0.5)
    assert not look_transfer.is_worth_it(model.skin, model)
    assert not look_transfer.is_worth_it(canvas.skin, model)
    other = looks.Look((looks.PLAIN,), look.of_corners, {}, {})
    assert look_transfer.is_worth_it(skin_of(triangles, uvs, other), model)


def test_points_give_their_colors() -> None:
    positions, triangles, uvs = grid(12)
    points = np.random.default_rng(4).uniform(0, 1, (4000, 3)) * (1, 1, 0)
    colors = np.column_stack([points[:, :2], np.zeros(4000), np.ones(4000)])
    model = look_transfer.Model(points, None, None, colors)
    canvas = look_transfer.Canvas(triangles, skin_of(triangles, uvs, None), swirl(positions))
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(128), go_on)
    at = textures.sample(textures.Texture("", drawn.color), uvs.astype(np.float32), "EXTEND")
    np.testing.assert_allclose(at[:, :2], canvas.places[:, :2], atol=0.05)


def test_drawing_can_be_canceled() -> None:
    positions, triangles, uvs = grid(5)
    look = textured(triangles, uvs, ramp(8))
    model = look_transfer.Model(positions, triangles, skin_of(triangles, uvs, look), None)
    canvas = look_transfer.Canvas(triangles, skin_of(triangles, uvs, None), positions)
    with pytest.raises(pointmorph.Cancelled):
        look_transfer.draw(canvas, model, look_transfer.Options(64), lambda *_: False)


def test_a_fine_texture_is_not_drawn_pixel_by_pixel() -> None:
    """What lies between the pixels of a coarse image counts as well: a fine checker is gray."""
    positions, triangles, uvs = grid(5)
    board = (np.indices((512, 512)).sum(axis=0) % 2).astype(np.float32)
    texture = textures.Texture("", np.stack([board] * 3 + [np.ones_like(board)], axis=-1))
    look = textured(triangles, uvs, texture)
    model = look_transfer.Model(positions, triangles, skin_of(triangles, uvs, look), None)
    canvas = look_transfer.Canvas(triangles, skin_of(triangles, uvs, None), positions)
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(64), go_on)
    assert np.ptp(drawn.color[..., 0]) < 0.05
    assert drawn.color[..., 0].mean() == pytest.approx(0.5, abs=0.01)


# --- Normals --------------------------------------------------------------------------------------


def test_tangent_space_there_and_back() -> None:
    positions, triangles, uvs = grid(15, 0.4)
    normals = np.repeat([[0.0, 0.0, 1.0]], len(positions), axis=0)[triangles]
    mirrored = uvs * (-1, 1)
    for layout in (uvs, mirrored):
        frames = tangents.frames_of_corners(positions, triangles, normals, layout[triangles])
        rows = np.arange(len(triangles))
        shares = np.full((len(rows), 3), 1 / 3)
        bent = np.random.default_rng(5).normal(size=(len(rows), 3)) * 0.3 + (0, 0, 1)
        bent /= np.linalg.norm(bent, axis=1, keepdims=True)
        world = tangents.from_tangent_space(frames, rows, shares, bent)
        found = 2.0 * tangents.to_tangent_space(frames, rows, shares, world) - 1.0
        np.testing.assert_allclose(found, bent, atol=1e-5)
    along, across, up = frames.at(rows, shares)
    np.testing.assert_allclose(along[:, 0] < -0.5, True)  # U runs against x
    np.testing.assert_allclose(across[:, 1] > 0.5, True)
    np.testing.assert_allclose(up, [[0, 0, 1]] * len(rows), atol=1e-12)


def test_a_bumpy_target_is_drawn_as_normals() -> None:
    """A flat sheet that becomes a wavy one of the same outline, by few faces."""
    positions, triangles, uvs = grid(2)
    target, faces, _ = grid(60, 0.2)
    look = looks.Look((looks.PLAIN,), np.zeros(3 * len(faces), int), {}, {})
    normals = pointmorph.meshes.vertex_normals(target, faces)
    skin = look_transfer.Skin(
        np.arange(3 * len(faces)).reshape(-1, 3),
        look,
        None,
        "",
        np.ones(len(faces), bool),
        normals[faces.reshape(-1)],
    )
    model = look_transfer.Model(target, faces, skin, None)
    canvas = look_transfer.Canvas(triangles, skin_of(triangles, uvs, None), positions)
    drawn = look_transfer.draw(canvas, model, look_transfer.Options(64, normal=True), go_on)
    # On a flat sheet with U along x and V along y, tangent space is space.
    u, v = (np.arange(64) + 0.5) / 64, (np.arange(64) + 0.5) / 64
    u, v = np.meshgrid(u, v)
    slope = np.stack(
        [
            -0.6 * np.cos(3 * u) * np.cos(2 * v),
            0.4 * np.sin(3 * u) * np.sin(2 * v),
            np.ones_like(u),
        ],
        axis=-1,
    )
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    found = 2.0 * drawn.normal - 1.0
    apart = np.degrees(np.arccos(np.clip((found * slope).sum(axis=-1), -1, 1)))
    assert np.percentile(apart, 90) < 8.0  # the closest place isn't the one straight above


def test_normals_go_along_with_the_triangles_that_they_are_on() -> None:
    """Those of a bent model, as what turns and stretches each of its faces."""
    transforms = load("transforms")
    rng = np.random.default_rng(4)
    triangles = rng.normal(size=(40, 3, 3)).astype(np.float32)
    normals = rng.normal(size=(40, 3, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = transforms.move_along(triangles, 3 * triangles @ turn.T + 1, normals)
    np.testing.assert_allclose(turned, normals @ turn.T, atol=1e-5)

    def up(corners: Array) -> Array:
        found = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return found[:, None] / np.linalg.norm(found, axis=1)[:, None, None]

    stretched = triangles @ np.array([[2, 1, 0], [0, 1, 0], [0, 0.5, 0.3]])
    moved = transforms.move_along(triangles, stretched, np.repeat(up(triangles), 3, axis=1))
    np.testing.assert_allclose(moved, np.repeat(up(stretched), 3, axis=1), atol=1e-5)

    triangles[0] = 0.0
    kept = transforms.move_along(triangles, stretched, normals)
    np.testing.assert_allclose(kept[0], normals[0], atol=1e-6)
    assert np.isfinite(kept).all()
