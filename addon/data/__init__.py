"""Blender's data blocks and properties, without a thought of morph objects."""
