"""The package against what the library promises."""

from __future__ import annotations

import functools
import json
import pickle
import threading
import time

import numpy as np
import pointmorph
import pytest
from pointmorph import formats
from shapes import grid, torus

A, B = 37, 29
"""Points along a side of the plane and of the bump that most tests share."""


def row(side: int, x: float, y: float) -> int:
    return round((x + 1) / 2 * (side - 1)) * side + round((y + 1) / 2 * (side - 1))


def features(a: int, b: int) -> dict[str, tuple[int, int]]:
    places = {"middle": (0, 0), "north": (0.5, 0.5), "west": (-0.5, 0.5), "south": (0.5, -0.3)}
    return {name: (row(a, *place), row(b, *place)) for name, place in places.items()}


@pytest.fixture(scope="module")
def morph() -> pointmorph.Morph:
    rng = np.random.default_rng(0)
    source = pointmorph.Cloud(
        grid(A), colors=rng.random((A * A, 4), np.float32), radii=np.full(A * A, 0.1), name="plane"
    )
    target = pointmorph.Cloud(
        grid(B, 0.8),
        colors=rng.random((B * B, 4), np.float32),
        radii=np.full(B * B, 0.2),
        name="bump",
    )
    return pointmorph.morph(source, target, features(A, B), path="linear")


def test_pairs_cover_both_clouds(morph: pointmorph.Morph) -> None:
    assert morph.pairs.dtype == np.int64
    assert set(morph.pairs[:, 0]) == set(range(A * A))
    assert set(morph.pairs[:, 1]) == set(range(B * B))
    assert len(np.unique(morph.pairs, axis=0)) == len(morph.pairs)
    pairs = {tuple(pair) for pair in morph.pairs.tolist()}
    assert all(pair in pairs for pair in features(A, B).values())


def test_settings_that_are_said_to_change_no_pair_change_none(morph: pointmorph.Morph) -> None:
    def other(option: pointmorph.Option) -> object:
        values = option.choices or (option.minimum, option.maximum)
        return next(value for value in values[::-1] if value != option.default)

    settings = {
        option.name: other(option)
        for option in pointmorph.options()
        if option.affects != "map" or not option.is_used("auto", "auto")
    }
    assert {"threads", "path", "omega", "solve", "influence"} <= set(settings)
    settings["threads"] = 2
    settings["stagger"] = "noise"  # which needs no delays
    again = pointmorph.morph(morph.source, morph.target, features(A, B), **settings)
    np.testing.assert_array_equal(again.pairs, morph.pairs)
    np.testing.assert_array_equal(again.source_to_target, morph.source_to_target)


def test_frames_that_were_announced_are_the_same(morph: pointmorph.Morph) -> None:
    clouds, marks = (morph.source, morph.target), features(A, B)
    plain = pointmorph.morph(*clouds, marks, path="rigid")
    announced = pointmorph.morph(*clouds, marks, path="rigid", frames=True, threads=2)
    np.testing.assert_array_equal(announced.pairs, plain.pairs)
    for t in (0.3, 0.7):
        one, other = plain.frame(t), announced.frame(t)
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.normals, other.normals)


def test_starts_from_an_earlier_morph(morph: pointmorph.Morph) -> None:
    stages: list[str] = []
    marks = {**features(A, B), "east": (row(A, 0.9, 0), row(B, 0.9, 0))}
    del marks["middle"]
    again = pointmorph.morph(
        morph.source, morph.target, marks, start=morph, progress=lambda s, f: stages.append(s)
    )
    assert "pose" not in stages
    assert np.linalg.norm(again.source_to_target - morph.source_to_target, axis=1).mean() < 0.1
    with pytest.raises(pointmorph.CloudError, match="start"):
        pointmorph.morph(morph.target, morph.source, start=morph)
    with pytest.raises(pointmorph.CloudError, match="start"):
        pointmorph.morph(morph.source, morph.target, start=(np.zeros((4, 2)), np.zeros(3)))


def test_a_start_that_the_domain_cannot_use_is_mentioned(morph: pointmorph.Morph) -> None:
    marks = features(A, B)
    again = pointmorph.morph(morph.source, morph.target, marks, domain="disk", start=morph)
    fresh = pointmorph.morph(morph.source, morph.target, marks, domain="disk")
    np.testing.assert_array_equal(again.pairs, fresh.pairs)
    assert [w for w in again.report["warnings"] if w not in fresh.report["warnings"]] == [
        "The earlier map was ignored: with domain disk the search starts in that domain. To "
        "continue from the map, use domain auto."
    ]


@functools.cache
def turned(path: str) -> tuple[pointmorph.Morph, np.ndarray]:
    """A bump turned by two radians, and by what matrix."""
    turn = np.array([[1.0, 0, 0], [0, np.cos(2), np.sin(2)], [0, -np.sin(2), np.cos(2)]])
    source = pointmorph.Cloud(grid(21, 0.8))
    target = pointmorph.Cloud(grid(21, 0.8) @ turn)
    marks = {name: (a, a) for name, (a, _) in features(21, 21).items()} | {"corner": (0, 0)}
    return pointmorph.morph(source, target, marks, path=path), turn


@pytest.mark.parametrize("path", ["similarity", "rigid"])
def test_a_turned_shape_does_not_shrink_on_other_paths(path: str) -> None:
    straight, turn = turned("linear")
    bent, _ = turned(path)

    def size(morph: pointmorph.Morph, t: float) -> float:
        rows = morph.frame(t).positions
        return float(np.linalg.norm(rows - rows.mean(axis=0)) / np.sqrt(len(rows)))

    assert size(straight, 0.5) < 0.9 * size(straight, 0)
    assert size(bent, 0.5) == pytest.approx(size(straight, 0), rel=0.02)
    source = straight.source
    rows = np.asarray(source.positions)
    motion = pointmorph.Motion(rows, np.tile([0.0, 0, 1], (len(rows), 1)), rows @ turn, path)
    assert np.array_equal(motion.at(0), rows)
    assert np.array_equal(motion.at(1), rows @ turn)
    half = motion.at(0.5)
    sizes = [np.linalg.norm(p - p.mean(axis=0)) for p in (rows, half)]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.01)
    with pytest.raises(pointmorph.OptionError):
        motion.at(1.5)


@pytest.mark.parametrize("t", [0, 1])
def test_ends_are_the_inputs_bit_for_bit(morph: pointmorph.Morph, t: int) -> None:
    cloud = (morph.source, morph.target)[t]
    frame = morph.frame(t)
    rows = morph.pairs[:, t]
    assert frame.positions.dtype == np.float32
    assert frame.positions.tobytes() == cloud.positions[rows].tobytes()
    assert frame.colors.tobytes() == cloud.colors[rows].tobytes()
    assert frame.radii.tobytes() == cloud.radii[rows].astype(np.float32).tobytes()


def test_between_is_linear_and_normals_have_length_one(morph: pointmorph.Morph) -> None:
    half, s, t = (morph.frame(x) for x in (0.5, 0, 1))
    np.testing.assert_allclose(half.positions, (s.positions + t.positions) / 2, atol=1e-6)
    np.testing.assert_allclose(half.colors, (s.colors + t.colors) / 2, atol=1e-6)
    np.testing.assert_allclose(half.radii, 0.15, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(half.normals, axis=1), 1, rtol=1e-5)


def test_frame_writes_into_the_callers_arrays(morph: pointmorph.Morph) -> None:
    out = morph.empty_frame()
    assert morph.frame(0.3, out=out) is out
    assert out.positions.tobytes() == morph.frame(0.3).positions.tobytes()


@pytest.mark.parametrize("t", [-0.1, 1.1, float("nan")])
def test_t_outside_the_path_is_refused(morph: pointmorph.Morph, t: float) -> None:
    with pytest.raises(pointmorph.OptionError):
        morph.frame(t)


def test_frame_of_another_type_is_refused(morph: pointmorph.Morph) -> None:
    wrong = pointmorph.Frame(*(a.astype(np.float64) for a in vars(morph.frame(0)).values()))
    with pytest.raises(pointmorph.OptionError, match="float32"):
        morph.frame(0.5, out=wrong)


def test_double_precision_stays_double() -> None:
    source = pointmorph.Cloud(grid(11, dtype=np.float64) + 1e6)
    target = pointmorph.Cloud(grid(11, 0.5, np.float64))
    morph = pointmorph.morph(source, target)
    assert morph.frame(0).positions.tobytes() == source.positions[morph.pairs[:, 0]].tobytes()
    assert morph.source_to_target.dtype == np.float64


def test_smooth_maps_lie_on_the_other_surface(morph: pointmorph.Morph) -> None:
    x, y, z = morph.source_to_target.T
    np.testing.assert_allclose(z, 0.8 * np.exp(-3 * (x**2 + y**2)), atol=2 / 32)
    assert np.abs(morph.target_to_source[:, 2]).max() < 1e-5


def test_report_tells_what_was_done(morph: pointmorph.Morph) -> None:
    report = morph.report
    for key in ("stages", "seconds", "peak_memory_bytes", "pairs", "feature_residual", "cracks"):
        assert key in report
    assert report["pairs"] == len(morph.pairs)
    assert sum(report["stages"].values()) <= report["seconds"] * 1.01
    assert 0 <= report["feature_residual"] <= 1e-3
    assert all(0 <= share < 0.01 for share in report["cracks"].values())
    assert report["options"]["pairing_cluster_size"] == 10


def test_quality_is_by_point_and_in_figures(morph: pointmorph.Morph) -> None:
    quality = morph.quality
    assert quality is morph.quality
    for points, n in ((quality.source, A * A), (quality.target, B * B)):
        assert points.stretch.shape == (n, 2)
        assert (points.stretch[:, 0] >= points.stretch[:, 1]).all()
        np.testing.assert_array_equal(points.area_ratio, points.stretch.prod(axis=1))
        for flags in (points.measured, points.flipped, points.reached):
            assert flags.shape == (n,)
            assert flags.dtype == np.bool_
        assert points.round_trip.shape == points.distortion.shape == (n,)
        assert (points.distortion >= 0).all()
    figures = quality.source_to_target
    assert figures.flipped == quality.source.flipped[quality.source.measured].mean()
    assert figures.coverage == quality.target.reached.mean()
    assert figures.round_trip_mean == pytest.approx(quality.source.round_trip.mean())
    assert figures.coverage > 0.98


def test_quality_sees_what_a_bump_does_to_a_plane(morph: pointmorph.Morph) -> None:
    # Straight above itself a plane is stretched along the slope alone, by √(1 + |∇z|²).
    x, y, _ = morph.source.positions.T.astype(np.float64)
    bump = 0.8 * np.exp(-3 * (x**2 + y**2))
    slope = np.sqrt(1 + (6 * bump) ** 2 * (x**2 + y**2))
    areas = np.sqrt(slope.mean())
    steep = (slope > 1.45) & morph.quality.source.measured
    ratio = morph.quality.source.stretch[:, 0] * areas / slope
    assert 0.8 < np.median(ratio[steep]) < 1.1  # the map gives a little of it to the flat parts
    flat = np.hypot(x, y) > 0.95
    assert np.median(morph.quality.source.distortion[flat]) < 0.3


def test_quality_in_the_report(morph: pointmorph.Morph) -> None:
    report = json.loads(json.dumps(morph.report))
    for way in ("source_to_target", "target_to_source"):
        assert report["quality"][way] == vars(getattr(morph.quality, way))
    assert report["worst"] == [vars(place) for place in morph.quality.worst]
    summary = dict(pointmorph.quality_summary(report))
    assert summary["Folded"].endswith("%")
    assert float(summary["Covered"].split()[0]) > 98


def test_the_advice_names_a_bad_mark() -> None:
    marks = {**features(31, 31), "wrong": (row(31, -0.6, -0.6), row(31, 0.2, -0.6))}
    morph = pointmorph.morph(pointmorph.Cloud(grid(31)), pointmorph.Cloud(grid(31)), marks)
    place = next(place for place in morph.quality.worst if '"wrong"' in place.advice)
    assert place.flaw in ("folded", "squeezed", "stretched", "lost")
    assert 0 < place.share < 0.2


def test_quality_can_be_stopped() -> None:
    again = pointmorph.morph(
        pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21, 0.8)), features(21, 21)
    )
    with pytest.raises(pointmorph.Cancelled):
        again.measure_quality(lambda stage, fraction: stage != "quality")
    assert again.quality.source.distortion.size == 441  # and can be asked for again


def test_inputs_may_have_any_layout() -> None:
    wide = np.asfortranarray(np.hstack([grid(11), grid(11)]))
    sliced = pointmorph.morph(pointmorph.Cloud(wide[:, :3]), pointmorph.Cloud(grid(11, 0.5)))
    dense = pointmorph.morph(pointmorph.Cloud(grid(11)), pointmorph.Cloud(grid(11, 0.5)))
    assert np.array_equal(sliced.pairs, dense.pairs)


def test_inputs_are_not_changed() -> None:
    positions = grid(11)
    positions.flags.writeable = False
    pointmorph.morph(pointmorph.Cloud(positions), pointmorph.Cloud(grid(11, 0.5)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"positions": np.zeros((5, 2))}, "(N, 3)"),
        ({"positions": np.zeros((5, 3)), "normals": np.zeros((4, 3))}, "each of 5 points"),
        ({"positions": np.zeros((5, 3)), "colors": np.zeros((5, 3))}, "(N, 4)"),
        ({"positions": np.array([["a", "b", "c"]])}, "numbers"),
        ({"positions": np.zeros((5, 3)), "boundary": [0.5]}, "list of rows"),
    ],
)
def test_arrays_of_another_shape_are_refused(arguments: dict, message: str) -> None:
    with pytest.raises(pointmorph.CloudError) as caught:
        pointmorph.Cloud(**arguments, name="Suzanne")
    assert message in str(caught.value)
    assert caught.value.subject == "Suzanne"


@pytest.mark.parametrize(
    "positions",
    [
        np.empty((0, 3), np.float32),
        np.zeros((100, 3), np.float32),
        np.linspace([0, 0, 0], [1, 2, 3], 100).astype(np.float32),
        np.where(np.arange(441 * 3).reshape(-1, 3) == 70, np.nan, grid(21)),
        np.where(np.arange(441 * 3).reshape(-1, 3) == 70, np.inf, grid(21)),
        grid(3),
    ],
)
def test_clouds_that_are_no_surface_are_refused(positions: np.ndarray) -> None:
    with pytest.raises(pointmorph.CloudError, match="Suzanne"):
        pointmorph.morph(pointmorph.Cloud(positions, name="Suzanne"), pointmorph.Cloud(grid(21)))


@pytest.mark.parametrize(
    "pair", [(0, 441), (-1, 0), (0.5, 1), ("a", 1), (1, 2, 3), None, (2**40, 0)]
)
def test_features_that_are_no_points_are_refused(pair: object) -> None:
    with pytest.raises(pointmorph.FeatureError, match='"nose"'):
        pointmorph.morph(pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21)), {"nose": pair})  # type: ignore[dict-item]


def test_a_loop_on_an_open_patch_is_refused() -> None:
    marks = features(21, 21)
    with pytest.raises(pointmorph.FeatureError, match="is open and needs no loop"):
        pointmorph.morph(
            pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21)), marks, loop=list(marks)
        )


@pytest.mark.parametrize(
    "loop", [["middle", "north"], ["middle", "north", "north"], ["a", "b", "c"]]
)
def test_bad_loops_are_refused(loop: list[str]) -> None:
    with pytest.raises(pointmorph.FeatureError, match="loop"):
        pointmorph.morph(
            pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21)), features(21, 21), loop=loop
        )


@pytest.mark.parametrize(
    ("name", "value"),
    [("influence", 0.1), ("method", "best"), ("sigma", 3), ("threads", True), ("threads", 10**30)],
)
def test_wrong_options_name_themselves(name: str, value: object) -> None:
    with pytest.raises(pointmorph.OptionError, match=name):
        pointmorph.morph(pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21)), **{name: value})


def test_every_option_says_what_it_is() -> None:
    source, target = pointmorph.Cloud(grid(11)), pointmorph.Cloud(grid(11, 0.3))
    marks = features(11, 11)
    start = pointmorph.morph(source, target, marks)  # so that the pose is searched for once
    for option in pointmorph.options():
        assert option.help
        assert option.kind in ("int", "float", "choice")
        pointmorph.morph(
            source,
            target,
            marks,
            start=start,
            **{option.name: option.default},
        )


def test_progress_runs_through_the_stages_and_cancels() -> None:
    seen: list[tuple[str, float]] = []
    source, target = pointmorph.Cloud(grid(9)), pointmorph.Cloud(grid(9, 0.5))
    pointmorph.morph(source, target, progress=lambda *call: seen.append(call))
    assert all(0 <= fraction <= 1 for _, fraction in seen)
    stages = list(dict.fromkeys(stage for stage, _ in seen))
    assert len(stages) >= 6
    for last in stages:
        with pytest.raises(pointmorph.Cancelled):
            pointmorph.morph(source, target, progress=lambda stage, _, last=last: stage != last)


def test_progress_never_falls_within_a_stage_of_the_same_name() -> None:
    """Handles were counted closely in a stage that had the name of the one before it."""
    seen: list[tuple[str, float]] = []
    tori = [pointmorph.Cloud(torus(tube, 60, 20)) for tube in (0.4, 0.3)]
    with pytest.raises(pointmorph.FeatureError, match="network"):
        pointmorph.morph(*tori, method="paper", progress=lambda *call: seen.append(call))
    for (stage, fraction), (before, last) in zip(seen[1:], seen, strict=False):
        assert stage != before or fraction >= last, stage
    assert "handles" in dict(seen)


def test_exceptions_of_the_progress_function_come_through() -> None:
    def fail(stage: str, fraction: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pointmorph.morph(pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21)), progress=fail)


def test_other_threads_run_during_a_morph() -> None:
    counter = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counter
        while not done.is_set():
            counter += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    start = time.perf_counter()
    pointmorph.morph(pointmorph.Cloud(grid(81)), pointmorph.Cloud(grid(81, 0.5)), features(81, 81))
    seconds = time.perf_counter() - start
    done.set()
    thread.join()
    assert counter > 20 * seconds  # a held GIL would give a handful


def test_errors_survive_pickling() -> None:
    error = pointmorph.CloudError("Suzanne", "points", "none", "Add some.")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "Suzanne: expected points, found none. Add some."
    assert (again.subject, again.advice) == ("Suzanne", "Add some.")


def test_real_patches(patch_pair: tuple) -> None:
    folder, marks = patch_pair
    source, target = (formats.read(folder / f"{side}.ply").cloud() for side in ("source", "target"))
    morph = pointmorph.morph(source, target, marks)
    for side, cloud in enumerate((source, target)):
        assert set(morph.pairs[:, side]) == set(range(len(cloud)))
        frame = morph.frame(side)
        assert frame.positions.tobytes() == cloud.positions[morph.pairs[:, side]].tobytes()
    pairs = {tuple(pair) for pair in morph.pairs.tolist()}
    assert all(pair in pairs for pair in marks.values())
    assert morph.report["feature_residual"] <= 1e-3
    image = morph.source_to_target
    assert np.isfinite(image).all()
    # the smooth map stays on the target: within a spacing of some point of it for nearly all
    reach = np.linalg.norm(image - target.positions[_first_partner(morph)], axis=1)
    assert np.median(reach) < 3 * np.median(morph.frame(1).radii)


def _first_partner(morph: pointmorph.Morph) -> np.ndarray:
    _, first = np.unique(morph.pairs[:, 0], return_index=True)
    return morph.pairs[first, 1]


@pytest.fixture(scope="module")
def torn() -> pointmorph.Morph:
    """A plane whose right half moves away: the frames between have a crack."""
    rng = np.random.default_rng(3)
    plane = grid(29)
    plane[:, :2] += rng.uniform(-0.005, 0.005, (841, 2))
    apart = plane + np.where(plane[:, :1] > 0, [[0.6, 0, 0]], 0.0)
    up = np.tile([0.0, 0, 1], (841, 1))
    color = np.column_stack([plane[:, 1] / 2.2 + 0.5, np.zeros((841, 2)), np.ones(841)])
    ends = [
        pointmorph.Cloud(rows.astype(np.float32), up, color.astype(np.float32), np.full(841, 0.07))
        for rows in (plane, apart)
    ]
    return pointmorph.morph(*ends, {str(i): (i, i) for i in range(0, 841, 30)})


def test_resampled_frames_close_cracks(torn: pointmorph.Morph) -> None:
    pairs = len(torn.pairs)
    for t in (0.0, 0.3, 0.55, 1.0):
        plain, frame = torn.frame(t), torn.resampled_frame(t)
        assert frame.positions.dtype == np.float32
        np.testing.assert_array_equal(frame.positions[:pairs], plain.positions)
        np.testing.assert_array_equal(frame.normals[:pairs], plain.normals)
        np.testing.assert_array_equal(frame.radii[:pairs], plain.radii)
        np.testing.assert_array_equal(frame.ids[:pairs], np.arange(pairs))
        assert np.all(np.diff(frame.ids) > 0)
        assert np.all(frame.radii >= 0)
        assert (len(frame.ids) == pairs) == (t in (0.0, 1.0))
        new = slice(pairs, None)
        np.testing.assert_allclose(frame.positions[new, 2], 0, atol=1e-4)
        # colours are those of the place: they change with y alone
        expected = frame.positions[new, 1] / 2.2 + 0.5
        np.testing.assert_allclose(frame.colors[new, 0], expected, atol=0.02)
        # where the point will be
        if 0 < t < 1:
            later = torn.resampled_frame(t + 1e-3)
            both, here, there = np.intersect1d(frame.ids, later.ids, return_indices=True)
            assert len(both) > pairs
            moved = (later.positions[there] - frame.positions[here]) / 1e-3
            assert np.abs(moved - frame.velocities[here]).max() < 0.05


@pytest.mark.parametrize("path", ["similarity", "rigid"])
def test_velocities_follow_bent_paths(path: str) -> None:
    turn = np.array([[1.0, 0, 0], [0, np.cos(1), np.sin(1)], [0, -np.sin(1), np.cos(1)]])
    source, target = pointmorph.Cloud(grid(21, 0.8)), pointmorph.Cloud(grid(21, 0.8) @ turn)
    marks = {name: (a, a) for name, (a, _) in features(21, 21).items()}
    result = pointmorph.morph(source, target, marks, path=path)
    pairs = len(result.pairs)
    step = 1e-4
    for t in (0.2, 0.7):
        before, after = result.frame(t - step).positions, result.frame(t + step).positions
        expected = (after - before) / (2 * step)
        velocities = result.resampled_frame(t).velocities[:pairs]
        assert np.abs(velocities - expected).max() < 1e-2 * np.abs(expected).max()


def test_frames_on_bent_paths_can_be_cancelled() -> None:
    again = pointmorph.morph(
        pointmorph.Cloud(grid(21)), pointmorph.Cloud(grid(21, 0.8)), path="rigid"
    )
    with pytest.raises(pointmorph.Cancelled):
        again.frame(0.5, progress=lambda stage, done: stage != "motion")
    stages: list[str] = []
    half_way = again.frame(0.5, progress=lambda stage, done: stages.append(stage)).positions
    assert "motion" in stages
    np.testing.assert_array_equal(again.frame(0.5).positions, half_way)


def test_resampled_frames_can_be_cancelled_and_check_t(torn: pointmorph.Morph) -> None:
    with pytest.raises(pointmorph.Cancelled):
        torn.resampled_frame(0.5, progress=lambda stage, done: False)
    with pytest.raises(pointmorph.OptionError, match="t"):
        torn.resampled_frame(1.5)


@pytest.mark.parametrize("path", ["linear", "rigid"])
def test_a_restored_morph_has_the_same_frames(path: str) -> None:
    turn = np.array([[1.0, 0, 0], [0, np.cos(1), np.sin(1)], [0, -np.sin(1), np.cos(1)]])
    marks = {name: (a, a) for name, (a, _) in features(21, 21).items()}
    result = pointmorph.morph(
        pointmorph.Cloud(grid(21, 0.8)), pointmorph.Cloud(grid(21, 0.8) @ turn), marks, path=path
    )
    ends = []
    for side, cloud in enumerate((result.source, result.target)):
        frame = result.frame(side)
        normals, radii = np.empty((441, 3)), np.empty(441)
        normals[result.pairs[:, side]] = frame.normals
        radii[result.pairs[:, side]] = frame.radii
        ends.append(pointmorph.Cloud(cloud.positions, normals, radii=radii))
    maps = result.source_to_target, result.target_to_source
    again = pointmorph.restore(*ends, result.pairs, maps, path=path)
    for t in (0.0, 0.4):
        for name in ("positions", "normals", "radii"):
            ours, theirs = (getattr(morph.frame(t), name) for morph in (again, result))
            np.testing.assert_allclose(ours, theirs, atol=1e-9)
    assert again.inserted() == result.inserted()
    without = pointmorph.restore(*ends, result.pairs, path=path).frame(0.4).positions
    np.testing.assert_allclose(without, result.frame(0.4).positions, atol=0.05)
    with pytest.raises(pointmorph.CloudError, match="every point in a pair"):
        pointmorph.restore(*ends, result.pairs[:-3])
    with pytest.raises(pointmorph.CloudError, match="row 441"):
        pointmorph.restore(*ends, np.vstack([result.pairs, [[441, 0]]]))
    with pytest.raises(pointmorph.CloudError, match="normals and radii"):
        pointmorph.restore(result.source, result.target, result.pairs)


def urchin(seed: int, turn: np.ndarray) -> tuple[pointmorph.Cloud, np.ndarray]:
    """A ball with four spikes of different lengths, and their ends."""
    spikes = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]])
    lengths = np.array([1.0, 0.6, 0.8, 0.7])
    ball = np.random.default_rng(seed).normal(size=(20000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    grown = 0.6 + np.exp((ball @ spikes.T - 1) / 0.05) @ lengths
    rows = pointmorph._pointmorph.blue_noise(ball * grown[:, None], None, 1500, [], None)
    positions = (ball * grown[:, None])[rows]
    ends = spikes * (0.6 + lengths)[:, None]
    return pointmorph.Cloud(positions @ turn.T, ball[rows] @ turn.T), ends @ turn.T


def test_proposals_are_the_same_spikes_of_both() -> None:
    c, s = np.cos(2.0), np.sin(2.0)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(
        [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    )
    (source, here), (target, there) = urchin(1, np.eye(3)), urchin(2, turn)
    proposals = pointmorph.propose_features(source, target)
    tips = [p for p in proposals if p.name.startswith("tip.")]
    assert [p.name for p in tips] == [f"tip.{k + 1}" for k in range(len(tips))]
    spikes = set()
    for tip in tips:
        from_ends = np.linalg.norm(here - source.positions[tip.source], axis=1)
        if from_ends.min() < 0.2:
            spikes.add(int(from_ends.argmin()))
            to_ends = np.linalg.norm(there - target.positions[tip.target], axis=1)
            assert to_ends.argmin() == from_ends.argmin()
    assert spikes == {0, 1, 2, 3}
    # A mark that was given isn't proposed again.
    given = {"longest": (tips[0].source, tips[0].target)}
    for other in pointmorph.propose_features(source, target, given):
        assert other.source != tips[0].source
        assert other.target != tips[0].target
        assert 0 <= other.confidence <= 1


def test_proposals_arent_for_the_papers_method() -> None:
    source, _ = urchin(1, np.eye(3))
    with pytest.raises(pointmorph.OptionError, match="paper"):
        pointmorph.propose_features(source, source, method="paper")
