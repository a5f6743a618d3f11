"""Which object shows the frames of a morph object, and where it stands.

A property of that object, its key `of`, says which morph object it belongs to. Duplicates have it,
too, so the morph object points at the one that the next bake goes to.
"""

import bpy
import numpy as np

_PLACED = "pointmorph_placed"


def found(scene, obj, of):
    """The object in a scene that the next bake of a morph object goes to, or None."""
    players = [one for one in scene.objects if one.library is None and one.get(of) == obj]
    chosen = obj.get(_back(of))
    return chosen if chosen in players else next(iter(players), None)


def belongs(player, obj, of):
    """Makes that object the one."""
    player[of] = obj
    if obj.is_editable:
        obj[_back(of)] = player


def place(player, matrix):
    """Puts an object where the morph object was, unless it was moved since it was put somewhere."""
    before = player.get(_PLACED)
    now = np.array(player.matrix_world).ravel()
    if before is None or np.allclose(now, np.array(before), rtol=1e-5, atol=1e-5):
        player.matrix_world = matrix
        player[_PLACED] = np.array(matrix).ravel().tolist()


def forget_deleted(of):
    """Lets go of objects that were taken out of all scenes, so that they don't stay in the file."""
    for obj in bpy.data.objects:
        player = obj.get(_back(of)) if obj.is_editable else None
        if player is not None and not player.users_collection:
            del obj[_back(of)]


def _back(of):
    return f"{of}_by"
