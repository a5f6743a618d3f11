"""What became of many morphs: a table, and a page with pictures."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pointmorph.base.errors import PointmorphError
from pointmorph.batch import thumbnails
from pointmorph.batch.jobs import MORPH, PICTURES, REPORT, Batch
from pointmorph.batch.runs import DONE, FAILED, KEPT, PairOutcome
from pointmorph.morphs.quality import percent
from pointmorph.morphs.run_words import advice_lines
from pointmorph.morphs.stored_morphs import open_morph
from pointmorph.storage import files

PAGE, TABLE = "index.html", "batch.json"
_COLUMNS = ("pair", "state", "seconds", "pairs", "covered", "folded", "mesh")

_STYLE = """
 body { font: 15px/1.4 system-ui, sans-serif; margin: 2rem; color: #222; background: #fff }
 table { border-collapse: collapse; width: 100% }
 th, td { text-align: left; padding: .4rem .7rem; border-bottom: 1px solid #ddd }
 th, td { vertical-align: top }
 .n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums }
 img { display: block; max-width: 100%; border-radius: 4px }
 .failed { color: #a11 } .pending { color: #777 }
"""


def summary(outcomes: Sequence[PairOutcome]) -> str:
    """How many are done, in words."""
    count = {state: sum(o.state == state for o in outcomes) for state in (DONE, KEPT, FAILED)}
    words = f"{count[DONE]} morphed, {count[KEPT]} already done, {count[FAILED]} failed"
    pending = len(outcomes) - sum(count.values())
    return f"{words}, {pending} to do" if pending else words


def rows(outcomes: Sequence[PairOutcome]) -> list[dict[str, Any]]:
    """For each pair what `batch.json` has: names, state, time, and figures of its report."""
    return [{**_figures(outcome), **_about(outcome)} for outcome in outcomes]


def _about(outcome: PairOutcome) -> dict[str, Any]:
    job = outcome.job
    about = {
        "pair": job.name, "state": outcome.state, "message": outcome.message,
        "source": str(job.source), "target": str(job.target), "folder": str(job.folder),
    }  # fmt: skip
    return {**about, "run_seconds": round(outcome.seconds, 3)}


def _figures(outcome: PairOutcome) -> dict[str, Any]:
    """From the report that the pair's morph has left."""
    if outcome.state not in (DONE, KEPT):
        return {}
    try:
        report = json.loads((outcome.job.folder / REPORT).read_text(encoding="utf-8"))
        both = report["quality"].values()
        names = (outcome.job.source.stem, outcome.job.target.stem)
        mesh = report.get("mesh") or {}
        return {
            "seconds": round(float(report["seconds"]), 3),
            "pairs": int(report["pairs"]),
            "memory": int(report["peak_memory_bytes"]),
            "covered": min(one["coverage"] for one in both),
            "folded": mesh.get("folded", max(one["flipped"] for one in both)),
            "mesh": mesh.get("grade"),
            "verdict": mesh.get("verdict"),
            "warnings": report["warnings"],
            "advice": _advice(report, names),
        }
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _advice(report: dict[str, Any], names: tuple[str, str]) -> list[str]:
    """Nothing where another version's report has something else there: figures are worth more."""
    try:
        return advice_lines(report, None, names, "pointmorph morph --mesh source --denser")
    except (AttributeError, KeyError, TypeError, ValueError):
        return []


def table(found: Sequence[dict[str, Any]]) -> list[str]:
    """The pairs as lines of text."""
    cells = [list(_COLUMNS), *([_cell(row, column) for column in _COLUMNS] for row in found)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(_COLUMNS))]
    lines = [
        "  ".join(
            cell.ljust(width) if k < 2 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in cells
    ]
    return [*lines, *(f"{row['pair']}: {row['message']}" for row in found if row["message"])]


def _cell(row: dict[str, Any], column: str) -> str:
    value = row.get(column)
    if value is None:
        return ""
    if column in ("covered", "folded"):
        return percent(value)
    return f"{value:.2f}" if column == "seconds" else str(value)


def write(batch: Batch, outcomes: Sequence[PairOutcome]) -> list[dict[str, Any]]:
    """Writes `batch.json`, `index.html` and pictures, and returns the rows. Raises FileError."""
    found = rows(outcomes)
    files.make_folder(batch.out / PICTURES)
    for row, outcome in zip(found, outcomes, strict=True):
        path = batch.out / PICTURES / f"{outcome.job.name}.png"
        if outcome.state in (DONE, KEPT) and _draw(outcome, path, batch.up):
            row["picture"] = f"{PICTURES}/{path.name}"
    content = {"jobs": str(batch.path), "pairs": found}
    files.write_bytes(batch.out / TABLE, (json.dumps(content, indent=1) + "\n").encode())
    files.write_bytes(batch.out / PAGE, _page(batch, outcomes, found).encode())
    return found


def _draw(outcome: PairOutcome, path: Path, up: str) -> bool:
    """Whether the pair has a picture; one that is younger than the morph is kept."""
    file = outcome.job.folder / MORPH
    try:
        if path.is_file() and path.stat().st_mtime_ns > file.stat().st_mtime_ns:
            return True
        film = thumbnails.film(open_morph(file), up=up)
    except (PointmorphError, OSError):
        return False
    files.write_bytes(path, thumbnails.png(film))
    return True


def _page(batch: Batch, outcomes: Sequence[PairOutcome], found: Sequence[dict[str, Any]]) -> str:
    title = html.escape(batch.path.stem)
    heads = "".join(f'<th class="{"n" if k > 1 else ""}">{c}</th>' for k, c in enumerate(_COLUMNS))
    body = "\n".join(_line(row) for row in found)
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style>
<h1>{title}</h1><p>{html.escape(summary(outcomes))}.</p>
<table><thead><tr>{heads}<th>preview</th></tr></thead><tbody>
{body}
</tbody></table></html>
"""


def _line(row: dict[str, Any]) -> str:
    cells = "".join(
        f'<td class="{"n" if k > 1 else row["state"]}">{html.escape(_cell(row, column))}</td>'
        for k, column in enumerate(_COLUMNS)
    )
    said = [row["message"], row.get("verdict"), *row.get("warnings", []), *row.get("advice", [])]
    words = "".join(f"<br>{html.escape(text)}" for text in said if text)
    picture = ""
    if "picture" in row:
        alt = html.escape(f"{row['pair']} from source to target")
        picture = f'<img src="{html.escape(row["picture"])}" alt="{alt}" loading="lazy">'
    return f"<tr>{cells}<td>{picture}{words.removeprefix('<br>')}</td></tr>"
