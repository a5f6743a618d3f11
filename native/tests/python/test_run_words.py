"""What the command line says about a result: each trouble once, in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pointmorph import _pointmorph
from pointmorph.morphs import run_words
from pointmorph.morphs.quality import percent
from pointmorph.morphs.verdicts import FAIR_MESH, GOOD_MESH, grade_of

NAMES = ("Fox", "Cat")
POSITIONS = np.array([[1.0, 2.0, 30.0], [-1.0, 2.0, 30.0], [0.25, -2.0, 1e-9], [0.0, 0.0, 0.0]])
BOTH = (POSITIONS, POSITIONS + np.array([100.0, 0.0, 0.0]))


def place(row: int, where: str, flaw: str = "", **values: Any) -> dict[str, Any]:
    return {"source": row, "target": row, "where": where, "flaw": flaw, "advice": where, **values}


def report(**parts: Any) -> dict[str, Any]:
    ways = {"source_to_target": {"flipped": 0.0, "coverage": 1.0}}
    return {"quality": ways, "worst": [], "doubtful": [], "likely_right": 0.9, **parts}


def mesh(grade: str, *worst: dict[str, Any]) -> dict[str, Any]:
    return {"grade": grade, "verdict": f"{grade.capitalize()}: so it is.", "worst": list(worst)}


def said(densify: str = "add --denser", **parts: Any) -> list[str]:
    return run_words.advice_lines(report(**parts), BOTH, NAMES, densify)


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
    doubtful = [place(0, "toward +X of Fox", confidence=0.1, unreached=True, side="source")]
    lost = [place(2, "toward -Y of Fox", "lost", side="source")]
    (line,) = said(doubtful=doubtful, worst=lost)
    assert line == (
        "Some parts of Fox have no counterpart on Cat. If they should have one, mark features on "
        "both models. On Fox: toward +X (at 1, 2, 30), toward -Y (at 0.2, -2, 0)"
    )


def test_what_only_the_target_has_is_not_the_sources() -> None:
    lost = [
        place(0, "toward +X, +Z of Fox", "lost", side="target"),
        place(1, "toward -X, +Z of Fox", "lost", side="target"),
        place(2, "toward -Y of Fox", "lost", side="source"),
    ]
    doubtful = [place(3, 'near "tail"', confidence=0.1, unreached=True, side="target")]
    assert said(doubtful=doubtful, worst=lost) == [
        "Some parts of Fox have no counterpart on Cat. If they should have one, mark features on "
        "both models. On Fox: toward -Y (at 0.2, -2, 0)",
        "Some parts of Cat have no counterpart on Fox. If they should have one, mark features on "
        'both models. Near these places of Fox: near "tail" (at 100, 0, 0 of Cat), '
        "toward ±X +Z (such as 101, 2, 30 of Cat)",
    ]


def test_places_of_older_reports_are_described_by_their_advice() -> None:
    def old(flaw: str, advice: str) -> dict[str, Any]:
        return {"source": 0, "target": 0, "flaw": flaw, "advice": advice}

    lost = "Toward +X of Fox a part of Cat has no counterpart on Fox (3 % of Cat): mark it"
    folded = 'At "nose" the map folds over itself (1 % of Fox): check that'
    worst = [old("lost", f"{lost}."), old("folded", f"{folded}."), old("folded", f"{folded}.")]
    doubtful = [{"source": 0, "target": 0, "confidence": 0.2, "advice": "On top it may be wrong."}]
    assert said(worst=worst, doubtful=doubtful) == ["On top it may be wrong", folded, lost]
    # It says where, but not of which model.
    (line,) = said(worst=[{**worst[0], "where": "toward +X of Fox"}])
    assert line == lost


def test_an_unknown_flaw_is_described_by_its_advice() -> None:
    torn = place(0, "toward +X of Fox", "torn") | {"advice": "Toward +X of Fox it is torn."}
    assert said(worst=[torn]) == ["Toward +X of Fox it is torn"]
    assert said(mesh=mesh("poor", torn)) == ["Toward +X of Fox it is torn"]


def test_names_of_features_are_kept() -> None:
    worst = [place(k, f'near "toe, {side}X"', "folded") for k, side in enumerate("+-")]
    (line,) = said(worst=worst)
    assert line.endswith('On Fox: near "toe, +X" (at 1, 2, 30), near "toe, -X" (at -1, 2, 30)')


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
        ({"quality": {"there": {"flipped": 0.23, "coverage": 1.0}}, "mesh": mesh("good")}, "good"),
        ({"worst": [place(0, "toward +X of Fox", "folded")]}, "fair"),
    ],
)
def test_the_grade_is_what_people_see(parts: dict[str, Any], grade: str) -> None:
    assert grade_of(report(**parts)) == grade
    assert run_words.verdict_line(report(**parts), NAMES).startswith(f"{grade.capitalize()}: ")


def test_advice_has_a_heading_that_goes_with_the_verdict() -> None:
    doubtful = [place(0, "toward +X of Fox", confidence=0.2, unreached=False)]
    good, fair = report(doubtful=doubtful, mesh=mesh("good")), report(doubtful=doubtful)
    assert run_words.listed_advice(good, []) == []
    assert run_words.listed_advice(good, ["a"]) == ["What could still be better:", "  - a"]
    two = run_words.listed_advice(fair, ["a", "b"])
    assert two == ["What would help, the most important first:", "  - a", "  - b"]


def test_shares_have_two_digits() -> None:
    shares = (0.0, 1e-6, 0.00034, 0.01, 0.0372, 0.0996, 0.45, 0.994, 1.0)
    written = ["0", "under 0.01", "0.034", "1", "3.7", "10", "45", "99", "100"]
    assert [percent(share) for share in shares] == [f"{text} %" for text in written]


def test_only_all_of_it_is_100_percent() -> None:
    shares = (0.995, 0.996, 0.99949, 0.9996, 0.9999, 0.999_99, 1 - 1e-12, 1.0)
    written = ["99.5", "99.6", "99.9", "99.96", "99.99", "over 99.99", "100", "100"]
    assert [percent(share) for share in shares] == [f"{text} %" for text in written]


def test_limits_of_meshes_are_those_that_grade_them() -> None:
    for limits, grade, beyond in ((GOOD_MESH, "good", "fair"), (FAIR_MESH, "fair", "poor")):
        assert _pointmorph.mesh_grade(**limits) == grade
        for figure, limit in limits.items():
            assert _pointmorph.mesh_grade(**limits | {figure: 1.001 * limit}) == beyond


def test_figures_are_aligned_and_explained() -> None:
    names = ("flipped", "coverage", "stretch_p99", "conformal_median", "collapsed")
    way = dict.fromkeys((*names, "round_trip_mean"), 0.001)
    given = report(quality={"there": way}, cracks={"0.5": 0.0}, feature_residual=0.0, features={})
    lines = run_words.figure_lines(given)
    assert not [line for line in lines if "Feature error" in line]  # there are none
    given |= {"features": {"nose": {}}, "feature_residual": 0.0023456}
    given["mesh"] = {"folded": 0.0, "creased": 0.0, "uncovered": 1e-5, "off": 0.123}
    lines = run_words.figure_lines(given)
    assert len({line.index(" %") for line in lines if " %  " in line}) == 1
    hints = [(line, run_words._HINTS[line[:18].strip()]) for line in lines]
    assert len({line.index(hint) for line, hint in hints}) == 1
    assert any(
        line.endswith("0.0023    spacings, before features are made to meet") for line in lines
    )
    assert any("up to 0.7 % can't be seen" in line for line in lines)
