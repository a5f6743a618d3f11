"""What the command line says about a result: each trouble once, in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pointmorph.morphs import run_words
from pointmorph.morphs.quality import percent
from pointmorph.morphs.verdicts import grade_of

NAMES = ("Fox", "Cat")
POSITIONS = np.array([[1.0, 2.0, 30.0], [-1.0, 2.0, 30.0], [0.25, -2.0, 1e-9], [0.0, 0.0, 0.0]])


def place(row: int, where: str, flaw: str = "", **values: Any) -> dict[str, Any]:
    return {"source": row, "target": row, "where": where, "flaw": flaw, "advice": where, **values}


def report(**parts: Any) -> dict[str, Any]:
    ways = {"source_to_target": {"flipped": 0.0, "coverage": 1.0}}
    return {"quality": ways, "worst": [], "doubtful": [], "likely_right": 0.9, **parts}


def mesh(grade: str, *worst: dict[str, Any]) -> dict[str, Any]:
    return {"grade": grade, "verdict": f"{grade.capitalize()}: so it is.", "worst": list(worst)}


def said(densify: str = "add --denser", **parts: Any) -> list[str]:
    return run_words.advice_lines(report(**parts), POSITIONS, NAMES, densify)


def test_a_kind_of_trouble_is_one_line_with_its_places() -> None:
    doubtful = [
        place(0, "toward +X, +Z of Fox", confidence=0.017, unreached=False),
        place(2, "toward -Y of Fox", confidence=0.2, unreached=False),
        place(0, "toward +X, +Z of Fox", confidence=0.3, unreached=False),
    ]
    assert said(doubtful=doubtful) == [
        "Mark features on both models where the map may be wrong. On Fox: "
        "toward +X +Z (at 1, 2, 30; 1.7 % sure), toward -Y (at 0.2, -2, 0; 20 % sure)"
    ]


def test_places_without_a_model_have_no_coordinates() -> None:
    doubtful = [place(0, "toward +X of Fox", confidence=0.2, unreached=False)]
    (line,) = run_words.advice_lines(report(doubtful=doubtful), None, NAMES, "")
    assert line.endswith("On Fox: toward +X (20 % sure)")


def test_mirrored_places_are_one() -> None:
    worst = [place(0, "toward +X, +Z of Fox", "folded"), place(1, "toward -X, +Z of Fox", "folded")]
    (line,) = said(worst=worst)
    assert line.endswith("On Fox: toward ±X +Z (such as 1, 2, 30)")
    four = [place(0, f"toward {x}X, {y}Y of Fox", "folded") for x in "+-" for y in "+-"]
    (line,) = said(worst=four)
    assert line.endswith("On Fox: toward ±X ±Y (such as 1, 2, 30)")


def test_at_most_three_places_are_named() -> None:
    worst = [place(3, f'near "{name}"', "stretched") for name in ("nose", "ear", "eye", "tail")]
    (line,) = said(worst=worst)
    assert line.startswith("Mark features on both models where Fox is stretched. On Fox: near")
    assert line.count("near") == 3
    assert line.endswith(", and 1 more place")
    assert said(worst=[*worst, place(3, "at the top", "stretched")])[0].endswith("2 more places")


def test_folds_and_creases_of_map_and_mesh_are_one_kind() -> None:
    faces = mesh(
        "poor", place(0, "toward +X of Fox", "creased"), place(1, "in the middle of Fox", "off")
    )
    lines = said(mesh=faces, worst=[place(2, "toward -Y of Fox", "folded")])
    assert len(lines) == 2
    assert "folds or creases. On Fox: toward +X (at 1, 2, 30), toward -Y (" in lines[0]
    assert lines[1].startswith("Mark features on both models where vertices lie off Cat.")


def test_too_few_vertices_name_what_adds_some() -> None:
    faces = mesh("poor", place(0, "toward +X of Fox", "uncovered"))
    (line,) = said(mesh=faces)
    assert "give it more vertices (add --denser)" in line
    assert said("", mesh=faces) == []


def test_what_nothing_comes_near_may_belong_nowhere() -> None:
    doubtful = [place(0, "toward +X of Fox", confidence=0.1, unreached=True)]
    lost = [place(2, "toward -Y of Fox", "lost")]
    (line,) = said(doubtful=doubtful, worst=lost)
    assert line.startswith("Some parts have no counterpart.")
    assert "sure" not in line
    assert "toward +X" in line
    assert "toward -Y" in line


def test_a_mark_that_is_bad_itself_is_to_be_checked() -> None:
    (line,) = said(worst=[place(0, 'at "nose"', "folded")])
    assert line.endswith(
        'at "nose" (at 1, 2, 30; check that this is the same place on both models)'
    )


@pytest.mark.parametrize(
    ("parts", "grade"),
    [
        ({}, "good"),
        ({"likely_right": 0.1}, "fair"),
        ({"mesh": mesh("good"), "likely_right": 0.1}, "fair"),
        ({"mesh": mesh("poor")}, "poor"),
        ({"quality": {"there": {"flipped": 0.03, "coverage": 1.0}}}, "poor"),
        ({"quality": {"there": {"flipped": 0.0, "coverage": 0.9}}, "mesh": mesh("good")}, "fair"),
        ({"worst": [place(0, "toward +X of Fox", "folded")]}, "fair"),
    ],
)
def test_the_grade_is_what_people_see(parts: dict[str, Any], grade: str) -> None:
    assert grade_of(report(**parts)) == grade
    assert run_words.verdict_line(report(**parts), NAMES).startswith(f"{grade.capitalize()}: ")


def test_shares_have_two_digits() -> None:
    shares = (0.0, 1e-6, 0.00034, 0.01, 0.0372, 0.0996, 0.45, 0.996, 1.0)
    written = ["0", "under 0.01", "0.034", "1", "3.7", "10", "45", "100", "100"]
    assert [percent(share) for share in shares] == [f"{text} %" for text in written]


def test_figures_are_aligned_and_explained() -> None:
    names = ("flipped", "coverage", "stretch_p99", "conformal_median", "collapsed")
    way = dict.fromkeys((*names, "round_trip_mean"), 0.001)
    given = report(quality={"there": way}, cracks={"0.5": 0.0}, feature_residual=0.0, features={})
    lines = run_words.figure_lines(given)
    assert not [line for line in lines if "Feature error" in line]  # there are none
    assert len({line.index(" %") for line in lines if " %  " in line}) == 1
    assert all(run_words._HINTS[line[:18].strip()] in line for line in lines)
