"""The report of a long run: what was tried, how much of it, and what was found."""

from __future__ import annotations

import datetime
import json
import os
import platform
from dataclasses import dataclass, field
from pathlib import Path


def processor_seconds() -> float:
    """Of this process and of those that it has waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@dataclass
class Report:
    """What docs/make_reliability.py makes a row of."""

    title: str
    tried: dict[str, int | float | str] = field(default_factory=dict)
    finds: list[str] = field(default_factory=list)
    began: float = field(default_factory=processor_seconds)

    def end(self, path: Path | None) -> int:
        """Writes it, where a path is given, and prints it; the exit status."""
        content = {
            "title": self.title,
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "python": platform.python_version(),
            "processor_seconds": round(processor_seconds() - self.began),
            "tried": self.tried,
            "finds": self.finds,
        }
        text = json.dumps(content, indent=1) + "\n"
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        print(text, end="")
        return 1 if self.finds else 0
