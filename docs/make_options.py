"""Prints the page of settings from the library's table of options.

python docs/make_options.py > docs/options.md
"""

from __future__ import annotations

import pointmorph


def page() -> str:
    lines = [
        "# Settings",
        "",
        "These settings have the same names on the command line (`--influence 5`), in Python",
        "(`morph(…, influence=5)`) and in Blender (`scene.pointmorph.influence`). *automatic* is",
        "`None` in Python. `docs/make_options.py` writes this page.",
        "",
        "*Affects* is what has to be made again when a setting changes: the map (which points",
        "belong together, and everything after it), the path (every frame between the ends), or",
        "frames (resampled ones). *Method* is the method that uses a setting. Settings of method",
        "paper also count with method auto unless the domain is auto, since the refinement starts",
        "from that domain.",
        "",
        "| name | default | range | unit | affects | method | meaning |",
        "|---|---|---|---|---|---|---|",
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
        lines.append(
            f"| `{option.name}` | {default} | {span} | {option.unit} | {option.affects} "
            f"| {option.method or 'both'} | {option.help} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page(), end="")
