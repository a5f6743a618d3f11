"""What `build_addon.py bench` makes of what it has measured. No time is asserted."""

from __future__ import annotations

import json
import statistics
from pathlib import Path

import numpy as np
import pytest
from build_tools import benchmarks
from build_tools.benchmarks import Record, Row
from build_tools.running import SetupError
from pointmorph._pointmorph import nearest_neighbors
from unit_of_time import find_neighbors

LESS = Row("map", "a map", "U", 4.0)
MORE = Row("threads", "one thread over two", "times", 1.85, more_is_better=True)


def record(*values: float, code: str = "now", shapes: str = "bodies") -> Record:
    return {"values": list(values), "code": code, "shapes": shapes}


def test_a_row_is_slower_where_every_run_lies_beyond_all_runs_before() -> None:
    before = record(3.0, 3.1, 3.3)
    assert benchmarks.slower(LESS, record(3.5, 3.6, 4.0), before)
    assert not benchmarks.slower(LESS, record(3.2, 9.0, 9.0), before)
    assert not benchmarks.slower(LESS, record(3.31, 3.32, 3.33), before), "by less than noise"
    assert not benchmarks.slower(LESS, record(1.0, 1.1, 1.2), before)
    assert benchmarks.slower(MORE, record(1.5, 1.6, 1.7), record(1.8, 1.9, 2.0))
    assert not benchmarks.slower(MORE, record(2.1, 2.1, 2.1), record(1.8, 1.9, 2.0))


def test_few_runs_and_other_shapes_are_not_compared() -> None:
    before = record(3.0, 3.1, 3.3)
    assert not benchmarks.slower(LESS, record(9.0, 9.0), before)
    assert not benchmarks.slower(LESS, record(9.0, 9.0, 9.0, shapes="koalas"), before)


def test_a_line_says_median_spread_and_whether_the_limit_is_met() -> None:
    line = benchmarks.line_of(LESS, record(5.0, 3.0, 3.5), "now")
    assert line == "| a map | 3.50 U | 3.00 to 5.00 | 3 | bodies | ≤ 4 U | yes |"
    line = benchmarks.line_of(MORE, record(1.5), "now")
    assert line == "| one thread over two | 1.50 times | 1.50 | 1 | bodies | ≥ 1.85 times | no |"
    without = benchmarks.line_of(Row("x", "x", "s"), record(12.34), "now")
    assert without == "| x | 12.3 s | 12.3 | 1 | bodies |  |  |"


def test_a_row_older_than_the_code_is_marked() -> None:
    assert "(older than the code)" in benchmarks.line_of(LESS, record(1.0, code="then"), "now")
    assert "older" not in benchmarks.line_of(LESS, record(1.0), "now")


def test_rows_are_chosen_by_name() -> None:
    assert [m.name for m in benchmarks.chosen(["frame_rigid", "cut"], quick=False)] == [
        "cut",
        "frames",
    ]
    quick = benchmarks.chosen([], quick=True)
    assert {m.name for m in benchmarks.MEASUREMENTS} - {m.name for m in quick} >= {"map_5m"}
    with pytest.raises(SetupError, match="no such row: nothing"):
        benchmarks.chosen(["nothing"], quick=False)


def test_only_what_stands_between_the_marks_is_replaced() -> None:
    page = f"before\n{benchmarks.BEGIN}\nold\n{benchmarks.END}\nafter\n"
    new = benchmarks.page_with(page, "new")
    assert new == page.replace("old", "new")
    with pytest.raises(SetupError, match="expected"):
        benchmarks.page_with("no marks", "new")


def test_machines_of_a_kind_have_one_name() -> None:
    intel = "model\t\t: 143\nmodel name\t: Intel(R) Xeon(R) Processor @ 2.0GHz\n"
    assert benchmarks.machine_kind(intel, 2) == "intel_xeon_model_143_2_threads"
    assert benchmarks.machine_kind("", 8) == "unknown_8_threads"


def test_a_run_names_what_became_slower_and_keeps_the_rest(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = {"marks": record(3.0, 3.0, 3.0), "cut": record(1.5, 1.5, 1.5, code="then")}
    kind = benchmarks.this_machine()
    (tmp_path / f"{kind}.json").write_text(json.dumps(known))
    page = tmp_path / "page.md"
    page.write_text(f"{benchmarks.BEGIN}\n{benchmarks.END}\n")
    monkeypatch.setattr(benchmarks, "RECORDS", tmp_path)
    monkeypatch.setattr(benchmarks, "PAGE", page)
    monkeypatch.setattr(benchmarks.paths, "BUILD", tmp_path)
    code = benchmarks.code_digest()

    def measured(*command: object, environment: dict[str, str]) -> int:
        output = Path(str(command[-1]))
        values = {"marks": [4.0, 4.1, 4.2], "marks_seconds": [1.0, 1.0, 1.0]}
        output.write_text(json.dumps({"shapes": "bodies", "values": values}))
        return 0

    monkeypatch.setattr(benchmarks, "show", measured)
    assert benchmarks.bench(["marks"], quick=False, runs=3, keep=True) == 0
    assert "Slower: marks: 3.00 to 4.10 U" in capsys.readouterr().out
    kept = json.loads((tmp_path / f"{kind}.json").read_text())
    assert kept["marks"] == record(4.0, 4.1, 4.2, code=code)
    assert kept["cut"] == known["cut"]
    assert page.read_text().count("(older than the code)") == 1


def test_the_page_shows_the_records() -> None:
    page = benchmarks.PAGE.read_text(encoding="utf-8")
    code = page.split("Sources: `")[1].split("`")[0]
    assert benchmarks.page_with(page, benchmarks.section(benchmarks.kept(), code)) == page, (
        "run: python3 build_addon.py bench --keep"
    )


def test_records_are_of_rows_that_there_are() -> None:
    rows = {row.name for row in benchmarks.ROWS}
    for records in benchmarks.kept().values():
        assert set(records) <= rows
        assert all(statistics.median(found["values"]) > 0 for found in records.values())


def test_the_unit_of_time_finds_what_the_library_finds() -> None:
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.arange(9.0)] * 3), -1).reshape(-1, 3)  # ties everywhere
    for points in (rng.normal(size=(2000, 3)), grid):
        np.testing.assert_array_equal(find_neighbors(points), nearest_neighbors(points, 16))
