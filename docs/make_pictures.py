"""Draws the pictures of the stage pages from made shapes, each in docs/images.

python docs/make_pictures.py            all of them, in about two minutes
python docs/make_pictures.py pose lod   these
"""

from __future__ import annotations

import argparse
from pathlib import Path

from stage_pictures import cloud, disk, frames, measures, mesh, morph, registration, sphere, surface
from stage_pictures.drawing import IMAGES, PICTURES, save

ROOMS = (cloud, mesh, surface, registration, disk, sphere, frames, measures, morph)
"""Importing them adds their pictures."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Draws the pictures of the stage pages.")
    parser.add_argument("stages", nargs="*", metavar="STAGE", help="all if none is named")
    parser.add_argument("--folder", type=Path, default=IMAGES)
    arguments = parser.parse_args()
    if unknown := set(arguments.stages) - set(PICTURES):
        parser.error(f"no picture of {', '.join(sorted(unknown))}; there are {', '.join(PICTURES)}")
    for stage in arguments.stages or PICTURES:
        path = arguments.folder / f"{stage}.png"
        save(PICTURES[stage](), path)
        print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
