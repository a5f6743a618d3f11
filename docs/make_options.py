"""Prints the settings' page from the library's own table.

python docs/make_options.py > docs/options.md
"""

from __future__ import annotations

import pointmorph


def page() -> str:
    lines = [
        "# Settings",
        "",
        "The same on the command line (`--influence 5`), in Python (`morph(…, influence=5)`)",
        "and in Blender's panel. *automatic* is `None` in Python. This page is written by",
        "`docs/make_options.py`.",
        "",
        "| name | default | range | unit | what it does |",
        "|---|---|---|---|---|",
    ]
    for option in pointmorph.options():
        default = "automatic" if option.default is None else option.default
        if isinstance(default, float):
            default = f"{default:g}"
        span = (
            ", ".join(option.choices)
            if option.kind == "choice"
            else f"{option.minimum:g} to {option.maximum:g}"
        )
        lines.append(f"| `{option.name}` | {default} | {span} | {option.unit} | {option.help} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page(), end="")
