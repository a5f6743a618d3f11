"""Where baked frames can go: an object for each format, which the panel, the operator and the
bake itself take all from.
"""

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import pointmorph

from . import attribute_names, versions


@dataclass(frozen=True)
class Content:
    """What a file of a format takes, of points or of meshes.

    Attributes
    ----------
    loses : str
        What it doesn't keep, in words.
    oldest : (int, int)
        The first Blender that can write it.
    as_vertices : bool
        Whether points are written as a mesh of bare vertices.
    id_name : str
        Name of the attribute for points' ids.
    byte_colors : bool
        Whether colors must be at the corners of faces, with 8 bits a channel.
    """

    loses: str
    oldest: tuple = (4, 2)
    as_vertices: bool = False
    id_name: str = "id"
    byte_colors: bool = False


@dataclass(frozen=True)
class FrameFormat:
    """A place for baked frames.

    Attributes
    ----------
    identifier, label, tip : str
        As the operator's option and the panel have them.
    in_files : bool
        Whether it asks for a folder.
    suffix : str
        Of the one file that Blender writes from the scene; empty where Blender doesn't.
    operator : str
        Of `bpy.ops.wm`, which writes that file.
    arguments : function
        Takes the first and the last frame; returns what the operator gets besides the path.
    points, faces : Content
    """

    identifier: str
    label: str
    tip: str
    in_files: bool = True
    suffix: str = ""
    operator: str = ""
    arguments: Callable = lambda first, last: {}
    points: Content = Content("")
    faces: Content = Content("")

    def content(self, faces):
        return self.faces if faces else self.points

    def losses(self, faces):
        """What a file doesn't keep, in words."""
        return f"{self.label} doesn't keep {self.content(faces).loses}"

    def check(self, faces):
        """Raises OptionError when this Blender can't write points, or meshes, that way."""
        oldest = self.content(faces).oldest
        if not versions.is_at_least(*oldest):
            raise pointmorph.OptionError(
                "Format",
                f"Blender {oldest[0]}.{oldest[1]} or later for {self.label}",
                versions.name(),
                "Bake PLY, or Alembic without colors.",
            )
        if self.operator and self.operator not in dir(bpy.ops.wm):
            raise pointmorph.OptionError(
                "Format",
                f"a Blender built with {self.label}",
                f"{versions.name()}, built without it",
                "Bake PLY.",
            )

    def write(self, path, first, last):
        """Has Blender write the selected object at all frames. Raises RuntimeError."""
        operator = getattr(bpy.ops.wm, self.operator)
        operator(filepath=str(path), **self.arguments(first, last))


SCENE = FrameFormat(
    "SCENE",
    "In the Scene",
    "An object that shows the baked frame of the current frame",
    in_files=False,
)
PLY = FrameFormat(
    "PLY", "PLY Files", "One file per frame with all attributes, including ID and velocity"
)
USD = FrameFormat(
    "USD",
    "USD",
    "One file with all attributes. Points need Blender 4.5 or later",
    suffix="usdc",
    operator="usd_export",
    arguments=lambda first, last: {"selected_objects_only": True, "export_animation": True},
    points=Content(
        f'the material, and stores the attribute id as "{attribute_names.FILE_ID}"',
        oldest=(4, 5),
        id_name=attribute_names.FILE_ID,
    ),
    faces=Content("custom names of the material's nodes"),
)
ALEMBIC = FrameFormat(
    "ALEMBIC",
    "Alembic",
    "One file with positions, as vertices, and velocity",
    suffix="abc",
    operator="alembic_export",
    arguments=lambda first, last: {
        "start": first,
        "end": last,
        "selected": True,
        "vcolors": True,
        "as_background_job": False,
    },
    points=Content("colors, normals, radii and IDs", as_vertices=True),
    faces=Content("the material, and stores colors with 8 bits per channel", byte_colors=True),
)

FORMATS = {one.identifier: one for one in (SCENE, PLY, USD, ALEMBIC)}
