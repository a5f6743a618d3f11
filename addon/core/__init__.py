"""What needs no Blender: plain arrays in, plain arrays out."""
