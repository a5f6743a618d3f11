"""Data-blocks made together, or not at all, and where new objects go."""

from contextlib import contextmanager

import bpy


@contextmanager
def all_or_nothing():
    """Gives a function to call with every data-block made; removes them all after an error."""
    created = []
    try:
        yield created.append
    except BaseException:
        for item in created:
            if isinstance(item, bpy.types.Object):
                item.shape_key_clear()  # a data-block that isn't removed with the mesh
        bpy.data.batch_remove(created)
        raise


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
