"""Data-blocks made together, or not at all, what they are called, and where new objects go."""

from contextlib import contextmanager

import bpy


@contextmanager
def all_or_nothing():
    """Gives a function to call with every data-block made; removes all that are left of them after
    an error."""
    created = []
    try:
        yield created.append
    except BaseException:
        created = [item for item in created if _is_there(item)]
        for item in created:
            if isinstance(item, bpy.types.Object):
                item.shape_key_clear()  # a data-block that isn't removed with the mesh
        bpy.data.batch_remove(created)
        raise


def _is_there(item):
    """Whether a data-block wasn't removed meanwhile, as what is joined to another is."""
    try:
        return bool(item.name)
    except ReferenceError:
        return False


LONGEST_NAME = 63 - 4  # bytes, with room for what makes a name another


def ending_in(name, ending):
    """A name with an ending, which Blender would cut off where the name is long."""
    room = LONGEST_NAME - len(ending.encode())
    return name.encode()[:room].decode(errors="ignore") + ending


def copied(obj):
    """A copy of an object that is of this file alone, and no library override of another one's."""
    copy = obj.copy()
    if copy.override_library is not None:
        copy.make_local(clear_liboverride=True)
    return copy


def link(context, obj):
    """Puts a new object into the active collection, or into the scene's where that is linked."""
    collection = context.collection
    if not collection.is_editable or collection.override_library is not None:
        collection = context.scene.collection
    collection.objects.link(obj)
