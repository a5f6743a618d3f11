"""Objects remembered while a computation runs: by name they may be confused with those of another
file, and as Python objects they may be gone after undo."""


def reference_to(obj):
    """What `find` needs; it survives renaming and undo, but not loading a file."""
    return obj.session_uid


def find(objects, reference):
    """The object among `objects`, or None."""
    return next((obj for obj in objects if obj.session_uid == reference), None)
