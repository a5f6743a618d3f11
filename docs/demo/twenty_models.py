"""One template onto twenty models: `pointmorph batch`, and a sheet of what came of it.

    python docs/demo/twenty_models.py [--out FOLDER] [--width PIXELS] [--samples N]

Makes a four-legged template of quads and twenty animals, each with other proportions and a mesh of
its own, wraps the template onto each, without a mark, and renders docs/images/template_onto_20.png:
beside each model the template on it, in the template's own colors and with its edges. It needs what
`build_addon.py setup` installs.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt
import pointmorph
import studio
from mathutils import Matrix, Vector
from PIL import Image
from pointmorph import formats
from pointmorph.batch.jobs import PairJob, read_batch

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "images" / "template_onto_20.png"
CACHE = ROOT / "build" / "demo" / "template_onto_20"
COLUMNS, ASPECT, AZIMUTH = 3, 2.1, math.radians(52.0)
APART = 1.0
"""From a model to the template on it, in their widths."""
GRAY = (0.4, 0.4, 0.4)
BODY, HEAD, EAR = (0.62, 0.42, 0.22), (0.65, 0.12, 0.08), (0.8, 0.6, 0.1)
COLORS = {
    "back": BODY, "chest": (0.75, 0.58, 0.38), "neck": (0.8, 0.3, 0.12), "head": HEAD,
    "muzzle": (0.35, 0.05, 0.05), "tail": (0.3, 0.12, 0.45), "ear -1": EAR, "ear 1": EAR,
    "hind -1": (0.05, 0.3, 0.1), "hind 1": (0.25, 0.5, 0.1), "fore -1": (0.03, 0.12, 0.45),
    "fore 1": (0.08, 0.35, 0.6),
}  # fmt: skip

FloatArray = npt.NDArray[np.floating]
Faces = list[list[int]]


@dataclass(frozen=True)
class Animal:
    """Proportions, in lengths of the body; angles in degrees."""

    name: str
    leg: float
    thick: float
    """Radius of the legs."""
    belly: float
    chest: float
    neck: float
    rise: float
    """By which the neck rises."""
    head: float
    muzzle: float
    ear: float
    tail: float
    droop: float
    """By which the tail hangs down."""


# The first is the template.
PROPORTIONS = """
name       leg   thick  belly  chest  neck  rise  head  muzzle  ear   tail  droop
Template   0.75  0.085  0.24   0.27   0.35  40    0.20  0.30    0.18  0.60   30
Hound      0.85  0.080  0.19   0.26   0.36  42    0.19  0.42    0.20  0.60   10
Dachshund  0.36  0.075  0.19   0.20   0.24  40    0.19  0.36    0.22  0.55   20
Giraffe    1.25  0.085  0.25   0.29   1.15  66    0.15  0.30    0.13  0.50   65
Bear       0.60  0.140  0.36   0.36   0.28  30    0.25  0.28    0.14  0.22   50
Mouse      0.30  0.060  0.30   0.24   0.20  20    0.20  0.26    0.28  1.00   14
Horse      1.00  0.085  0.26   0.29   0.62  52    0.17  0.42    0.15  0.65   62
Pig        0.42  0.090  0.37   0.35   0.22  10    0.24  0.28    0.18  0.28   20
Cow        0.72  0.090  0.36   0.33   0.34  22    0.21  0.34    0.17  0.65   72
Fox        0.62  0.060  0.18   0.20   0.30  36    0.18  0.36    0.22  0.95    8
Crocodile  0.28  0.080  0.24   0.22   0.20   4    0.18  0.70    0.10  1.30   12
Sheep      0.50  0.065  0.38   0.37   0.30  34    0.19  0.24    0.15  0.24   45
Camel      1.00  0.080  0.30   0.30   0.75  44    0.17  0.34    0.13  0.45   70
Elephant   0.80  0.160  0.42   0.40   0.24  20    0.30  0.62    0.36  0.50   75
Rabbit     0.38  0.080  0.33   0.25   0.22  46    0.20  0.22    0.42  0.20   10
Deer       1.05  0.060  0.22   0.25   0.58  60    0.16  0.28    0.20  0.24   30
Lizard     0.30  0.065  0.20   0.18   0.20  12    0.16  0.28    0.10  1.50   10
Hippo      0.40  0.130  0.43   0.40   0.24   8    0.30  0.44    0.12  0.30   55
Cat        0.55  0.065  0.19   0.19   0.26  44    0.21  0.18    0.18  0.90  -35
Wolf       0.82  0.085  0.22   0.30   0.34  24    0.20  0.38    0.19  0.62   52
Calf       0.95  0.075  0.24   0.25   0.30  34    0.23  0.28    0.19  0.55   74
"""


def animals() -> list[Animal]:
    _, *rows = PROPORTIONS.split("\n")[1:-1]
    return [Animal(name, *map(float, numbers)) for name, *numbers in map(str.split, rows)]


Bone = tuple[str, Vector, Vector, float, float]


def bones(animal: Animal) -> Iterator[Bone]:
    """Name, both ends and the radii there; the animal looks along -y and stands on z = 0."""
    hip, withers = Vector((0, 0.5, animal.leg)), Vector((0, -0.5, animal.leg + 0.03))
    middle = (hip + withers) / 2 - Vector((0, 0, 0.02))
    yield "back", hip, middle, animal.belly * 0.85, animal.belly
    yield "chest", middle, withers, animal.belly, animal.chest
    rise = math.radians(animal.rise)
    along = Vector((0, -math.cos(rise), math.sin(rise)))
    throat = withers + 0.6 * animal.chest * along
    nape = throat + animal.neck * along
    yield "neck", throat, nape, 0.62 * animal.chest, 0.72 * animal.head
    down = Vector((0, -1, -0.25)).normalized()
    brow = nape + 0.35 * animal.head * along
    yield "head", nape, brow, 0.8 * animal.head, animal.head
    nose = brow + (0.6 * animal.head + animal.muzzle) * down
    yield "muzzle", brow, nose, 0.8 * animal.head, 0.42 * animal.head
    for side in (-1, 1):
        root = brow + Vector((side * 0.62 * animal.head, 0.25 * animal.head, 0.55 * animal.head))
        tip = root + animal.ear * Vector((side * 0.45, 0.25, 1.0)).normalized()
        yield f"ear {side}", root, tip, 0.3 * animal.head, 0.16 * animal.head
        for name, top, width in (("hind", hip, animal.belly), ("fore", withers, animal.chest)):
            out = side * max(0.62 * width, 1.25 * animal.thick)
            shoulder = top + Vector((out, 0, -0.25 * width))
            foot = Vector((out, top.y, animal.thick))
            knee = (shoulder + foot) / 2 + Vector((0, 0.05 if name == "hind" else -0.03, 0))
            yield f"{name} {side}", shoulder, knee, 1.55 * animal.thick, 1.1 * animal.thick
            yield f"{name} {side}", knee, foot, 1.1 * animal.thick, animal.thick
            toe = foot + Vector((0, -1.2 * animal.thick, -0.15 * animal.thick))
            yield f"{name} {side}", foot, toe, animal.thick, 0.8 * animal.thick
    angle = math.radians(animal.droop)
    root = hip + Vector((0, 0.55 * animal.belly, 0.35 * animal.belly))
    tip = root + animal.tail * Vector((0, math.cos(angle), -math.sin(angle)))
    tip.z = max(tip.z, 0.09)
    yield "tail", root, tip, 0.3 * animal.belly, 0.055


def modeled(animal: Animal, voxel: float, turn: float) -> bpy.types.Object:
    """A closed mesh of the animal. Its quads follow the axes of a grid that is turned by `turn`."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=1.0)
    ball = bpy.context.object.data
    around, corners = positions_of(ball), np.array([face.vertices[:] for face in ball.polygons])
    bpy.data.objects.remove(bpy.context.object)
    places, faces = [], []
    for _, start, end, first, last in bones(animal):
        count = max(2, math.ceil((end - start).length / (0.25 * min(first, last))))
        for share in np.linspace(0, 1, count):
            faces += (corners + len(around) * len(places)).tolist()
            places.append(
                np.array(start.lerp(end, share)) + around * (first + share * (last - first))
            )
    mesh = bpy.data.meshes.new(animal.name)
    mesh.from_pydata(np.concatenate(places).tolist(), [], faces)
    obj = bpy.data.objects.new(animal.name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    turned = Matrix.Rotation(turn, 4, "Z") @ Matrix.Rotation(0.7 * turn, 4, "X")
    mesh.transform(turned)
    remesh = obj.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", voxel
    smooth = obj.modifiers.new("Smooth", "SMOOTH")
    smooth.factor, smooth.iterations = 0.5, 6
    graph = bpy.context.evaluated_depsgraph_get()
    made = bpy.data.meshes.new_from_object(obj.evaluated_get(graph))
    made.transform(turned.inverted())
    obj.modifiers.clear()
    obj.data = made
    return obj


def positions_of(mesh: bpy.types.Mesh) -> FloatArray:
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", places)
    return places.reshape(-1, 3)


def write_obj(path: Path, mesh: bpy.types.Mesh) -> None:
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in positions_of(mesh)]
    lines += ["f " + " ".join(str(k + 1) for k in face.vertices) + "\n" for face in mesh.polygons]
    path.write_text("".join(lines))


def make_models(folder: Path) -> None:
    """The template and the models as files, and the file of jobs."""
    (folder / "models").mkdir(parents=True, exist_ok=True)
    for number, animal in enumerate(animals()):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        voxel = 0.04 if number == 0 else 0.03 + 0.001 * (number % 9)
        obj = modeled(animal, voxel, turn=0.4 * number)
        place = "template.obj" if number == 0 else f"models/{number:02d}_{animal.name.lower()}.obj"
        write_obj(folder / place, obj.data)
        print(f"{animal.name}: {len(obj.data.vertices)} vertices", flush=True)
    jobs = {"template": {"source": "template.obj", "targets": "models/*.obj"}, "out": "morphed"}
    (folder / "jobs.json").write_text(json.dumps(jobs, indent=1) + "\n")


# --- The sheet ------------------------------------------------------------------------------------


def painted(template: FloatArray) -> FloatArray:
    """(N, 4) colors of the template's vertices: of the bone that is nearest, by its radius."""
    least, colors = np.full(len(template), np.inf), np.ones((len(template), 4), np.float32)
    for name, start, end, first, last in bones(animals()[0]):
        along = np.array(end - start)
        share = np.clip((template - start) @ along / (along @ along), 0, 1)
        away = np.linalg.norm(template - (np.array(start) + share[:, None] * along), axis=1)
        away /= first + share * (last - first)
        near = away < least
        least[near], colors[near, :3] = away[near], COLORS[name]
    return colors


def shown(name: str, positions: FloatArray, faces: Faces, colors: FloatArray) -> bpy.types.Object:
    """A mesh that is drawn in its colors; smooth."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions.tolist(), [], faces)
    mesh.color_attributes.new("Color", "FLOAT_COLOR", "POINT")
    mesh.color_attributes["Color"].data.foreach_set("color", colors.ravel())
    mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    color = nodes.new("ShaderNodeVertexColor")
    color.layer_name = "Color"
    surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Roughness"].default_value = 0.75
    material.node_tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def draw_edges(obj: bpy.types.Object) -> None:
    """Lets the edges of a mesh be seen."""
    ink = bpy.data.materials.new("Ink")
    ink.use_nodes = True
    surface = next(node for node in ink.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (0.01, 0.01, 0.012, 1.0)
    obj.data.materials.append(ink)
    wire = obj.modifiers.new("Edges", "WIREFRAME")
    wire.thickness, wire.use_replace, wire.material_offset = 0.006, False, 1
    wire.use_even_offset = False


def photograph(job: PairJob, wrapped: FloatArray, exposure: studio.Exposure, path: Path) -> None:
    """The target of a job, and beside it the template with its vertices at `wrapped`."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    model, template = formats.read(job.target), formats.read(job.source)
    gray = np.tile(np.float32([*GRAY, 1]), (len(model.positions), 1))
    right = np.array([math.cos(AZIMUTH), math.sin(AZIMUTH), 0])
    aside = np.ptp(model.positions @ right) * APART / 2 * right
    colors = painted(template.positions)
    pair = [
        shown("Model", model.positions - aside, polygons(job.target), gray),
        shown("Template", wrapped + aside, polygons(job.source), colors),
    ]
    draw_edges(pair[1])
    scene = bpy.context.scene
    aspect = exposure.size[0] / exposure.size[1]
    studio.set_up(scene, [positions_of(obj.data) for obj in pair], aspect, AZIMUTH)
    studio.develop(scene, exposure)
    studio.photograph(scene, path)


def polygons(path: Path) -> Faces:
    """The faces of a file that `write_obj` wrote; readers of the library make triangles of them."""
    lines = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("f ")]
    return [[int(corner) - 1 for corner in line] for line in lines]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=CACHE, help="folder for models and morphs")
    parser.add_argument("--width", type=int, default=1500, help="of the picture, in pixels")
    parser.add_argument("--samples", type=int, default=24)
    options = parser.parse_args()
    make_models(options.out)
    path = options.out / "jobs.json"
    subprocess.run([sys.executable, "-m", "pointmorph", "batch", str(path)], check=True)
    width = options.width // COLUMNS
    exposure = studio.Exposure((width, round(width / ASPECT)), options.samples)
    folder = options.out / "pictures"
    folder.mkdir(exist_ok=True)
    jobs = read_batch(path).jobs
    itself = dataclasses.replace(jobs[0], target=jobs[0].source)
    pictures = [folder / "template.png", *(folder / f"{job.name}.png" for job in jobs)]
    photograph(itself, formats.read(itself.source).positions, exposure, pictures[0])
    for job, picture in zip(jobs, pictures[1:], strict=True):
        photograph(job, pointmorph.open_morph(job.morph_file).wrapped(1.0), exposure, picture)
    names = [animal.name for animal in animals()]
    studio.contact_sheet(pictures, names, PICTURE, COLUMNS)
    sheet = Image.open(PICTURE).quantize(256, kmeans=8, dither=Image.Dither.NONE)
    sheet.save(PICTURE, optimize=True)  # with fewer colors, a third of the size


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # Blender as a Python module doesn't always survive its own end
