"""How the shapes of a morph object that follows them lie in each frame."""

import bpy
import numpy as np
from pointmorph.sequences import ShapeState

from ..core import transforms
from ..data import arrays
from . import morph_object, recipes, shape_follower


def read_steps(context, obj, numbers):
    """A generator that goes through frames of the scene, yields after each, and returns for each a
    `ShapeState` of every shape, in the object's own space as that is in the present frame.

    The scene is in its own frame again when it ends, however that comes.

    Raises
    ------
    CloudError
        When a shape is gone, or doesn't have the points that were morphed.
    """
    scene = context.scene
    name, was, part = scene.name, scene.frame_current, scene.frame_subframe
    transforms.check_invertible(obj.name, obj.matrix_world)
    into = np.linalg.inv(np.array(obj.matrix_world, dtype=np.float64))
    shapes = shape_follower.followed(obj, context)
    shape_follower.check_counts(obj, shapes, context)
    at_rest = [
        (arrays.by_row(row, arrays.read_vectors(obj.data, f"{stage}_normal")), matrix)
        for stage, row, matrix in zip(
            morph_object.stages(obj),
            morph_object.stage_rows(obj),
            _matrices_at_rest(obj, shapes),
            strict=True,
        )
    ]
    taken = []
    try:
        for number in numbers:
            scene.frame_set(number)
            depsgraph = context.evaluated_depsgraph_get()
            poses = [
                _pose(shape.evaluated_get(depsgraph), into, *rest)
                for shape, rest in zip(shapes, at_rest, strict=True)
            ]
            before = taken[-1] if taken else poses
            taken.append([_shared(*pair) for pair in zip(before, poses, strict=True)])
            yield
    finally:
        # By name: undo may have replaced it.
        scene = bpy.data.scenes.get(name)
        if scene is not None:
            scene.frame_set(was, subframe=part)
    return taken


def _matrices_at_rest(obj, shapes):
    """(3, 3) for every shape: how it was turned and scaled when it was morphed."""
    known = recipes.recipe_of(obj).get("shapes")
    if known is None:
        return [np.array(shape.matrix_world)[:3, :3] for shape in shapes]
    return [np.reshape(shape["matrix"], (4, 4))[:3, :3] for shape in known]


def _pose(shape, into, normals, at_rest):
    """An evaluated shape taken through a matrix. Only faces say where points face; without them
    the normals at rest turn along with the object."""
    matrix = into @ np.array(shape.matrix_world, dtype=np.float64)
    data = shape.data
    found = None
    if shape.type == "MESH":
        positions = arrays.vertex_positions(data)
        if data.polygons:
            found = arrays.mesh_normals(data)
    else:
        positions = arrays.cloud_positions(data)
    if found is None:
        since = np.eye(4)
        since[:3, :3] = matrix[:3, :3] @ np.linalg.inv(at_rest)
        found = transforms.move_normals(since, normals)
    else:
        found = transforms.move_normals(matrix, found)
    return ShapeState(transforms.move_positions(matrix, positions), found)


def _shared(before, pose):
    """What hasn't moved takes no more room."""
    return ShapeState(
        *(
            old if np.array_equal(old, new) else new
            for old, new in zip(vars(before).values(), vars(pose).values(), strict=True)
        )
    )
