"""Two heads made in Blender, for systems that can't download Debian's models."""

from __future__ import annotations

from collections.abc import Iterable

import bmesh
import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Vector
from pointmorph.meshes import Shape, boundary_loops

Features = dict[str, tuple[int, int]]

# Outward normal of the cuts, down and to the back.
DOWN_AND_BACK = Vector((0.0, 0.7, -0.7))


def suzanne_and_bear() -> tuple[Shape, Shape, Features]:
    """Open patches, each with one boundary, and their features."""
    suzanne = _cut(_suzanne(), subdivisions=3, plane_point=Vector((0.0, 0.38, -0.2)))
    bear = _cut(_bear(), subdivisions=1, plane_point=Vector((0.0, 0.3, -0.75)))
    shapes = (Shape("Suzanne", *suzanne), Shape("Bear", *bear))
    rows = [_feature_rows(shape) for shape in shapes]
    return (*shapes, {name: (rows[0][name], rows[1][name]) for name in rows[0]})


def _suzanne() -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("Suzanne")
    head = bmesh.new()
    bmesh.ops.create_monkey(head)
    eyeballs = set(head.verts) - max(_islands(head.verts), key=len)
    bmesh.ops.delete(head, geom=list(eyeballs), context="VERTS")
    bmesh.ops.holes_fill(head, edges=head.edges[:])  # the sockets
    head.to_mesh(mesh)
    head.free()
    return mesh


def _bear() -> bpy.types.Mesh:
    balls = bpy.data.metaballs.new("Bear")
    balls.resolution = balls.render_resolution = 0.06
    head, neck, snout = ((0, 0, 0), 1.6, 2), ((0, 0.5, -0.9), 1.1, 2), ((0, -0.85, -0.25), 0.8, 2)
    ears = [((side * 0.75, 0.1, 0.8), 0.6, 6) for side in (-1, 1)]
    nose = ((0, -1.32, -0.08), 0.33, 6)
    for center, radius, stiffness in (head, neck, snout, *ears, nose):
        ball = balls.elements.new()
        ball.co, ball.radius, ball.stiffness = center, radius, stiffness
    holder = bpy.data.objects.new("Bear", balls)
    mesh = _evaluated(holder)
    bpy.data.metaballs.remove(balls)
    return mesh


def _evaluated(holder: bpy.types.Object) -> bpy.types.Mesh:
    """The evaluated object as a mesh; the object is removed."""
    bpy.context.scene.collection.objects.link(holder)
    graph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(holder.evaluated_get(graph))
    bpy.data.objects.remove(holder)
    return mesh


def _islands(vertices: Iterable[bmesh.types.BMVert]) -> list[set[bmesh.types.BMVert]]:
    islands, left = [], set(vertices)
    while left:
        front = [left.pop()]
        island = set(front)
        while front:
            reached = {v for edge in front.pop().link_edges for v in edge.verts} & left
            left -= reached
            island |= reached
            front.extend(reached)
        islands.append(island)
    return islands


def _cut(
    mesh: bpy.types.Mesh, subdivisions: int, plane_point: Vector
) -> tuple[npt.NDArray[np.float64], None, None, None, npt.NDArray[np.int64]]:
    """Subdivides a mesh and cuts it by a plane; positions and triangles in the order of Shape."""
    holder = bpy.data.objects.new(mesh.name, mesh)
    holder.modifiers.new("Subdivision", "SUBSURF").levels = subdivisions
    smooth = _evaluated(holder)
    bpy.data.meshes.remove(mesh)
    head = bmesh.new()
    head.from_mesh(smooth)
    bpy.data.meshes.remove(smooth)
    bmesh.ops.bisect_plane(
        head,
        geom=[*head.verts, *head.edges, *head.faces],
        plane_co=plane_point,
        plane_no=DOWN_AND_BACK,
        clear_outer=True,
    )
    bmesh.ops.triangulate(head, faces=head.faces[:])
    head.verts.index_update()
    positions = np.array([v.co for v in head.verts], np.float64)
    triangles = np.array([[v.index for v in face.verts] for face in head.faces], np.int64)
    head.free()
    return positions, None, None, None, triangles


def _feature_rows(shape: Shape) -> dict[str, int]:
    """Both heads look along -y and stand upright along z."""
    x, y, z = shape.positions.T
    rim = boundary_loops(shape.faces, len(x))[0]

    def highest(score: npt.NDArray[np.float64], where: npt.NDArray[np.bool_]) -> int:
        return int(np.argmax(np.where(where, score, -np.inf)))

    middle, front = np.abs(x) < 0.1, y < -0.4
    return {
        "nose": highest(-y, middle),
        "chin": highest(-y - 2 * z, middle & front),
        "crown": highest(z, middle),
        "ear.L": highest(x + 0.5 * z, x > 0),
        "ear.R": highest(-x + 0.5 * z, x < 0),
        "eye.L": highest(-((x - 0.36) ** 2) - (z - 0.25) ** 2, front),
        "eye.R": highest(-((x + 0.36) ** 2) - (z - 0.25) ** 2, front),
        "rim.front": int(rim[np.argmin(y[rim])]),
        "rim.back": int(rim[np.argmax(y[rim])]),
    }
