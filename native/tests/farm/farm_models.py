"""A small batch for engines that run jobs."""

from __future__ import annotations

import json
from pathlib import Path

from test_stored_commands import write_obj

FRAMES = 300
TRIES = 5
"""To end a task in the middle."""


def write_models(folder: Path, **content: object) -> Path:
    """A file of jobs with two pairs: one that can be morphed, and one with a damaged model."""
    write_obj(folder / "a.obj", 9, 0.0)
    write_obj(folder / "b.obj", 7, 0.6)
    (folder / "c.obj").write_text("v 0 0\n")
    jobs = {
        "template": {"source": "a.obj", "targets": ["b.obj", "c.obj"]},
        "frames": FRAMES, "settings": {"method": "paper"}, **content,
    }  # fmt: skip
    path = folder / "jobs.json"
    path.write_text(json.dumps(jobs))
    return path


def frames_of(out: Path) -> list[Path]:
    return sorted((out / "a_to_b" / "frames").glob("frame_*.ply"))


def same_frames(out: Path, other: Path) -> bool:
    """Whether all frames are there, with the same bits in both folders."""
    ours, theirs = frames_of(out), frames_of(other)
    return len(ours) == len(theirs) > 1 and all(
        a.name == b.name and a.read_bytes() == b.read_bytes()
        for a, b in zip(ours, theirs, strict=True)
    )
