"""Many morphs at once, here or on a farm."""
