"""Writes docs/reliability.md from the reports of the long runs in docs/reliability.

python docs/make_reliability.py
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "native" / "tests" / "python"))

from memory_bounds import BOUNDS  # noqa: E402

PAGE = HERE / "reliability.md"

BEGINNING = """\
# Reliability

What was tried to make Pointmorph break, how often, and what came of it. The scripts in
`native/tests/long_runs` try it; `docs/make_reliability.py` makes this page of their reports. Each
run of the tests repeats a small part: `test_properties.py`, `test_damaged_files.py`,
`test_stored_commands.py`, `test_memory.py`, the suite `farm`, and in Blender
`test_random_walk.py` and `test_stopped_bakes.py`.

## What holds

- *Any two shapes, any settings.* There is a morph, or words that say what was expected, what was
  found and what to do. In a morph every point has a pair, every number is finite, and the ends are
  the two shapes to the last bit. Threads, repeats and the unit of length change no bit.
- *Any damaged file.* It is read, or refused in words.
- *Any end.* A run that is killed, interrupted, out of disk or out of memory leaves every file whole
  or not there. The next run removes what a killed one has left half-written, and writes the same
  bytes as a run that was never stopped.
- *Any order of operations in Blender.* No traceback, nothing that runs on, and a file that is the
  same after it was saved and opened.
- *Any length of time.* Memory doesn't grow from morph to morph or from frame to frame. How
  much a morph takes at most is [below](#memory).

What can't be promised is listed at the [end](#what-isnt-tried).
"""

NONE = "-"
KINDS = {
    "any bytes": (
        "inputs that libFuzzer found, damaged: options, shapes, features, loops, saved morphs,"
        " transforms, whole morphs, previews; damaged files of every format, of batches, and saved"
        " morphs",
        "`fuzzing.py`, `damaged_files.py`",
        "ten million inputs of each kind: nine tenths of those in the"
        " [table](#any-bytes-as-input-of-the-library) are options, as a whole morph takes up to"
        " seconds",
    ),
    "sanitizers": (
        "address and undefined on all C++ tests; threads on loops and on whole morphs by every way,"
        " with progress and cancel, on the pool; leaks of whole morphs, also stopped and failing",
        NONE,
        NONE,
    ),
    "properties": (
        "finite numbers, exact ends, every point in a pair; no bit changes with threads, order and"
        " unit; earlier maps, saved morphs",
        "`properties.py`",
        NONE,
    ),
    "edge of numbers": (
        "sizes of 1e-30 to 1e30, density that varies 10,000-fold, lines, clumps, needles, few"
        " points",
        "`properties.py`",
        NONE,
    ),
    "stops": (
        "signals, also a second one, and what they leave; bakes in Blender of every format that are"
        " killed",
        "`stops.py`, `stopped_bakes.py`",
        NONE,
    ),
    "Blender": (
        "random walks: undo, redo, files, several scenes, linked and overridden objects, objects"
        " that change or go while they are read; with a window, undo, deletion, another file,"
        " another scene, disabling and quitting while it computes; walks over two windows that"
        " show two scenes, with what both draw and report, and the end of one of them while it"
        " computes",
        "`random_walks.py`",
        NONE,
    ),
    "memory": (
        "the [bounds](#memory) of each domain and of what is asked of a morph",
        "`memory.py`",
        NONE,
    ),
    "strangers' files": ("what [security](security.md) lists", "`damaged_files.py`", NONE),
    "confidence": (
        "[252 maps](stages/measures/local_confidence.md), each kind judged by what was fitted to"
        " the others, once",
        "`bench_confidence.py`: hands, birds, furniture, vehicles, vessels, made by script, and"
        " things with nothing in common",
        "scans of these",
    ),
    "earlier files": (
        "kept files of this version, which later ones must open: a saved morph, a batch, a .blend"
        " file; what earlier versions would have written, made by script",
        NONE,
        NONE,
    ),
}
"""What is tried in each run of the tests, in long runs, and not at all."""


def kinds() -> str:
    rows = "".join(f"| {kind} | {' | '.join(parts)} |\n" for kind, parts in KINDS.items())
    head = "| | in each run of the tests | in long runs | not tried |\n|---|---|---|---|\n"
    return f"\n## What is tried, and by what\n\n{head}{rows}"


def memory() -> str:
    """The bounds that test_memory.py holds."""
    rows = "".join(
        f"| {kind} | {megabytes} MB | {number(more)} bytes |\n"
        for kind, (megabytes, more) in BOUNDS.items()
    )
    return (
        "\n## Memory\n\nOn two threads, a morph takes at most this much memory besides what"
        " `import pointmorph` does:\nso much, and so much more for each point of both shapes. At"
        " most four fifths of it were measured,\nat 4,000, 16,000, 48,000 and 160,000 points.\n\n"
        f"| | | a point |\n|---|--:|--:|\n{rows}"
    )


ENDING = """
## What isn't tried

- Power failures: files are forced onto the disk before they get their names, but no power was cut.
- Network drives, which may know no locks: there, leftovers of a killed run may stay.
- Linux's out-of-memory killer can end any program; what it leaves is what `kill -9` leaves.
- Ctrl-C within the first moments, while Python still loads the modules, ends the run with Python's
  own traceback. Nothing was written by then.
- Less than about 200 MB of address space: there, the libraries that Python loads may not start, and
  scipy's OpenBLAS, where it is installed, tries forever.
- macOS: built, not run.
- Scripts that reload or remove other files in Blender without leaving a step to undo, as its own
  operators do: Blender 5.0 crashed in a later undo. Whether it would without the add-on wasn't
  tried.
"""

MENDED = {
    "Any bytes as input of the library": [
        "Previews that begin with the maps of other clouds read past their end",
        "Rigid paths missed their ends where the turns of what they follow cancel",
        "Frames and re-sampled frames without finite numbers: of saved morphs whose images lie far"
        " from the other model or nearly coincide, or whose pairs all lie in one place",
        "Re-sampling that took as many new points as fit between a few places far apart",
    ],
    "Damaged files of every format": [
        "PLY files with a name that no table can have, or with lines of different lengths",
        "OBJ files with less than three coordinates or with lines that go on and never end",
    ],
    "Properties of any morph": [
        "Patches without points inside, and faces that don't follow one another: both read past"
        " their arrays and could end the program",
    ],
    "Stopped at any moment": [
        "A signal at the very moment at which a file was begun left an empty part of it behind",
    ],
    "Random walks through Blender": [
        "Baking onto a mesh that a script had given other vertices than its shape keys",
        "Colors that had to be baked on a mesh with a vertex extremely far away",
    ],
}
"""What earlier runs found, by the title of a run. Each is a test."""


def number(value: float | str) -> str:
    return f"{value:,}" if isinstance(value, int) else str(value)


def time_of(report: dict) -> str:
    """What it took, in words; nothing where that isn't known."""
    if "processor_seconds" not in report:
        return ""
    minutes = max(round(report["processor_seconds"] / 60), 1)
    return f"{minutes} {'minute' if minutes == 1 else 'minutes'} of processor time, "


def section(report: dict) -> str:
    tried = "\n".join(f"| {what} | {number(count)} |" for what, count in report["tried"].items())
    found = report["finds"]
    result = "\n".join(f"- {find}" for find in found) if found else "Nothing broke."
    mended = "".join(f"- {what}\n" for what in MENDED.get(report["title"], []))
    if mended:
        mended = f"\nEarlier runs found, and these are mended:\n\n{mended}"
    return (
        f"\n### {report['title']}\n\n{report['date']}, {time_of(report)}"
        f"Python {report['python']}\n\n| tried | |\n|---|--:|\n{tried}\n\n{result}\n{mended}"
    )


def page() -> str:
    paths = sorted((HERE / "reliability").glob("*.json"))
    return (
        BEGINNING
        + kinds()
        + memory()
        + "\n## What was tried\n"
        + "".join(section(json.loads(path.read_text())) for path in paths)
        + ENDING
    )


if __name__ == "__main__":
    PAGE.write_text(page())
