"""A morph of two clouds, and all that can be asked of it."""
