"""What holds for any two clouds and any settings: a morph with these properties, or words."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pointmorph
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from morph_cases import Case, cases

Test = Callable[..., None]


TIMES = int(os.environ.get("POINTMORPH_TIMES", "1"))
"""How many times the examples of a test; native/tests/long_runs/properties.py sets it."""


def drawn(count: int) -> Callable[[Test], Test]:
    """The same examples in every run, others with `TIMES`."""
    return settings(
        max_examples=count * TIMES,
        derandomize=TIMES == 1,
        database=None,
        deadline=None,
        phases=[Phase.explicit, Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )


def made(case: Case, **more: Any) -> pointmorph.Morph | None:
    """The morph, or nothing where it is refused in words."""
    try:
        return case.morph(**more)
    except pointmorph.PointmorphError as error:
        said = str(error)
        assert "expected" in said, said
        assert "found" in said, said
        assert "nan" not in said, said
        return None


def existing(case: Case, **more: Any) -> pointmorph.Morph:
    """The morph; other cases are left out."""
    morph = made(case, **more)
    assume(morph is not None)
    assert morph is not None
    return morph


def clouds(case: Case, change: Callable[[np.ndarray], np.ndarray]) -> Case:
    """The case with the points of both clouds changed; without normals and radii."""
    changed = [
        pointmorph.Cloud(change(cloud.positions), name=cloud.name)
        for cloud in (case.source, case.target)
    ]
    return replace(case, source=changed[0], target=changed[1])


def assert_same(a: pointmorph.Morph, b: pointmorph.Morph, unit: float = 1.0) -> None:
    """To the bit, but for the unit of length."""
    np.testing.assert_array_equal(a.pairs, b.pairs)
    np.testing.assert_array_equal(a.source_to_target * unit, b.source_to_target)
    np.testing.assert_array_equal(a.target_to_source * unit, b.target_to_source)
    np.testing.assert_array_equal(a.frame(0.4).positions * unit, b.frame(0.4).positions)


@given(cases())
@drawn(30)
def test_every_point_has_a_pair_and_every_number_is_finite(case: Case) -> None:
    morph = existing(case)
    for side, cloud in enumerate((case.source, case.target)):
        np.testing.assert_array_equal(np.unique(morph.pairs[:, side]), np.arange(len(cloud)))
    assert np.isfinite(morph.source_to_target).all()
    assert np.isfinite(morph.target_to_source).all()
    json.dumps(morph.report, allow_nan=False)
    frames = [morph.frame(t) for t in (0.0, 0.3, 0.5, 1.0)]
    frames += [morph.resampled_frame(t) for t in (0.0, 0.5, 1.0)]
    for frame in frames:
        for name in ("positions", "normals", "colors", "radii"):
            assert np.isfinite(getattr(frame, name)).all(), name
    for frame, cloud, side in ((frames[0], case.source, 0), (frames[3], case.target, 1)):
        rows = morph.pairs[:, side]
        ends = cloud.positions[rows].astype(frame.positions.dtype)
        np.testing.assert_array_equal(frame.positions, ends)


@given(cases(), st.integers(2, 5))
@drawn(10)
def test_threads_and_repeats_change_no_bit(case: Case, threads: int) -> None:
    first, again = made(case, threads=1), made(case, threads=threads)
    assert (first is None) == (again is None)
    if first is not None and again is not None:
        assert_same(first, again)


@given(cases(), st.sampled_from([2.0**-20, 2.0, 2.0**15]))
@drawn(10)
def test_units_of_length_change_nothing(case: Case, unit: float) -> None:
    def small(rows: np.ndarray) -> np.ndarray:
        return (rows / np.abs(rows).max()).astype(np.float32)

    here = clouds(case, small)
    there = clouds(case, lambda rows: small(rows) * np.float32(unit))
    case.settings.pop("mls_width", None)  # a length
    first, again = made(here), made(there)
    assert (first is None) == (again is None)
    if first is not None and again is not None:
        assert_same(first, again, unit)


@given(cases())
@drawn(10)
def test_a_run_from_an_earlier_map_keeps_its_marks(case: Case) -> None:
    assume(case.features)
    morph = existing(case, method="auto")
    again = case.morph(method="auto", start=morph)
    assert worst(again) <= 1.05 * worst(morph) + 0.05  # spacings


def worst(morph: pointmorph.Morph) -> float:
    """The largest distance of a mark's image from its place, in spacings."""
    return max((feature.residual for feature in morph.quality.features), default=0.0)


@given(cases(), st.floats(0, 1))
@drawn(8)
def test_a_kept_morph_makes_the_same_frames(case: Case, t: float) -> None:
    morph = existing(case)
    with tempfile.TemporaryDirectory() as folder:
        morph.save(Path(folder) / "a.morph")
        again = pointmorph.open_morph(Path(folder) / "a.morph")
        for name in ("positions", "normals", "colors", "radii"):
            here, there = getattr(morph.frame(t), name), getattr(again.frame(t), name)
            np.testing.assert_array_equal(here, there)
        del again  # Windows deletes no file that is open
