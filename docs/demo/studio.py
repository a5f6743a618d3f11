"""A photo studio in Blender: camera, lights and backdrop; pictures, contact sheets and films."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix, Vector
from PIL import Image, ImageDraw, ImageFont

FloatArray = npt.NDArray[np.floating]

# The models look along -y and stand along z.
ELEVATION = math.radians(7.0)
LENS, SENSOR = 85.0, 36.0
MARGIN = 1.08
LABEL_SHARE = 0.1
"""Share of the picture's height kept free for a caption at the bottom."""
FRAME_TIME, REST_TIME = 60, 900
"""Milliseconds for which the film shows a frame, and its first and last frame."""

# Direction from the model (x to the right of the view, y away from the camera), watts per squared
# unit of the model's size, size, color.
LIGHTS = {
    "Key": ((-1.9, -2.2, 2.2), 180.0, 1.2, (1.0, 0.95, 0.88)),
    "Fill": ((2.6, -1.8, 0.4), 45.0, 2.4, (0.82, 0.9, 1.0)),
    "Rim": ((1.4, 2.4, 2.0), 220.0, 1.2, (1.0, 1.0, 1.0)),
}
BACKDROP = ((0.40, 0.41, 0.43), (0.62, 0.635, 0.65))
"""Linear colors at the bottom and the top of the picture."""


@dataclass(frozen=True)
class Exposure:
    """Size and quality of a picture."""

    size: tuple[int, int]
    """Width and height in pixels."""
    samples: int
    fast_denoising: bool = False


def set_up(
    scene: bpy.types.Scene, points: Sequence[FloatArray], aspect: float, azimuth: float
) -> None:
    """Adds a camera, three lights and a backdrop that suit all the clouds, in world space.

    Parameters
    ----------
    azimuth : float
        Radians from the front to the models' left: where the camera stands.
    """
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    center, size = (low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0
    _add_camera(scene, everything, center, aspect, azimuth)
    turn = Matrix.Rotation(azimuth, 3, "Z")
    for name, (place, power, extent, color) in LIGHTS.items():
        light = bpy.data.lights.new(name, "AREA")
        light.energy, light.size, light.color = power * size**2, extent * size, color
        lamp = bpy.data.objects.new(name, light)
        lamp.location = Vector(center) + (turn @ Vector(place)) * size
        lamp.rotation_euler = (-(turn @ Vector(place))).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
    scene.world = _backdrop()


def _add_camera(
    scene: bpy.types.Scene,
    points: FloatArray,
    center: FloatArray,
    aspect: float,
    azimuth: float,
) -> None:
    """Adds a camera just far enough away to have all points in the picture."""
    backward = np.array(
        [
            math.sin(azimuth) * math.cos(ELEVATION),
            -math.cos(azimuth) * math.cos(ELEVATION),
            math.sin(ELEVATION),
        ]
    )
    right = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    axes = np.stack([right, np.cross(backward, right), backward])
    seen = (points - center) @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    seen -= middle
    # The sensor spans the longer side of the picture.
    half_width = SENSOR / LENS / 2.0 * min(1.0, aspect)
    half_height = SENSOR / LENS / 2.0 * min(1.0, 1.0 / aspect)
    half_height *= 1.0 - LABEL_SHARE
    reach = np.maximum(np.abs(seen[:, 0]) / half_width, np.abs(seen[:, 1]) / half_height)
    distance = float((seen[:, 2] + MARGIN * reach).max())

    camera = bpy.data.cameras.new("Camera")
    camera.lens, camera.sensor_width = LENS, SENSOR
    camera.clip_start, camera.clip_end = distance / 100.0, distance * 10.0
    camera.shift_y = -LABEL_SHARE / 2.0 * min(1.0, 1.0 / aspect)
    holder = bpy.data.objects.new("Camera", camera)
    holder.matrix_world = (
        Matrix.Translation(Vector(center + (middle + np.array([0.0, 0.0, distance])) @ axes))
        @ Matrix(axes.T.tolist()).to_4x4()
    )
    scene.collection.objects.link(holder)
    scene.camera = holder


def _backdrop() -> bpy.types.World:
    """A soft vertical gradient for the camera, even light for the model."""
    world = bpy.data.worlds.new("Backdrop")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    light, backdrop = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeBackground")
    light.inputs["Color"].default_value = (0.8, 0.85, 0.9, 1.0)
    light.inputs["Strength"].default_value = 0.35
    place, split = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeSeparateXYZ")
    ramp, ray = nodes.new("ShaderNodeValToRGB"), nodes.new("ShaderNodeLightPath")
    choice, output = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeOutputWorld")
    for element, color in zip(ramp.color_ramp.elements, BACKDROP, strict=True):
        element.color = (*color, 1.0)
    links.new(place.outputs["Window"], split.inputs[0])
    links.new(split.outputs["Y"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], backdrop.inputs["Color"])
    links.new(ray.outputs["Is Camera Ray"], choice.inputs[0])
    links.new(light.outputs[0], choice.inputs[1])
    links.new(backdrop.outputs[0], choice.inputs[2])
    links.new(choice.outputs[0], output.inputs["Surface"])
    return world


def develop(scene: bpy.types.Scene, exposure: Exposure) -> None:
    """Sets up Cycles on the CPU, with few samples and a denoiser."""
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = exposure.size
    render.image_settings.file_format = "PNG"
    scene.cycles.device = "CPU"
    scene.cycles.samples = exposure.samples
    scene.cycles.max_bounces = 3
    scene.cycles.transparent_max_bounces = 32  # back faces that a ray passes
    scene.cycles.use_denoising = True
    fast = exposure.fast_denoising
    scene.cycles.denoising_prefilter = "FAST" if fast else "ACCURATE"
    scene.cycles.denoising_quality = "FAST" if fast else "HIGH"
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"


def photograph(scene: bpy.types.Scene, path: Path) -> None:
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)


def contact_sheet(
    pictures: Sequence[Path], captions: Sequence[str], path: Path, columns: int | None = None
) -> None:
    """The pictures side by side, so many in a row, each with a caption at the bottom."""
    opened = [Image.open(picture).convert("RGB") for picture in pictures]
    width, height = opened[0].size
    font = ImageFont.load_default(size=0.42 * LABEL_SHARE * height)
    columns = columns or len(opened)
    sheet = Image.new("RGB", (width * columns, height * -(-len(opened) // columns)))
    pen = ImageDraw.Draw(sheet)
    for number, (picture, caption) in enumerate(zip(opened, captions, strict=True)):
        row, column = divmod(number, columns)
        sheet.paste(picture, (column * width, row * height))
        place = ((column + 0.5) * width, (row + 1.0 - 0.55 * LABEL_SHARE) * height)
        pen.text(place, caption, font=font, fill=(45, 46, 50), anchor="mm")
    sheet.save(path, optimize=True)


def film(pictures: Sequence[Path], path: Path) -> None:
    """A GIF that loops forward and backward, with a pause at both ends."""
    there = [Image.open(picture).convert("RGB") for picture in pictures]
    # One palette for all frames, so that colors don't flicker.
    ends = Image.new("RGB", (there[0].width * 3, there[0].height))
    for column, picture in enumerate((there[0], there[len(there) // 2], there[-1])):
        ends.paste(picture, (column * picture.width, 0))
    palette = ends.quantize(256, Image.Quantize.MEDIANCUT)
    there = [picture.quantize(palette=palette) for picture in there]
    frames = [*there, *there[-2:0:-1]]
    durations = [FRAME_TIME] * len(frames)
    durations[0] = durations[len(there) - 1] = REST_TIME
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0)
