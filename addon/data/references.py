"""Objects and scenes remembered while a computation runs: by name they may be confused with those
of another file, and as Python objects they may be gone after undo."""


def reference_to(block):
    """What `find` needs; it survives renaming and undo, but not loading a file."""
    return block.session_uid


def find(blocks, reference):
    """The data-block among `blocks`, or None."""
    return next((block for block in blocks if block.session_uid == reference), None)
