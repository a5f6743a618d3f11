"""The table of benchmarks: its rows and limits, what was measured before, and the page with it.

native/benchmarks/measure_row.py measures a row, in a process of its own, and writes what each run
took. What is kept lies in native/benchmarks/records, a file for each kind of machine.
"""

from __future__ import annotations

import json
import os
import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from . import paths
from .running import SetupError, child_environment, digest, say, show, step

FOLDER = paths.ROOT / "native" / "benchmarks"
RECORDS = FOLDER / "records"
PAGE = paths.ROOT / "docs" / "benchmarks.md"
PICTURE = paths.ROOT / "docs" / "images" / "bench_growth.png"
BEGIN, END = "<!-- bench: begin -->", "<!-- bench: end -->"

RUNS = 5
ENOUGH = 3
"""So many runs, now and before, before anything is called slower."""
APART = 1.03
"""The noise that remains where all runs of one kind lie beyond all of the other."""


class Record(TypedDict):
    """What came of a row."""

    values: list[float]
    """One for each run, in the row's own unit."""
    code: str
    """The digest of the sources that were measured."""
    shapes: str
    """What was morphed: only the same shapes are compared."""


@dataclass(frozen=True)
class Row:
    name: str
    what: str
    unit: str
    limit: float | None = None
    """None where nothing is asked for."""
    more_is_better: bool = False

    def met(self, values: Sequence[float]) -> bool | None:
        if self.limit is None:
            return None
        middle = statistics.median(values)
        return middle >= self.limit if self.more_is_better else middle <= self.limit


SIZES = {"map_10k": 10_000, "map_100k": 100_000, "map_1m": 1_000_000, "map_5m": 5_000_000}
"""Points of each of both clouds, of the rows that show how time grows."""


@dataclass(frozen=True)
class Measurement:
    """What one process measures: a row or several."""

    name: str
    rows: tuple[Row, ...]
    quick: bool = True
    """Whether it takes a minute or less."""


def _one(name: str, what: str, limit: float) -> Measurement:
    return Measurement(name, (Row(name, what, "U", limit),))


def _map(name: str, limit: float | None) -> Measurement:
    what = f"default, {SIZES[name]:,} points each, no marks"
    rows = (Row(name, what, "U", limit), Row(f"{name}_seconds", what, "s"))
    return Measurement(name, rows, quick=SIZES[name] <= 100_000)


def _command(name: str, points: str, limits: tuple[float, float]) -> Measurement:
    what = f"whole command, {points} points each, files in to files out"
    rows = (Row(name, what, "U", limits[0]), Row(f"{name}_memory", what, "GiB", limits[1]))
    return Measurement(name, rows, quick=False)


_PAPER = "`--method paper`, 98,250 / 84,348 points"
_OPERATOR = "`bpy.ops.pointmorph.morph()`, 98,250 / 84,348 vertices"
_FRAME = "to another frame in Blender, not drawn"
_THREADS = "one thread over two, 1,000,000 points each"
MEASUREMENTS = (
    _one("marks", "default, 98,250 / 84,348 points, eight marks", 4.0),
    _map("map_10k", None),
    _map("map_100k", 5.0),
    _map("map_1m", None),
    _map("map_5m", None),
    Measurement(
        "small",
        (
            Row("small", "default, 10,000 / 8,000 points, no marks, mean of three pairs", "U", 20),
            Row("small_most", "the same, the slowest of the pairs", "U", 40),
        ),
    ),
    _one("small_marks", "default, 10,000 / 8,000 points, eight marks, mean of three pairs", 9.0),
    _one("disk", f"{_PAPER}: disk", 1.8),
    _one("cut", f"{_PAPER}: cut", 2.0),
    _one("sphere", f"{_PAPER}: sphere", 2.5),
    _command("command_1m", "1,000,000", (9.0, 1.2)),
    _command("command_5m", "5,000,000", (12.0, 6.0)),
    Measurement("operator", (Row("operator", f"{_OPERATOR}, over the map alone", "times", 1.15),)),
    Measurement("threads", (Row("threads", f"{_THREADS}, map", "times", 1.85, True),), False),
    Measurement(
        "threads_command",
        (Row("threads_command", f"{_THREADS}, whole command", "times", 1.75, True),),
        quick=False,
    ),
    Measurement(
        "frames",
        (
            Row("frame_linear", "frame of 200,000 pairs, linear, of a copy", "%", 80, True),
            Row("frame_rigid", "frame of 200,000 pairs, rigid, of a copy", "%", 30, True),
        ),
    ),
    Measurement(
        "playback",
        (
            Row("playback_points", f"{_FRAME}, 161,000 points", "ms"),
            Row("playback_discs", f"{_FRAME}, 161,000 discs", "ms"),
            Row("playback_mesh", f"{_FRAME}, a mesh of 49,999 vertices", "ms"),
        ),
    ),
    Measurement(
        "resampling",
        (
            Row("resampling", "re-sampling 171,000 pairs: preparation", "U", 3.0),
            Row("resampling_frame", "re-sampling 171,000 pairs: a frame", "U", 0.3),
        ),
    ),
)
ROWS = tuple(row for measurement in MEASUREMENTS for row in measurement.rows)

Records = dict[str, Record]


def machine_kind(cpuinfo: str, threads: int) -> str:
    """A name for machines whose times can be compared."""
    found = re.search(r"^model name\s*:\s*(.+)$", cpuinfo, re.MULTILINE)
    model = re.sub(r"\(R\)|\(TM\)|\bCPU\b|\bProcessor\b|@.*", " ", found[1] if found else "unknown")
    extra = re.search(r"^model\s*:\s*(\d+)$", cpuinfo, re.MULTILINE)
    words = [*model.split(), *([f"model {extra[1]}"] if extra else []), f"{threads} threads"]
    return re.sub(r"[^a-z0-9]+", "_", " ".join(words).lower()).strip("_")


def this_machine() -> str:
    try:
        cpuinfo = Path("/proc/cpuinfo").read_text()
    except OSError:
        cpuinfo = ""
    return machine_kind(cpuinfo, len(os.sched_getaffinity(0)))


def code_digest() -> str:
    """Of all that the times depend on."""
    native = [paths.ROOT / "native" / part for part in ("bindings", "include", "python", "src")]
    return digest(*native, paths.ROOT / "CMakeLists.txt")[:12]


def chosen(names: Sequence[str], quick: bool) -> list[Measurement]:
    """What to measure for some rows; without any, all or what is quick."""
    known = {m.name for m in MEASUREMENTS} | {row.name for row in ROWS}
    if unknown := sorted(set(names) - known):
        words = ", ".join(m.name for m in MEASUREMENTS)
        raise SetupError(f"bench: no such row: {', '.join(unknown)}. Rows: {words}")
    wanted = set(names)
    return [
        m
        for m in MEASUREMENTS
        if (wanted & {m.name, *(row.name for row in m.rows)} if names else m.quick or not quick)
    ]


def slower(row: Row, now: Record, before: Record) -> bool:
    """Whether a row has become slower by more than noise: every run lies beyond all runs before."""
    few = min(len(now["values"]), len(before["values"])) < ENOUGH
    if few or now["shapes"] != before["shapes"]:
        return False
    if row.more_is_better:
        return max(now["values"]) * APART < min(before["values"])
    return min(now["values"]) > max(before["values"]) * APART


def figure(value: float, unit: str) -> str:
    decimals = 0 if unit == "%" or value >= 100 else 1 if value >= 10 else 2
    return f"{value:.{decimals}f}"


def line_of(row: Row, record: Record, code: str) -> str:
    """A row of the table, marked where the code has changed since."""
    values = record["values"]
    middle, *ends = (figure(f(values), row.unit) for f in (statistics.median, min, max))
    limit, met = "", ""
    if row.limit is not None:
        limit = f"{'≥' if row.more_is_better else '≤'} {row.limit:g} {row.unit}"
        met = "yes" if row.met(values) else "no"
    spread = " to ".join(dict.fromkeys(ends))
    old = "" if record["code"] == code else " (older than the code)"
    cells = (
        f"{row.what}{old}",
        f"{middle} {row.unit}",
        spread,
        str(len(values)),
        record["shapes"],
        limit,
        met,
    )
    return f"| {' | '.join(cells)} |"


HEADER = ("what", "median", "least to most", "runs", "shapes", "limit", "met")


def table(records: Mapping[str, Record], code: str) -> list[str]:
    """The table of what has been measured."""
    lines = ["| " + " | ".join(HEADER) + " |", "|---" * len(HEADER) + "|"]
    return lines + [line_of(row, records[row.name], code) for row in ROWS if row.name in records]


def read(path: Path) -> Records:
    if not path.is_file():
        return {}
    content: Records = json.loads(path.read_text(encoding="utf-8"))
    return content


def section(kinds: Mapping[str, Records], code: str) -> str:
    """What stands between the marks of the page: a table for each kind of machine."""
    parts = [f"Sources: `{code}`."]
    for kind, records in sorted(kinds.items()):
        parts.append(f"`{kind}`:")
        parts.append("\n".join(table(records, code)))
    return "\n\n".join(parts)


def page_with(page: str, part: str) -> str:
    """The page with another part between its marks."""
    before, found, rest = page.partition(BEGIN)
    _, ends, after = rest.partition(END)
    if not found or not ends:
        raise SetupError(f"{PAGE.name}: expected {BEGIN} and {END}. Put them where the table goes.")
    return f"{before}{BEGIN}\n{part}\n{END}{after}"


def kept() -> dict[str, Records]:
    """All records that are committed, by kind of machine."""
    return {path.stem: read(path) for path in sorted(RECORDS.glob("*.json"))}


def measure(measurements: Iterable[Measurement], runs: int, code: str, folder: Path) -> Records:
    """Measures anew; what fails is named, and left as it was."""
    found: Records = {}
    folder.mkdir(parents=True, exist_ok=True)
    environment = child_environment(PYTHONPATH=str(paths.ROOT / "native"))
    for measurement in measurements:
        output = folder / f"{measurement.name}.json"
        output.unlink(missing_ok=True)
        command = (paths.PYTHON, FOLDER / "measure_row.py", measurement.name)
        with step(measurement.name):
            status = show(*command, "--runs", str(runs), "--json", output, environment=environment)
        if status != 0 or not output.is_file():
            say(f"{measurement.name}: not measured, status {status}")
            continue
        content = json.loads(output.read_text(encoding="utf-8"))
        for row in measurement.rows:
            values = content["values"][row.name]
            found[row.name] = {"values": values, "code": code, "shapes": content["shapes"]}
    return found


def bench(names: Sequence[str], quick: bool, runs: int | None, keep: bool) -> int:
    """Measures rows, prints the table, and names what has become slower; `keep` writes the page."""
    measurements = chosen(names, quick)
    code, kind = code_digest(), this_machine()
    folder = paths.BUILD / "bench"
    found = measure(measurements, runs or (ENOUGH if quick else RUNS), code, folder)
    before = kept().get(kind, {})
    say("\n".join(table({**before, **found}, code)))
    for row in ROWS:
        if (
            row.name in found
            and row.name in before
            and slower(row, found[row.name], before[row.name])
        ):
            was, now = (statistics.median(r[row.name]["values"]) for r in (before, found))
            say(
                f"Slower: {row.name}: {figure(was, row.unit)} to {figure(now, row.unit)} {row.unit}"
            )
    records = {**before, **found}
    (folder / f"{kind}.json").write_text(_text(records), encoding="utf-8")
    status = draw(folder / f"{kind}.json", PICTURE if keep else folder / PICTURE.name)
    if keep:
        RECORDS.mkdir(exist_ok=True)
        (RECORDS / f"{kind}.json").write_text(_text(records), encoding="utf-8")
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(page_with(page, section(kept(), code)), encoding="utf-8")
    expected = {row.name for measurement in measurements for row in measurement.rows}
    return status or int(expected != set(found))


def draw(records: Path, picture: Path) -> int:
    """How the time grows, where it was measured at two sizes or more."""
    if len([name for name in SIZES if f"{name}_seconds" in read(records)]) < 2:
        return 0
    environment = child_environment(PYTHONPATH=str(paths.ROOT / "native"))
    return show(paths.PYTHON, FOLDER / "draw_growth.py", records, picture, environment=environment)


def _text(records: Records) -> str:
    rows = [f" {json.dumps(name)}: {json.dumps(records[name])}" for name in sorted(records)]
    return "{\n" + ",\n".join(rows) + "\n}\n"
