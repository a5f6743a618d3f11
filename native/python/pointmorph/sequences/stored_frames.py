"""The frames of a stored morph in a folder, and the meshes beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pointmorph import formats
from pointmorph.base.errors import FileError, OptionError
from pointmorph.morphs.stored_morphs import StoredMorph
from pointmorph.sequences.frame_sequences import FrameRun, FrameSequence, MeshWriter
from pointmorph.sequences.own_meshes import OwnMeshWriter
from pointmorph.sequences.source_meshes import SourceMesh
from pointmorph.shapes.clouds import SIDES
from pointmorph.storage import files
from pointmorph.storage.frame_records import file_checksum


def missing_frames(
    morph: StoredMorph,
    folder: Path,
    times: Sequence[float],
    resample: bool,
    mesh: str | None,
    which: Sequence[int],
) -> list[int]:
    """Which of these frames of a run of the command aren't in the folder, or are broken.

    Raises
    ------
    OptionError, FileError
        As the command itself: if the morph can't have these meshes, for instance.
    """
    sequence = FrameSequence(morph, times, resample=resample)
    run = FrameRun(sequence, folder, mesh_writer(mesh, None, morph, sequence))
    return run.missing(which)


def mesh_writer(
    side: str | None, model: Path | None, morph: StoredMorph, sequence: FrameSequence
) -> str | MeshWriter | None:
    """What writes the mesh beside each frame. Raises OptionError."""
    if side not in SIDES:
        return side
    if not (morph.has_mesh if side == "source" else morph.has_target_mesh):
        raise OptionError(
            "mesh",
            f"a morph whose {side} has faces, with method auto and without --samples",
            "one without",
            f"Leave out --mesh, or choose a mesh format instead of {side}.",
        )
    mesh = SourceMesh(*_model(model, side, morph))
    return OwnMeshWriter(morph, mesh, side, sequence.times)


def _model(given: Path | None, side: str, morph: StoredMorph) -> tuple[Path, formats.Shape]:
    """The model's own file: the very one that was morphed. Raises FileError, OptionError."""
    origin = morph.header["origin"].get(side)
    known = isinstance(origin, dict) and {"path", "sha256"} <= set(origin)
    path = given if given is not None else Path(origin["path"]) if known else None
    if path is None or not files.reachable(path).is_file():
        found = "no such file" if path is None else f"nothing at {path}"
        raise OptionError(
            side, f"the file of the {side}, for its mesh", found, f"Add --{side} FILE."
        )
    if known and file_checksum(path) != origin["sha256"]:
        raise FileError(
            str(path),
            "the file that was morphed",
            "one that has changed since",
            "Morph again, or restore the file.",
        )
    shape = formats.read(path)
    cloud = morph.source if side == "source" else morph.target
    if len(shape.positions) != len(cloud) or shape.faces is None:
        raise FileError(
            str(path),
            f"the {len(cloud)} vertices and the faces that were morphed",
            f"{len(shape.positions)} vertices",
            "Give the file that was morphed.",
        )
    return path, shape
