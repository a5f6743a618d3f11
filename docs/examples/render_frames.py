"""Renders frames that ``pointmorph frames`` or ``pointmorph batch`` has made, in Blender.

    blender -b --python-exit-code 1 --python render_frames.py -- FRAMES OUT FIRST LAST

Renders the frames FIRST to LAST of the folder FRAMES to OUT/0000.png …: meshes, if there are some
beside the points (``--mesh``). Pictures that are there are kept, unless the frame, the options or
this script have changed since. Options after LAST: ``--width PIXELS``, ``--samples N``, ``--up y``,
``--every N`` (only frames whose number is a multiple of N).
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import math
import os
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector


def main(words: list[str]) -> None:
    chosen = read(words)
    scene = empty_scene(chosen.width, chosen.samples)
    material = colored_material()
    for number in range(chosen.first, chosen.last + 1):
        if number % chosen.every:
            continue
        picture, frame = chosen.out / f"{number:04d}.png", frame_file(chosen.frames, number)
        origin = origin_of(frame, [chosen.width, chosen.samples, chosen.up])
        if picture.exists() and origin.encode() in picture.read_bytes():
            continue
        scene.render.stamp_note_text = origin
        shape = imported(frame, chosen.up)
        if not shape.data.polygons:
            show_points(shape, material)
        shape.data.materials.clear()
        shape.data.materials.append(material)
        place_camera(scene, shape)
        # A picture gets its name once it is complete.
        part = picture.with_name(f".{number:04d}.part.png")
        scene.render.filepath = str(part)
        bpy.ops.render.render(write_still=True)
        os.replace(part, picture)
        bpy.data.objects.remove(shape)


def read(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="render_frames.py")
    parser.add_argument("frames", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--up", choices=["y", "z"], default="z")
    parser.add_argument("--every", type=int, default=1)
    return parser.parse_args(words)


def frame_file(folder: Path, number: int) -> Path:
    """The mesh of a frame, or its points."""
    mesh = folder / f"mesh_{number:04d}.ply"
    return mesh if mesh.exists() else folder / f"frame_{number:04d}.ply"


def origin_of(frame: Path, options: list[object]) -> str:
    """A checksum of all that a picture is made from; the picture has it as its note."""
    parts = (frame.read_bytes(), Path(__file__).read_bytes(), repr(options).encode())
    sums = b"".join(hashlib.sha256(part).digest() for part in parts)
    return hashlib.sha256(sums).hexdigest()


def empty_scene(width: int, samples: int) -> Any:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for name in dir(scene.render):  # what else Blender writes into a picture, the time for one
        if name.startswith("use_stamp"):
            setattr(scene.render, name, name == "use_stamp_note")
    scene.render.engine = "CYCLES"
    scene.cycles.samples = samples
    scene.render.resolution_x = scene.render.resolution_y = width
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("World")
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy = 2.0
    light.rotation_euler = (math.radians(40), 0.0, math.radians(30))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    for added in (light, camera):
        scene.collection.objects.link(added)
    scene.camera = camera
    return scene


def colored_material() -> Any:
    """Takes the color that the frame's vertices have."""
    material = bpy.data.materials.new("Frame")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    color = nodes.new("ShaderNodeAttribute")
    color.attribute_name = "Col"
    base = nodes["Principled BSDF"].inputs["Base Color"]
    material.node_tree.links.new(color.outputs["Color"], base)
    return material


def imported(path: Path, up: str) -> Any:
    forward = "NEGATIVE_Z" if up == "y" else "Y"
    bpy.ops.wm.ply_import(filepath=str(path), up_axis=up.upper(), forward_axis=forward)
    return bpy.context.object


def show_points(shape: Any, material: Any) -> None:
    """Lets points without faces be rendered, as large as the frame says."""
    tree = bpy.data.node_groups.new("Points", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    names = (
        "NodeGroupInput",
        "GeometryNodeMeshToPoints",
        "GeometryNodeSetMaterial",
        "NodeGroupOutput",
    )
    chain = [tree.nodes.new(name) for name in names]
    for before, after in itertools.pairwise(chain):
        tree.links.new(before.outputs[0], after.inputs[0])
    radius = tree.nodes.new("GeometryNodeInputNamedAttribute")
    radius.data_type = "FLOAT"
    radius.inputs["Name"].default_value = "radius"
    tree.links.new(radius.outputs["Attribute"], chain[1].inputs["Radius"])
    chain[2].inputs["Material"].default_value = material
    shape.modifiers.new("Points", "NODES").node_group = tree


def place_camera(scene: Any, shape: Any) -> None:
    """From the front, a little from above, with all of the shape in sight."""
    corners = [shape.matrix_world @ Vector(corner) for corner in shape.bound_box]
    center = sum(corners, Vector()) / len(corners)
    size = max((corner - center).length for corner in corners)
    direction = Vector((0.55, -1.0, 0.35)).normalized()
    camera = scene.camera
    camera.location = center + direction * size / math.sin(0.5 * camera.data.angle) * 1.05
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    camera.data.clip_end = 10.0 * size / math.sin(0.5 * camera.data.angle)
    camera.data.clip_start = 1e-4 * camera.data.clip_end


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :])
