"""Shape keys of a target, on a mesh that morphs into it or on the source: turned as the map turns
the surface."""

from dataclasses import dataclass

import numpy as np

from ..core import transforms
from ..data import arrays, nodes
from . import morph_builder

AT_END = " at the end"
"""After a key's name, of the second one that it takes."""
_SMALL = 1e-6  # of the size of a shape: what moves less doesn't move


@dataclass(frozen=True)
class Key:
    """A shape key: by how much it moves each vertex, and the range of its slider.

    `at_end`, of one that was carried, is what is added to that once the mesh is the target; None
    where that is the same, or not wanted.
    """

    name: str
    offsets: np.ndarray
    slider: tuple
    at_end: np.ndarray | None = None


def read(target, matrix, weights):
    """The keys of a target that move anything, in the morph's frame.

    Parameters
    ----------
    matrix : (4, 4) array
        To that frame.
    weights : dict of str to (rows, weights)
        Of the vertex groups that limit keys.
    """
    keys = target.data.shape_keys
    if keys is None:
        return []
    turn = np.eye(4)
    turn[:3, :3] = matrix[:3, :3]
    size = float(np.ptp(arrays.basis_positions(target.data), axis=0).max(initial=0.0))
    found = []
    for key in keys.key_blocks:
        if key == keys.reference_key or key.relative_key is None:
            continue
        offsets = arrays.key_positions(key) - arrays.key_positions(key.relative_key)
        if key.vertex_group in weights:
            rows, values = weights[key.vertex_group]
            share = np.zeros((len(offsets), 1), np.float32)
            share[rows, 0] = values
            offsets = share * offsets
        if np.abs(offsets).max(initial=0.0) > _SMALL * size:
            offsets = transforms.move_positions(turn, offsets)
            found.append(Key(key.name, offsets, (key.slider_min, key.slider_max)))
    return found


def limiting_groups(target):
    """By index, the names of the vertex groups that limit its shape keys."""
    keys = target.data.shape_keys
    wanted = {key.vertex_group for key in keys.key_blocks} if keys is not None else ()
    return {group.index: group.name for group in target.vertex_groups if group.name in wanted}


def carried(key, carrier, own, ends_as_target):
    """A key along the map, in the own space of the mesh that gets it.

    Parameters
    ----------
    key : Key
    carrier : pointmorph.Carrier
    own : (4, 4) array
        From the morph's frame to that space.
    ends_as_target : bool
        Whether the mesh morphs, so that the key must move it as the target at the end.
    """
    turn = own[:3, :3].T
    offsets = carrier.displacements(key.offsets) @ turn
    at_end = None
    if ends_as_target:
        at_end = carrier.values(key.offsets) @ turn - offsets
        if np.abs(at_end).max() <= 1e-4 * max(float(np.abs(offsets).max()), 1e-30):
            at_end = None
    return Key(key.name, offsets, key.slider, at_end)


def write(obj, name, key, t):
    """Gives an object the shape key `name`, in place of one of that name.

    Parameters
    ----------
    t : (ShapeKey, int) or None
        Whose value says how far the object is on its way to the target, and what it is there; None
        where `key` has no `at_end`.

    Returns
    -------
    list of str
        Names of the keys that this took.
    """
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    block = _put(obj, name, key.offsets)
    _give_range(block, *key.slider)
    end_name = name + AT_END
    if key.at_end is None:
        old = obj.data.shape_keys.key_blocks.get(end_name)
        if old is not None:
            obj.shape_key_remove(old)
        return [name]
    end = _put(obj, end_name, key.at_end)
    # Its value is a share of the first one's, which begins at 0.
    _give_range(end, min(key.slider[0], 0.0), max(key.slider[1], 0.0))
    end.driver_remove("value")
    driver = end.driver_add("value").driver
    driver.type = "SCRIPTED"
    slider, last = t
    nodes.drive(driver, slider)
    variable = driver.variables.new()
    variable.name = "value"
    variable.type = "SINGLE_PROP"
    variable.targets[0].id_type = "KEY"
    variable.targets[0].id = obj.data.shape_keys
    variable.targets[0].data_path = block.path_from_id("value")
    # Simple enough for Blender to compute without Python, also where scripts may not run.
    driver.expression = f"value * t / {last}"
    return [name, end_name]


def _give_range(block, low, high):
    block.slider_min = -10.0  # the least that there is, since no end can pass the other
    block.slider_max, block.slider_min = high, low


def _put(obj, name, offsets):
    keys = obj.data.shape_keys
    block = keys.key_blocks.get(name)
    if block is None:
        block = morph_builder.new_key(obj, name)
    block.relative_key = keys.reference_key
    base = arrays.key_positions(keys.reference_key)
    arrays.write_key(block, base + offsets)
    return block
